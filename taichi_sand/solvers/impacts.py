"""Impacts of rigid grains: approaches too fast to be left to soft contacts are answered at once, with restitution and friction."""

from typing import Any

import taichi as ti

from taichi_sand.solvers.flights import go_on, move_on, relative_gravity, shares, time_to_touch
from taichi_sand.solvers.hits import each_hit, mark, mark_pair
from taichi_sand.solvers.impulses import (
    arms,
    friction_bound,
    give,
    is_held,
    load_of,
    meeting,
    min_normal_impulse,
    slip_by,
    slip_of,
    tangential_mass,
    update_contact,
)
from taichi_sand.solvers.noting import WIPE, note, noting
from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.blocks import nothing
from taichi_sand.world.extras.energy_ledger import drive, settle_work
from taichi_sand.world.extras.materials import bounce_of
from taichi_sand.world.geometry import add, at_least, at_most, movable, perp, within, wrench
from taichi_sand.world.sweep import sweep
from taichi_sand.world.walls.servo import along_course, apart, driver, drives, each_driven, hit_by

ROUNDS, LAUNCHED_ROUNDS = 32, 2
"""Most rounds of impacts in a step; and where each is a launch of its own."""
AFAR, AFAR_FROM_WALL = 0.02, 0.001
"""Grains that are to meet across a gap wider than this, over the distance of their centres when they touch, are first moved to where they
do; below it the levers reach to the middle between them, or to the wall, and are as much longer than the radii at most."""
MOST_APPROACH = 4.0
"""Two grains approach by twice the speed cap at most as a step begins. Impacts that give energy, round after round, would else make speeds
that are no numbers before the step is over; an impact answers so many caps of it."""
LOADS = 4.0
"""A contact that bears a load is hit by what approaches LOADS times as fast as that load would make it approach in a step, as the slowest
impact of a disc that lies on the ground. Slower ones are borne: the impulses that a pile closes under have to be remembered, not answered
and forgotten. (Periodic slopes of 21 and 25 degrees, restitution 0.3 and 0.8: flow as fast with 4, 20 and 1e9, within 3 %.)"""


def rounds(world: Any) -> int:
    """Most rounds of impacts in a step."""
    return ROUNDS if world.layout == "one" else LAUNCHED_ROUNDS


@ti.func
def collide(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Answers the impact of pair p, if it would touch within the step faster than it may softly (physics.md A2, A4); but for those with
    walls that answer to all their contacts at once.

    It is answered where the surfaces touch, whatever part of the step that takes: the levers are the radii, and momentum, angular momentum
    and energy are those of the flight. What is reflected is the velocity of that moment, without the half of the step's kick that belongs
    to later: else a bounce would add speed * g h.
    """
    if apart(w, p, wall):
        follow(w, s, c, p, wall)
    else:
        answer(w, s, c, p, wall, w.pairs.mass[p])


@ti.func
def ram(w: ti.template(), s: ti.template(), c: ti.template(), p):
    """Answers the impact of pair p with a wall with `force`, and has the wall take its part. One without mass gives none."""
    m, normal = driver(w, p), w.pairs.normal[p]
    if w.movers.mass[m] > 0.0:
        mass = 1.0 / (1.0 / w.pairs.mass[p] + w.movers.way[m].dot(normal) ** 2 / w.movers.mass[m])
        impulse = answer(w, s, c, p, True, mass)
        hit_by(w, m, along_course(w, m, impulse, w.pairs.normal[p]))


@noinline
def ram_with(w: ti.template(), s: ti.template(), m: ti.i32):
    """The impacts with wall m."""
    each_driven(w, s, s.constants[None], m, ram)


@ti.func
def ram_all(w: ti.template(), s: ti.template(), c: ti.template()):
    """The impacts with walls with `force`, one after the other."""
    if ti.static(drives(w)):
        ti.loop_config(serialize=True)
        for _run in range(1):
            if colliding(w):
                for m in range(w.movers.walls[None]):
                    ram_with(w, s, m)


@ti.func
def foresee(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Marks pair p, if it is one whose impact is to be answered."""
    _i, _j, _normal, gap, _motion, _lever, speed = meeting(w, p, wall)
    if hard(w, c, p, gap, speed):
        w.pace[None].hit = 1
        mark_pair(w, s, p, wall)


@ti.func
def collide_hit(w: ti.template(), s: ti.template(), c: ti.template(), b):
    """A round of impacts in block b."""
    each_hit(w, s, b, collide)


@ti.func
def catch_up(w: ti.template(), s: ti.template(), c: ti.template(), b):
    """Where grains of block b have been moved in the last round, their pairs follow."""
    each_hit(w, s, b, follow)


@ti.func
def hard(w: ti.template(), c: ti.template(), p, gap, speed):
    """Whether pair p, whose surfaces part with this speed, may touch within the step faster than it may softly."""
    met = ti.max(speed * c.step + gap, speed + c.threshold) < 0.0  # one branch, which is seldom taken
    if met:
        met = speed < -LOADS * w.pairs.force[p].x * c.step / w.pairs.mass[p]
    return met


@ti.func
def answer(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template(), mass):
    """Has pair p, of effective mass `mass` [kg], follow its grains, and answers its impact, if it touches within the step. Returns the
    impulse (normal, tangential) [N s].
    """
    impulse, before = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
    time, met = c.step, False
    for turn in range(2):  # in the first they are moved to where they meet; a loop, so that all this is compiled once
        if turn == 0 or met:
            follow(w, s, c, p, wall)
            i, j, normal, gap, motion, lever, speed = meeting(w, p, wall)
            one, two = shares(w, i, j, wall)
            pull = relative_gravity(w, one, two, wall)
            if turn == 1:
                impulse = bounce(w, s, c, p, i, j, normal, gap, motion, lever, speed, pull, mass, wall)
                if ti.static(not wall):
                    if one * two > 0.0:
                        go_on(w, p, i, j, before, time, one, two)
            elif hard(w, c, p, gap, speed) and w.pace[None].round <= ti.static(rounds(w)) + 1:
                time = time_to_touch(w, c, p, i, j, normal, gap, motion, speed, pull, wall)
                if time < c.step:
                    met, before = True, motion
                    afar = gap >= ti.static(AFAR_FROM_WALL if wall else AFAR) * w.pairs.contact_distance[p]
                    if ti.static(not wall):
                        run = motion.norm() + 1e-30
                        if not afar:
                            time = 0.0
                        time = at_most(w.grains.radius[i] / (run * one + 1e-30), at_most(w.grains.radius[j] / (run * two + 1e-30), time))
                    if afar:
                        gain = move_on(w, i, j, normal, motion, pull, time, c.step, one, two, wall)
                        if noting(w):
                            give = w.grains.mobility[i].x + (0.0 if ti.static(wall) else w.grains.mobility[j].x)
                            note(w, s, p, c.rate / give * gain)
                    mark(w, s, i, afar)
                    if ti.static(not wall):
                        mark(w, s, j, afar)
    return impulse


@ti.func
def bounce(
    w: ti.template(), s: ti.template(), c: ti.template(), p, i, j, normal, gap, motion, lever, speed, pull, mass, wall: ti.template()
):
    """Gives pair p the impulse of its impact, and returns it."""
    arm_i, arm_j = arms(w, i, j, gap, lever, wall)
    approach = within(MOST_APPROACH * w.pace[None].speed_cap, at_least(0.0, 0.5 * pull.dot(normal) * c.step - speed))
    impulse = ti.Vector([(1.0 + bounce_of(w, p, c.restitution, wall)) * mass * approach, 0.0])
    if ti.static(w.turns):
        slip = slip_of(w, i, j, motion, normal, arm_i, arm_j, wall) + slip_by(w, i, j, impulse.x, arm_i, arm_j, lever, wall)
        bound = friction_bound(w, s, c, p, wall, impulse.x)
        impulse.y = within(bound, -tangential_mass(w, i, j, arm_i, arm_j, wall) * slip)
    give(w, s, i, j, impulse, normal, arm_i, arm_j, lever, False, wall)
    if noting(w):
        note(w, s, p, c.rate * (impulse.x * normal + impulse.y * perp(normal)))
    drive(w, s, p, gap + w.pairs.contact_distance[p], normal, impulse, wall)
    min_normal_impulse(w, s, c, p, 0.0, 0.0)  # they touch
    w.pace[None].hit = 1
    return impulse


@ti.func
def follow(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Looks at pair p where impacts of this step have moved its grains to, and stores there what it carries."""
    marks = s.struck[w.pairs.first[p]]
    if ti.static(not wall):
        marks |= s.struck[w.pairs.second[p]]
    if marks & 1:
        carry_over(w, s, c, p, wall)


@ti.func
def carry_over(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Looks at pair p where its grains are now, and stores there what it carries, no longer where they were."""
    i = w.pairs.first[p]
    j = i if ti.static(wall) else w.pairs.second[p]
    carried = w.pairs.force[p] * c.step
    for turn in range(2):
        if is_held(s, carried):
            sign = 2.0 * turn - 1.0
            first, second = load_of(w, s, c, p, i, j, carried, wall)
            add(w.grains.wrench, i, sign * first)
            if ti.static(not wall):
                add(w.grains.wrench, j, sign * second)
        if turn == 0:
            update_contact(w, s, c, p, wall)


@ti.func
def warm_start(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """After the impacts: the contact impulses of the step before, where the kick has left them out."""
    g = ti.static(w.grains)
    if w.pace[None].warm_start == 1:
        for i in range(start, end):
            change = g.wrench[i] * g.mobility[i]
            settle_work(w, s, i, g.wrench[i], change - wrench(w.box[None].gravity * c.step, 0.0) * movable(w, i))
            add(g.twist, i, change)
            s.struck[i], s.near[w.grid.cell[i]] = 0, 0


@ti.func
def colliding(w: ti.template()):
    """Whether a round of impacts is due."""
    return w.pace[None].spent == 0 and w.pace[None].impacts == 1


@ti.func
def ahead(w: ti.template()):
    """Whether impacts of the last round may have moved grains."""
    return colliding(w) and w.pace[None].moved == 1


@ti.func
def close_round(w: ti.template()):
    """One more round of impacts only if the last one met any."""
    if w.pace[None].spent == 0:
        w.pace[None].impacts = w.pace[None].hit
        w.pace[None].hit = 0
        w.pace[None].round += 1


@ti.func
def collide_all(w: ti.template(), s: ti.template(), c: ti.template()):
    """Rounds of impacts, one after the other, until there are none left or the rounds are used up."""
    sweep(w, (WIPE, foresee), nothing, s, c, colliding)
    close_round(w)
    if ti.static(w.layout == "one"):
        for _round in range(ti.static(rounds(w)) + 1):  # in the last one pairs only follow
            sweep(w, collide_hit, nothing, s, c, colliding)
            ram_all(w, s, c)
            close_round(w)
    else:
        for _round in ti.static(range(rounds(w))):
            sweep(w, collide_hit, nothing, s, c, colliding)
            ram_all(w, s, c)
            close_round(w)
        sweep(w, catch_up, nothing, s, c, ahead)
    w.pace[None].impacts = 0
