"""Impacts of rigid grains: approaches too fast to be left to soft contacts are answered at once, with restitution and friction."""

import taichi as ti

from taichi_sand.solvers.impulses import arms, cone, give, lowest, meeting, slip_by, slip_of, tangential_mass
from taichi_sand.world.geometry import add, movable, within
from taichi_sand.world.ledger import drive, settle_work
from taichi_sand.world.servo import along_course, apart, driver, drives, each_driven, hit_by
from taichi_sand.world.sweep import each_grain, nothing, sweep

ROUNDS = 8
"""Most rounds of impacts in a step."""


@ti.func
def free(w: ti.template(), i):
    """Whether grain i can move and carried no contact in the last step."""
    carried = w.grains.wrench[i]
    return w.grains.mobility[i].x > 0.0 and carried.x == 0.0 and carried.y == 0.0


@ti.func
def collide(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Answers the impact of pair p, but for those with walls that answer to all their contacts at once."""
    if not apart(w, p, wall):
        answer(w, s, c, p, wall, w.pairs.mass[p])


@ti.func
def ram(w: ti.template(), s: ti.template(), c: ti.template(), p):
    """Answers the impact of pair p with a wall with `force`, and has the wall take its part. One without mass gives none."""
    m = driver(w, p)
    normal = w.pairs.normal[p]
    if w.movers.mass[m] > 0.0:
        mass = 1.0 / (1.0 / w.pairs.mass[p] + w.movers.way[m].dot(normal) ** 2 / w.movers.mass[m])
        impulse = answer(w, s, c, p, True, mass)
        hit_by(w, m, along_course(w, m, impulse, normal))


@ti.func
def ram_all(w: ti.template(), s: ti.template(), c: ti.template()):
    """The impacts with walls with `force`, one after the other."""
    if ti.static(drives(w)):
        ti.loop_config(serialize=True)
        for _run in range(1):
            if colliding(w):
                for m in range(w.movers.walls[None]):
                    each_driven(w, s, c, m, ram)


@ti.func
def answer(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template(), mass):
    """Answers the impact of pair p, of effective mass `mass` [kg], if it would touch within the step faster than the threshold
    (physics.md A2, A4).

    One of its grains must be free: in a pile that closes under load the impulses have to be remembered, not answered and forgotten.
    What is reflected is the velocity of the moment, with half the step's gravity: with all of it a bounce would add speed * g h.
    Returns the impulse (normal, tangential) [N s].
    """
    pairs = ti.static(w.pairs)
    impulse = ti.Vector([0.0, 0.0])
    i, j, normal, gap, motion, lever, speed = meeting(w, p, wall)
    if speed < -c.threshold and speed * c.step + gap < 0.0 and (free(w, i) or free(w, j)):
        arm_i, arm_j = arms(w, i, j, gap, lever, wall)
        kicked = (movable(w, j) - movable(w, i) if ti.static(not wall) else -movable(w, i)) * w.box[None].gravity.dot(normal) * c.step
        impulse.x = -(1.0 + c.restitution) * mass * (speed - 0.5 * kicked)
        if ti.static(w.turns):
            slip = slip_of(w, i, j, motion, normal, arm_i, arm_j, wall) + slip_by(w, i, j, impulse.x, arm_i, arm_j, lever, wall)
            bound = cone(w, s, c, p, wall, impulse.x)
            impulse.y = within(bound, -tangential_mass(w, i, j, arm_i, arm_j, wall) * slip)
        give(w, s, i, j, impulse, normal, arm_i, arm_j, lever, wall)
        drive(w, s, p, gap + pairs.contact_distance[p], normal, impulse, wall)
        lowest(w, s, c, p, 0.0, 0.0)  # they touch
        w.pace[None].hit = 1
    return impulse


@ti.func
def guess(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """The contact impulses of the step before, where the kick has left them out."""
    g = ti.static(w.grains)
    if w.pace[None].guess == 1:
        for i in range(start, end):
            settle_work(w, s, i, g.wrench[i], g.wrench[i] * g.mobility[i])
            add(g.twist, i, g.wrench[i] * g.mobility[i])


@ti.func
def colliding(w: ti.template()):
    """Whether a round of impacts is due."""
    return w.pace[None].spent == 0 and w.pace[None].impacts == 1


@ti.func
def close_round(w: ti.template()):
    """One more round of impacts only if the last one met any."""
    if w.pace[None].spent == 0:
        w.pace[None].impacts = w.pace[None].hit
        w.pace[None].hit = 0


@ti.func
def collide_all(w: ti.template(), s: ti.template(), c: ti.template()):
    """Rounds of impacts, one after the other, until there are none left or the rounds are used up."""
    if ti.static(w.layout == "one"):
        for _round in range(ROUNDS):
            sweep(w, (collide,), nothing, s, c, colliding)
            ram_all(w, s, c)
            close_round(w)
    else:
        for _round in ti.static(range(2)):
            sweep(w, (collide,), nothing, s, c, colliding)
            ram_all(w, s, c)
            close_round(w)
    w.pace[None].impacts = 0
    each_grain(w, guess, s, c)
