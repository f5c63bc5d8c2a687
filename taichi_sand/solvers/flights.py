"""Flights within a step: when the grains of a pair touch, and how they are moved there ahead of all others."""

import taichi as ti

from taichi_sand.world.clumps import head, turned
from taichi_sand.world.geometry import add, at_least, motion_of, perp, spin, wrench


@ti.func
def flight(w: ti.template(), p, i, j, normal, gap, motion, speed):
    """Time until the discs of pair p of two grains touch [s], if they fly on as they do; 1e30 if they pass one another."""
    total, away = w.pairs.contact_distance[p], at_least(0.0, gap)
    run = motion
    if ti.static(w.clumps):
        arms = w.pairs.arms[p]
        run += spin(w, j) * perp(turned(w, j, arms.zw)) - spin(w, i) * perp(turned(w, i, arms.xy))
    inwards = -speed * (total + away)
    reached = inwards * inwards - run.dot(run) * away * (away + 2.0 * total)
    time = ti.select(away > 0.0, 1e30, 0.0)
    if away > 0.0 and reached >= 0.0 and inwards > 0.0:
        time = away * (away + 2.0 * total) / (inwards + ti.sqrt(reached))
    return time


@ti.func
def shares(w: ti.template(), i, j, wall: ti.template()):
    """Shares of the two grains of a pair in a motion that leaves their centre of mass where it is."""
    one, two = 1.0, 0.0
    if ti.static(not wall):
        one = w.grains.mobility[i].x / (w.grains.mobility[i].x + w.grains.mobility[j].x)
        two = 1.0 - one
    return one, two


@ti.func
def relative_gravity(w: ti.template(), one, two, wall: ti.template()):
    """Acceleration of the second of a pair as seen from the first [m/s2]: none where both fall."""
    return w.box[None].gravity * (ti.cast(two > 0.0, w.real) - ti.cast(one > 0.0, w.real))


@ti.func
def time_to_touch(w: ti.template(), c: ti.template(), p, i, j, normal, gap, motion, speed, pull, wall: ti.template()):
    """Time until pair p touches, if its grains fly on [s]."""
    time = 0.0
    if ti.static(wall):
        far, start, fall = at_least(0.0, gap), 0.5 * pull.dot(normal) * c.step - speed, pull.dot(normal)
        time = 2.0 * far / (start + ti.sqrt(at_least(0.0, start * start - 2.0 * fall * far)))
    else:
        time = flight(w, p, i, j, normal, gap, motion, speed)
    return time


@ti.func
def move_on(w: ti.template(), i, j, normal, motion, pull, time, step, one, two, wall: ti.template()):
    """Moves the grains of a pair, and what they fall, to where they are in `time`. Returns how much faster the second then is, as seen from
    the first [m/s].
    """
    way, gain = (motion + 0.5 * (time - step) * pull) * time, pull * time
    if ti.static(wall):
        way, gain = way.dot(normal) * normal, gain.dot(normal) * normal
    advance(w, i, -one * way, -one * gain, time)
    if ti.static(not wall):
        advance(w, j, two * way, two * gain, time)
    w.pace[None].moved = 1
    return gain


@ti.func
def advance(w: ti.template(), i, way, gain, time):
    """Moves grain i by `way`, and turns it for `time`, ahead of the others; its velocity changes by `gain`."""
    g = ti.static(w.grains)
    add(g.shift, i, way)
    add(g.twist, i, wrench(gain, 0.0))
    if ti.static(w.turns):
        add(g.turn, i, spin(w, i) * time)
    if ti.static(w.clumps):
        head(w, i)


@ti.func
def go_on(w: ti.template(), p, i, j, before, time, one, two):
    """Moves two grains that have met along their new path, to where that comes nearest to where they were: answered ahead of time, they
    then do not stand in the way of others. `before` is how the second moved as seen from the first.
    """
    motion = motion_of(w, p, i, j, 0.0, before, False)
    way = at_least(0.0, -time * before.dot(motion) / (motion.dot(motion) + 1e-30)) * motion
    add(w.grains.shift, i, -one * way)
    add(w.grains.shift, j, two * way)
