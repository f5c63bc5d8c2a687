"""Boulders: a few grains much larger than the others, which must not enlarge everybody's cells.

They lie behind the others in the grain table, in a cell of their own, and make up a block of their own, the last one, that holds all
pairs that they are part of: with walls, with one another, and with the grains in the cells around them. As a boulder reaches into many
blocks of the sweep, that block is swept first, by itself.
"""

import numpy as np
import taichi as ti

from taichi_sand.world.blocks import block_count
from taichi_sand.world.geometry import position
from taichi_sand.world.search.candidates import list_pair, list_range
from taichi_sand.world.search.cell_list import cell_count
from taichi_sand.world.search.growth import BOULDER_WALLS, BOULDERS, lack
from taichi_sand.world.search.wall_candidates import list_walls
from taichi_sand.world.tables import round_up

BOULDER = 3.0
"""A boulder is larger than this many grains of median size."""
MOST_BOULDERS, LEAST_OTHERS = 256, 16
"""Only so many can be listed apart, and only if there are so many other grains for each: else all go into cells."""
LAYERS = 5.0
"""Room for pairs, in layers of mean grains around a boulder: those that touch it, that may before the next list build, and smaller ones."""


def part_boulders(radius: np.ndarray, discs: int) -> tuple[float, int]:
    """Of grains with these radii [m] and up to so many discs: diameter of the largest that is no boulder [m], rows of the neighbour list
    for the pairs of boulders; 0 = there are none.
    """
    apart = radius > BOULDER * np.median(radius)
    if not 0 < apart.sum() <= min(MOST_BOULDERS, len(radius) // (1 + LEAST_OTHERS)):
        return 2 * float(radius.max()), 0
    around = np.pi * (radius[apart] / radius[~apart].mean() + LAYERS)
    return 2 * float(radius[~apart].max()), discs * round_up(int(LAYERS * around.sum()) + int(apart.sum()) ** 2 // 2)


@ti.func
def is_boulder(w: ti.template(), i):
    """Whether grain i is larger than those that cells are made for."""
    return 2.0 * w.grains.radius[i] > w.box[None].listed * 1.00001


@ti.func
def list_boulders(w: ti.template()):
    """Lists the pairs of boulders, in the last rows for pairs of grains and the last for walls, and makes them a block."""
    pairs, blocks = ti.static(w.pairs, w.blocks)
    b, half = block_count(w) - 1, w.pace[None].half
    start, end = w.grid.start[cell_count(w) - 1], w.count[None]
    q, p = (half + 1) * w.half - w.boulder_walls, half * w.half + w.wall_base - w.boulders
    last, last_q = p + w.boulders, (half + 1) * w.half
    blocks.grain_start[b], blocks.grain_end[b] = start, end
    blocks.pair_start[b], blocks.wall_start[b] = p, q
    for i in range(start, end):
        row = half * w.capacity + i
        next_p = list_around(w, i, p, last)
        for j in range(i + 1, end):
            next_p = list_pair(w, i, j, next_p, last, 1)
        next_q = list_walls(w, i, q, last_q, True)
        pairs.row_start[row], pairs.row_count[row] = p, next_p - p
        pairs.wall_row_start[row], pairs.wall_row_count[row] = q, next_q - q
        p, q = next_p, next_q
    blocks.pair_end[b], blocks.wall_end[b] = p, q
    if p > last:
        lack(w, BOULDERS, p - blocks.pair_start[b], w.boulders)
    if q > last_q:
        lack(w, BOULDER_WALLS, q - blocks.wall_start[b], w.boulder_walls)


@ti.func
def list_around(w: ti.template(), i, p, last):
    """Lists boulder i with the grains in cells that it may reach. Returns the next row.

    Cells are as wide as two of the other grains that may meet need, so that a boulder sees by its radius farther, less one of theirs.
    """
    grid = ti.static(w.grid)
    count = ti.Vector([grid.columns[None], grid.rows[None]])
    reach = grid.cell_size[None] + w.grains.radius[i] - 0.5 * w.box[None].listed
    low = ti.cast(ti.floor((position(w, i) - reach) / grid.cell_size[None]), ti.i32)
    high = ti.cast(ti.floor((position(w, i) + reach) / grid.cell_size[None]), ti.i32)
    for k in ti.static(range(2)):
        if ti.static(w.periodic[k]):
            high[k] = ti.min(high[k], low[k] + count[k] - 1)
        else:  # what lies beyond the box is in the nearest cell
            low[k], high[k] = ti.min(ti.max(low[k], 0), count[k] - 1), ti.min(ti.max(high[k], 0), count[k] - 1)
    row = p
    for x in range(low.x, high.x + 1):
        for y in range(low.y, high.y + 1):
            cell = (x + count.x) % count.x * count.y + (y + count.y) % count.y
            row = list_range(w, i, grid.start[cell], grid.start[cell + 1], row, last, 1)
    return row
