"""The scalar views: what each shows of a grain, in which colours, over which range."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_sand.errors import SandError, suggest
from taichi_sand.measure import structure
from taichi_sand.view import palette
from taichi_sand.world.tables import World

PERCENTILE = 0.99
HOLD = 1.0
"""Time [s] in which a range that has become too wide shrinks to 1/e: colours follow the scene but do not flicker."""


@dataclass(frozen=True)
class View:
    """One way to colour grains by a number."""

    measure: Callable[[World, np.ndarray], None] | None  # None = of the water, and by it of the grains: view.water
    stops: str  # of the colour map; "" = from the cold to the hot colour of the scene
    unit: str
    full: float | None = None  # top of the range; None = percentile 99 of what is there
    carried: str = ""  # column that grains must carry for it: there only with the effect that has it
    least: float = 0.0  # the top never falls below this part of the highest one so far: what rests is shown at rest


VIEWS = {
    "speed": View(structure.speed, palette.INFERNO, "m/s", least=1e-2),
    "energy": View(structure.energy, "", "J", least=1e-4),
    "force": View(structure.force, palette.INFERNO, "N"),
    "pressure": View(structure.pressure, palette.INFERNO, "N/m"),
    "stress": View(structure.stress, palette.INFERNO, "N/m"),
    "deviator": View(structure.deviator, palette.INFERNO, "N/m"),
    "rotation": View(structure.orientation, palette.CYCLIC, "turn", full=1.0),
    "order": View(structure.order, palette.VIRIDIS, "", full=1.0),
    "temperature": View(structure.temperature, palette.INFERNO, "K", carried="temperature"),
    "moisture": View(structure.moisture, palette.DRY_TO_WET, "", full=0.3, carried="wetness"),
    "saturation": View(structure.saturation, palette.DRY_TO_WET, "", full=1.0, carried="water_wet"),
    "water pressure": View(None, palette.VIRIDIS, "Pa", carried="water_wet", least=1e-2),
    "water speed": View(None, palette.VIRIDIS, "m/s", carried="water_wet", least=1e-2),
}
KIND, PHOTOELASTIC = "kind", "photoelastic"
"""Views that show no number of a grain: see the painter."""


def views_of(world: World) -> list[str]:
    """Names of the views that there are of this world."""
    numbers = [name for name, view in VIEWS.items() if not view.carried or hasattr(world.carried, view.carried)]
    return [KIND, *numbers, PHOTOELASTIC]


def check_view(color: str, world: World) -> None:
    """Refuses a name that is no view of this world, and says which there are."""
    names = views_of(world)
    if color not in names:
        raise SandError(f"there is no view '{color}'{suggest(color, names)}; there are {', '.join(names)}")


def quantile(values: np.ndarray, share: float) -> float:
    """The smallest value that at least `share` of the values do not exceed; 0 of none."""
    if not len(values):
        return 0.0
    rank = max(0, math.ceil(share * len(values)) - 1)
    return float(np.partition(values, rank)[rank])


class Range:
    """Top of a range that rises at once and falls slowly, in simulated time, but not below `least` of the highest it has been."""

    def __init__(self, least: float = 0.0) -> None:
        self.least = least
        self.top = self.highest = 0.0
        self.time = float("-inf")

    def follow(self, value: float, time: float) -> float:
        """The top at `time` [s], where the data reach up to `value`. Going back in time forgets what was."""
        if time < self.time:
            self.top, self.highest, self.time = 0.0, 0.0, time
        kept = self.top * math.exp((self.time - time) / HOLD)
        self.highest = max(value, self.highest)
        self.top, self.time = max(value, kept, self.least * self.highest), time
        return self.top
