"""Waking and falling asleep: the grains are rearranged, and the pairs of sleepers are put aside."""

from typing import Any

import taichi as ti

from taichi_sand.world.blocks import always, sweep_block
from taichi_sand.world.extras.grain_rows import clear_motion, copy_at_rest
from taichi_sand.world.extras.steady_force import steady_force
from taichi_sand.world.geometry import add, perp, position, wall_row
from taichi_sand.world.search.cell_list import note_flight, permute
from taichi_sand.world.search.neighbour_list import build_neighbour_list_now
from taichi_sand.world.search.prefix_sum import prefix_sum, put_in_order
from taichi_sand.world.sleep.state import ASLEEP, MOST_PRICE, home, shake, site_of, sleep_pays, sleeper_block
from taichi_sand.world.sleep.wake import clear_stale_rows_now, wake_some_now
from taichi_sand.world.sweep import sweep_cells
from taichi_sand.world.tables import World


def rearrange(sim: Any) -> None:
    """Wakes the sleepers that are called, and lays those down that have been still; the solver of `sim` knows how long that is."""
    if sim.world.layout == "strips" and wake_some_now(sim.world):
        rebuild_neighbour_list(sim)
        clear_stale_rows_now(sim.world)
        return
    wake_all(sim.world, 0)
    rebuild_neighbour_list(sim)
    fall_asleep(sim.world, sim.solver)
    rebuild_neighbour_list(sim)


def rebuild_neighbour_list(sim: Any) -> None:
    """One list build, between launches; the world of `sim` gets larger tables if it needs them."""
    build_neighbour_list_now(sim.world)
    sim.fit_tables()


def wake(world: World) -> None:
    """Wakes everybody: after a change by hand, of gravity or of a parameter, and before grains come or go by hand. The next march makes
    tables larger that this list build has found too small.
    """
    if world.sleeps and world.sleep.state[None].asleep:
        wake_all(world, 1)
        build_neighbour_list_now(world)


@ti.kernel
def wake_all(w: ti.template(), everybody: ti.i32):
    """Makes all grains awake, for the next list build; those at woken sites, or everybody, also forget that they were still."""
    sleep = ti.static(w.sleep)
    awake, asleep = sleep.state[None].awake, sleep.state[None].asleep
    first = w.count[None] - asleep
    gone = first - awake
    ti.loop_config(serialize=w.serial)
    for i in range(awake):
        sleep.origin[i] = i
    ti.loop_config(serialize=w.serial)
    for k in range(asleep if gone == 0 else 0):
        get_up(w, first + k, awake + k, everybody)
    ti.loop_config(serialize=True)
    for k in range(asleep if gone > 0 else 0):  # into slots of other sleepers, so one after the other
        get_up(w, first + k, awake + k, everybody)
    ti.loop_config(serialize=w.serial)
    for site in range(sleep.woken.shape[0]):
        sleep.woken[site] = 0
    sleep.state[None].awake, sleep.state[None].asleep = awake + asleep, 0
    sleep.state[None].moved, sleep.state[None].due = 1, 0
    w.count[None] = awake + asleep
    w.pace[None].spent = 1


@ti.func
def get_up(w: ti.template(), j, i, everybody):
    """The sleeper of slot j is awake, in slot i."""
    sleep = ti.static(w.sleep)
    called = everybody == 1 or sleep.woken[home(w, j)] == 1
    copy_at_rest(w, j, i)
    w.grains.mobility[i] = sleep.mobility[j]
    sleep.still[i] = 0.0 if called else ASLEEP
    sleep.origin[i] = j


@ti.kernel
def fall_asleep(w: ti.template(), s: ti.template()):
    """After a list build of everybody: chooses who sleeps, puts them behind the others, and freezes their pairs."""
    state = ti.static(w.sleep.state)
    before = 0
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        before += ti.cast(w.sleep.still[i] >= 0.5 * ASLEEP, ti.i32)
    choose(w, s.constants[None].sleeping_time)
    if ti.static(w.layout == "cells"):
        weigh_in_colours(w, s)
    freeze(w)
    permute(w, w.count[None])
    lay_to_rest(w)
    if state[None].asleep > before:
        state[None].owed, state[None].price = 0.0, 1.0
    elif sleep_pays(w):
        state[None].owed, state[None].price = 0.0, ti.min(2.0 * state[None].price, MOST_PRICE)
    w.pace[None].spent = 1


@ti.func
def choose(w: ti.template(), patience):
    """`slot` of every grain, and its `origin`: those who stay awake first, then the sleepers by lattice site."""
    sleep, scratch = ti.static(w.sleep, w.grid.scratch.whole)
    count = w.count[None]
    ti.loop_config(serialize=w.serial)
    for site in range(sleep.start.shape[0]):
        sleep.restless[site], sleep.start[site] = 0, 0
    ti.loop_config(serialize=w.serial)
    for i in range(count):
        if sleep.still[i] < patience:
            sleep.restless[home(w, i)] = 1
    if ti.static(w.moves):
        shake(w)
    ti.loop_config(serialize=w.serial)
    for i in range(w.capacity):
        sleep.slot[i] = 0
        if i < count:
            quiet = may_sleep(w, i, patience)
            sleep.slot[i], scratch[i][0] = ti.cast(not quiet, ti.i32), -1
            if quiet:  # how many of its site before it
                scratch[i][0] = ti.atomic_add(sleep.start[home(w, i)], 1)
    prefix_sum(sleep.slot, w.grid.scratch.sums, w.layout == "cells")
    prefix_sum(sleep.start, w.grid.scratch.sums, w.layout == "cells")
    awake = sleep.slot[w.capacity - 1]  # that slot is empty
    ti.loop_config(serialize=w.serial)
    for site in range(sleep.start.shape[0]):
        add(sleep.start, site, awake)
    ti.loop_config(serialize=w.serial)
    for i in range(count):
        sleep.origin[sleep.slot[i] if scratch[i][0] < 0 else sleep.start[home(w, i)] + scratch[i][0]] = i
    if ti.static(w.layout == "cells"):
        for site in range(sleep.start.shape[0] - 1):
            put_in_order(sleep.origin, sleep.start[site], sleep.start[site + 1])
    ti.loop_config(serialize=w.serial)
    for k in range(count):
        sleep.slot[sleep.origin[k]] = k
        w.grid.source[k] = sleep.origin[k]
    sleep.state[None].awake, sleep.state[None].asleep = awake, count - awake


@ti.func
def may_sleep(w: ti.template(), i, patience):
    """Whether grain i has been still for long enough, and all around it are still, or it sleeps already."""
    sleep = ti.static(w.sleep)
    quiet = sleep.still[i] >= patience
    if quiet and sleep.still[i] < 0.5 * ASLEEP:
        site = w.grains.site[i]
        for x in range(site.x - 1, site.x + 2):
            for y in range(site.y - 1, site.y + 2):
                quiet = quiet and sleep.restless[site_of(w, x, y)] == 0
    return quiet


@ti.func
def freeze(w: ti.template()):
    """Copies the pairs among sleepers, and of sleepers with walls, to the third part of the neighbour list."""
    sleep, pairs = ti.static(w.sleep, w.pairs)
    awake, count, half = sleep.state[None].awake, w.count[None], w.pace[None].half
    ti.loop_config(serialize=w.serial)
    for k in range(w.capacity):
        sleep.row_count[k], sleep.wall_row_count[k] = 0, 0
        if k >= awake and k < count:
            at = half * w.capacity + sleep.origin[k]
            for n in range(pairs.row_count[at]):
                if sleep.slot[pairs.second[pairs.row_start[at] + n * w.lanes]] >= awake:
                    sleep.row_count[k] = sleep.row_count[k] + 1
            sleep.wall_row_count[k] = pairs.wall_row_count[at]
        sleep.row_start[k], sleep.wall_row_start[k] = sleep.row_count[k], sleep.wall_row_count[k]
    prefix_sum(sleep.row_start, w.grid.scratch.sums, w.layout == "cells")
    prefix_sum(sleep.wall_row_start, w.grid.scratch.sums, w.layout == "cells")
    b, row, wall_row = sleeper_block(w), 2 * w.half, 2 * w.half + w.wall_base
    w.blocks.pair_start[b], w.blocks.pair_end[b] = row, row + sleep.row_start[w.capacity - 1]
    w.blocks.wall_start[b], w.blocks.wall_end[b] = wall_row, wall_row + sleep.wall_row_start[w.capacity - 1]
    ti.loop_config(serialize=w.serial)
    for k in range(awake, count):
        add(sleep.row_start, k, row)
        add(sleep.wall_row_start, k, wall_row)
        freeze_pairs(w, k, half * w.capacity + sleep.origin[k])


@ti.func
def freeze_pairs(w: ti.template(), k, at):
    """Copies the pairs of sleeper k; `at` is its row in the table of where its pairs begin."""
    sleep, pairs = ti.static(w.sleep, w.pairs)
    row = sleep.row_start[k]
    for n in range(pairs.row_count[at]):
        p = pairs.row_start[at] + n * w.lanes
        if sleep.slot[pairs.second[p]] >= sleep.state[None].awake:
            copy_row(w, p, row, k, sleep.slot[pairs.second[p]])
            row += 1
    for n in range(pairs.wall_row_count[at]):
        p, q = pairs.wall_row_start[at] + n, sleep.wall_row_start[k] + n
        copy_row(w, p, q, k, pairs.second[p])
        copy_wall_row(w, p, q)


@ti.func
def copy_row(w: ti.template(), p, row, first, second):
    """Copies pair p to `row`, with new slots."""
    pairs = ti.static(w.pairs)
    pairs.first[row], pairs.second[row] = first, second
    for column in ti.static((pairs.reach, pairs.contact_distance, pairs.normal, pairs.gap, pairs.mass, pairs.root_mass, pairs.mass_t)):
        column[row] = column[p]
    for column in ti.static(pairs.memory):
        column[row] = column[p]
    if ti.static(w.clumps):
        for column in ti.static((pairs.discs, pairs.arms, pairs.rims, pairs.levers)):
            column[row] = column[p]


@ti.func
def copy_wall_row(w: ti.template(), p, row):
    """Copies what only a pair with a wall has."""
    for column in ti.static((w.pairs.along, w.pairs.bounds, w.pairs.slopes, w.pairs.side)):
        column[wall_row(w, row)] = column[wall_row(w, p)]
    if ti.static(w.moves):
        w.pairs.hinge[wall_row(w, row)] = w.pairs.hinge[wall_row(w, p)]


@ti.func
def lay_to_rest(w: ti.template()):
    """Stops the new sleepers, and sums up what they carry."""
    g, sleep, pairs = ti.static(w.grains, w.sleep, w.pairs)
    ti.loop_config(serialize=w.serial)
    for j in range(sleep.state[None].awake, w.count[None]):
        sleep.mobility[j], sleep.still[j] = g.mobility[j], ASLEEP
        clear_motion(w, j)
        p = position(w, j)
        note_flight(w, j, p, ti.Vector([0.0, 0.0]))
        if ti.static(w.layout != "cells"):
            sleep.balance[j], sleep.load[j] = ti.Vector([0.0, 0.0]), 0.0
        if sleep.mobility[j].x > 0.0:
            add(sleep.balance, j, w.box[None].gravity / sleep.mobility[j].x + steady_force(w, j).xy)
    if ti.static(w.layout != "cells"):
        b = sleeper_block(w)
        ti.loop_config(serialize=True)
        for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
            put_weight(w, pairs.first[p], p, -1.0)
            put_weight(w, pairs.second[p], p, 1.0)
        ti.loop_config(serialize=True)
        for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
            put_weight(w, pairs.first[p], p, -1.0)
    sleep.state[None].moved = 1


@ti.func
def weigh_in_colours(w: ti.template(), s: ti.template()):
    """In cells what sleepers will carry is summed up while everybody's pairs are still in cells: in parallel, in a fixed order."""
    for j in range(w.capacity):
        w.sleep.balance[j], w.sleep.load[j] = ti.Vector([0.0, 0.0]), 0.0
    sweep_cells(w, (put_pair,), sweep_block, s, s, always)


@ti.func
def put_pair(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Adds the force of pair p to what its grains will carry, in the slots they get, if both are to sleep."""
    awake = w.sleep.state[None].awake
    i = w.sleep.slot[w.pairs.first[p]]
    j = i if ti.static(wall) else w.sleep.slot[w.pairs.second[p]]
    if i >= awake and j >= awake:
        put_weight(w, i, p, -1.0)
        if ti.static(not wall):
            put_weight(w, j, p, 1.0)


@ti.func
def put_weight(w: ti.template(), j, p, way):
    """Adds the force of pair p to what sleeper j carries."""
    force, normal = w.pairs.force[p], w.pairs.normal[p]
    w.sleep.balance[j] = w.sleep.balance[j] + way * (force.x * normal + force.y * perp(normal))
    w.sleep.load[j] = w.sleep.load[j] + force.norm()
