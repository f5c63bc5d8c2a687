"""The numbers that views colour grains by, and the ranges that the colours span."""

from typing import Any

import numpy as np

from taichi_sand.view import kernels
from taichi_sand.view.views import PERCENTILE, VIEWS, Range, quantile
from taichi_sand.world.tables import World

CHAIN_EXPONENT, CHAIN_PERCENTILE = 0.7, 0.97
"""Chains are as wide as the force over this percentile to this power."""


class Scales:
    """Measures the views of one world; each range follows what is there as `Range` does."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._values, self._moving = np.zeros(world.capacity, np.float32), np.zeros(world.capacity, np.float32)
        self._ranges = {name: Range(view.least) for name, view in VIEWS.items()}
        self.chains = Range()
        self.water: Any = None  # view.water.Pool, where there is water

    def measure(self, name: str, time: float) -> tuple[np.ndarray, float]:
        """Value of every grain by slot, in an array that the next call fills again, and the top of the range at `time` [s]."""
        view = VIEWS[name]
        if view.measure is None:
            self.water.at_grains(self.world, name, self._values)
            return self._values, self.of_water(name, time)
        view.measure(self.world, self._values)
        top = view.full
        if top is None:
            found = kernels.moving_values(self.world, self._values, self._moving)
            top = self._ranges[name].follow(quantile(self._moving[:found], PERCENTILE), time)
        return self._values, top

    def of_water(self, name: str, time: float) -> float:
        """Top of the range of a view of the water at `time` [s]."""
        return self._ranges[name].follow(quantile(self.water.show(name), PERCENTILE), time)

    def levels(self, forces: Any, time: float) -> tuple[np.ndarray, float]:
        """Strength of these normal forces (n,) [N] in chains, 0 … 1, and the force that is 1 at `time` [s]."""
        top = self.chains.follow(quantile(forces, CHAIN_PERCENTILE), time)
        return np.minimum(1.0, forces / max(top, 1e-30)) ** CHAIN_EXPONENT, top
