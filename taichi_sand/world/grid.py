"""The dense grid: a stable counting sort that keeps the grains in the order of their cells.

Cells are numbered column by column, upwards; grains that left the box land in one cell more, behind all others, and are gone.
"""

from typing import Any, NamedTuple

import taichi as ti

from taichi_sand.world.flags import ESCAPED, flag
from taichi_sand.world.geometry import position, velocity


class Grid(NamedTuple):
    """Cells, and what the sort needs."""

    start: Any  # first slot of each cell, shape (cells + 2,), i32
    cell: Any  # cell of each grain, before the sort by its old slot, i32
    source: Any  # the slot that each grain had before the sort, i32
    columns: Any  # cells along x, 0-D i32
    rows: Any  # cells along y, 0-D i32
    cell_size: Any  # 0-D 2-vector [m]
    flight: Any  # position and velocity of each grain, rounded: enough to tell who is far, shape (capacity,), 4-vectors
    whole: Any  # scratch, shape (capacity,), i32
    number: Any  # scratch, shape (capacity,), real


def allocate_grid(real: Any, capacity: int, cells: int) -> Grid:
    """Empty grid for up to `cells` cells."""
    return Grid(
        start=ti.field(ti.i32, cells + 2),
        cell=ti.field(ti.i32, capacity),
        source=ti.field(ti.i32, capacity),
        columns=ti.field(ti.i32, ()),
        rows=ti.field(ti.i32, ()),
        cell_size=ti.Vector.field(2, real, ()),
        flight=ti.Vector.field(4, real, capacity),
        whole=ti.field(ti.i32, capacity),
        number=ti.field(real, capacity),
    )


@ti.func
def anchor(w: ti.template(), i):
    """Folds the shift of grain i into its site and offset, and its turn into its angle."""
    g = ti.static(w.grains)
    box = w.box[None]
    place = g.offset[i] + g.shift[i]
    hop = ti.floor(place / box.spacing + 0.5)
    site = g.site[i] + ti.cast(hop, ti.i32)
    g.offset[i] = place - hop * box.spacing
    for k in ti.static(range(2)):
        if ti.static(w.periodic[k]):
            site[k] = site[k] - box.sites[k] * ti.cast(ti.floor(ti.cast(site[k], w.real) / box.sites[k]), ti.i32)
    g.site[i] = site
    g.shift[i] = ti.Vector([0.0, 0.0])
    g.start_velocity[i] = velocity(w, i)
    if ti.static(w.turns):
        angle = g.angle[i] + g.turn[i]
        g.angle[i] = angle - 2 * ti.math.pi * ti.floor(angle / (2 * ti.math.pi) + 0.5)
        g.turn[i] = 0.0


@ti.func
def outside(w: ti.template(), i):
    """1 if grain i has wholly left through an open edge; one found behind a closed edge is put back and flagged."""
    g = ti.static(w.grains)
    box = w.box[None]
    p, r = position(w, i), g.radius[i]
    left = 0
    for k in ti.static(range(2)):
        if ti.static(not w.periodic[k]):
            for end in ti.static(range(2)):
                beyond = -p[k] if ti.static(end == 0) else p[k] - box.size[k]
                if ti.static(w.open_edges[2 * k + end]):
                    left |= ti.cast(beyond > r, ti.i32)
                elif beyond > 0.0:
                    g.offset[i][k] += (beyond + 0.5 * r) * (1 if ti.static(end == 0) else -1)
                    g.twist[i][k] = 0.0
                    g.start_velocity[i][k] = 0.0
                    flag(w, ESCAPED, g.id[i])
    return left


@ti.func
def cell_of(w: ti.template(), i):
    """Cell of grain i; beyond the box the nearest one."""
    grid = ti.static(w.grid)
    at = ti.cast(ti.floor(position(w, i) / grid.cell_size[None]), ti.i32)
    column = ti.min(ti.max(at.x, 0), grid.columns[None] - 1)
    row = ti.min(ti.max(at.y, 0), grid.rows[None] - 1)
    return column * grid.rows[None] + row


@ti.func
def lay_cells(w: ti.template(), width):
    """Cuts the box into cells at least `width` wide. Periodic axes get a number of cells that the colours of a sweep fit."""
    grid = ti.static(w.grid)
    box = w.box[None]
    count = ti.Vector([1, 1])
    for k in ti.static(range(2)):
        count[k] = ti.max(1, ti.cast(box.size[k] / ti.max(width, box.least_cell), ti.i32))
        if ti.static(w.periodic[k] and w.layout == "cells"):
            count[k] -= count[k] % (2 if ti.static(k == 0) else 3)
    grid.columns[None], grid.rows[None] = count.x, count.y
    grid.cell_size[None] = box.size / ti.cast(count, w.real)


@ti.func
def sort(w: ti.template()):
    """Stable counting sort of the grains by cell; leaves the old slot of each in `source` and drops the grains that left."""
    grid = ti.static(w.grid)
    cells = grid.columns[None] * grid.rows[None]
    present = w.count[None]
    ti.loop_config(serialize=True)
    for c in range(cells + 2):
        grid.start[c] = 0
    ti.loop_config(serialize=True)
    for i in range(present):
        grid.start[grid.cell[i] + 1] += 1
    ti.loop_config(serialize=True)
    for c in range(cells + 1):
        grid.start[c + 1] += grid.start[c]
    ti.loop_config(serialize=True)
    for i in range(present):
        slot = grid.start[grid.cell[i]]
        grid.start[grid.cell[i]] = slot + 1
        grid.source[slot] = i
    ti.loop_config(serialize=True)
    for k in range(cells + 1):
        c = cells + 1 - k
        grid.start[c] = grid.start[c - 1]
    grid.start[0] = 0
    w.count[None] = grid.start[cells]


@ti.func
def permute(w: ti.template(), present):
    """Moves every column of the grain table into the new order."""
    g = ti.static(w.grains)
    for column in ti.static((g.offset, g.start_velocity, g.twist, g.mobility, g.wrench)):
        for k in ti.static(range(column.n)):
            permute_one(w, present, column.get_scalar_field(k), w.grid.number)
    for k in ti.static(range(2)):
        permute_one(w, present, g.site.get_scalar_field(k), w.grid.whole)
    permute_one(w, present, g.radius, w.grid.number)
    for column in ti.static((g.id, g.kind)):
        permute_one(w, present, column, w.grid.whole)
    if ti.static(w.turns):
        permute_one(w, present, g.angle, w.grid.number)


@ti.func
def permute_one(w: ti.template(), present, column: ti.template(), scratch: ti.template()):
    """column[i] becomes what column[source[i]] was."""
    ti.loop_config(serialize=True)
    for i in range(present):
        scratch[i] = column[w.grid.source[i]]
    ti.loop_config(serialize=True)
    for i in range(present):
        column[i] = scratch[i]


@ti.func
def follow(w: ti.template()):
    """Cells and flights in the new order of the grains."""
    permute_one(w, w.count[None], w.grid.cell, w.grid.whole)
    ti.loop_config(serialize=True)
    for i in range(w.count[None]):
        p, v = position(w, i), velocity(w, i)
        w.grid.flight[i] = ti.Vector([p.x, p.y, v.x, v.y])
