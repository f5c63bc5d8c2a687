"""Measurements by name, besides the numbers of the report: what one asks of a whole bed, from where its grains lie."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

STRIP = 1.5
"""Width of the strips that a surface is looked at through [d]."""
FLANK = (0.2, 0.8)
"""Part of a flank that its slope is fitted to, from top to foot: the top is round, the foot is one grain thin."""
FOOT = 1.5
"""A heap ends where it is so many d high above its lowest free grain."""
LEAST = 4
"""Fewest strips that a slope is fitted to."""


def surface(place: np.ndarray, radius: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Highest points of the grains at `place` (n, 2) with `radius` (n,), one in each strip of `width` that holds any: x and y, by x [m]."""
    top = place[:, 1] + radius
    order = np.lexsort((-top, np.floor(place[:, 0] / width)))
    first = np.unique(np.floor(place[order, 0] / width), return_index=True)[1]
    best = order[first]
    return place[best, 0], top[best]


def repose_angle(sim: Any) -> float:
    """Mean slope of the two flanks of a heap [degrees], fitted between FLANK of the way from its top to each foot; NaN without a heap.

    The y axis is up; fixed grains are no part of it.
    """
    from taichi_sand.world import census

    places, whole = census.places(sim.world)
    free = whole[:, 2] == 0
    if free.sum() < LEAST:
        return math.nan
    d = sim.bed.diameter
    x, y = surface(places[free, :2], places[free, 2], STRIP * d)
    low = float((places[free, 1] + places[free, 2]).min())
    heap = y > low + FOOT * d
    if not heap.any():
        return math.nan
    top = float(np.average(x[heap], weights=(y[heap] - low) ** 4))
    slopes = []
    for side in (-1, 1):
        out = side * (x - top)
        reach = float(out[heap].max(initial=0.0))
        flank = (out > FLANK[0] * reach) & (out < FLANK[1] * reach)
        if flank.sum() < LEAST:
            return math.nan
        slopes.append(-np.polyfit(out[flank], y[flank], 1)[0])
    return math.degrees(math.atan(float(np.mean(slopes))))


MEASURES: dict[str, Callable[[Any], float]] = {"repose_angle": repose_angle}
"""Measurements, each a function of a Simulation."""
UNITS = {"repose_angle": "degrees"}
