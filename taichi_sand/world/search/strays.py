"""Strays: grains that are listed by themselves, as they are much faster than most, or have left the path that was foreseen for them.

The list build foresees that grains fly straight on. Where a few fall onto a bed, or hit it, they alone would end the list for everybody
every few steps. Instead the list is made for most, and strays are listed one by one: those that are fast right after the list build, and
whoever leaves its path later on, from where it is then. Each is foreseen up to a time of its own, for a flight of FLIGHT diameters, and
then listed anew. Their pairs stand in a block of their own, behind those of the list build, that is swept first.

A pair that is listed stays so until the next list build, and is listed once: what it carries needs not be moved.
"""

from typing import Any, NamedTuple

import taichi as ti

from taichi_sand.taichi_support import field_pool
from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.blocks import block_count
from taichi_sand.world.extras.sinks import in_sink
from taichi_sand.world.geometry import position, present, velocity
from taichi_sand.world.search.candidates import list_stray_range, near_of
from taichi_sand.world.search.growth import BOULDER_WALLS, BOULDERS, NO_ROOMS, Rooms, lack
from taichi_sand.world.search.pair_history import clear_links, first_row
from taichi_sand.world.search.wall_candidates import list_walls

SPEEDS = 32
"""Classes of speed, each sqrt(2) times as fast as the one before."""
FEW = 16
"""At most a FEW-th of the grains are strays for their speed, or listed anew in one step; more are not cheaper than a list build."""
GAIN = 2.0
"""The list is made for most of the grains if their velocities differ that many times less than all do."""
FLIGHT = 4.0
"""Mean diameters for which the flight of a stray is foreseen: lattice sites know of walls that far (MOST_REACH)."""
SLOWEST = 4
"""Most grains have at least the speeds of this class, up to 2^-9.5 diameters a step: a list holds for 36 steps then."""
LEAST_STRAYS, LEAST_ROWS = 64, 512
ROOM = 8
"""A ROOM-th of the grains may be strays."""


class Strays(NamedTuple):
    """Grains that are listed by themselves, and their rows of the neighbour list: those of the block that boulders would have. Rows are
    counted from the first of that block, in each half; 0 = none, 1 = that row, and so on.
    """

    count: Any  # 0-D i32
    slot: Any  # of each; shape (strays,), i32
    until: Any  # time since the list build up to which its flight is foreseen [s]
    number: Any  # of each grain: 1 + which stray it is, 0 = none; shape (capacity,), i32
    first: Any  # of each grain: the row that was listed last with it as the first; shape (2 * capacity,), i32
    next: Any  # of each row: the one listed before it with the same first grain; shape (2 * rows,), i32
    partner: Any  # of each grain: the row that was listed last with it as the second
    next_partner: Any  # of each row: the one listed before it with the same second grain
    wall_first: Any  # of each grain: its row that was listed last with a wall; and the one before that
    wall_next: Any
    speeds: Any  # scratch: how many grains are how fast


def most_strays(relists: bool, capacity: int) -> int:
    """Strays that there may be among so many grains, if they are listed by themselves."""
    return max(LEAST_STRAYS, capacity // ROOM) if relists else 0


def room_for_strays(relists: bool, capacity: int) -> Rooms:
    """Rows for their pairs and for those with walls."""
    return Rooms(boulders=max(LEAST_ROWS, capacity), boulder_walls=max(LEAST_ROWS, capacity // 2)) if relists else NO_ROOMS


def may_stray(layout: str, sleeps: bool, moves: bool, boulders: bool, pack: Any, scene: Any) -> bool:
    """Whether strays are listed by themselves. Walls that move, sleepers, images of a periodic box and the discs of a clump are foreseen
    by list builds alone.
    """
    return layout == "one" and not (sleeps or moves or boulders or pack.clumps or any(scene.periodic))


def allocate_strays(real: Any, capacity: int, strays: int, rooms: Rooms) -> Strays | None:
    """Room for so many strays among `capacity` grains, and for rows of theirs; None if there are to be none."""
    if not strays:
        return None
    rows, wall_rows = rooms.boulders, rooms.boulder_walls
    sizes = {"slot": strays, "number": capacity, "first": 2 * capacity, "next": 2 * rows, "speeds": SPEEDS}
    sizes |= {"partner": 2 * capacity, "next_partner": 2 * rows, "wall_first": 2 * capacity, "wall_next": 2 * wall_rows}
    made = {name: field_pool.scalars(ti.i32, size) for name, size in sizes.items()}
    return Strays(count=field_pool.scalars(ti.i32, ()), until=field_pool.scalars(real, strays), **made)


@ti.func
def is_stray(w: ti.template(), i):
    """Whether grain i is listed by itself."""
    alone = False
    if ti.static(w.relists):
        alone = w.strays.number[i] > 0
    return alone


@ti.func
def most_of(w: ti.template(), low, high):
    """How fast two of the grains that the list is made for approach one another at most, and how fast they are [m/s], where the velocities
    of all lie between `low` and `high`.
    """
    speeds, pace = ti.static(w.strays.speeds, w.pace)
    count = present(w)
    unit = pace[None].step / w.box[None].diameter
    centre, spread, fastest = 0.5 * (low + high), 0.5 * (high - low).norm(), ti.max(ti.abs(low), ti.abs(high)).norm()
    if count > 0:
        mean = ti.Vector([0.0, 0.0])
        for i in range(count):
            mean += velocity(w, i)
        mean /= count
        for k in range(SPEEDS):
            speeds[k] = 0
        for i in range(count):
            away = (velocity(w, i) - mean) * unit
            speeds[speed_class(away.dot(away))] += 1
        top, left = SPEEDS - 1, count // FEW
        while top > SLOWEST and speeds[top] <= left:
            left -= speeds[top]
            top -= 1
        most = ti.pow(2.0, 0.5 * (top + 1 - 3 * SPEEDS // 4)) / unit
        if GAIN * most < spread:
            centre, spread, fastest = mean, most, mean.norm() + most
    pace[None].centre_x, pace[None].centre_y, pace[None].spread = centre.x, centre.y, 1.0001 * spread
    return 2.0 * spread, fastest


@ti.func
def speed_class(square):
    """Class of a speed, of which this is the square [diameters a step]."""
    exponent = (ti.bit_cast(ti.cast(square, ti.f32), ti.i32) >> 23) - 127
    return ti.min(ti.max(exponent + ti.static(3 * SPEEDS // 4), 0), SPEEDS - 1)


@ti.func
def part_strays(w: ti.template()):
    """Finds the grains that are faster than the list is made for, once they are sorted."""
    w.strays.count[None] = 0
    centre, spread = ti.Vector([w.pace[None].centre_x, w.pace[None].centre_y]), w.pace[None].spread
    for i in range(w.count[None]):
        away = velocity(w, i) - centre
        w.strays.number[i] = 0
        if away.dot(away) > spread * spread:
            become_stray(w, i)


@ti.func
def list_strays(w: ti.template()):
    """Lists the strays that there are right after a list build. What finds no room is counted all the same (world.search.growth)."""
    strays, blocks = ti.static(w.strays, w.blocks)
    half = w.pace[None].half
    b = block_count(w) - 1
    blocks.grain_start[b], blocks.grain_end[b] = 0, 0
    blocks.pair_start[b], blocks.wall_start[b] = first_row(w, half, False), first_row(w, half, True)
    blocks.pair_end[b], blocks.wall_end[b] = blocks.pair_start[b], blocks.wall_start[b]
    for i in range(w.count[None]):
        clear_links(w, half * w.capacity + i)
    for k in range(strays.count[None]):
        strays.until[k] = 0.0
    foresee_strays(w)
    if blocks.pair_end[b] > blocks.pair_start[b] + w.boulders:
        lack(w, BOULDERS, blocks.pair_end[b] - blocks.pair_start[b], w.boulders)
    if blocks.wall_end[b] > blocks.wall_start[b] + w.boulder_walls:
        lack(w, BOULDER_WALLS, blocks.wall_end[b] - blocks.wall_start[b], w.boulder_walls)


@ti.func
def relist(w: ti.template()):
    """Lists anew the grains that have left their foreseen paths, and the strays whose foreseen flight ends before the next step does; where
    they are many, or there is no room for their pairs, a list build is due instead.
    """
    pace, g, blocks = ti.static(w.pace, w.grains, w.blocks)
    pace[None].straying = 0
    if pace[None].strayed == 1:
        pace[None].strayed = 0
        time, astray = pace[None].since * pace[None].step, 0
        for i in range(w.count[None]):
            off = g.shift[i] - g.start_shift[i] - g.start_velocity[i] * time
            if 4.0 * off.dot(off) > pace[None].skin * pace[None].skin:
                astray += 1
                become_stray(w, i)
        if FEW * astray > w.count[None]:
            pace[None].spent = 1
    if pace[None].spent == 0:
        b, half = block_count(w) - 1, pace[None].half
        before = blocks.pair_end[b] + blocks.wall_end[b]
        foresee_strays(w)
        if blocks.pair_end[b] + blocks.wall_end[b] > before:
            pace[None].impacts = 1
        if blocks.pair_end[b] > first_row(w, half, False) + w.boulders or blocks.wall_end[b] > first_row(w, half, True) + w.boulder_walls:
            pace[None].spent = 1


@ti.func
def become_stray(w: ti.template(), i):
    """Grain i is listed by itself, from now on; if there are too many, a list build is due."""
    strays = ti.static(w.strays)
    if strays.number[i] == 0:
        if strays.count[None] < strays.slot.shape[0]:
            strays.slot[strays.count[None]] = i
            strays.count[None] += 1
            strays.number[i] = strays.count[None]
        else:
            w.pace[None].spent = 1
    if strays.number[i] > 0:
        strays.until[strays.number[i] - 1] = 0.0


@noinline
def foresee_strays(w: ti.template()):
    """Lists those of the strays that are due."""
    strays = ti.static(w.strays)
    soonest = ti.cast(1e30, w.real)
    now = ti.cast(w.pace[None].since + 1, w.real) * w.pace[None].step
    for k in range(strays.count[None]):
        if strays.until[k] < now:
            foresee_flight(w, k)
            strays.until[k] = -strays.until[k]  # all that are due know where they go before the first is listed
    for k in range(strays.count[None]):
        if strays.until[k] < 0.0:
            strays.until[k] = -strays.until[k]
            list_stray(w, strays.slot[k])
        soonest = ti.min(soonest, strays.until[k])
    w.pace[None].soonest = soonest


@ti.func
def foresee_flight(w: ti.template(), k):
    """Stray k flies straight on from where it is: traced back to the list build, so that all flights count from one time."""
    g = ti.static(w.grains)
    pace, i = w.pace[None], w.strays.slot[k]
    time, v, p = pace.since * pace.step, velocity(w, i), position(w, i)
    start = p - v * time
    if pace.since > 0 and is_away(w, i, p):
        w.pace[None].spent = 1
    g.start_velocity[i], g.start_shift[i] = v, g.shift[i] - v * time
    w.grid.flight[w.capacity + k] = ti.Vector([start.x, start.y, v.x, v.y])
    w.strays.until[k] = ti.min(pace.horizon, time + FLIGHT * w.box[None].diameter / (v.norm() + 1e-20))


@ti.func
def is_away(w: ti.template(), i, p):
    """Whether grain i, at p, is where a list build takes grains out, or puts them back."""
    away = not (p.dot(p) >= 0.0)
    for k in ti.static(range(2)):
        for end in ti.static(range(2)):
            beyond = -p[k] if ti.static(end == 0) else p[k] - w.box[None].size[k]
            away = away or beyond > (w.grains.radius[i] if ti.static(w.open_edges[2 * k + end]) else 0.0)
    if ti.static(w.flows):
        away = away or in_sink(w, i, p)
    return away


@ti.func
def list_stray(w: ti.template(), i):
    """Lists stray i with the grains in the cells that it crosses, with other strays, and with walls.

    Where the others were at the list build follows from where they are to be met: each has since moved with the velocity of most, give or
    take their spread.
    """
    grid, blocks = ti.static(w.grid, w.blocks)
    pace, b = w.pace[None], block_count(w) - 1
    own = w.strays.number[i] - 1
    flight, since, until = grid.flight[w.capacity + own], pace.since * pace.step, w.strays.until[own]
    reach = near_of(w, i) + pace.spread * until
    drift = flight.zw - ti.Vector([pace.centre_x, pace.centre_y])
    one, two = flight.xy + drift * since, flight.xy + drift * until
    most = ti.Vector([grid.columns[None], grid.rows[None]]) - 1
    low = ti.min(ti.max(ti.cast(ti.floor((ti.min(one, two) - reach) / grid.cell_size[None]), ti.i32), 0), most)
    high = ti.min(ti.max(ti.cast(ti.floor((ti.max(one, two) + reach) / grid.cell_size[None]), ti.i32), 0), most)
    row, last = blocks.pair_end[b], blocks.pair_start[b] + w.boulders
    for run in range(high.x - low.x + 2):  # the columns, and then the strays
        start, end = w.capacity, w.capacity + w.strays.count[None]
        if low.x + run <= high.x:
            cell = (low.x + run) * grid.rows[None]
            start, end = grid.start[cell + low.y], grid.start[cell + high.y + 1]
        row = list_stray_range(w, i, start, end, row, last)
    blocks.pair_end[b] = row
    blocks.wall_end[b] = list_walls(w, i, blocks.wall_end[b], blocks.wall_start[b] + w.boulder_walls, True, True)
