"""Walls with `force` or `pressure`: one degree of freedom each, the rate u at which they run along their course, in velocities.

Such a wall takes what its force and the contacts with grains make of it: M dv/dt = F - P, with P what the contacts resist along the
course, and no faster than its velocity either way. P is a rising function of the rate, made of all contacts with the wall, so the
rate is the root of one equation. Without mass the contacts bear exactly F, or the wall runs at its velocity: a rate that answers to
the last step's P instead would press with many times F before it has slowed down, the lighter the wall the more.
The rows of the neighbour list that such walls are in are linked to one another in every list build; one thread goes along them.
"""

from typing import Any

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.blocks import block_count, going
from taichi_sand.world.geometry import distance_to_second, perp, wall_row
from taichi_sand.world.walls.motion import pivot_at

MOST_TRIALS = 24
"""Rates that are tried in a step; at rest two are, on a hard landing some ten."""
EXACT = 1e-4
"""What contacts resist is right to this share of the force, or to rounding."""


def rounding(world: Any) -> float:
    """Share of a number that its bits do not tell."""
    return 1e-12 if world.real == ti.f64 else 1e-6


@ti.func
def link_driven(w: ti.template()):
    """In a list build: links the rows of walls with `force`, in the order of the table. Their grains are awake. Not where the table is too
    small for its rows: they are listed again.
    """
    movers, pairs, blocks = ti.static(w.movers, w.pairs, w.blocks)
    ti.loop_config(serialize=True)
    for _run in range(1):
        movers.first[None] = -1
        for b in range((block_count(w) - ti.static(int(w.sleeps))) * int(w.pace[None].lacking == 0)):
            for p in range(blocks.wall_start[b], blocks.wall_end[b]):
                if driver(w, p) >= 0:
                    pairs.driven[wall_row(w, p)] = movers.first[None]
                    movers.first[None] = p


@ti.func
def driver(w: ti.template(), p):
    """Number of the moving wall with `force` that wall pair p is about; -1 = none."""
    m = w.movers.wall[w.pairs.second[p]]
    if m >= 0:
        m = ti.select(w.movers.force[m] > 0.0, m, -1)
    return m


@ti.func
def apart(w: ti.template(), p, wall: ti.template()):
    """Whether sweeps leave pair p alone, as its wall answers to all its contacts at once."""
    alone = False
    if ti.static(wall and w.moves):
        if ti.static(w.movers.driven):
            alone = driver(w, p) >= 0
    return alone


def drives(world: Any) -> bool:
    """Whether any wall has a `force`."""
    return world.moves and world.movers.driven


@ti.func
def along_course(w: ti.template(), m, push, normal):
    """What a push (normal, tangential) on wall m resists its course with."""
    way = w.movers.way[m]
    return -(push.x * way.dot(normal) + push.y * way.dot(perp(normal)))


@ti.func
def hit_by(w: ti.template(), m, impulse):
    """Has wall m, which has a mass, take an impulse against its course [N s]."""
    movers = ti.static(w.movers)
    movers.rate[m] = ti.max(-1.0, ti.min(1.0, movers.rate[m] - impulse / (movers.mass[m] * movers.speed[m])))
    movers.twist[m] = movers.rate[m] * movers.course[m]


@ti.func
def weightless(w: ti.template(), p, wall: ti.template()):
    """Whether pair p is with a wall with `force` and without mass: there is nothing that an impact could be with."""
    none = False
    if ti.static(wall and w.moves):
        if ti.static(w.movers.driven):
            m = driver(w, p)
            if m >= 0:
                none = w.movers.mass[m] == 0.0
    return none


@ti.func
def swinging(w: ti.template(), p, normal, wall: ti.template()):
    """Root of the effective mass of pair p [kg^(1/2)]: a wall that has a mass swings with the grain."""
    root = w.pairs.root_mass[p]
    if ti.static(wall and w.moves):
        if ti.static(w.movers.driven):
            m = driver(w, p)
            if m >= 0:
                if w.movers.mass[m] > 0.0:
                    root /= ti.sqrt(1.0 + (root * w.movers.way[m].dot(normal)) ** 2 / w.movers.mass[m])
    return root


@ti.func
def thrust(w: ti.template(), m):
    """What wall m is driven with now [N]: its force, or its pressure times the length that can be loaded."""
    movers = ti.static(w.movers)
    span, way = movers.span[m], movers.way[m]
    across = ti.Vector([-way.y, way.x])
    for k in ti.static(range(2)):
        n = movers.beside[m][k]
        if n >= 0:
            age = movers.age[n] + movers.since[n]
            span[2 + k] += (pivot_at(movers, n, age, movers.omega[n] * age) - movers.pivot[n]).dot(across)
    return movers.force[m] * ti.cast(ti.max(0.0, ti.min(span.y, span.w) - ti.max(span.x, span.z)), w.real)


@ti.func
def run_at(w: ti.template(), m, rate, time):
    """Has wall m run at this rate, and be where that has brought it within `time`."""
    movers = ti.static(w.movers)
    shift = ti.cast(movers.velocity[m] * (movers.since[m] + time * rate), w.real)
    movers.pose[m] = ti.Vector([1.0, 0.0, shift.x, shift.y])
    movers.twist[m] = rate * movers.course[m]


@ti.func
def pressed(w: ti.template(), s: ti.template(), c: ti.template(), m, push: ti.template(), time):
    """What contacts resist the course of wall m with as it runs now, by how much that grows with its speed, and the sum of its parts.

    `push(w, s, c, p, m, time)` returns the first two of contact p, and changes nothing.
    """
    total = ti.Vector([0.0, 0.0, 0.0])
    p = w.movers.first[None]
    while p >= 0:
        if driver(w, p) == m:
            part = push(w, s, c, p, m, time)
            total += ti.Vector([part.x, part.y, ti.abs(part.x)])
        p = w.pairs.driven[wall_row(w, p)]
    return total


@ti.func
def each_driven(w: ti.template(), s: ti.template(), c: ti.template(), m, act: ti.template()):
    """act(w, s, c, p) on all pairs p of wall m."""
    p = w.movers.first[None]
    while p >= 0:
        if driver(w, p) == m:
            act(w, s, c, p)
        p = w.pairs.driven[wall_row(w, p)]


@ti.func
def carried(w: ti.template(), m):
    """What the contacts of wall m resisted its course with last [N]."""
    total = 0.0
    p = w.movers.first[None]
    while p >= 0:
        if driver(w, p) == m:
            _, normal = distance_to_second(w, p, w.pairs.first[p], True)
            total += along_course(w, m, w.pairs.force[p], normal)
        p = w.pairs.driven[wall_row(w, p)]
    return total


@ti.func
def balance(w: ti.template(), s: ti.template(), c: ti.template(), m, push: ti.template(), time, force, mass, start, guess):
    """Rate at which wall m runs: the root of force - mass * speed * (rate - start) = what the contacts resist, within -1 … 1.

    Newton's steps, kept between the rates that are known to be too low and too high. Leaves the wall running at it. What contacts resist
    jumps where they begin to touch, as dashpots do: the root is then the rate just below, at which they do not press too much.
    """
    low, high = -1.5, 1.5
    rate, speed = guess, w.movers.speed[m]
    trials = 0
    while trials < MOST_TRIALS:
        run_at(w, m, rate, time)
        found = pressed(w, s, c, m, push, time)
        rest = force - mass * speed * (rate - start) - found.x
        slope = speed * (mass + found.y)
        low, high = ti.select(rest >= 0.0, rate, low), ti.select(rest >= 0.0, high, rate)
        small = EXACT * ti.abs(force) + ti.static(rounding(w)) * found.z
        trials += 1
        if ti.abs(rest) <= small or low >= 1.0 or high <= -1.0:
            trials = MOST_TRIALS + 1
        elif high - low < ti.static(rounding(w)):
            trials = MOST_TRIALS
        else:
            ahead = ti.select(rest > 0.0, 1.0, -1.0)
            if slope > 0.0:
                ahead = ti.max(-1.0, ti.min(1.0, rate + rest / slope))
            if ahead <= low or ahead >= high or trials % 4 == 0:
                ahead = 0.5 * (ti.max(low, -1.0) + ti.min(high, 1.0))
            rate = ahead
    if trials == MOST_TRIALS:
        rate = ti.max(low, -1.0)
    run_at(w, m, rate, time)
    return rate


@ti.func
def nobody(w: ti.template(), s: ti.template(), c: ti.template(), p):
    """Does nothing to a pair."""


@ti.func
def bear(
    w: ti.template(),
    s: ti.template(),
    push: ti.template(),
    solve: ti.template(),
    keep: ti.template(),
    first: ti.template(),
):
    """Ends a sweep of impulses: solves the contacts of the walls with `force`, all those of one wall together with the rate at which it
    runs, and then has them store what they carry: solve(w, s, c, p), keep(w, s, c, p).

    In the first sweep that is the rate at which it moves, in the second one the rate at which it starts into the next step.
    """
    ti.loop_config(serialize=True)
    for _run in range(1):
        if going(w):
            for m in range(w.movers.walls[None]):
                if w.movers.force[m] > 0.0:
                    bear_wall(w, s, push, solve, keep, first, m)


@noinline
def bear_wall(
    w: ti.template(), s: ti.template(), push: ti.template(), solve: ti.template(), keep: ti.template(), first: ti.template(), m: ti.i32
):
    """Ends a sweep of impulses for wall m, see `bear`."""
    c = s.constants[None]
    movers = ti.static(w.movers)
    if ti.static(first):
        movers.onward[m] = movers.rate[m]
    impulse, start = thrust(w, m) * c.step, movers.onward[m]
    rate = balance(w, s, c, m, push, 0.0, impulse, movers.mass[m], start, movers.rate[m])
    if ti.static(first):
        movers.rate[m] = rate
    else:
        movers.onward[m] = rate
    each_driven(w, s, c, m, solve)
    run_at(w, m, movers.rate[m], c.step)
    each_driven(w, s, c, m, keep)
