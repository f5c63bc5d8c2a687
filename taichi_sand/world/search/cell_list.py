"""The dense grid: a stable counting sort that keeps the grains in the order of their cells.

Cells are numbered column by column, upwards; boulders lie in one cell more, behind all others; grains that left the box land behind
that, and are gone.
"""

from typing import Any, NamedTuple

import taichi as ti

from taichi_sand.taichi_support import field_pool
from taichi_sand.world.clumps import head
from taichi_sand.world.extras.grain_rows import CELL, NUMBERS, WHOLE, load_row, sort_carried, store_row
from taichi_sand.world.extras.sinks import drain
from taichi_sand.world.flags import ESCAPED, NOWHERE, flag
from taichi_sand.world.geometry import add, position, present, velocity
from taichi_sand.world.search.images import moved_over
from taichi_sand.world.search.prefix_sum import prefix_sum, put_in_order, scratch_rows
from taichi_sand.world.tables import ABREAST, FEW_ABREAST, STRIPS

GROUPS = 8
ROOM = GROUPS - 1
"""Rows for the groups of a grain; so many of them hold any."""


class Scratch(NamedTuple):
    """What holds nothing between one kernel and the next."""

    sums: Any  # for prefix sums
    whole: Any  # for the whole numbers of a grain and its cell, shape (capacity,), i32 vectors
    number: Any  # for its others, vectors
    excess: Any  # of a grain and each of a group, see candidates.least_excess
    met: Any  # groups of ABREAST slots that a grain may meet some of: GROUPS rows a grain of first slot, and a bit for each
    found: Any  # how many there are


class Grid(NamedTuple):
    """Cells, and what the sort needs."""

    start: Any  # first slot of each cell, shape (cells + 2,), i32
    cell: Any  # cell of each grain, before the sort by its old slot, i32
    source: Any  # the slot that each grain had before the sort, i32
    columns: Any  # cells along x, 0-D i32
    rows: Any  # cells along y, 0-D i32
    cell_size: Any  # 0-D 2-vector [m]
    flight: Any  # x, y and velocity x, y of each grain, rounded: enough to tell who is far; four rows of vectors for every ABREAST grains
    scratch: Scratch


def allocate_grid(real: Any, layout: str, capacity: int, cells: int, summed: int) -> Grid:
    """Empty grid for up to `cells` cells, with scratch for the prefix sums of up to `summed` rows."""
    many = FEW_ABREAST if layout == "cells" else ABREAST
    return Grid(
        start=field_pool.scalars(ti.i32, cells + 2),
        cell=field_pool.scalars(ti.i32, capacity),
        source=field_pool.scalars(ti.i32, capacity),
        columns=field_pool.scalars(ti.i32, ()),
        rows=field_pool.scalars(ti.i32, ()),
        cell_size=field_pool.vectors(2, real, ()),
        flight=field_pool.vectors(many, real, 4 * (capacity // many + 1)),
        scratch=Scratch(
            sums=field_pool.scalars(ti.i32, scratch_rows(summed)),
            whole=field_pool.vectors(CELL + 1, ti.i32, capacity),
            number=field_pool.vectors(len(NUMBERS), real, capacity),
            excess=field_pool.vectors(many, real, capacity),
            met=field_pool.vectors(2, ti.i32, GROUPS * capacity),
            found=field_pool.scalars(ti.i32, capacity),
        ),
    )


@ti.func
def anchor(w: ti.template(), i):
    """Folds the shift of grain i into its site and offset, and its turn into its angle."""
    g = ti.static(w.grains)
    box = w.box[None]
    place = g.offset[i] + g.shift[i]
    hop = ti.floor(place / box.spacing + 0.5)
    if ti.static(w.sheared):
        place, hop = moved_over(w, i, place, hop)
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
    """1 if grain i has wholly left through an open edge, is in a sink, or was taken out.

    One found behind a closed edge is put back and flagged, one whose place is no number is taken out and flagged.
    """
    g = ti.static(w.grains)
    box = w.box[None]
    p, r = position(w, i), g.radius[i]
    if ti.static(w.flows):
        drain(w, i, p)
    left = ti.cast(g.id[i] < 0, ti.i32)
    if not (p.dot(p) >= 0.0):
        left = 1
        flag(w, NOWHERE, g.id[i])
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
def cell_count(w: ti.template()):
    """Cells, the one for boulders, the last, included."""
    return w.grid.columns[None] * w.grid.rows[None] + ti.static(int(w.boulders > 0))


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
    cells = cell_count(w)
    count = present(w)
    if ti.static(w.layout == "cells"):
        count_abreast(w)
    else:
        count_through(w, cells, count)
    if ti.static(w.sleeps):
        w.sleep.state[None].awake = grid.start[cells]
        if w.sleep.state[None].asleep == 0:
            w.count[None] = grid.start[cells]
        elif grid.start[cells] < count:
            w.sleep.state[None].due = 1
    else:
        w.count[None] = grid.start[cells]


@ti.func
def count_through(w: ti.template(), cells, count):
    """First slot of every cell, and who comes to every slot: grain by grain."""
    grid = ti.static(w.grid)
    ti.loop_config(serialize=True)
    for c in range(cells + 2):
        grid.start[c] = 0
    ti.loop_config(serialize=True)
    for i in range(count):
        add(grid.start, grid.cell[i] + 1, 1)
    ti.loop_config(serialize=True)
    for c in range(cells + 1):
        add(grid.start, c + 1, grid.start[c])
    ti.loop_config(serialize=True)
    for i in range(count):
        slot = grid.start[grid.cell[i]]
        grid.start[grid.cell[i]] = slot + 1
        grid.source[slot] = i
    ti.loop_config(serialize=True)
    for k in range(cells + 1):
        c = cells + 1 - k
        grid.start[c] = grid.start[c - 1]
    grid.start[0] = 0


@ti.func
def count_abreast(w: ti.template()):
    """First slot of every cell, and who comes to every slot: all grains at once. They come into their cells as threads have it, and are put
    in order there, but for those who left.
    """
    grid = ti.static(w.grid)
    for c in range(grid.start.shape[0]):
        grid.start[c] = 0
    for i in range(present(w)):
        grid.scratch.whole[i][0] = ti.atomic_add(grid.start[grid.cell[i]], 1)
    prefix_sum(grid.start, grid.scratch.sums, True)
    for i in range(present(w)):
        grid.source[grid.start[grid.cell[i]] + grid.scratch.whole[i][0]] = i
    for c in range(cell_count(w)):
        put_in_order(grid.source, grid.start[c], grid.start[c + 1])


@ti.func
def note_flight(w: ti.template(), i, place, motion):
    """Where grain i is and how it moves, for who looks at many at once."""
    many = ti.static(w.grid.flight.n)
    row, lane = 4 * (i // many), i % many
    for k in ti.static(range(2)):
        w.grid.flight[row + k][lane], w.grid.flight[row + 2 + k][lane] = place[k], motion[k]


@ti.func
def flight_of(w: ti.template(), i):
    """Position and velocity of grain i, as noted."""
    many = ti.static(w.grid.flight.n)
    row, lane = 4 * (i // many), i % many
    return ti.Vector([w.grid.flight[row + k][lane] for k in ti.static(range(4))])


@ti.func
def permute(w: ti.template(), count):
    """Moves every row of the grain table, and its cell, into the new order."""
    grid = ti.static(w.grid)
    ti.loop_config(serialize=w.layout == "one")
    for i in range(count):
        k = grid.source[i]
        store_row(w, WHOLE, NUMBERS, k, i)
        grid.scratch.whole[i][CELL] = grid.cell[k]
    ti.loop_config(serialize=w.layout == "one")
    for i in range(count):
        load_row(w, WHOLE, NUMBERS, i, i)
        grid.cell[i] = grid.scratch.whole[i][CELL]
        twist = w.grains.twist[i]
        if ti.static(w.clumps):
            w.grains.start_spin[i] = twist.z
            head(w, i)
        p = position(w, i)
        note_flight(w, i, p, twist.xy)
    if ti.static(w.sleeps):
        for i in range(count):
            w.sleep.push[i].x = w.sleep.still[grid.source[i]]
        for i in range(count):
            w.sleep.still[i] = w.sleep.push[i].x
    sort_carried(w, count)


@ti.func
def cut_blocks(w: ti.template()):
    """First and last grain of every block of the sweep."""
    grid = ti.static(w.grid)
    blocks = ti.static(w.blocks)
    columns, rows = grid.columns[None], grid.rows[None]
    if ti.static(w.layout == "one"):
        blocks.grain_start[0], blocks.grain_end[0] = 0, grid.start[columns * rows]
    elif ti.static(w.layout == "strips"):
        ti.loop_config(serialize=True)
        for b in range(STRIPS):
            start, end = b * columns // STRIPS, (b + 1) * columns // STRIPS
            if columns < STRIPS:
                start, end = ti.min(b, columns), ti.min(b + 1, columns)
                if ti.static(w.periodic[0]):
                    start, end = (0 if b == 0 else columns), columns
            blocks.grain_start[b], blocks.grain_end[b] = grid.start[start * rows], grid.start[end * rows]
    else:
        for b in range(columns * rows):
            blocks.grain_start[b], blocks.grain_end[b] = grid.start[b], grid.start[b + 1]
