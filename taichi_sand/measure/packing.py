"""The packing fraction inside a bed."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.measure.discs import Kinds, discs_of
from taichi_sand.measure.pairs import real_of
from taichi_sand.world.reading import read_columns

CELLS_ACROSS = 8
"""A bed of n grains gets cells of about sqrt(n) / CELLS_ACROSS diameters, between SMALLEST and LARGEST."""
SMALLEST, LARGEST = 2.0, 6.0
POINTS = 24
"""Points a disc is spread over when its area is dealt to cells."""
FULL = 1 << 22
"""Whole number that stands for one full cell."""


@ti.func
def covered(discs: ti.template(), low, high, x, y):
    """Whether one of the discs low … high - 1 covers (x, y)."""
    found = False
    for d in range(low, high):
        across, up = x - discs[d, 0], y - discs[d, 1]
        if across * across + up * up < discs[d, 2] * discs[d, 2]:
            found = True
    return found


@ti.kernel
def deal_area(
    discs: ti.types.ndarray(ndim=2),
    first: ti.types.ndarray(dtype=ti.i32, ndim=1),
    cell: ti.f32,
    filled: ti.types.ndarray(dtype=ti.i32, ndim=2),
):
    """filled[cx, cy] += area of the grains in the cell, in parts of FULL: whole numbers, so that the order does not matter.

    Each disc (x, y, radius) is spread over POINTS of equal weight on a sunflower spiral; those that lie in an earlier disc of its grain, of
    which first[d] is the first, do not count.
    """
    for d in range(discs.shape[0]):
        r = ti.cast(discs[d, 2], ti.f32)
        part = ti.cast(3.14159265 * r * r / (cell * cell) / POINTS * FULL, ti.i32)
        for k in range(POINTS):
            rho = r * ti.sqrt((ti.cast(k, ti.f32) + 0.5) / POINTS)
            phi = 2.39996323 * ti.cast(k, ti.f32)
            x, y = discs[d, 0] + rho * ti.cos(phi), discs[d, 1] + rho * ti.sin(phi)
            column, row = ti.cast(ti.floor(x / cell), ti.i32), ti.cast(ti.floor(y / cell), ti.i32)
            within = 0 <= column < filled.shape[0] and 0 <= row < filled.shape[1]
            if within and not covered(discs, first[d], d, x, y):
                ti.atomic_add(filled[column, row], part)


def packing_fraction(sim: Any) -> float:
    """Area of grains a unit area inside the bed; 0 where no bed is that large: see the head of measure/report.py."""
    table = read_columns(sim.world, ("kind", "position", "angle", "radius"))
    discs = discs_of(Kinds(sim.scene), *table.values())
    d, size = sim.bed.diameter, np.array(sim.scene.size)
    cell = float(np.clip(np.sqrt(max(sim.count, 1)) / CELLS_ACROSS, SMALLEST, LARGEST)) * d
    shape = tuple(np.maximum(1, np.ceil(size / cell)).astype(int))
    filled = np.zeros(shape, np.int32)
    rows = np.column_stack([discs.place, discs.radius]).astype(real_of(sim)[1])
    if len(rows):
        deal_area(rows, discs.first.astype(np.int32), cell, filled)
    fraction = np.pad(filled / FULL, 1)
    full = fraction > 0.5
    around = [full[1 + dx : 1 + dx + shape[0], 1 + dy : 1 + dy + shape[1]] for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    inside = np.logical_and.reduce(around)
    return float(fraction[1:-1, 1:-1][inside].mean()) if inside.any() else 0.0
