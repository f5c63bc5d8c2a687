"""What contacts bear, summed over a world: overlaps, the load on floors and walls, bearing contacts. Of NumPy, from the pairs as they are
read.
"""

import numpy as np

from taichi_sand.measure.pairs import FIRST_MOVES, NORMAL, ONE, OVERLAP, PUSH, SECOND_MOVES, SLIDE, STATE, TWO, Found

FLOOR_SLOPE = 0.17
"""A wall is a floor where its normal into the bed rises by more than this, sin 10 degrees."""
BEARING = 1e-3
"""A contact bears when its normal force is more than this part of the mean one."""


class Loads:
    """The loads of the pairs `found`; forces are those that contacts carry, without the impacts of the last step."""

    def __init__(self, found: Found) -> None:
        self.one, self.two = found.whole[:, ONE].copy(), found.whole[:, TWO].copy()
        state = found.whole[:, STATE]
        self.moves = (state & FIRST_MOVES) > 0, (state & SECOND_MOVES) > 0
        numbers = np.ascontiguousarray(found.exact.T, np.float64)
        self.overlap, self.push, self.slide = numbers[OVERLAP], numbers[PUSH], numbers[SLIDE]
        self.normal = numbers[NORMAL : NORMAL + 2]

    @property
    def overlaps(self) -> np.ndarray:
        """Of the pairs that touch [m]."""
        return self.overlap[self.overlap > 0]

    def forces(self) -> np.ndarray:
        """On the second of every pair [N], (2, n)."""
        return self.push * self.normal + self.slide * np.stack([-self.normal[1], self.normal[0]])

    def on_floors(self, up: np.ndarray) -> float:
        """Downward force on walls that are floors [N]."""
        floors = (self.two < 0) & (up @ self.normal < -FLOOR_SLOPE)
        return float(-(up @ self.forces())[floors].sum())

    def on_walls(self) -> float:
        """Sum of the sizes of the forces on walls [N]."""
        return float(np.hypot(self.push, self.slide)[self.two < 0].sum())

    def outer(self) -> np.ndarray:
        """Force from outside, walls and fixed grains, on the grains that can move [N], (2,)."""
        first, second = self.moves
        side = np.where(self.two < 0, -1.0, second.astype(float) - first)
        return self.forces() @ side

    def coordination(self, made: int) -> float:
        """Mean number of bearing contacts of a grain, walls included, over the grains that are no rattlers; ids are below `made`."""
        pushing = self.push[self.push > 0]
        if not len(pushing):
            return 0.0
        bears = self.push > BEARING * pushing.mean()
        inner = bears & (self.two >= 0)
        one, two, moves = self.one[bears], self.two[inner], (self.moves[0][bears], self.moves[1][inner])
        bearing = np.bincount(one, minlength=made) + np.bincount(two, minlength=made)
        free = np.zeros(made, bool)
        free[one], free[two] = moves
        carries = (bearing >= 2) | ~free
        both = carries[one] & np.where(self.two[bears] >= 0, carries[np.maximum(self.two[bears], 0)], True)
        within = both[self.two[bears] >= 0]
        ends = (both & moves[0]).sum() + (within & moves[1]).sum()
        grains = ((bearing >= 2) & free).sum()
        return float(ends / grains) if grains else 0.0
