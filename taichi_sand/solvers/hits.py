"""Which grains impacts have hit in a step, and the pairs that are to be looked at again for that."""

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.geometry import movable
from taichi_sand.world.search.cell_list import cell_count
from taichi_sand.world.search.images import column_below


@noinline
def do_with_wall(w: ti.template(), s: ti.template(), do: ti.template(), p: ti.i32):
    """do(w, s, c, row, wall) on wall pair p."""
    do(w, s, s.constants[None], p, True)


@noinline
def each_hit(w: ti.template(), s: ti.template(), b: ti.i32, do: ti.template()):
    """do(w, s, c, row, wall) on the pairs of block b of which a grain has been hit since they were looked at."""
    c = s.constants[None]
    grid = ti.static(w.grid)
    since = 2 * w.pace[None].round - 2
    start, end = w.blocks.grain_start[b], w.blocks.grain_end[b]
    if start < end:
        for cell in range(grid.cell[start], grid.cell[end - 1] + 1):
            boulders = ti.static(w.boulders > 0) and cell == cell_count(w) - 1
            if s.near[cell] >= since or boulders:
                for i in range(ti.max(start, grid.start[cell]), ti.min(end, grid.start[cell + 1])):
                    each_hit_of(w, s, c, i, since, ti.select(boulders, 1, w.lanes), do)


@ti.func
def each_hit_of(w: ti.template(), s: ti.template(), c: ti.template(), i, since, stride, do: ti.template()):
    """The same on the pairs of grain i, which lie `stride` apart."""
    row = w.pace[None].half * w.capacity + i
    for k in range(w.pairs.row_count[row]):
        p = w.pairs.row_start[row] + k * stride
        if ti.max(s.struck[i], s.struck[w.pairs.second[p]]) >= since:
            do(w, s, c, p, False)
    for k in range(w.pairs.wall_row_count[row]):
        if s.struck[i] >= since:
            do_with_wall(w, s, do, w.pairs.wall_row_start[row] + k)


@ti.func
def mark_alone(w: ti.template(), s: ti.template(), i, moved):
    """Grain i is hit in this round, and perhaps moved."""
    if movable(w, i) > 0.0:
        s.struck[i] = 2 * w.pace[None].round + (s.struck[i] & 1 | ti.cast(moved, ti.i32))


@ti.func
def mark_pair(w: ti.template(), s: ti.template(), p, wall: ti.template()):
    """Pair p is to be looked at in the next round. The other pairs of its grains are only if it does hit then: see `mark`."""
    s.near[w.grid.cell[w.pairs.first[p]]] = 2 * w.pace[None].round
    mark_alone(w, s, w.pairs.first[p], False)
    if ti.static(not wall):
        mark_alone(w, s, w.pairs.second[p], False)


@ti.func
def mark(w: ti.template(), s: ti.template(), i, moved):
    """Grain i has been hit in this round, and perhaps moved: its pairs are to be looked at again. They belong to grains of its own cell
    and of the S, SW, W and NW ones.
    """
    mark_alone(w, s, i, moved)
    if movable(w, i) > 0.0:
        now = 2 * w.pace[None].round
        grid = ti.static(w.grid)
        columns, rows = grid.columns[None], grid.rows[None]
        for k in range(ti.static(9 if w.sheared else 5)):
            x, y = grid.cell[i] // rows - ti.cast(k > 1, ti.i32), grid.cell[i] % rows + ti.select(k > 1, k - 3, -k)
            if ti.static(w.sheared):
                if k > 4:  # the pairs with images below
                    x, y = column_below(w, grid.cell[i] // rows, k - 5), ti.select(grid.cell[i] % rows == 0, rows - 1, -1)
            if ti.static(w.periodic[0]):
                x = (x + columns) % columns
            if ti.static(w.periodic[1] and not w.sheared):
                y = (y + rows) % rows
            if x >= 0 and x < columns and y >= 0 and y < rows:  # a boulder's pairs are its own
                s.near[x * rows + y] = now
