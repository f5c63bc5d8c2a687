"""The contacts of a world as rows, in the order of the ids of their grains. The work of sorting them knows nothing of the world: it is
compiled once for all.
"""

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import taichi as ti

from taichi_sand.measure.pairs import (
    BRIDGE,
    COUPLE,
    DISCS,
    HISTORY,
    MORE,
    NORMAL,
    ONE,
    OVERLAP,
    PART,
    POINT,
    PUSH,
    ROW,
    SLIDE,
    STATE,
    TWO,
    Exacts,
    Found,
    Wholes,
    pairs_of,
    take,
)
from taichi_sand.measure.wall_numbers import WallNumbers, wall_numbers
from taichi_sand.world.tables import World

NAMES = (
    *("id1", "id2", "disc1", "disc2", "bridge"),
    *("point", "normal", "overlap", "force_n", "force_t", "history", "couple"),
)
FIRST_EXACT = 5
"""The first names are whole numbers."""
CONTACT = np.dtype(
    [(name, np.int64 if k < FIRST_EXACT else np.float64, (2,) if name in ("point", "normal") else ()) for k, name in enumerate(NAMES)]
)
"""A row; every number has 8 bytes."""
WORDS = CONTACT.itemsize // 8

Integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
Words = ti.types.ndarray(dtype=ti.types.vector(None, None), ndim=1)
"""Rows of any numbers."""


@ti.func
def number_of_wall(part, x, y, start: ti.template(), pieces: ti.template()):
    """Number of the wall that a part belongs to at this point."""
    best, number = ti.cast(1e30, ti.f32), -1
    for k in range(start[part], start[part + 1]):
        a = ti.Vector([pieces[k, 1], pieces[k, 2]])
        way = ti.Vector([pieces[k, 3], pieces[k, 4]]) - a
        off = ti.Vector([ti.cast(x, ti.f32), ti.cast(y, ti.f32)]) - a
        off -= ti.min(1.0, ti.max(0.0, off.dot(way) / (way.dot(way) + 1e-30))) * way
        if off.norm() < best:
            best, number = off.norm(), ti.cast(pieces[k, 0], ti.i32)
    return number


@ti.func
def later(whole: ti.template(), k, than):
    """Whether row k, of the same lower id, comes after another one."""
    return whole[k][TWO] > whole[than][TWO] or (whole[k][TWO] == whole[than][TWO] and whole[k][DISCS] > whole[than][DISCS])


@ti.func
def sort_by_ids(
    whole: ti.template(),
    exact: ti.template(),
    start: ti.template(),
    pieces: ti.template(),
    first: ti.template(),
    order: ti.template(),
    walls: ti.template(),
    alone: ti.template(),
):
    """Gives the rows of walls their numbers, and finds the place of each row by ids, which is left in ROW; without `walls` these rows get
    none. `first` has two numbers more than there are ids; the last but one becomes how many have a place.
    """
    ti.loop_config(serialize=alone)
    for id in range(first.shape[0]):
        first[id] = 0
    ti.loop_config(serialize=alone)
    for k in range(whole.shape[0]):
        if ti.static(walls):
            if whole[k][TWO] < 0:
                whole[k][TWO] = -1 - number_of_wall(-1 - whole[k][TWO], exact[k][POINT], exact[k][POINT + 1], start, pieces)
        if ti.static(walls) or whole[k][TWO] >= 0:
            take(first, whole[k][ONE] + 1, 1, alone)
    ti.loop_config(serialize=True)
    for id in range(1, first.shape[0]):
        first[id] += first[id - 1]
    ti.loop_config(serialize=alone)
    for k in range(whole.shape[0]):
        if ti.static(walls) or whole[k][TWO] >= 0:
            order[take(first, whole[k][ONE], 1, alone)] = k
    ti.loop_config(serialize=alone)
    for id in range(first.shape[0] - 1):  # first[id] is now where those of `id` end
        low = first[id - 1] if id > 0 else 0
        for m in range(low + 1, first[id]):
            k, n = order[m], m
            while n > low and later(whole, order[ti.max(n - 1, 0)], k):
                order[n] = order[n - 1]
                n -= 1
            order[n] = k
        for m in range(low, first[id]):
            whole[order[m]][ROW] = m


@ti.kernel
def lay_contacts(
    whole: Wholes,
    exact: Exacts,
    start: Integers,
    pieces: ti.types.ndarray(dtype=ti.f32, ndim=2),
    first: Integers,
    order: Integers,
    names: Words,
    numbers: Words,
    alone: ti.template(),
):
    """Fills rows of CONTACT, in order: whole numbers into `names`, then the others into `numbers`; both may be the same memory."""
    sort_by_ids(whole, exact, start, pieces, first, order, True, alone)
    ti.loop_config(serialize=alone)
    for k in range(whole.shape[0]):  # as they were found: their neighbours are in the caches then
        row, x = whole[k], exact[k]
        m, wall = row[ROW], row[TWO] < 0
        words = (row[ONE], row[TWO], row[DISCS] // PART, -1 if wall else row[DISCS] % PART, row[STATE] & BRIDGE)
        for c in ti.static(range(FIRST_EXACT)):
            names[m][c] = words[c]
        push, slide = x[PUSH] + x[MORE], x[SLIDE] + x[MORE + 1]
        values = (x[POINT], x[POINT + 1], x[NORMAL], x[NORMAL + 1], x[OVERLAP], push, slide, x[HISTORY], x[COUPLE])
        for c in ti.static(range(WORDS - FIRST_EXACT)):
            numbers[m][FIRST_EXACT + c] = values[c]


_numbers: WeakKeyDictionary[World, WallNumbers] = WeakKeyDictionary()


def numbers_of(sim: Any) -> WallNumbers:
    """The numbers of the walls of a simulation."""
    known = _numbers.get(sim.world)
    if known is None or known.walls is not sim.scene.walls:
        known = _numbers[sim.world] = wall_numbers(sim.scene, sim.world.box[None].least)
    return known


def contacts(sim: Any, every: bool = False) -> np.ndarray:
    """Contacts of `sim`, a Simulation, of type CONTACT, (n,), by ids; with `every` all pairs of the neighbour list."""
    return as_contacts(sim, pairs_of(sim, every))


def as_contacts(sim: Any, found: Found) -> np.ndarray:
    """The same of pairs that have been read, which are not to be used any more."""
    walls, many, kind = numbers_of(sim), len(found.whole), found.exact.dtype
    rows = np.empty((many, WORDS), kind)
    names = rows.view(np.int64) if kind == np.float64 else np.empty((many, FIRST_EXACT), np.int32)
    if many:
        first, order = np.empty(sim.made + 2, np.int32), np.empty(many, np.int32)
        lay_contacts(found.whole, found.exact, walls.start, walls.pieces, first, order, names, rows, sim.world.serial)
    if kind == np.float64:
        return rows.view(CONTACT)[:, 0]
    wide = rows.astype(np.float64)
    wide.view(np.int64)[:, :FIRST_EXACT] = names
    return wide.view(CONTACT)[:, 0]
