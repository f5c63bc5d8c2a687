"""One stroke of a tool of the mouse: where the hand is, and what it does."""

from typing import Any

import numpy as np

from taichi_sand.run.simulation import Simulation
from taichi_sand.world import edit
from taichi_sand.world.extras import hand


class Stroke:
    """One stroke of a tool, from press to release."""

    def __init__(self, session: Any, tool: Any) -> None:
        self.session, self.tool = session, tool
        self.x = self.y = 0.0
        self.vx = self.vy = 0.0
        self.phase = "press"
        self.path: list[np.ndarray] = []  # of the hand, for tools that draw [m]

    def move(self, phase: str, x: float, y: float, vx: float, vy: float) -> None:
        """The hand is at (x, y) [m] and moves [m/s]; once a frame, even if it stands still."""
        self.phase, self.x, self.y, self.vx, self.vy = phase, x, y, vx, vy
        self.tool.work(self)

    def let_go(self) -> None:
        """The hand acts no more."""
        self.hand(work=hand.IDLE)

    def end(self) -> None:
        """The button was let go, or another tool chosen."""
        self.let_go()
        if self.tool.finish:
            self.tool.finish(self)

    @property
    def sim(self) -> Simulation:
        """What it acts on."""
        return self.session.sim

    @property
    def place(self) -> np.ndarray:
        """Where the hand is [m]."""
        return np.array([self.x, self.y])

    def hand(self, **values: Any) -> None:
        """What the kernels see of the hand."""
        now = self.sim.hand.now
        if values.get("work") == hand.IDLE:
            now[None].work = hand.IDLE
            return
        now[None] = {**hand.REST, "place": (self.x, self.y), "velocity": (self.vx, self.vy), **values}

    def under(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slots under the brush; and of all grains x, y, radius, and id, kind, whether fixed."""
        places, whole = edit.places(self.sim.world)
        near = np.hypot(*(places[:, :2] - self.place).T) < self.session.brush.size
        return np.flatnonzero(near), places, whole
