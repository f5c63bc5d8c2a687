"""A scene that is played, and what goes with it while another one is."""

from dataclasses import dataclass, field
from typing import Any

from taichi_sand.play.brush import Brush
from taichi_sand.play.snapshot import Snapshot
from taichi_sand.scene.schema import Scene

LOOKS = {"color": "kind", "chains": False, "velocities": False, "forces": False, "grid": False, "bonds": True, "asleep": True, "hud": True}
"""What may be switched of how it looks, and how it starts."""


@dataclass(eq=False)
class Chapter:
    """A scene that was opened. Moments know theirs: so undoing finds the way back to the scene before."""

    home: Scene  # as it was opened
    name: str = ""  # that files of it get
    room: int = 0  # for grains that are added by hand
    brush: Brush = field(init=False)
    start: Snapshot = field(init=False)  # what a reset goes back to
    look: dict[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        view = self.home.view
        self.look = {**LOOKS, "color": view.color, "chains": view.force_chains, "cold": view.cold, "hot": view.hot}
