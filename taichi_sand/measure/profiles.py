"""What is measured along a line, by depth, or of all contacts at once: arrays of a few numbers, to be drawn."""

import math
from typing import Any

import numpy as np

from taichi_sand.measure.contacts import contacts
from taichi_sand.measure.grain_state import state_of, stresses
from taichi_sand.measure.named import GAP, LEAST, STRIP, free_discs, surface
from taichi_sand.measure.report import upwards

FORCES, BINS = 6.0, 24
"""P(f) is told up to so many mean forces, in so many bins."""
LAYER = 2.0
"""Depth profiles have layers of so many d."""

Line = tuple[float, float, float, float]
"""x, y of one end, x, y of the other [m]."""


def surface_line(sim: Any, line: Line) -> dict[str, Any] | None:
    """The surface of the bed between the ends of `line`, fitted by a straight line: `ends` (x0, y0, x1, y1) [m], `angle` [degrees] against
    the horizontal, upwards to the right positive, and `rms` of what it is off [d]. None where there are fewer than LEAST strips of it.

    The y axis is up, fixed grains are no part of it.
    """
    place, radius = free_discs(sim)
    d = sim.bed.diameter
    if not len(radius):
        return None
    x, y = surface(place, radius, STRIP * d, GAP * d)
    low, high = sorted((line[0], line[2]))
    within = (x >= low) & (x <= high)
    if within.sum() < LEAST:
        return None
    slope, height = np.polyfit(x[within], y[within], 1)
    off = y[within] - (slope * x[within] + height)
    ends = [low, slope * low + height, high, slope * high + height]
    return {"ends": [float(end) for end in ends], "angle": math.degrees(math.atan(slope)), "rms": float(np.sqrt(np.mean(off**2)) / d)}


def crossing(sim: Any, line: Line) -> float:
    """Grains that pass through `line` a second, to its right as seen from its first end, in the mean over the grains whose centres are
    within d of it (the flux of a coarse-grained field, Goldhirsch 2010, with a box for a kernel); 0 of no line.
    """
    start, way = np.array(line[:2]), np.array(line[2:]) - line[:2]
    length, d = float(np.hypot(*way)), sim.bed.diameter
    if not length:
        return 0.0
    along, across = way / length, np.array([way[1], -way[0]]) / length
    state = state_of(sim)
    off = state["position"] - start
    beside = (np.abs(off @ across) < d) & (off @ along >= 0) & (off @ along <= length)
    return float((state["velocity"][beside] @ across).sum() / (2 * d))


def force_distribution(sim: Any) -> tuple[list[float], list[float]]:
    """P(f) of the normal forces between grains that push, f over their mean, by its middles: f, and the logarithm (base 10) of the
    probability density, NaN where there are none (Radjai et al. 1996).
    """
    rows = contacts(sim)
    force = rows["force_n"][(rows["id2"] >= 0) & (rows["force_n"] > 0)]
    counts, edges = np.histogram(force / force.mean() if len(force) else force, BINS, (0.0, FORCES))
    density = counts / max(1, len(force)) / (FORCES / BINS)
    with np.errstate(divide="ignore"):
        tall = np.where(counts > 0, np.log10(density), np.nan)
    return (0.5 * (edges[1:] + edges[:-1])).tolist(), tall.tolist()


def stress_by_depth(sim: Any) -> tuple[list[float], list[float]]:
    """Vertical stress of the grains that can move by their depth below the highest of them: depth [d], mean in layers of LAYER d, by area
    (Love-Weber, compression positive) [N/m]. Up is against gravity.
    """
    state = state_of(sim)
    free = state["mass"] > 0
    if not free.any():
        return [], []
    up, d = upwards(sim), sim.bed.diameter
    stress = np.einsum("i,nij,j->n", up, stresses(sim, state, contacts(sim)), up)[free]
    height, area = state["position"][free] @ up, state["area"][free]
    layer = ((height.max() - height) / (LAYER * d)).astype(int)
    total, there = np.bincount(layer, stress * area), np.bincount(layer, area)
    filled = np.flatnonzero(there)
    return ((filled + 0.5) * LAYER).tolist(), (total[filled] / there[filled]).tolist()
