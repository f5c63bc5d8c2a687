"""Which grains impacts have hit in a step, and the pairs that are to be looked at again for that."""

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.geometry import movable
from taichi_sand.world.search.images import column_below
from taichi_sand.world.search.large_grains import is_boulder
from taichi_sand.world.search.pair_history import first_row, next_row

RUN = 64
"""Slots that are passed over together where nothing near was hit: a dense flow has all rounds in every step, for a handful of grains."""


@ti.func
def mark(w: ti.template(), s: ti.template(), i, moved):
    """Grain i has been hit in this round, and perhaps moved: its pairs are to be looked at again. They belong to grains of its own cell
    and of the S, SW, W and NW ones, and to strays.
    """
    if movable(w, i) > 0.0:
        now = 2 * w.pace[None].round
        s.struck[i] = now + (s.struck[i] & 1 | ti.cast(moved, ti.i32))
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
                for n in range(grid.start[x * rows + y], grid.start[x * rows + y + 1]):
                    s.near[n], s.near_run[n // RUN] = now, now
        if ti.static(w.relists):
            row, half = w.strays.partner[w.pace[None].half * w.capacity + i], w.pace[None].half
            while row > 0:
                p = first_row(w, half, False) + row - 1
                n = w.pairs.first[p]
                s.near[n], s.near_run[n // RUN] = now, now
                row = w.strays.next_partner[half * w.boulders + row - 1]


@noinline
def do_with_wall(w: ti.template(), s: ti.template(), do: ti.template(), p: ti.i32):
    """do(w, s, c, row, wall) on wall pair p."""
    do(w, s, s.constants[None], p, True)


@noinline
def each_hit(w: ti.template(), s: ti.template(), b: ti.i32, do: ti.template()):
    """do(w, s, c, row, wall) on the pairs of block b of which a grain has been hit since they were looked at."""
    c = s.constants[None]
    since = 2 * w.pace[None].round - 2
    start, end = w.blocks.grain_start[b], w.blocks.grain_end[b]
    for run in range(start // RUN, (end + RUN - 1) // RUN):
        boulder = False
        if ti.static(w.boulders > 0 and not w.relists):
            boulder = end > start and is_boulder(w, start)
        if s.near_run[run] >= since or boulder:
            for i in range(ti.max(start, run * RUN), ti.min(end, (run + 1) * RUN)):
                if s.near[i] >= since or boulder:
                    each_hit_of(w, s, c, i, since, ti.select(boulder, 1, w.lanes), do)


@ti.func
def each_hit_of(w: ti.template(), s: ti.template(), c: ti.template(), i, since, stride, do: ti.template()):
    """The same for the pairs of which grain i is the first; its rows are `stride` apart."""
    half = w.pace[None].half
    slot, k, link = half * w.capacity + i, 0, 0
    if ti.static(w.relists):
        link = w.strays.first[slot]
    rows = w.pairs.row_count[slot]
    p = 0
    while k < rows or link > 0:
        p = w.pairs.row_start[slot] + k * stride
        if ti.static(w.relists):
            if k >= rows:  # then those that it has got as a stray
                p, link = next_row(w, half, link, False)
        k += 1
        if ti.max(s.struck[i], s.struck[w.pairs.second[p]]) >= since:
            do(w, s, c, p, False)
    if s.struck[i] >= since:
        for q in range(w.pairs.wall_row_start[slot], w.pairs.wall_row_start[slot] + w.pairs.wall_row_count[slot]):
            do_with_wall(w, s, do, q)
        if ti.static(w.relists):
            link = w.strays.wall_first[slot]
            while link > 0:
                p, link = next_row(w, half, link, True)
                do_with_wall(w, s, do, p)
