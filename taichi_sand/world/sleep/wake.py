"""Waking a few: most sleepers sleep on, their pairs stay frozen, and what it costs goes with those who wake and those who move up.

Not in cells: there all are woken, and those who may sleep are laid down again (world.sleep.fall_asleep).
"""

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.clumps import head
from taichi_sand.world.extras.grain_rows import (
    NUMBERS_AT_REST,
    WHOLE_AT_REST,
    clear_motion,
    load_row,
    move_carried,
    store_row,
)
from taichi_sand.world.geometry import add, perp, position, wall_row
from taichi_sand.world.search.cell_list import note_flight
from taichi_sand.world.search.neighbour_list import clear_rows
from taichi_sand.world.sleep.state import due_to_sleep, home, sleeper_block


@ti.func
def wake_some(w: ti.template()):
    """Puts the sleepers at woken sites behind those awake; a list build of the awake and `clear_stale_rows` must follow."""
    last = w.count[None]
    first = last - w.sleep.state[None].asleep
    end = number_anew(w, first, last)
    rename(w, first, last)
    move_up(w, first, end)


@ti.kernel
def wake_some_now(w: ti.template()) -> ti.i32:
    """Wakes the sleepers at woken sites, as a kernel. Returns 0, and does nothing, if others are to fall asleep."""
    woken = 0
    ti.loop_config(serialize=True)
    for _run in range(1):
        if not due_to_sleep(w):
            wake_some(w)
            woken = 1
    return woken


@noinline
def number_anew(w: ti.template(), first: ti.i32, last: ti.i32) -> ti.i32:
    """`slot` of every sleeper: those who wake first, then the others in the order they have. Returns the end of those who wake or move."""
    sleep = ti.static(w.sleep)
    slot = sleep.state[None].awake
    for j in range(first, last):
        sleep.slot[j] = -1
        if sleep.woken[home(w, j)] == 1:
            sleep.slot[j], sleep.still[j] = slot, 0.0
            slot += 1
    sleep.state[None].asleep -= slot - sleep.state[None].awake
    sleep.state[None].awake = slot
    at, old = slot, sleep.start[0]
    for site in range(sleep.start.shape[0] - 1):
        here = sleep.start[site + 1] - old
        old = sleep.start[site + 1]
        sleep.start[site] = at
        at += 0 if sleep.woken[site] == 1 else here
        sleep.woken[site] = 0
    sleep.start[sleep.start.shape[0] - 1] = at
    end = first
    for j in range(first, last):
        if sleep.slot[j] < 0:
            sleep.slot[j] = slot
            slot += 1
        if sleep.slot[j] != j or j < sleep.state[None].awake:
            end = j + 1
    w.count[None] = slot
    sleep.state[None].due = 0
    w.pace[None].spent = 1
    return end


@noinline
def rename(w: ti.template(), first: ti.i32, last: ti.i32):
    """The pairs of sleepers, frozen or with one awake, under the new slots."""
    sleep, pairs = ti.static(w.sleep, w.pairs)
    frozen = sleeper_block(w)
    for b in range(frozen + 1):
        for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
            for column in ti.static((pairs.first, pairs.second)):
                if column[p] >= first and column[p] < last:
                    column[p] = sleep.slot[column[p]]
    for p in range(w.blocks.wall_start[frozen], w.blocks.wall_end[frozen]):
        if pairs.first[p] >= first and pairs.first[p] < last:
            pairs.first[p] = sleep.slot[pairs.first[p]]


@noinline
def move_up(w: ti.template(), first: ti.i32, end: ti.i32):
    """Moves the sleepers first .. end-1, all that they carry and where their pairs begin to their new slots."""
    sleep, pairs, whole, number = ti.static(w.sleep, w.pairs, w.grid.scratch.whole, w.grid.scratch.number)
    for j in range(first, end):
        store_row(w, WHOLE_AT_REST, NUMBERS_AT_REST, j, j)
    for j in range(first, end):
        k = sleep.slot[j]
        load_row(w, WHOLE_AT_REST, NUMBERS_AT_REST, j, k)
        clear_motion(w, k)
        p = position(w, k)
        note_flight(w, k, p, ti.Vector([0.0, 0.0]))
        w.grid.source[k] = k
        if ti.static(w.clumps):
            w.grains.start_spin[k] = 0.0
            head(w, k)
    move_carried(w, first, end, sleep.slot)
    for j in range(first, end):
        m, b = sleep.mobility[j], sleep.balance[j]
        kept = [m.x, m.y, m.z, m.w, b.x, b.y, sleep.load[j], sleep.still[j]]
        for c in ti.static(range(8)):
            number[j][c] = kept[c]
    for j in range(first, end):
        k, n = sleep.slot[j], number[j]
        sleep.mobility[k] = ti.Vector([n[0], n[1], n[2], n[3]])
        sleep.balance[k], sleep.load[k], sleep.still[k] = ti.Vector([n[4], n[5]]), n[6], n[7]
        if k < sleep.state[None].awake:
            w.grains.mobility[k] = sleep.mobility[k]
    for j in range(first, end):
        rows = [sleep.row_start[j], sleep.row_count[j], sleep.wall_row_start[j], sleep.wall_row_count[j]]
        for c in ti.static(range(4)):
            whole[j][c] = rows[c]
    for j in range(first, end):
        k, i = sleep.slot[j], whole[j]
        sleep.row_start[k], sleep.row_count[k], sleep.wall_row_start[k], sleep.wall_row_count[k] = i[0], i[1], i[2], i[3]
        for half in ti.static(range(2)):
            at = half * w.capacity + k
            pairs.row_start[at], pairs.row_count[at], pairs.wall_row_start[at], pairs.wall_row_count[at] = i[0], i[1], i[2], i[3]


@noinline
def clear_stale_rows(w: ti.template()):
    """Empties the frozen rows of pairs of which one member is awake: the list build has listed them anew, with what they carried."""
    b = sleeper_block(w)
    first = w.count[None] - w.sleep.state[None].asleep
    for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
        i, j = w.pairs.first[p], w.pairs.second[p]
        if i < first or j < first:
            force, normal = w.pairs.force[p], w.pairs.normal[p]
            push = force.x * normal + force.y * perp(normal)
            if i >= first:
                ease(w, i, push, force.norm())
            if j >= first:
                ease(w, j, -push, force.norm())
            clear_rows(w, p, p + 1, 1)
    for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
        if w.pairs.first[p] < first:
            clear_wall_row(w, p)


@ti.func
def clear_wall_row(w: ti.template(), row):
    """A row for a pair with a wall that stands for none: the end of a wall, far away. Of a line the distance would have a sign, and the
    second of a pair of grains would be no part of a wall.
    """
    pairs = ti.static(w.pairs)
    k = wall_row(w, row)
    clear_rows(w, row, row + 1, 1)
    pairs.second[row], pairs.side[k] = 0, 0.0
    pairs.along[k], pairs.bounds[k] = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
    if ti.static(w.moves):
        pairs.hinge[k] = ti.Vector([0.0, 0.0])


@ti.kernel
def clear_stale_rows_now(w: ti.template()):
    """Empties the frozen rows of pairs of which one member is awake, as a kernel."""
    ti.loop_config(serialize=True)
    for _run in range(1):
        clear_stale_rows(w)


@ti.func
def ease(w: ti.template(), j, push, size):
    """A frozen force on sleeper j is frozen no more."""
    add(w.sleep.balance, j, push)
    add(w.sleep.load, j, -size)
