"""Candidates looked at closely: discs of theirs that may meet before the next list build get a row of the neighbour list."""

from typing import Any

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.clumps import MOST, disc_count, disc_of, turned
from taichi_sand.world.geometry import mobility, perp, spin, velocity, weigh_clumps
from taichi_sand.world.search.images import seen
from taichi_sand.world.search.pair_history import horizon_of, is_listed, link_row, remember
from taichi_sand.world.tables import ABREAST, FEW_ABREAST


@ti.func
def least_excess(x, y, u, v, near, since, until):
    """Least squared distance between the times `since` and `until` of two points that are (x, y) apart at time 0 and move apart by (u, v),
    less near^2.

    Of numbers, or of vectors of ABREAST numbers: plain arithmetic, so that a processor does them side by side.
    """
    when = -(x * u + y * v) / (u * u + v * v + 1e-30)
    when = ti.select(when > since, when, since)
    when = ti.select(when < until, when, until)
    x_then, y_then = x + u * when, y + v * when
    return x_then * x_then + y_then * y_then - near * near


@ti.func
def may_meet(reach, motion, near, horizon):
    """Whether two points `reach` apart that move apart by `motion` come closer than `near` within `horizon`."""
    return least_excess(reach.x, reach.y, motion.x, motion.y, near, 0.0, horizon) < 0.0


@ti.func
def abreast(column: ti.template(), first, part: ti.template(), many: ti.template()):
    """Component `part` of `many` rows."""
    return ti.Vector([column[first + k][part] for k in range(many)])


@ti.func
def near_of(w: ti.template(), i):
    """How near others have to come to grain i for a close look [m]."""
    box = w.box[None]
    return w.grains.radius[i] + 0.5 * box.listed + box.bridge + w.pace[None].skin + 1e-6 * (box.size.x + box.size.y)


@ti.func
def hits_among(w: ti.template(), flight, near, first, end, since, until):
    """Which of the next grains from `first` on, but before `end`, come within `near` of one on this flight between two times: a bit each,
    of as many as are looked at together.
    """
    grid = ti.static(w.grid)
    box = w.box[None]
    many = ti.static(at_once(w))
    x, y = abreast(grid.flight, first, 0, many) - flight.x, abreast(grid.flight, first, 1, many) - flight.y
    u, v = abreast(grid.flight, first, 2, many) - flight.z, abreast(grid.flight, first, 3, many) - flight.w
    if ti.static(w.sheared):
        x, u = seen(w, x, y, u)
    if ti.static(w.periodic[0]):
        x -= box.size.x * ti.floor(x / box.size.x + 0.5)
    if ti.static(w.periodic[1]):
        y -= box.size.y * ti.floor(y / box.size.y + 0.5)
    excess = least_excess(x, y, u, v, near, since, until)
    hits = ti.select(excess < 0.0, ti.Vector([1 << k for k in range(many)]), 0).sum()
    return hits & (1 << ti.min(end - first, many)) - 1


def at_once(world: Any) -> int:
    """Grains that are looked at together."""
    return FEW_ABREAST if world.layout == "cells" else ABREAST


@noinline
def list_range(w: ti.template(), i: ti.i32, start: ti.i32, end: ti.i32, p: ti.i32, last: ti.i32, lanes: ti.template()) -> ti.i32:
    """Lists grain i with those of the grains start .. end-1 that it may meet; with no lanes it only counts them."""
    flight, near, row = w.grid.flight[i], near_of(w, i), p
    many = ti.static(at_once(w))
    for group in range((end - start + many - 1) // many):
        first = start + group * many
        hits = hits_among(w, flight, near, first, end, 0.0, w.pace[None].horizon)
        while hits != 0:
            lowest = hits & -hits
            j = first + 31 - ti.math.clz(lowest)
            if ti.static(w.relists):  # strays are listed later
                if w.strays.number[j] == 0:
                    row = list_pair(w, i, j, row, last, lanes, False)
            else:
                row = list_pair(w, i, j, row, last, lanes, False)
            hits -= lowest
    return row


@noinline
def list_stray_range(w: ti.template(), i: ti.i32, start: ti.i32, end: ti.i32, p: ti.i32, last: ti.i32) -> ti.i32:
    """Lists grain i, a stray, with those that it may meet of the grains, or behind them the strays, start .. end-1, but for those it is
    listed with already. Returns the next row.
    """
    strays = ti.static(w.strays)
    own = strays.number[i] - 1
    flight, near, row = w.grid.flight[w.capacity + own], near_of(w, i), p
    since, until = w.pace[None].since * w.pace[None].step, strays.until[own]
    many = ti.static(at_once(w))
    for group in range((end - start + many - 1) // many):
        first = start + group * many
        hits = hits_among(w, flight, near, first, end, since, until)
        while hits != 0:
            lowest = hits & -hits
            j = first + 31 - ti.math.clz(lowest)
            stray = j >= w.capacity
            if stray:
                j = strays.slot[j - w.capacity]
            if (stray or strays.number[j] == 0) and j != i:
                if not is_listed(w, i, j):
                    row = list_pair(w, i, j, row, last, 1, True)
            hits -= lowest
    return row


@noinline
def list_pair(w: ti.template(), i: ti.i32, j: ti.i32, row: ti.i32, last: ti.i32, lanes: ti.template(), stray: ti.template()) -> ti.i32:
    """Lists the discs of grains i and j that, looked at closely, may meet; i may be a `stray`. Returns the next row."""
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
                    next_row = list_discs(w, i, j, a, b, reach, over, give.x, next_row, last, lanes, stray)
        else:
            next_row = list_discs(w, i, j, 0, 0, reach, over, give.x, next_row, last, lanes, stray)
    return next_row


@ti.func
def list_discs(w: ti.template(), i, j, a, b, reach, over, weight, row, last, lanes: ti.template(), stray: ti.template()):
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
    path, next_row = apart, row
    if ti.static(stray):  # the other one's flight goes on as it was foreseen
        time = w.pace[None].since * w.pace[None].step
        path += g.start_shift[j] + g.start_velocity[j] * time - g.shift[i]
        apart += g.shift[j] - g.shift[i]
        motion = g.start_velocity[j] - velocity(w, i)
    if may_meet(path, motion, rims.x + rims.y + w.box[None].bridge + w.pace[None].skin, horizon_of(w, i, stray)):
        next_row = row + ti.static(max(lanes, 1))
        if ti.static(lanes > 0):
            if row < last:  # what finds no room is counted all the same (world.search.growth)
                write_row(w, row, i, j, a, b, reach, apart, rims, weight, stray)
                if ti.static(w.sheared):
                    w.pairs.over[row] = over
                if ti.static(stray):
                    link_row(w, row, i, False)
    return next_row


@ti.func
def write_row(w: ti.template(), row, i, j, a, b, reach, apart, rims, weight, stray: ti.template()):
    """One row of the neighbour list for disc a of grain i and disc b of grain j, which are `apart`; their grains were `reach` at the last
    list build.
    """
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
    remember(w, row, i, j, stray)
