"""What grains take up of the water, and give back, where the effect `moisture` is on: none of it is lost.

A grain under water fills up to what bridges hold (MOIST of its pores), and lets go of what it holds beyond that. Markers are whole: what a
cell owes grains, or they owe it, is kept until it makes one.
"""

import math
from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.effects.water.grid import KAPPA
from taichi_sand.effects.water.markers import FIRST, SECOND
from taichi_sand.world.extras.wetness import MOIST
from taichi_sand.world.geometry import add, at_most

PORES = 0.8
"""Pores over grains in a bed: those of spheres of the porosity 0.44."""
RATE = 10.0
"""At which grains take up water and let go of it [1/s]."""


@ti.func
def held_by(f: ti.template(), share):
    """Water that a grain of this solid fraction of a cell holds if its pores are full, in markers."""
    return PORES * share / f.now[None].marker


@ti.func
def soak(w: ti.template(), f: ti.template(), i, row, share, wet):
    """Grain i, which lies in the cell of `row` and is under water as far as `wet`, exchanges water with it."""
    if wet > 0.0:
        own = w.carried.wetness[i]
        change = (MOIST - own) * at_most(1.0, RATE * f.now[None].next) * wet
        w.carried.wetness[i] = own + change
        add(f.cells.owed, row, -held_by(f, share) * change)


@ti.func
def row_of(f: ti.template(), p):
    """The cell that place p lies in."""
    now = f.now[None]
    i = ti.max(1, ti.min(now.columns, ti.floor(p.x + 0.5, ti.i32)))
    return i * (now.rows + 2) + ti.max(1, ti.min(now.rows, ti.floor(p.y + 0.5, ti.i32)))


@ti.func
def taken_up(f: ti.template(), k):
    """Whether marker k goes to the grains of its cell."""
    row = row_of(f, f.place[k])
    goes = f.cells.owed[row] <= -1.0
    if goes:
        add(f.cells.owed, row, 1.0)
    return goes


@ti.func
def let_go(f: ti.template()):
    """Markers for what grains have let go of."""
    now = f.now[None]
    for i in range(1, now.columns + 1):
        for j in range(1, now.rows + 1):
            row = i * (now.rows + 2) + j
            while f.cells.owed[row] >= 1.0 and f.now[None].markers < f.place.shape[0]:
                k = f.now[None].markers
                x, y = FIRST * (k % 65536 + 1), SECOND * (k % 65536 + 1)
                f.place[k] = ti.Vector([i + 0.9 * (x - ti.floor(x) - 0.5), j + 0.9 * (y - ti.floor(y) - 0.5)])
                f.velocity[k] = ti.Vector([f.u.speed[row], f.v.speed[row]])
                f.now[None].markers = k + 1
                add(f.cells.owed, row, -1.0)


def held(world: Any, fluid: Any, sizes: np.ndarray) -> float:
    """Water that all grains hold by themselves [m2]; `sizes` as in Fluid."""
    count = int(world.count[None])
    radius, kind, there = (getattr(world.grains, name).to_numpy()[:count] for name in ("radius", "kind", "id"))
    area = KAPPA * math.pi * (radius.astype(float) * sizes[kind]) ** 2
    return float((PORES * area * world.carried.wetness.to_numpy()[:count])[there >= 0].sum())


def most_held(grains: Any, cell: float) -> float:
    """What full pores of all `grains` hold, in cells of this area [m2]."""
    return float(PORES * KAPPA * math.pi * (grains.size**2).sum()) / cell
