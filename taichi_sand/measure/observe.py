"""Sums over the world tables, on the device, once a report.

Every kernel here runs over the blocks of the sweep, each block serially, and writes one row of sums a block; the host adds the rows
in order. So the sums depend on the layout of the world, never on the number of threads. `real` is the type they are summed in:
ti.f64 where the backend has it.
"""

import taichi as ti

from taichi_sand.measure.contacts import FAR_APART, gap_now
from taichi_sand.world.clumps import disc_around, discs_around
from taichi_sand.world.geometry import mobility, perp, spin, velocity
from taichi_sand.world.sweep import block_count

MASS, PX, PY, SPIN, KINETIC, POTENTIAL, SPEED2, HEIGHT, LOWEST, MOVING = range(10)
"""Columns of the sums over grains."""
GRAIN_COLUMNS = 10

LISTED, TOUCHING, OVERLAP, DEEPEST, PUSH, PUSHING, FLOOR, WALL, OUTER_X, OUTER_Y = range(10)
"""Columns of the sums over pairs."""
PAIR_COLUMNS = 10

SPACING, UP, GRAVITY = 0, 2, 4
"""Where the frame array keeps (x, y) of the lattice spacing [m], of the upward unit vector, of gravity [m/s2]."""

FLOOR_SLOPE = 0.17
"""A wall is a floor where its normal into the bed rises by more than this, sin 10 degrees."""
POINTS = 24
"""Points a disc is spread over when its area is dealt to cells."""
FULL = 1 << 22
"""Whole number that stands for one full cell."""


@ti.func
def place(w: ti.template(), frame: ti.template(), i, real: ti.template()):
    """Centre of grain i [m], in the type `real`."""
    g = ti.static(w.grains)
    x = (ti.cast(g.site[i].x, real) + 0.5) * frame[SPACING] + ti.cast(g.offset[i].x, real) + g.shift[i].x
    y = (ti.cast(g.site[i].y, real) + 0.5) * frame[SPACING + 1] + ti.cast(g.offset[i].y, real) + g.shift[i].y
    return ti.Vector([x, y])


@ti.kernel
def sum_grains(w: ti.template(), frame: ti.types.ndarray(), sums: ti.types.ndarray(), real: ti.template()):
    """sums[b, column] over the grains of block b that can move; LOWEST over all grains."""
    for b in range(block_count(w)):
        lowest = ti.cast(1e30, real)
        fastest = ti.cast(0.0, real)
        total = ti.Vector.zero(real, 9)
        for i in range(w.blocks.grain_start[b], w.blocks.grain_end[b]):
            x = place(w, frame, i, real)
            height = x.x * frame[UP] + x.y * frame[UP + 1]
            for k in range(discs_around(w, i)):
                disc = disc_around(w, i, k)
                lowest = ti.min(lowest, height + disc.x * frame[UP] + disc.y * frame[UP + 1] - disc.z)
            if mobility(w, i).x > 0.0:
                v = ti.cast(velocity(w, i), real)
                m = ti.cast(1.0, real) / mobility(w, i).x
                fastest = ti.max(fastest, v.dot(v))
                total[MASS] += m
                total[PX] += m * v.x
                total[PY] += m * v.y
                total[SPIN] += m * (x.x * v.y - x.y * v.x)
                total[KINETIC] += 0.5 * m * v.dot(v)
                total[POTENTIAL] -= m * (x.x * frame[GRAVITY] + x.y * frame[GRAVITY + 1])
                total[HEIGHT] += m * height
                total[8] += 1.0
                if mobility(w, i).z > 0.0:
                    inertia = ti.cast(1.0, real) / mobility(w, i).z
                    turning = ti.cast(spin(w, i), real)
                    total[SPIN] += inertia * turning
                    total[KINETIC] += 0.5 * inertia * turning * turning
        for column in ti.static(range(8)):
            sums[b, column] = total[column]
        sums[b, SPEED2] = fastest
        sums[b, LOWEST] = lowest
        sums[b, MOVING] = total[8]


@ti.kernel
def weigh_grains(w: ti.template(), mass: ti.types.ndarray()):
    """Mass of every grain by its slot [kg]; 0 of a fixed one."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        mass[i] = 1.0 / mobility(w, i).x if mobility(w, i).x > 0.0 else 0.0


@ti.func
def outer_side(w: ti.template(), p, wall: ti.template()):
    """Sign of the force that pair p exerts on the grains that can move, from outside: walls and fixed grains; 0 within."""
    first, second = w.pairs.first[p], w.pairs.second[p]
    side = -1.0
    if ti.static(not wall):
        one, two = w.grains.mobility[first].x > 0.0, w.grains.mobility[second].x > 0.0
        side = ti.cast(two, ti.f32) - ti.cast(one, ti.f32)
    return side


@ti.func
def observe(
    w: ti.template(), frame: ti.template(), p, wall: ti.template(), overlaps: ti.template(), base, total: ti.template(), real: ti.template()
):
    """Adds pair p to the sums of its block and writes its overlap [m], 0 if apart."""
    gap, normal = gap_now(w, p, wall)
    force = ti.cast(w.pairs.force[p], real)
    overlap = ti.max(ti.cast(-gap, real), 0.0)
    overlaps[p - base] = overlap
    total[LISTED] += ti.cast(gap < FAR_APART, real)
    if overlap > 0.0:
        total[TOUCHING] += 1.0
        total[OVERLAP] += overlap
        total[DEEPEST] = ti.max(total[DEEPEST], overlap)
    if force.x > 0.0:
        total[PUSH] += force.x
        total[PUSHING] += 1.0
    push = force.x * normal + force.y * perp(normal)  # of a wet contact it may be a pull
    side = outer_side(w, p, wall)
    total[OUTER_X] += side * push.x
    total[OUTER_Y] += side * push.y
    if ti.static(wall):
        total[WALL] += ti.sqrt(push.dot(push))
        if normal.x * frame[UP] + normal.y * frame[UP + 1] < -FLOOR_SLOPE:
            total[FLOOR] -= push.x * frame[UP] + push.y * frame[UP + 1]


@ti.kernel
def sum_pairs(w: ti.template(), frame: ti.types.ndarray(), sums: ti.types.ndarray(), overlaps: ti.types.ndarray(), real: ti.template()):
    """sums[b, column] over the pairs of block b, and every pair's overlap by its row within the half in use."""
    for b in range(block_count(w)):
        total = ti.Vector.zero(real, PAIR_COLUMNS)
        base = w.pace[None].half * w.half
        if ti.static(w.sleeps):
            base = w.half if w.blocks.pair_start[b] >= 2 * w.half else base  # frozen pairs come behind the others
        for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
            observe(w, frame, p, False, overlaps, base, total, real)
        for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
            observe(w, frame, p, True, overlaps, base, total, real)
        for column in ti.static(range(PAIR_COLUMNS)):
            sums[b, column] = total[column]


@ti.kernel
def count_bearing(w: ti.template(), least: ti.f32, bearing: ti.types.ndarray()):
    """bearing[i] += 1 for every contact of grain i that pushes with more than `least` [N]."""
    for b in range(block_count(w)):
        for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
            if w.pairs.force[p].x > least:
                ti.atomic_add(bearing[w.pairs.first[p]], 1)
                ti.atomic_add(bearing[w.pairs.second[p]], 1)
        for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
            if w.pairs.force[p].x > least:
                ti.atomic_add(bearing[w.pairs.first[p]], 1)


@ti.func
def carries(w: ti.template(), i, bearing: ti.template()):
    """Whether grain i is part of the packing: no rattler, which has fewer than two bearing contacts; a fixed grain always is."""
    return ti.cast(bearing[i] >= 2 or mobility(w, i).x == 0.0, ti.i32)


@ti.kernel
def count_ends(w: ti.template(), least: ti.f32, bearing: ti.types.ndarray(), ends: ti.types.ndarray()):
    """ends[b, 0]: ends of bearing contacts at moving grains that are no rattlers; ends[b, 1]: such grains."""
    for b in range(block_count(w)):
        met = 0
        grains = 0
        for i in range(w.blocks.grain_start[b], w.blocks.grain_end[b]):
            if bearing[i] >= 2 and mobility(w, i).x > 0.0:
                grains += 1
        for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
            i, j = w.pairs.first[p], w.pairs.second[p]
            if w.pairs.force[p].x > least and carries(w, i, bearing) == 1 and carries(w, j, bearing) == 1:
                met += ti.cast(mobility(w, i).x > 0.0, ti.i32) + ti.cast(mobility(w, j).x > 0.0, ti.i32)
        for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
            i = w.pairs.first[p]
            if w.pairs.force[p].x > least and bearing[i] >= 2 and mobility(w, i).x > 0.0:
                met += 1
        ends[b, 0] = met
        ends[b, 1] = grains


@ti.kernel
def deal_area(w: ti.template(), frame: ti.types.ndarray(), cell: ti.f32, filled: ti.types.ndarray(), real: ti.template()):
    """filled[cx, cy] += area of the grains in the cell, in parts of FULL: whole numbers, so that the order does not matter.

    Each disc is spread over POINTS of equal weight on a sunflower spiral; those that lie in an earlier disc of its grain do not count.
    """
    for i in range(w.count[None]):
        x = place(w, frame, i, real)
        for d in range(discs_around(w, i)):
            disc = disc_around(w, i, d)
            part = ti.cast(3.14159265 * disc.z * disc.z / (cell * cell) / POINTS * FULL, ti.i32)
            for k in range(POINTS):
                rho = disc.z * ti.sqrt((ti.cast(k, ti.f32) + 0.5) / POINTS)
                phi = 2.39996323 * ti.cast(k, ti.f32)
                point = disc.xy + rho * ti.Vector([ti.cos(phi), ti.sin(phi)])
                at = ti.cast(ti.floor((x + point) / cell), ti.i32)
                within = 0 <= at.x < filled.shape[0] and 0 <= at.y < filled.shape[1]
                if within and first_to_cover(w, i, d, point):
                    ti.atomic_add(filled[at.x, at.y], part)


@ti.func
def first_to_cover(w: ti.template(), i, d, point):
    """Whether no disc of grain i before disc d covers `point`, seen from the centre of the grain [m]."""
    first = True
    for earlier in range(d):
        disc = disc_around(w, i, earlier)
        if (point - disc.xy).norm_sqr() < disc.z * disc.z:
            first = False
    return first
