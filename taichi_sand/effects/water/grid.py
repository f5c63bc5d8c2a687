"""The grid of the water: a staggered (MAC) one over the box, its tables, and where the nodes of its components lie.

Cells 1 .. columns by 1 .. rows cover the box; one more all around is what lies beyond its edges. All tables have a row a cell, cell after
cell up a column: `u` of a row is on the left face of its cell, `v` on the lower one. Places are counted in cells, so that the middle of
cell (i, j) is at (i, j): the nodes of u are half a cell to the left of it, those of v half a cell below. In a periodic box the last face
is the first one again.
"""

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import taichi as ti

from taichi_sand.taichi_support import field_pool
from taichi_sand.world.tables import fill_struct, round_up

AIR, WET, SOLID, HOLE = 0, 1, -1, 2
"""Kinds of cells. A hole is an air cell with water all around it, and soon a wet one."""
FLOWS, WALL, DRY_WALL = 1, -1, -2
"""What is known of a face: water flows through it; it lies in an edge with water before it, or without, or in any other wall."""
EDGE, INSIDE = 1, 2
"""Faces that are blocked by an edge of the box, or by a wall inside it."""
MOST_LEVELS = 12
RATE = 12.0
"""Where markers have come too near to one another, or too far apart, the flow makes up for it so fast [1/s]. Without it a dam break loses
a fifth of its water; as much in every step, whatever its length, would feed the motion."""
KAPPA = 2 / 3
"""Of a disc, which stands for a sphere in a slab one grain thick, so much is solid: 4/3 π r³ over 2 r π r²."""
LEAST_CELLS, LEAST_MARKERS = 4096, 16384
"""Least room: so all small boxes are alike to kernels."""
COARSEST = 4
"""Grids of the multigrid halve until they are no wider than this one way."""


class Faces(NamedTuple):
    """Of one component; a row a cell."""

    speed: Any  # of the water [m/s]
    before: Any  # as the markers have it, before the forces of the step [m/s]
    weight: Any  # of the markers around
    known: Any  # FLOWS, WALL, DRY_WALL; k + 1 = its speed follows from the neighbours in the k-th layer, 0 = it has none; i32
    solid: Any  # solid fraction; times the speed of the grains to come [m/s]; of those that can move, times ρ/ρ_s; impulse owed
    #             by the grains' side [kg/(m s)]; a 4-vector
    drag: Any  # force of the grains per slip, and times their speed: (kg/(m3 s), N/m3), 2-vector
    gain: Any  # how much of the pressure gradient is left beside an implicit drag, 1 / (1 + a)
    share: Any  # coefficient of the pressure, ε / (1 + a) + s ρ/ρ_s
    depth: Any  # part of the way to the next cell's middle that is wet, 1 but at the surface
    pull: Any  # pressure gradient [Pa/m]
    felt: Any  # what grains feel of it: pull, speed and 1, all times the part that is wet; 4-vector
    block: Any  # EDGE, INSIDE: it lies in a wall; else 0; i32
    wall: Any  # speed of that wall [m/s]


class Cells(NamedTuple):
    """A row a cell, but for those of the multigrid, whose grids follow one another."""

    kind: Any  # AIR, WET, SOLID; i32
    fill: Any  # share of the pores that markers fill
    pores: Any  # porosity
    room: Any  # for markers, beside walls, over that of a cell
    met: Any  # which side of the square up and right of the middle a wall was first found to cross, see walls; i32
    owed: Any  # markers that grains have let go of, less those that they have taken up
    label: Any  # lowest row of those that water could get to from it; i32
    depth: Any  # how far the middle is below the surface, as far as that is near [cells]
    pressure: Any  # times Δt/ρ [m2/s]
    way: Any  # of the conjugate gradients [m2/s]
    image: Any  # of that under the matrix [1/s]
    middle: Any  # diagonal of the matrix [1/m2]
    left: Any  # what couples a cell to the one on its left, and below [1/m2]
    below: Any
    rest: Any  # right-hand side, and residual [1/s]
    answer: Any  # of the multigrid to it [m2/s]


class Wells(NamedTuple):
    """A row a [[water]] table with a `rate`."""

    region: Any  # x0, y0, x1, y1 [cells], 4-vector
    rate: Any  # [m2/s], below 0 drains off
    velocity: Any  # of water that wells up in the air [m/s], 2-vector
    span: Any  # from when until when [s], 2-vector
    owed: Any  # markers that are yet to come, or to go
    made: Any  # markers that have come; i32


@dataclass(frozen=True, eq=False)
class Fluid:
    """All tables of the water, and what of it is structure."""

    u: Faces
    v: Faces
    cells: Cells
    place: Any  # of the markers [cells], 2-vector, a row a marker
    velocity: Any  # of the markers [m/s], 2-vector
    now: Any  # 0-D struct of now_type
    wells: Any  # what wells up or drains off; a row each
    hits: Any  # of a wall with a square between four middles, the first one: place [cells], velocity [cells/s]; 4-vector
    lines: Any  # of walls, of the squares between four middles, by their lower left one: unit normal, distance from the origin
    #             [cells], speed along the normal [cells/s]; 4-vector, zeros = none
    levels: Any  # of the multigrid: columns, rows, first row of the tables, 0; 4-vector, i32
    sizes: Any  # of a kind of grains: radius of a disc of the same area / radius
    wraps: tuple  # whether the box is periodic along x, y
    opens: tuple  # whether its left, right, lower, upper edge is open
    reach: int  # nodes that it reaches either way
    rigid: bool  # whether contacts are impulses
    soaks: bool  # whether grains hold water of their own
    boulders: bool  # whether some are as wide as cells
    real: Any


def now_type(real: Any) -> Any:
    """Struct of the numbers of the water."""
    return ti.types.struct(
        columns=ti.i32,
        rows=ti.i32,
        width=real,  # of a cell [m]
        height=real,
        levels=ti.i32,  # grids of the multigrid
        markers=ti.i32,
        marker=real,  # share of a cell that one fills
        spread=real,  # width of the kernel that grains are dealt to the grid with, over that of a cell
        step=real,  # of the water, until it acts next [s]; 0 = it has not yet
        top=ti.i32,  # row of cells above which there is no water
        fastest=real,  # marker [m/s]
        rounds=ti.i32,  # of the conjugate gradients, in the last step
        left=real,  # divergence that they have left [1/s]
        rate=real,  # with which markers are brought back to their number [1/s]
        law=ti.i32,  # of drag: number in drag.LAWS
        gone=ti.i32,  # markers that have left through open edges
        wells=ti.i32,
        full=ti.i32,  # 1 = there was no room for a marker
        free=ti.i32,  # 1 = there is a free surface, 0 = all of the box is full
        fenced=ti.i32,  # 1 = there are walls inside the box
        density=real,  # [kg/m3]
        viscosity=real,  # [Pa s]
        permeability=real,  # of beds, over that by the law of drag
        gravity=ti.types.vector(2, real),  # [m/s2]
        next=real,  # length of the step that begins [s]
        time=real,  # when it begins [s]
    )


@dataclass(frozen=True)
class Plan:
    """How the box is cut up."""

    columns: int
    rows: int
    width: float  # of a cell [m]
    height: float


def plan(size: tuple[float, float], cell: float, wraps: tuple[bool, bool]) -> Plan:
    """Cells about `cell` [m] wide; a periodic way has an even number of them, as the multigrid's two colours need."""
    counts = [max(2, 2 * round(side / cell / 2) if wrap else round(side / cell)) for side, wrap in zip(size, wraps, strict=True)]
    return Plan(*counts, size[0] / counts[0], size[1] / counts[1])


def grids(columns: int, rows: int) -> list[tuple[int, int, int, int]]:
    """Columns, rows and first row in the tables of every grid of the multigrid, the finest first."""
    found, start = [], 0
    while len(found) < MOST_LEVELS:
        found.append((columns, rows, start, 0))
        start += (columns + 2) * (rows + 2)
        if min(columns, rows) <= COARSEST:
            break
        columns, rows = (columns + 1) // 2, (rows + 1) // 2
    return found


def allocate_faces(real: Any, count: int) -> Faces:
    """Empty tables of one component."""
    vectors = {"solid": 4, "drag": 2, "felt": 4}
    made = {name: field_pool.vectors(size, real, count) for name, size in vectors.items()}
    whole = {name: ti.i32 if name in ("known", "block") else real for name in Faces._fields if name not in vectors}
    return Faces(**made, **{name: field_pool.scalars(kind, count) for name, kind in whole.items()})


def allocate_cells(real: Any, count: int, total: int) -> Cells:
    """Empty tables of `count` cells, and `total` in all grids of the multigrid."""
    whole = ("middle", "left", "below", "rest", "answer")
    return Cells(
        **{
            name: field_pool.scalars(ti.i32 if name in ("kind", "label", "met") else real, total if name in whole else count)
            for name in Cells._fields
        }
    )


def allocate_wells(real: Any, count: int) -> Wells:
    """Empty tables of `count` wells and drains."""
    rows = round_up(count, 8)
    one, made = {name: field_pool.scalars(real, rows) for name in ("rate", "owed")}, field_pool.scalars(ti.i32, rows)
    pairs = {name: field_pool.vectors(2, real, rows) for name in ("velocity", "span")}
    return Wells(region=field_pool.vectors(4, real, rows), **pairs, made=made, **one)


def allocate(real: Any, plan: Plan, markers: int, kinds: int, wells: int) -> dict[str, Any]:
    """Tables of a grid, and of so many markers, as members of a Fluid."""
    found = grids(plan.columns, plan.rows)
    count, total = (plan.columns + 2) * (plan.rows + 2), sum((c + 2) * (r + 2) for c, r, _, _ in found)
    count, total, markers = round_up(count, LEAST_CELLS), round_up(total, 2 * LEAST_CELLS), round_up(markers + 1, LEAST_MARKERS)
    struct = now_type(real)
    start = dict.fromkeys(struct.members, 0) | {"gravity": (0.0, 0.0), "levels": len(found), "rate": RATE, "free": 1, **asdict(plan)}
    levels = field_pool.vectors(4, ti.i32, MOST_LEVELS)
    for k, row in enumerate(found):
        levels[k] = row
    return {
        "u": allocate_faces(real, count),
        "v": allocate_faces(real, count),
        "cells": allocate_cells(real, count, total),
        "lines": field_pool.vectors(4, real, count),
        "hits": field_pool.vectors(4, real, count),
        "place": field_pool.vectors(2, real, markers),
        "velocity": field_pool.vectors(2, real, markers),
        "now": fill_struct(struct, start),
        "wells": allocate_wells(real, wells),
        "levels": levels,
        "sizes": field_pool.scalars(real, round_up(kinds, 8)),
    }


@ti.func
def node(i, last, count, wraps: ti.template()):
    """The node of a component that stands for node i: the nearest one of 1 .. last, or in a periodic box one of 1 .. count."""
    found = ti.max(1, ti.min(last, i))
    if ti.static(wraps):
        found = (i - 1 + count) % count + 1
    return found


@ti.func
def mirror(i, count, on_wall: ti.template(), wraps: ti.template()):
    """The node of a component that bears what would fall on node i: mirrored at an edge, on which the first and last ones lie, or half
    a cell beyond them.
    """
    found = i
    if ti.static(wraps):
        found = (i - 1 + count) % count + 1
    elif ti.static(on_wall):
        found = ti.select(i < 1, 2 - i, ti.select(i > count + 1, 2 * count + 2 - i, i))
    else:
        found = ti.select(i < 1, 1 - i, ti.select(i > count, 2 * count + 1 - i, i))
    return found


@ti.func
def corners(f: ti.template(), c: ti.template(), p):
    """The four nodes of component c (0: u, 1: v, 2: middles of cells) around place p [cells], as rows: lower left, right, upper left,
    right; and how far p is along from the first, x and y.
    """
    now = f.now[None]
    columns, rows = now.columns, now.rows
    x, y = p.x + ti.static(0.5 if c == 0 else 0.0), p.y + ti.static(0.5 if c == 1 else 0.0)
    last_x, last_y = columns + ti.static(int(c == 0)), rows + ti.static(int(c == 1))
    i, j = ti.floor(x, ti.i32), ti.floor(y, ti.i32)
    a, b = node(i, last_x, columns, f.wraps[0]), node(i + 1, last_x, columns, f.wraps[0])
    low, high = node(j, last_y, rows, f.wraps[1]), node(j + 1, last_y, rows, f.wraps[1])
    stride = rows + 2
    return ti.Vector([a * stride + low, b * stride + low, a * stride + high, b * stride + high]), ti.Vector([x - i, y - j])


@ti.func
def lerp(values, t):
    """Values at four corners, bilinear at t."""
    lower = (1.0 - t.x) * values[0] + t.x * values[1]
    upper = (1.0 - t.x) * values[2] + t.x * values[3]
    return (1.0 - t.y) * lower + t.y * upper


@ti.func
def close_ring(f: ti.template(), faces: ti.template(), c: ti.template()):
    """In a periodic box the faces of component c beyond the last are the first ones again: speed and what grains are."""
    columns, rows = f.now[None].columns, f.now[None].rows
    stride = rows + 2
    if ti.static(f.wraps[0] and c == 0):
        for j in range(1, rows + 1):
            copy_face(faces, (columns + 1) * stride + j, stride + j)
    if ti.static(f.wraps[1] and c == 1):
        for i in range(1, columns + 1):
            copy_face(faces, i * stride + rows + 1, i * stride + 1)


@ti.func
def copy_face(faces: ti.template(), to, row):
    """All numbers of a face."""
    for column in ti.static(faces):
        column[to] = column[row]
