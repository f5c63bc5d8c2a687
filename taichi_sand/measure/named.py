"""Measurements by name, besides the numbers of the report: what one asks of a whole bed, from where its grains lie."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

STRIP = 1.5
"""Width of the strips that a surface is looked at through [d]."""
GAP = 3.0
"""A gap of so many d parts what lies above it from the bed below."""
FLANK = (0.2, 0.8)
"""Part of a flank that its slope is fitted to, from top to foot: the top is round, the foot is one grain thin."""
FOOT = 1.5
"""A heap ends where it is so many d high above its lowest free grain."""
LEAST = 4
"""Fewest strips that a slope is fitted to."""


def surface(place: np.ndarray, radius: np.ndarray, width: float, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Highest points of the bed of grains at `place` (n, 2) with `radius` (n,), one in each strip of `width` that holds any: x, y [m].

    What lies over a gap of more than `gap` [m] is not of the bed: grains that fall, or hang in a silo above it.
    """
    order = np.lexsort((place[:, 1], np.floor(place[:, 0] / width)))
    strip, height, top = np.floor(place[order, 0] / width), place[order, 1], place[order, 1] + radius[order]
    tops = []
    for rows in np.split(np.arange(len(order)), np.flatnonzero(np.diff(strip)) + 1):
        apart = np.flatnonzero(np.diff(height[rows]) > gap)
        bed = rows[: apart[0] + 1] if len(apart) else rows
        tops.append(bed[np.argmax(top[bed])])
    return place[order[tops], 0], top[tops]


def repose_angle(sim: Any) -> float:
    """Mean slope of the two flanks of a heap [degrees], fitted between FLANK of the way from its top to each foot; NaN without a heap.

    The y axis is up; fixed grains are no part of it.
    """
    from taichi_sand.world import edit

    places, whole = edit.places(sim.world)
    free = whole[:, 2] == 0
    if free.sum() < LEAST:
        return math.nan
    d = sim.bed.diameter
    x, y = surface(places[free, :2], places[free, 2], STRIP * d, GAP * d)
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


def spread(sim: Any) -> float:
    """Width of the bed [m]: between the x below which a hundredth of the free grains lie, and beyond which; NaN without any."""
    from taichi_sand.world import edit

    places, whole = edit.places(sim.world)
    x = places[whole[:, 2] == 0, 0]
    return float(np.subtract(*np.percentile(x, [99, 1]))) if len(x) else math.nan


def core(sim: Any) -> float:
    """Mean distance from the middle of the bed of the smaller half of the free grains, over that of the larger half: 1 if they are mixed,
    less if small ones are in the core; NaN without two sizes.
    """
    from taichi_sand.world import edit

    places, whole = edit.places(sim.world)
    place, radius = places[whole[:, 2] == 0, :2], places[whole[:, 2] == 0, 2]
    if not len(radius) or radius.min() == radius.max():
        return math.nan
    away = np.hypot(*(place - np.average(place, axis=0, weights=radius**2)).T)
    large = radius > (radius.min() + radius.max()) / 2
    return float(away[~large].mean() / away[large].mean())


MEASURES: dict[str, Callable[[Any], float]] = {"repose_angle": repose_angle, "spread": spread, "core": core}
"""Measurements, each a function of a Simulation."""
UNITS = {"repose_angle": "degrees", "spread": "m", "core": ""}
