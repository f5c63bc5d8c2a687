"""The scalar views: what each shows of a grain, in which colours, over which range."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_sand.measure import structure
from taichi_sand.view import palette
from taichi_sand.world.tables import World

PERCENTILE = 0.99
HOLD = 1.0
"""Time [s] in which a range that has become too wide shrinks to 1/e: colours follow the scene but do not flicker."""


@dataclass(frozen=True)
class View:
    """One way to colour grains by a number."""

    measure: Callable[[World, np.ndarray], None]
    stops: str  # of the colour map; "" = from the cold to the hot colour of the scene
    unit: str
    full: float | None = None  # top of the range; None = percentile 99 of what is there


VIEWS = {
    "speed": View(structure.speed, palette.INFERNO, "m/s"),
    "energy": View(structure.energy, "", "J"),
    "force": View(structure.force, palette.INFERNO, "N"),
    "pressure": View(structure.pressure, palette.INFERNO, "N/m"),
    "rotation": View(structure.orientation, palette.CYCLIC, "turn", full=1.0),
    "order": View(structure.order, palette.VIRIDIS, "", full=1.0),
}
KIND = "kind"


def check_view(color: str) -> None:
    """Refuses a name that is no view, and says which there are."""
    if color != KIND and color not in VIEWS:
        raise ValueError(f"there is no view '{color}'; there are {', '.join([KIND, *VIEWS])}")


def quantile(values: np.ndarray, share: float) -> float:
    """The smallest value that at least `share` of the values do not exceed; 0 of none."""
    if not len(values):
        return 0.0
    rank = max(0, int(np.ceil(share * len(values))) - 1)
    return float(np.partition(values, rank)[rank])


class Range:
    """Top of a range that rises at once and falls slowly, in simulated time."""

    def __init__(self) -> None:
        self.top = 0.0
        self.time = float("-inf")

    def follow(self, value: float, time: float) -> float:
        """The top at `time` [s], where the data reach up to `value`. Going back in time forgets what was."""
        kept = self.top * np.exp((self.time - time) / HOLD) if time >= self.time else 0.0
        self.top, self.time = max(value, float(kept)), time
        return self.top
