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
    place, radius = free_discs(sim)
    if len(radius) < LEAST:
        return math.nan
    d = sim.bed.diameter
    x, y = surface(place, radius, STRIP * d, GAP * d)
    low = float((place[:, 1] + radius).min())
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
    x = free_discs(sim)[0][:, 0]
    return float(np.subtract(*np.percentile(x, [99, 1]))) if len(x) else math.nan


def core(sim: Any) -> float:
    """Mean distance from the middle of the bed of the smaller half of the free grains, over that of the larger half: 1 if they are mixed,
    less if small ones are in the core; NaN without two sizes.
    """
    place, radius = free_discs(sim)
    if not len(radius) or radius.min() == radius.max():
        return math.nan
    away = np.hypot(*(place - np.average(place, axis=0, weights=radius**2)).T)
    large = radius > (radius.min() + radius.max()) / 2
    return float(away[~large].mean() / away[large].mean())


def friction_angle(sim: Any) -> float:
    """Angle of friction that the bed mobilises [degrees]: asin((s1 - s2) / (s1 + s2)), s1 and s2 the principal values of the mean
    Love-Weber stress of its grains (Mohr 1882); NaN where nothing is pressed.
    """
    from taichi_sand.measure.contacts import contacts
    from taichi_sand.measure.grain_state import state_of, stresses

    state = state_of(sim)
    total = (stresses(sim, state, contacts(sim)) * state["area"][:, None, None]).sum(axis=0)
    low, high = np.linalg.eigvalsh(0.5 * (total + total.T))
    mean = 0.5 * (low + high)
    return math.degrees(math.asin(min(1.0, float(0.5 * (high - low) / abs(mean))))) if mean else math.nan


def load_share(sim: Any) -> float:
    """What floors bear, over the weight of the grains that can move; NaN without weight."""
    from taichi_sand.measure.grain_state import state_of
    from taichi_sand.measure.report import contacts

    weight = float(state_of(sim)["mass"].sum() * np.hypot(*sim.scene.gravity))
    return contacts(sim)["floor_force_N"] / weight if weight else math.nan


def surface_angle(sim: Any) -> float:
    """Slope of the surface of the free grains [degrees], downwards to the right, fitted over the middle half of their width; NaN without
    any. The y axis is up.
    """
    place, radius = free_discs(sim)
    if len(radius) < LEAST:
        return math.nan
    d = sim.bed.diameter
    x, y = surface(place, radius, STRIP * d, GAP * d)
    low, high = np.percentile(place[:, 0], [25, 75])
    inner = (x > low) & (x < high)
    return -math.degrees(math.atan(np.polyfit(x[inner], y[inner], 1)[0])) if inner.sum() >= LEAST else math.nan


def large_above(sim: Any) -> float:
    """Share of the small grains that lie below the large ones, in the mean of these: 1 if they are on top, 0.5 if they are mixed, 0 if
    they are at the bottom; NaN without two sizes. Large is more than halfway between the least and the largest radius.
    """
    place, radius = free_discs(sim)
    large = radius > (radius.min(initial=np.inf) + radius.max(initial=0.0)) / 2
    return share_below(place[large, 1], place[~large, 1])


def light_above(sim: Any) -> float:
    """The same of the densest grains below the lightest ones; NaN without two densities."""
    from taichi_sand.measure.grain_state import state_of

    state = state_of(sim)
    free = state["mass"] > 0
    density, height = state["mass"][free] / state["area"][free], state["position"][free, 1]
    light, dense = (np.isclose(density, one(density, initial=start), rtol=1e-3) for one, start in ((np.min, np.inf), (np.max, 0.0)))
    return share_below(height[light & ~dense], height[dense & ~light])


def share_below(ones: np.ndarray, others: np.ndarray) -> float:
    """Mean share of `others` (n,) below each of `ones` (m,); NaN without both."""
    if not len(ones) or not len(others):
        return math.nan
    return float(np.searchsorted(np.sort(others), ones).mean() / len(others))


def order(sim: Any) -> float:
    """Mean of |psi6| over all grains: 1 in a hexagonal crystal; NaN without any."""
    from taichi_sand.measure import structure

    found = np.zeros(sim.count, np.float32)
    if not len(found):
        return math.nan
    structure.order(sim.world, found)
    return float(found.mean())


def shear_friction(sim: Any) -> float:
    """Shear stress over pressure across a flow along x, in the middle of a bed; NaN where nothing is pressed."""
    from taichi_sand.measure import flowing

    return flowing.shear_friction(sim)


def inertial_number(sim: Any) -> float:
    """Inertial number there (da Cruz et al. 2005)."""
    from taichi_sand.measure import flowing

    return flowing.inertial_number(sim)


def free_discs(sim: Any) -> tuple[np.ndarray, np.ndarray]:
    """Place (n, 2) and radius (n,) of the grains that can move [m]."""
    from taichi_sand.world import edit

    places, whole = edit.places(sim.world)
    free = whole[:, 2] == 0
    return places[free, :2], places[free, 2]


MEASURES: dict[str, Callable[[Any], float]] = {
    "repose_angle": repose_angle,
    "spread": spread,
    "core": core,
    "friction_angle": friction_angle,
    "load_share": load_share,
    "surface_angle": surface_angle,
    "large_above": large_above,
    "light_above": light_above,
    "order": order,
    "shear_friction": shear_friction,
    "inertial_number": inertial_number,
}
"""Measurements, each a function of a Simulation."""
UNITS = {"repose_angle": "degrees", "spread": "m", "core": "", "friction_angle": "degrees", "load_share": ""}
UNITS |= {"surface_angle": "degrees", "large_above": "", "light_above": "", "order": "", "shear_friction": "", "inertial_number": ""}
