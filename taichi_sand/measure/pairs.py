"""What is read of the pairs of a world: a row each of those that touch, push or pull. All that looks at single contacts looks here.

A row belongs to a pair of discs, or of a disc and a wall, that overlap where they are now, or that pushed or pulled in the last step, or
have a liquid bridge. Its point, its overlap and which rows there are go by the places of this moment. Forces are those of the last step,
along the normal that they were found with: where the grains are now (rigid, and md but for symplectic Euler), or were at the start of the
last step (md with symplectic Euler, which takes forces from there).
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.world.blocks import block_count
from taichi_sand.world.clumps import MOST, turned
from taichi_sand.world.geometry import distance_to_second, mobility, moved, radii, spin, turned_by, velocity, wall_row
from taichi_sand.world.search.images import fold
from taichi_sand.world.search.pair_history import BEYOND, discs_of

ROW, ONE, TWO, DISCS, STATE = range(5)
"""Whole numbers of a row: the pair; id of its first grain; id of the second, which is higher, of a wall -1 - its part; number of the
first disc times PART plus that of the second, or of the part of the wall; what holds, in bits.
"""
PART = 1 << 24
"""More parts than this the walls have not."""
BRIDGE, FIRST_MOVES, SECOND_MOVES = 1, 2, 4
"""There is a liquid bridge; the first, the second is a grain that can be accelerated."""
POINT, NORMAL, OVERLAP, PUSH, SLIDE, HISTORY, COUPLE, MORE = 0, 2, 4, 5, 6, 7, 8, 9
"""Its other numbers, SI: x, y of point and normal; the normal and the tangential force that it carries; stretch of the tangential spring;
torque of rolling resistance on the second; what it passed on in the last step beside those forces, normal and tangential.
"""
WHOLES, EXACTS = 5, 11
Wholes, Exacts = (ti.types.ndarray(dtype=ti.types.vector(width, None), ndim=1) for width in (WHOLES, EXACTS))
"""Of rows that are read and written whole: Taichi would look up the shape of a table of numbers anew for every one of them."""
FAR_APART = 1e12
"""Rows that hold no pair are farther apart than this [m]."""


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
def passed_on(w: ti.template(), s: ti.template(), p):
    """What pair p has passed on in the last step beside the force that it carries, normal and tangential [N]."""
    more = ti.Vector([0.0, 0.0])
    if ti.static(notes(s)):
        if w.pace[None].noted == 1:
            more = ti.Vector([s.passed[0][p], s.passed[1][p]])
    return more


@ti.func
def point_of(w: ti.template(), p, gap, normal, share, real: ti.template()):
    """Where pair p touches: `share` of the gap away from the first disc; in the box where that is periodic [m]."""
    i = w.pairs.first[p]
    reach, arm = w.grains.radius[i], ti.Vector([0.0, 0.0])
    if ti.static(w.clumps):
        reach, arm = w.pairs.rims[p].x, turned(w, i, w.pairs.arms[p].xy)
    if gap < BEYOND:
        reach += share * gap
    point = place(w, i, real) + ti.cast(arm + reach * normal, real)
    return fold(w, point, ti.cast(w.box[None].size, real))


@ti.func
def take(counts: ti.template(), k, amount, alone: ti.template()):
    """What stands at counts[k], which is more by `amount` then; `alone` on one thread that is no atomic."""
    before = counts[k]
    if ti.static(alone):
        counts[k] = before + amount
    else:
        before = ti.atomic_add(counts[k], amount)
    return before


@ti.func
def write_row(
    w: ti.template(),
    s: ti.template(),
    k,
    p,
    names,
    gap,
    normal,
    along,
    share,
    force,
    more,
    whole: ti.template(),
    exact: ti.template(),
    real: ti.template(),
):
    """Writes row k, of pair p: `names` are ONE, TWO and STATE as the pair has its grains; the rest is told in `read_pairs`."""
    one, two, state = names[0], names[1], names[2]
    first, second, sign = discs_of(w, p) // MOST, discs_of(w, p) % MOST, 1.0
    if two < 0:
        second = -1 - two
    elif one > two:
        sign = -1.0
        one, two = two, one
        first, second = second, first
        state = (state & BRIDGE) | (state & FIRST_MOVES) * 2 | (state & SECOND_MOVES) // 2
    whole[k] = ti.Vector([p, one, two, first * PART + second, state])
    point, overlap = point_of(w, p, gap, normal, share, real), ti.select(gap < FAR_APART, -gap, 0.0)
    stretch, couple = remembered(s, "spring", p), sign * remembered(s, "torque", p)
    way = sign * along
    numbers = ti.static((point.x, point.y, way.x, way.y, overlap, force.x, force.y, stretch, couple, more.x, more.y))
    exact[k] = ti.Vector([ti.cast(number, real) for number in numbers])


@ti.kernel
def read_pairs(
    w: ti.template(),
    s: ti.template(),
    every: ti.i32,
    whole: Wholes,
    exact: Exacts,
    many: ti.types.ndarray(dtype=ti.i32, ndim=1),
    real: ti.template(),
):
    """Fills rows of what touches, pushes or pulls, with `every` of all pairs: many[0] of them. many[1]: pairs that are listed.

    What comes after gap and normal is compiled once for pairs of grains and those with walls: it is most of the time to compile.
    """
    ti.loop_config(serialize=w.serial)
    for b in range(block_count(w)):
        listed = 0
        for side in range(2):
            low, high = w.blocks.pair_start[b], w.blocks.pair_end[b]
            if side == 1:
                low, high = w.blocks.wall_start[b], w.blocks.wall_end[b]
            for p in range(low, high):
                i, j = w.pairs.first[p], w.pairs.second[p]
                one, two, state = w.grains.id[i], -1 - j, 0
                distance, normal, gap = FAR_APART * 2.0, ti.Vector([0.0, 0.0]), FAR_APART * 2.0
                if side == 1:
                    distance, normal = distance_to_second(w, p, i, True)
                    gap = distance - radii(w, p, True)
                elif i != j:  # a row that only fills up a lane holds one grain twice
                    two = w.grains.id[j]
                    if two < 0:
                        one = -1
                    distance, normal = distance_to_second(w, p, i, False)
                    gap = distance - radii(w, p, False)
                    if mobility(w, j).x > 0.0:
                        state = SECOND_MOVES
                else:
                    one = -1
                if gap < FAR_APART:
                    listed += 1
                force, more = w.pairs.force[p], passed_on(w, s, p)
                if remembered(s, "bridge", p) > 0.0:
                    state |= BRIDGE
                pushes = force.x != 0.0 or force.y != 0.0 or more.x != 0.0 or more.y != 0.0
                if one >= 0 and (every != 0 or gap < 0.0 or pushes or state & BRIDGE > 0):
                    along, share = normal, 0.5
                    if side == 1:
                        along, share = normal_of_force(w, s, p, distance, normal, True), 1.0
                    else:
                        along = normal_of_force(w, s, p, distance, normal, False)
                    if mobility(w, i).x > 0.0:
                        state |= FIRST_MOVES
                    k = take(many, 0, 1, w.serial)
                    write_row(w, s, k, p, ti.Vector([one, two, state]), gap, normal, along, share, force, more, whole, exact, real)
        take(many, 1, listed, w.serial)


class Found(NamedTuple):
    """Rows that were read: valid until the next are."""

    whole: np.ndarray  # (n, WHOLES), i32
    exact: np.ndarray  # (n, EXACTS)
    listed: int  # pairs in the neighbour list


@lru_cache(maxsize=1)
def room(rows: int, kind: Any) -> tuple[np.ndarray, np.ndarray]:
    """Room for so many rows, the same every time: to get it from the system takes as long as to fill it."""
    return np.empty((rows, WHOLES), np.int32), np.empty((rows, EXACTS), kind)


def pairs_of(sim: Any, every: bool = False) -> Found:
    """What is read of the pairs of `sim`, a Simulation; with `every` all of the neighbour list; in its order."""
    world, (real, kind) = sim.world, real_of(sim)
    whole, exact = room(world.half * (1 + world.sleeps), kind)
    many = np.zeros(2, np.int32)
    read_pairs(world, sim.solver, int(every), whole, exact, many, real)
    whole, exact = whole[: many[0]], exact[: many[0]]
    if not world.serial:  # then they come in any order
        order = np.argsort(whole[:, ROW])
        whole, exact = whole[order], exact[order]
    return Found(whole, exact, int(many[1]))
