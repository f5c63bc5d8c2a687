"""Memory of pairs: what a pair carried before the search, found again by its grains."""

import taichi as ti

from taichi_sand.world.clumps import MOST
from taichi_sand.world.geometry import wall_row


@ti.func
def discs_of(w: ti.template(), row):
    """Which discs of its grains a row is about."""
    discs = 0
    if ti.static(w.clumps):
        discs = w.pairs.discs[row]
    return discs


@ti.func
def remember(w: ti.template(), row, i, j):
    """Gives the pair of i and j the memory it had before the search; none if it is new."""
    discs = discs_of(w, row)
    old = recall(w, w.pairs.row_start, w.pairs.row_count, w.grid.source[i], w.grid.source[j], discs, w.lanes)
    if old < 0:
        discs = discs % MOST * MOST + discs // MOST
        old = recall(w, w.pairs.row_start, w.pairs.row_count, w.grid.source[j], w.grid.source[i], discs, w.lanes)
    carry(w, row, old)


@ti.func
def remember_wall(w: ti.template(), row, i, part, two_sided):
    """The same for a pair with a wall; a grain also remembers on which side of a line it was."""
    old = recall(w, w.pairs.wall_row_start, w.pairs.wall_row_count, w.grid.source[i], part, discs_of(w, row), 1)
    if old >= 0 and two_sided:
        w.pairs.side[wall_row(w, row)] = w.pairs.side[wall_row(w, old)]
    carry(w, row, old)


@ti.func
def recall(w: ti.template(), row_start: ti.template(), row_count: ti.template(), first, second, discs, apart: ti.template()):
    """Row of the search before that held these discs of (first, second), slots of that search; -1 if there is none."""
    found = -1
    slot = (1 - w.pace[None].half) * w.capacity + first
    step = apart
    if ti.static(w.sleeps):
        step = 1 if row_start[slot] >= 2 * w.half else apart  # frozen pairs follow one another
    for k in range(row_count[slot]):
        row = row_start[slot] + k * step
        if w.pairs.second[row] == second and discs_of(w, row) == discs:
            found = row
    return found


@ti.func
def carry(w: ti.template(), row, old):
    """Copies the memory of row `old` to `row`; zeros if old < 0."""
    for column in ti.static(w.pairs.memory):
        column[row] = column[old] if old >= 0 else ti.zero(column[row])
