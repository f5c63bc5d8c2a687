"""Real time: how many steps a frame takes, so that simulated time follows the wall clock where the machine can."""

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

FRAME = 1 / 60
"""Time of a frame [s]."""
MOST_WALL = 0.05
"""A frame never makes up for more wall time than this [s]: what is lost is lost, and simulated time slows down."""
BUDGET = 0.024
"""Wall time that simulating may take in a frame [s]; the picture keeps moving however slow the simulation is."""
KEEPS_UP, SETTLED = 0.9, 60
"""Slowed down is what reaches less than this share of the speed that was asked for, after so many frames."""
MEMORY = 0.1
"""Share of the newest frame in running means."""


class Pace:
    """How fast it goes."""

    def __init__(self) -> None:
        self.cost = 0.0  # wall time of a step [s]
        self.rest = 0.0  # steps that are due but not whole
        self.factor = 0.0  # simulated time / wall time
        self.mean = FRAME  # wall time of a frame [s]
        self.stages: dict[str, float] = {}  # wall time of each stage in a frame [s]
        self.count = 0  # frames in which time went on

    def advance(self, session: "Session", wall: float, single: int | None) -> int:
        """Simulates what is due `wall` [s] after the last frame, or while it is paused so many steps; returns how many it did."""
        steps = self.steps(wall, session.sim.step, session.speed) if single is None else single
        before, start = session.sim.time, time.perf_counter()
        session.advance(steps)
        if session.rewind.due(session.sim.time):
            session.do(["snap"])
        spent = time.perf_counter() - start
        self.spent(steps, spent)
        self.stage("simulate", spent)
        if single is None:
            self.frame(wall, session.sim.time - before)
        return steps

    def steps(self, wall: float, step: float, speed: float) -> int:
        """Steps due after `wall` [s] since the last frame."""
        due = min(wall, MOST_WALL) * speed / step + self.rest
        most = max(1, int(BUDGET / self.cost)) if self.cost else max(1, round(FRAME * speed / step / 4))
        count = min(int(due), most)
        self.rest = min(due - count, 1.0)
        return count

    def spent(self, steps: int, seconds: float) -> None:
        """`steps` took `seconds` of wall time."""
        if steps:
            each = seconds / steps
            self.cost = each if not self.cost else self.cost + MEMORY * (each - self.cost)

    @property
    def frames(self) -> float:
        """Frames a second."""
        return 1 / self.mean

    def frame(self, wall: float, simulated: float) -> None:
        """A frame that took `wall` [s] brought `simulated` [s]."""
        wall = max(wall, 1e-6)
        self.count += 1
        self.factor += MEMORY * (simulated / wall - self.factor)
        self.mean += MEMORY * (wall - self.mean)

    def slowed(self, speed: float) -> bool:
        """Whether simulated time lags behind `speed` times the wall's, once means can be told."""
        return self.count > SETTLED and self.factor < KEEPS_UP * speed

    def stage(self, name: str, seconds: float) -> None:
        """Stage `name` of a frame took `seconds`."""
        before = self.stages.get(name)  # the first time compiles and is not counted
        self.stages[name] = 0.0 if before is None else seconds if not before else before + MEMORY * (seconds - before)
