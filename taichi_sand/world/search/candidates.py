"""Candidates looked at closely: discs of theirs that may meet before the next list build get a row of the neighbour list."""

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.clumps import MOST, disc_count, disc_of, turned
from taichi_sand.world.geometry import mobility, perp, spin, velocity, weigh_clumps
from taichi_sand.world.search.cell_list import GROUPS, ROOM, flight_of
from taichi_sand.world.search.images import seen
from taichi_sand.world.search.pair_history import remember


@ti.func
def least_excess(x, y, u, v, near, horizon):
    """Least squared distance within `horizon` of two points (x, y) apart that move apart by (u, v), less near^2.

    Of numbers, or of vectors of ABREAST numbers: plain arithmetic, so that a processor does them side by side (which LLVM sees where
    vectors are read and written as they lie in memory).
    """
    when = -(x * u + y * v) / (u * u + v * v + 1e-30)
    when = ti.select(when > 0.0, when, 0.0)
    when = ti.select(when < horizon, when, horizon)
    x_then, y_then = x + u * when, y + v * when
    return x_then * x_then + y_then * y_then - near * near


@ti.func
def may_meet(reach, motion, near, horizon):
    """Whether two points `reach` apart that move apart by `motion` come closer than `near` within `horizon`."""
    return least_excess(reach.x, reach.y, motion.x, motion.y, near, horizon) < 0.0


@ti.func
def scan_range(w: ti.template(), i, start, end, since, found):
    """Finds which of the grains start .. end-1 grain i may meet, a group of ABREAST slots at a time. Of the groups that hold any, found is
    how many there are so far; those from number `since` on are stored, as many as there is room for. Returns how many there are then.

    They are looked at closely when this is done for all grains of a block, a tenth of a list build sooner than one by one: a processor
    need not wait to know who may meet whom before it goes on.
    """
    grid = ti.static(w.grid)
    box = w.box[None]
    pace = w.pace[None]
    flight = flight_of(w, i)
    rounding = 1e-6 * (box.size.x + box.size.y)
    near = w.grains.radius[i] + 0.5 * box.listed + box.bridge + pace.skin + rounding
    many = ti.static(grid.flight.n)
    place = found - since
    for group in range(start // many, (end + many - 1) // many):
        first = group * many
        x, y = grid.flight[4 * group] - flight.x, grid.flight[4 * group + 1] - flight.y
        u, v = grid.flight[4 * group + 2] - flight.z, grid.flight[4 * group + 3] - flight.w
        if ti.static(w.sheared):
            x, u = seen(w, x, y, u)
        if ti.static(w.periodic[0]):
            x -= box.size.x * ti.floor(x / box.size.x + 0.5)
        if ti.static(w.periodic[1]):
            y -= box.size.y * ti.floor(y / box.size.y + 0.5)
        grid.scratch.excess[i] = least_excess(x, y, u, v, near, pace.horizon)
        hits = 0
        for k in ti.static(range(many)):
            hits |= ti.cast(grid.scratch.excess[i][k] < 0.0, ti.i32) << k
        hits &= (1 << ti.min(end - first, many)) - (1 << ti.max(start - first, 0))
        row = GROUPS * i + ti.select(place >= 0, ti.min(place, ti.static(ROOM)), ti.static(ROOM))  # the last is never read
        grid.scratch.met[row] = ti.Vector([first, hits])
        place += ti.cast(hits != 0, ti.i32)
    return place + since


@noinline
def list_found(w: ti.template(), i: ti.i32, count: ti.i32, p: ti.i32, last: ti.i32, lanes: ti.template()) -> ti.i32:
    """Lists grain i with those that the first `count` groups that are stored for it hold; with no lanes it only counts them. Returns the
    next row.
    """
    row = p
    for k in range(ti.min(count, ti.static(ROOM))):
        first, hits = w.grid.scratch.met[GROUPS * i + k][0], w.grid.scratch.met[GROUPS * i + k][1]
        while hits != 0:
            lowest = hits & -hits
            row = list_pair(w, i, first + 31 - ti.math.clz(lowest), row, last, lanes)
            hits -= lowest
    return row


@noinline
def list_range(w: ti.template(), i: ti.i32, start: ti.i32, end: ti.i32, p: ti.i32, last: ti.i32, lanes: ti.template()) -> ti.i32:
    """Lists grain i with those of the grains start .. end-1 that it may meet; with no lanes it only counts them."""
    row, since, found = p, 0, 1
    while since < found:
        found = scan_range(w, i, start, end, since, 0)
        row = list_found(w, i, found - since, row, last, lanes)
        since += ROOM
    return row


@noinline
def list_pair(w: ti.template(), i: ti.i32, j: ti.i32, row: ti.i32, last: ti.i32, lanes: ti.template()) -> ti.i32:
    """Lists the discs of grains i and j that, looked at closely, may meet. Returns the next row."""
    g = ti.static(w.grains)
    box = w.box[None]
    hop = g.site[j] - g.site[i]
    over = ti.cast(0.0, w.real)
    if ti.static(w.sheared):
        over = -ti.floor(ti.cast(hop.y, w.real) / box.sites.y + 0.5)
    for k in ti.static(range(2)):
        if ti.static(w.periodic[k]):
            hop[k] -= box.sites[k] * ti.cast(ti.floor(ti.cast(hop[k], w.real) / box.sites[k] + 0.5), ti.i32)
    reach = ti.cast(hop, w.real) * box.spacing + (g.offset[j] - g.offset[i])
    if ti.static(w.sheared):
        reach.x += over * w.shear[None].offset
        if over != 0.0:
            reach.x -= box.size.x * ti.floor(reach.x / box.size.x + 0.5)
    give = mobility(w, i) + mobility(w, j)
    next_row = row
    if give.x > 0.0:
        if ti.static(w.clumps):
            for a in range(disc_count(w, i)):
                for b in range(disc_count(w, j)):
                    next_row = list_discs(w, i, j, a, b, reach, over, give.x, next_row, last, lanes)
        else:
            next_row = list_discs(w, i, j, 0, 0, reach, over, give.x, next_row, last, lanes)
    return next_row


@ti.func
def list_discs(w: ti.template(), i, j, a, b, reach, over, weight, row, last, lanes: ti.template()):
    """Lists disc a of grain i and disc b of grain j, seen `over` boxes above itself, `reach` from grain to grain, if they may meet.
    Returns the next row.
    """
    g = ti.static(w.grains)
    rims = ti.Vector([g.radius[i], g.radius[j]])
    apart, motion = reach, velocity(w, j) - velocity(w, i)
    if ti.static(w.sheared):
        motion.x += over * w.shear[None].speed
    if ti.static(w.clumps):
        one, two = disc_of(w, i, a), disc_of(w, j, b)
        arm_i, arm_j = turned(w, i, one.xy), turned(w, j, two.xy)
        apart += arm_j - arm_i
        motion += spin(w, j) * perp(arm_j) - spin(w, i) * perp(arm_i)
        rims = ti.Vector([one.z, two.z])
    next_row = row
    if may_meet(apart, motion, rims.x + rims.y + w.box[None].bridge + w.pace[None].skin, w.pace[None].horizon):
        next_row = row + ti.static(max(lanes, 1))
        if ti.static(lanes > 0):
            if row < last:  # what finds no room is counted all the same (world.search.growth)
                write_row(w, row, i, j, a, b, reach, apart, rims, weight)
                if ti.static(w.sheared):
                    w.pairs.over[row] = over
    return next_row


@ti.func
def write_row(w: ti.template(), row, i, j, a, b, reach, apart, rims, weight):
    """One row of the neighbour list for disc a of grain i and disc b of grain j, which are `apart`, their grains `reach`."""
    g = ti.static(w.grains)
    pairs = ti.static(w.pairs)
    radii = rims.x + rims.y
    pairs.first[row], pairs.second[row] = i, j
    pairs.reach[row] = reach
    pairs.contact_distance[row] = radii
    pairs.normal[row] = apart / (apart.norm() + 1e-30)
    pairs.gap[row] = apart.norm() - radii
    if ti.static(w.clumps):
        pairs.discs[row] = a * MOST + b
        one, two = disc_of(w, i, a), disc_of(w, j, b)
        pairs.arms[row] = ti.Vector([one.x, one.y, two.x, two.y])
        pairs.rims[row] = rims
        weigh_clumps(w, row, i, j, False)
    else:
        turning = mobility(w, i).z * g.radius[i] ** 2 + mobility(w, j).z * g.radius[j] ** 2
        pairs.mass[row], pairs.mass_t[row] = 1.0 / weight, 1.0 / (weight + turning)
        pairs.root_mass[row] = ti.sqrt(1.0 / weight)
    remember(w, row, i, j)
