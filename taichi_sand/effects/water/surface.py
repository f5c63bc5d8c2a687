"""Where the water is: cells whose pores are more than half full, and how far the surface is from the middle of the last one.

The surface lies between the middles of a wet cell and an air cell, θ of the way along, where both fills together are θ + 1/2: exact if it
is flat. The pressure is 0 there, not in the middle of the air cell (ghost fluid; Gibou et al. 2002): with that waves had half their
frequency.
"""

import taichi as ti

from taichi_sand.effects.water.grid import AIR, DRY_WALL, FLOWS, HOLE, INSIDE, SOLID, WALL, WET
from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.geometry import at_least

FULL = 0.5
LEAST_DEPTH = 0.01
"""θ is no smaller: pressures near a face that is hardly wet would be huge."""
LEAST_PORES, LEAST_ROOM = 0.2, 0.1


@ti.func
def find_pores(f: ti.template()):
    """Porosity of cells, and which are more than half full."""
    now = f.now[None]
    stride = now.rows + 2
    cells = ti.static(f.cells)
    for i in range(1, now.columns + 1):
        for j in range(1, now.rows + 1):
            row = i * stride + j
            solid = f.u.solid[row][0] + f.u.solid[row + stride][0] + f.v.solid[row][0] + f.v.solid[row + 1][0]
            pores = at_least(LEAST_PORES, 1.0 - 0.25 * solid)
            cells.pores[row] = pores
            cells.fill[row] *= now.marker / (pores * at_least(LEAST_ROOM, cells.room[row]))
            cells.kind[row] = ti.select(cells.fill[row] > FULL, WET, AIR)


@ti.func
def close_edges(f: ti.template()):
    """Kinds and fills of the cells beyond the edges."""
    now = f.now[None]
    stride = now.rows + 2
    for i in range(now.columns + 2):
        edge(f, i * stride, i * stride + now.rows, i * stride + 1, ti.static(f.wraps[1]), ti.static(f.opens[2]))
        edge(f, i * stride + now.rows + 1, i * stride + 1, i * stride + now.rows, ti.static(f.wraps[1]), ti.static(f.opens[3]))
    for j in range(now.rows + 2):
        edge(f, j, now.columns * stride + j, stride + j, ti.static(f.wraps[0]), ti.static(f.opens[0]))
        edge(f, (now.columns + 1) * stride + j, stride + j, now.columns * stride + j, ti.static(f.wraps[0]), ti.static(f.opens[1]))


@ti.func
def edge(f: ti.template(), row, other, inner, wraps: ti.template(), opens: ti.template()):
    """A cell beyond an edge: as the one on the other side, air, or solid."""
    if ti.static(wraps):
        f.cells.kind[row], f.cells.fill[row] = f.cells.kind[other], f.cells.fill[other]
    else:
        f.cells.kind[row], f.cells.fill[row] = ti.static(AIR if opens else SOLID), 0.0
        if ti.static(not opens):
            f.cells.fill[row] = f.cells.fill[inner]


@ti.func
def fill_holes(f: ti.template()):
    """A single air cell amid water is no surface."""
    now = f.now[None]
    stride = now.rows + 2
    kind = ti.static(f.cells.kind)
    for i in range(1, now.columns + 1):
        for j in range(1, now.rows + 1):
            row = i * stride + j
            if kind[row] == AIR and kind[row - stride] != AIR and kind[row + stride] != AIR and kind[row - 1] != AIR:
                if kind[row + 1] == WET or kind[row + 1] == HOLE:
                    kind[row] = HOLE
    for row in range((now.columns + 2) * stride):
        if kind[row] == HOLE:
            kind[row] = WET


@ti.func
def find_depths(f: ti.template(), faces: ti.template(), hop):
    """Which faces of a component are wet, and how deep; the cell before a face is `hop` rows back."""
    now = f.now[None]
    cells = ti.static(f.cells)
    for row in range(hop, (now.columns + 2) * (now.rows + 2)):
        one, two = cells.kind[row - hop], cells.kind[row]
        fenced = faces.block[row] == INSIDE
        wall, wet = one == SOLID or two == SOLID or fenced, one == WET or two == WET
        depth = 1.0
        if wet and not wall and one != two:
            depth = at_least(LEAST_DEPTH, ti.min(1.0, cells.fill[row - hop] + cells.fill[row] - 0.5))
        faces.depth[row] = depth
        faces.known[row] = ti.select(wall, ti.select(wet and not fenced, WALL, DRY_WALL), ti.select(wet, FLOWS, 0))


@ti.func
def find_heights(f: ti.template()):
    """How far the middles of cells are below the surface: exact to one cell either way if it is flat, as fills are ramps two cells wide."""
    now = f.now[None]
    cells = ti.static(f.cells)
    stride = now.rows + 2
    for i in range(1, now.columns + 1):
        for j in range(1, now.rows + 1):
            row, total = i * stride + j, 0.0
            for hop in ti.static((-1, 0, 1)):
                total += cells.fill[row + hop * stride - 1] + cells.fill[row + hop * stride] + cells.fill[row + hop * stride + 1]
            cells.depth[row] = total / 3.0 - 1.5


@noinline
def find_surface(f: ti.template()):
    """Kinds of all cells, wet faces and their depths."""
    find_pores(f)
    close_edges(f)
    fill_holes(f)
    close_edges(f)
    find_heights(f)
    find_depths(f, f.u, f.now[None].rows + 2)
    find_depths(f, f.v, 1)
