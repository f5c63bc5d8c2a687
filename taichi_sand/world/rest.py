"""Waking and falling asleep: the grains are rearranged, and the pairs of those who sleep are laid by."""

from typing import Any

import taichi as ti

from taichi_sand.world.carried import move_along
from taichi_sand.world.geometry import perp, position, wall_row
from taichi_sand.world.grid import permute
from taichi_sand.world.naps import ASLEEP, MOST_PRICE, home, shake, site_of, sleeper_block, tired
from taichi_sand.world.pairs import search_now
from taichi_sand.world.stir import bury, stir
from taichi_sand.world.tables import World


def rearrange(world: World, solver: Any) -> None:
    """Wakes the sleepers that are called, and lays those down that have been still; `solver` knows how long that is."""
    if world.layout != "cells" and stir(world):
        search_now(world)
        bury(world)
        return
    rouse(world, 0)
    search_now(world)
    lull(world, solver)
    search_now(world)


def wake(world: World) -> None:
    """Wakes everybody: after a change by hand, of gravity or of a parameter, and before grains come or go by hand."""
    if world.sleeps and world.naps.state[None].asleep:
        rouse(world, 1)
        search_now(world)


@ti.kernel
def rouse(w: ti.template(), everybody: ti.i32):
    """Makes all grains awake, for the next search; those at woken sites, or everybody, also forget that they were still."""
    g, naps = ti.static(w.grains, w.naps)
    awake, asleep = naps.state[None].awake, naps.state[None].asleep
    first = w.count[None] - asleep
    ti.loop_config(serialize=True)
    for i in range(awake):
        naps.origin[i] = i
    ti.loop_config(serialize=True)
    for k in range(asleep):
        j, i = first + k, awake + k
        called = everybody == 1 or naps.woken[home(w, j)] == 1
        g.site[i], g.id[i], g.kind[i] = g.site[j], g.id[j], g.kind[j]
        g.offset[i], g.shift[i], g.start_velocity[i] = g.offset[j], ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
        g.twist[i], g.wrench[i] = ti.Vector([0.0, 0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0, 0.0])
        g.angle[i], g.turn[i], g.radius[i] = g.angle[j], 0.0, g.radius[j]
        g.mobility[i] = naps.mobility[j]
        naps.still[i] = 0.0 if called else ASLEEP
        move_along(w, j, i)
        naps.origin[i] = j
    ti.loop_config(serialize=True)
    for site in range(naps.woken.shape[0]):
        naps.woken[site] = 0
    naps.state[None].awake, naps.state[None].asleep = awake + asleep, 0
    naps.state[None].moved, naps.state[None].due = 1, 0
    w.count[None] = awake + asleep
    w.pace[None].spent = 1


@ti.kernel
def lull(w: ti.template(), s: ti.template()):
    """After a search of everybody: chooses who sleeps, puts them behind the others, and freezes their pairs."""
    state = ti.static(w.naps.state)
    before = 0
    ti.loop_config(serialize=True)
    for i in range(w.count[None]):
        before += ti.cast(w.naps.still[i] >= 0.5 * ASLEEP, ti.i32)
    choose(w, s.constants[None].sleeping_time)
    freeze(w)
    permute(w, w.count[None])
    lay_to_rest(w)
    if state[None].asleep > before:
        state[None].owed, state[None].price = 0.0, 1.0
    elif tired(w):
        state[None].owed, state[None].price = 0.0, ti.min(2.0 * state[None].price, MOST_PRICE)
    w.pace[None].spent = 1


@ti.func
def choose(w: ti.template(), patience):
    """`slot` of every grain, and its `origin`: those who stay awake first, then the sleepers by lattice site."""
    naps = ti.static(w.naps)
    count = w.count[None]
    ti.loop_config(serialize=True)
    for site in range(naps.start.shape[0]):
        naps.restless[site], naps.start[site] = 0, 0
    ti.loop_config(serialize=True)
    for i in range(count):
        if naps.still[i] < patience:
            naps.restless[home(w, i)] = 1
    if ti.static(w.moves):
        shake(w)
    ti.loop_config(serialize=True)
    for _run in range(1):
        awake = 0
        for i in range(count):
            quiet = naps.still[i] >= patience
            if quiet and naps.still[i] < 0.5 * ASLEEP:
                site = w.grains.site[i]
                for x in range(site.x - 1, site.x + 2):
                    for y in range(site.y - 1, site.y + 2):
                        quiet = quiet and naps.restless[site_of(w, x, y)] == 0
            naps.slot[i] = -1
            if quiet:
                naps.start[home(w, i) + 1] += 1
            else:
                naps.slot[i] = awake
                naps.origin[awake] = i
                awake += 1
        naps.state[None].awake, naps.state[None].asleep = awake, count - awake
        naps.start[0] = awake
        for site in range(naps.start.shape[0] - 1):
            naps.start[site + 1] += naps.start[site]
        for i in range(count):
            if naps.slot[i] < 0:
                site = home(w, i)
                naps.slot[i] = naps.start[site]
                naps.origin[naps.start[site]] = i
                naps.start[site] += 1
        for k in range(naps.start.shape[0] - 1):
            site = naps.start.shape[0] - 1 - k
            naps.start[site] = naps.start[site - 1]
        naps.start[0] = awake
        for k in range(count):
            w.grid.source[k] = naps.origin[k]


@ti.func
def freeze(w: ti.template()):
    """Copies the pairs among sleepers, and of sleepers with walls, to the third part of the pair table."""
    naps, pairs = ti.static(w.naps, w.pairs)
    awake, half = naps.state[None].awake, w.pace[None].half
    ti.loop_config(serialize=True)
    for _run in range(1):
        row = 2 * w.half
        wall_end = 2 * w.half + w.wall_base
        b = sleeper_block(w)
        w.blocks.pair_start[b], w.blocks.wall_start[b] = row, wall_end
        for k in range(awake, w.count[None]):
            i = naps.origin[k]
            at = half * w.capacity + i
            naps.row_start[k], naps.wall_row_start[k] = row, wall_end
            for n in range(pairs.row_count[at]):
                p = pairs.row_start[at] + n * w.lanes
                if naps.slot[pairs.second[p]] >= awake:
                    copy_row(w, p, row, k, naps.slot[pairs.second[p]])
                    row += 1
            for n in range(pairs.wall_row_count[at]):
                p = pairs.wall_row_start[at] + n
                copy_row(w, p, wall_end, k, pairs.second[p])
                copy_wall_row(w, p, wall_end)
                wall_end += 1
            naps.row_count[k], naps.wall_row_count[k] = row - naps.row_start[k], wall_end - naps.wall_row_start[k]
        w.blocks.pair_end[b], w.blocks.wall_end[b] = row, wall_end


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
    for column in ti.static((w.pairs.along, w.pairs.bounds, w.pairs.side)):
        column[wall_row(w, row)] = column[wall_row(w, p)]
    if ti.static(w.moves):
        w.pairs.hinge[wall_row(w, row)] = w.pairs.hinge[wall_row(w, p)]


@ti.func
def lay_to_rest(w: ti.template()):
    """Stops the new sleepers, and sums up what they carry."""
    g, naps, pairs = ti.static(w.grains, w.naps, w.pairs)
    awake, gravity = naps.state[None].awake, w.box[None].gravity
    ti.loop_config(serialize=True)
    for j in range(awake, w.count[None]):
        naps.mobility[j], naps.still[j] = g.mobility[j], ASLEEP
        for column in ti.static((g.mobility, g.twist, g.wrench)):
            column[j] = ti.Vector([0.0, 0.0, 0.0, 0.0])
        g.start_velocity[j] = ti.Vector([0.0, 0.0])
        p = position(w, j)
        w.grid.flight[j] = ti.Vector([p.x, p.y, 0.0, 0.0])
        naps.balance[j], naps.load[j] = ti.Vector([0.0, 0.0]), 0.0
        if naps.mobility[j].x > 0.0:
            naps.balance[j] = gravity / naps.mobility[j].x
    b = sleeper_block(w)
    ti.loop_config(serialize=True)
    for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
        put_weight(w, pairs.first[p], p, -1.0)
        put_weight(w, pairs.second[p], p, 1.0)
    ti.loop_config(serialize=True)
    for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
        put_weight(w, pairs.first[p], p, -1.0)
    naps.state[None].moved = 1


@ti.func
def put_weight(w: ti.template(), j, p, way):
    """Adds the force of pair p to what sleeper j carries."""
    force, normal = w.pairs.force[p], w.pairs.normal[p]
    w.naps.balance[j] = w.naps.balance[j] + way * (force.x * normal + force.y * perp(normal))
    w.naps.load[j] = w.naps.load[j] + force.norm()
