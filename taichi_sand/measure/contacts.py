"""The contacts of a world, as rows: who touches whom, where, and with which force. All that looks at single contacts looks here.

A row belongs to a pair of discs, or of a disc and a wall, that overlap where they are now, or that pushed or pulled in the last step, or
have a liquid bridge. `point`, `overlap` and which rows there are go by the places of this moment. Forces are those of the last step, along
the normal that they were found with: where the grains are now (rigid, and md but for symplectic Euler), or were at the start of the last
step (md with symplectic Euler, which takes forces from there).
"""

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import taichi as ti

from taichi_sand.measure.wall_numbers import WallNumbers, wall_numbers
from taichi_sand.world.clumps import MOST, turned
from taichi_sand.world.geometry import distance_to_second, moved, radii, spin, turned_by, velocity, wall_row
from taichi_sand.world.search.pair_history import BEYOND, discs_of
from taichi_sand.world.sweep import block_count
from taichi_sand.world.tables import World

NAMES = (
    *("id1", "id2", "disc1", "disc2", "bridge"),
    *("point", "normal", "overlap", "force_n", "force_t", "history", "couple"),
)
WHOLE = 5
"""The first names are whole numbers."""
CONTACT = np.dtype(
    [(name, np.int64 if k < WHOLE else np.float64, (2,) if name in ("point", "normal") else ()) for k, name in enumerate(NAMES)]
)
"""A row; every number has 8 bytes."""
WORDS = CONTACT.itemsize // 8
FAR_APART = 1e12
"""Rows that hold no pair are farther apart than this [m]."""
PART = 1 << 24
"""More parts than this the walls have not."""


def real_of(sim: Any) -> tuple[Any, Any]:
    """Type to measure in, for Taichi and for NumPy: f64 where the backend has it."""
    wide = sim.arch in ("cpu", "cuda", "x64", "arm64")
    return (ti.f64, np.float64) if wide else (ti.f32, np.float32)


@ti.func
def place(w: ti.template(), i, real: ti.template()):
    """Centre of grain i [m], in the type `real`."""
    g = ti.static(w.grains)
    spacing = ti.cast(w.box[None].spacing, real)
    return (ti.cast(g.site[i], real) + 0.5) * spacing + ti.cast(g.offset[i], real) + ti.cast(g.shift[i], real)


@ti.func
def gap_now(w: ti.template(), p, wall: ti.template()):
    """Gap of pair p at the present places [m] and its unit normal."""
    distance, normal = distance_to_second(w, p, w.pairs.first[p], wall)
    return distance - radii(w, p, wall), normal


@ti.func
def is_wall(w: ti.template(), p):
    """Whether row p is for a disc and a wall."""
    return p % w.half >= w.wall_base


def columns(solver: Any, name: str) -> list[Any]:
    """The columns of the neighbour list in which effects remember something of that name: the hand has a method `spring`."""
    found = [getattr(effect, name, None) for effect in solver.effects]
    return [column for column in found if hasattr(column, "to_numpy")]


@ti.func
def remembered(s: ti.template(), name: ti.template(), p):
    """What the effects remember of pair p by that name; 0 if none does."""
    value = 0.0
    for column in ti.static(columns(s, name)):
        value += column[p]
    return value


@ti.func
def went(w: ti.template(), p, i, second: ti.template()):
    """By how much the disc of grain i that pair p is about has moved in the last step [m]."""
    step = w.pace[None].step
    way = velocity(w, i) * step
    if ti.static(w.clumps):
        arm, turn = turned(w, i, w.pairs.arms[p].zw if ti.static(second) else w.pairs.arms[p].xy), -spin(w, i) * step
        way += arm - turned_by(ti.Vector([ti.cos(turn), ti.sin(turn)]), arm)
    return way


@ti.func
def normal_of_force(w: ti.template(), s: ti.template(), p, distance, normal, wall: ti.template()):
    """Normal that the force of pair p goes with; `distance` and `normal` as they are now."""
    found = normal
    if ti.static(s.lags):
        i = w.pairs.first[p]
        if ti.static(wall):
            m, motion = -1, ti.Vector([0.0, 0.0, 0.0, 0.0])
            if ti.static(w.moves):
                m = w.movers.wall[w.pairs.second[p]]
                if m >= 0:
                    motion = w.movers.twist[m]
            if w.pairs.side[wall_row(w, p)] != 0.0:
                turn = -motion.z * w.pace[None].step
                found = turned_by(ti.Vector([ti.cos(turn), ti.sin(turn)]), normal)
            elif distance < BEYOND:
                before = distance * normal + went(w, p, i, False)
                if ti.static(w.moves):
                    if m >= 0:
                        turn = motion.z * w.pace[None].step
                        arm = moved(w, p, i, False) + distance * normal - w.pairs.hinge[wall_row(w, p)] - w.movers.pose[m].zw
                        back = turned_by(ti.Vector([ti.cos(turn), -ti.sin(turn)]), arm)
                        before -= w.pace[None].step * motion.xy + arm - back
                found = before / (before.norm() + 1e-30)
        else:
            before = distance * normal + went(w, p, i, False) - went(w, p, w.pairs.second[p], True)
            found = before / (before.norm() + 1e-30)
    return found


def notes(solver: Any) -> bool:
    """Whether contacts pass on more in a step than the force that they carry at its end: see solvers.noting."""
    return hasattr(solver, "passed")


@ti.func
def push_of(w: ti.template(), s: ti.template(), p):
    """What pair p has passed on in the last step: normal and tangential force [N], by the normal that its force goes with."""
    push = w.pairs.force[p]
    if ti.static(notes(s)):
        if w.pace[None].noted == 1:
            push += ti.Vector([s.passed[0][p], s.passed[1][p]])
    return push


@ti.func
def point_of(w: ti.template(), p, gap, normal, wall: ti.template(), real: ti.template()):
    """Where pair p touches: in the middle of the overlap, or on the wall; in the box where that is periodic [m]."""
    i = w.pairs.first[p]
    reach, arm = w.grains.radius[i], ti.Vector([0.0, 0.0])
    if ti.static(w.clumps):
        reach, arm = w.pairs.rims[p].x, turned(w, i, w.pairs.arms[p].xy)
    if gap < BEYOND:
        reach += gap if ti.static(wall) else 0.5 * gap
    point = place(w, i, real) + ti.cast(arm + reach * normal, real)
    for k in ti.static(range(2)):
        if ti.static(w.periodic[k]):
            size = ti.cast(w.box[None].size[k], real)
            point[k] -= ti.floor(point[k] / size) * size
    return point


@ti.func
def number_of_wall(w: ti.template(), part, point, start: ti.template(), pieces: ti.template()):
    """Number of the wall that a part belongs to at this point."""
    best, number = ti.cast(1e30, ti.f32), -1
    for k in range(start[part], start[part + 1]):
        a = ti.Vector([ti.cast(pieces[k, 1], ti.f32), ti.cast(pieces[k, 2], ti.f32)])
        way = ti.Vector([ti.cast(pieces[k, 3], ti.f32), ti.cast(pieces[k, 4], ti.f32)]) - a
        off = ti.cast(point, ti.f32) - a
        off -= ti.min(1.0, ti.max(0.0, off.dot(way) / (way.dot(way) + 1e-30))) * way
        if off.norm() < best:
            best, number = off.norm(), ti.cast(pieces[k, 0], ti.i32)
    return number


@ti.func
def find(
    w: ti.template(),
    s: ti.template(),
    p,
    wall: ti.template(),
    every,
    start: ti.template(),
    pieces: ti.template(),
    lists: ti.template(),
    many: ti.template(),
    first: ti.template(),
):
    """Notes row p, if it is a contact, or with `every` a pair."""
    i = w.pairs.first[p]
    j = i if ti.static(wall) else w.pairs.second[p]
    alive = w.grains.id[i] >= 0 and w.grains.id[j] >= 0
    if alive and (ti.static(wall) or i != j):  # a row that only fills up a lane holds one grain twice
        gap, normal = gap_now(w, p, wall)
        force = push_of(w, s, p)
        if every != 0 or (gap < 0.0 or force.x != 0.0 or force.y != 0.0 or remembered(s, "bridge", p) > 0.0):
            k = ti.atomic_add(many[0], 1)
            one, two = w.grains.id[i], w.grains.id[j]
            discs = discs_of(w, p)
            a, b = discs // MOST, discs % MOST
            if ti.static(wall):
                part = w.pairs.second[p]
                two = -1 - number_of_wall(w, part, point_of(w, p, gap, normal, True, ti.f32), start, pieces)
                lists[3, k] = a * PART + part
            else:
                if one > two:
                    one, two, a, b = two, one, b, a
                lists[3, k] = a * PART + b
            lists[0, k], lists[1, k], lists[2, k] = p, one, two
            ti.atomic_add(first[one + 1], 1)


@ti.kernel
def find_contacts(
    w: ti.template(),
    s: ti.template(),
    every: ti.i32,
    start: ti.types.ndarray(dtype=ti.i32, ndim=1),
    pieces: ti.types.ndarray(dtype=ti.f32, ndim=2),
    lists: ti.types.ndarray(dtype=ti.i32, ndim=2),
    many: ti.types.ndarray(dtype=ti.i32, ndim=1),
    first: ti.types.ndarray(dtype=ti.i32, ndim=1),
    order: ti.types.ndarray(dtype=ti.i32, ndim=1),
):
    """Lists rows of contacts in `order`, by ids. Row k found: lists[:, k] = pair, lower id, higher id or -1 - wall, discs; many[0] of them.

    first[id] becomes where the contacts of lower ids begin; it has two rows more than there are ids.
    """
    ti.loop_config(serialize=w.serial)
    for b in range(block_count(w)):
        for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
            find(w, s, p, False, every, start, pieces, lists, many, first)
        for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
            find(w, s, p, True, every, start, pieces, lists, many, first)
    ti.loop_config(serialize=True)
    for id in range(1, first.shape[0]):
        first[id] += first[id - 1]
    ti.loop_config(serialize=w.serial)
    for k in range(many[0]):
        order[ti.atomic_add(first[lists[1, k]], 1)] = k
    ti.loop_config(serialize=w.serial)
    for id in range(first.shape[0] - 1):  # first[id] is now where those of `id` end
        low = first[id - 1] if id > 0 else 0
        for m in range(low + 1, first[id]):
            k, n = order[m], m
            while n > low and later(lists, order[ti.max(n - 1, 0)], k):
                order[n] = order[n - 1]
                n -= 1
            order[n] = k


@ti.func
def later(lists: ti.template(), k, than):
    """Whether row k, of the same lower id, comes after another one."""
    return lists[2, k] > lists[2, than] or (lists[2, k] == lists[2, than] and lists[3, k] > lists[3, than])


@ti.func
def write(
    w: ti.template(),
    s: ti.template(),
    m,
    k,
    p,
    lists: ti.template(),
    whole: ti.template(),
    exact: ti.template(),
    wall: ti.template(),
    real: ti.template(),
):
    """Writes contact m: row k of those found, of pair p."""
    distance, normal = distance_to_second(w, p, w.pairs.first[p], wall)
    gap = distance - radii(w, p, wall)
    point = point_of(w, p, gap, normal, wall, real)
    along, force = normal_of_force(w, s, p, distance, normal, wall), push_of(w, s, p)
    couple = remembered(s, "torque", p)
    if w.grains.id[w.pairs.first[p]] != lists[1, k]:
        along, couple = -along, -couple
    whole[m, 0], whole[m, 1] = lists[1, k], lists[2, k]
    whole[m, 2], whole[m, 3] = lists[3, k] // PART, -1 if ti.static(wall) else lists[3, k] % PART
    whole[m, 4] = ti.cast(remembered(s, "bridge", p) > 0.0, ti.i32)
    overlap = ti.select(gap < FAR_APART, -gap, 0.0)
    numbers = ti.static((point.x, point.y, along.x, along.y, overlap, force.x, force.y, remembered(s, "spring", p), couple))
    for c in ti.static(range(len(numbers))):
        exact[m, WHOLE + c] = ti.cast(numbers[c], real)


@ti.kernel
def write_contacts(
    w: ti.template(),
    s: ti.template(),
    order: ti.types.ndarray(dtype=ti.i32, ndim=1),
    lists: ti.types.ndarray(dtype=ti.i32, ndim=2),
    whole: ti.types.ndarray(),
    exact: ti.types.ndarray(),
    real: ti.template(),
):
    """Fills the rows of the contacts: whole numbers, then the others, which are of type `real`; both may be the same memory."""
    ti.loop_config(serialize=w.serial)
    for m in range(whole.shape[0]):
        k = order[m]
        p = lists[0, k]
        if is_wall(w, p):
            write(w, s, m, k, p, lists, whole, exact, True, real)
        else:
            write(w, s, m, k, p, lists, whole, exact, False, real)


_numbers: WeakKeyDictionary[World, WallNumbers] = WeakKeyDictionary()


def numbers_of(sim: Any) -> WallNumbers:
    """The numbers of the walls of a simulation."""
    known = _numbers.get(sim.world)
    if known is None or known.walls is not sim.scene.walls:
        known = _numbers[sim.world] = wall_numbers(sim.scene, sim.world.box[None].least)
    return known


def contacts(sim: Any, every: bool = False) -> np.ndarray:
    """Contacts of `sim`, a Simulation, of type CONTACT, (n,), by ids; with `every` all pairs of the neighbour list."""
    world, numbers = sim.world, numbers_of(sim)
    rows = world.half * (1 + world.sleeps)
    lists, order = np.empty((4, rows), np.int32), np.empty(rows, np.int32)
    many, first = np.zeros(1, np.int32), np.zeros(sim.made + 2, np.int32)
    find_contacts(world, sim.solver, int(every), numbers.start, numbers.pieces, lists, many, first, order)
    real, kind = real_of(sim)
    found = np.zeros((int(many[0]), WORDS), kind)
    whole = found.view(np.int64) if kind == np.float64 else np.zeros((len(found), WHOLE), np.int32)
    write_contacts(world, sim.solver, order, lists, whole, found, real)
    if kind == np.float64:
        return found.view(CONTACT)[:, 0]
    wide = found.astype(np.float64)
    wide.view(np.int64)[:, :WHOLE] = whole
    return wide.view(CONTACT)[:, 0]
