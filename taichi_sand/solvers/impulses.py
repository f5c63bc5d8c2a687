"""Levers, speeds, bounds and impulses of a rigid contact, as the solver needs them at one pair."""

from typing import Any

import taichi as ti

from taichi_sand.world.clumps import tilt, torques
from taichi_sand.world.extras.energy_ledger import set_off, strike
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.geometry import (
    add,
    couple,
    distance_to_second,
    motion_of,
    perp,
    rolling,
    spin,
    weigh_clumps,
    within,
    wrench,
)
from taichi_sand.world.search.pair_history import hand_on


@ti.func
def arms(w: ti.template(), i, j, gap, lever, wall: ti.template()):
    """Levers of both grains for a tangential push, from the centre to the contact point; of discs they add up to the distance of the
    centres. A wall that the grain has slid off is FAR, and gives back what it carried at the radius.
    """
    arm_i, arm_j = lever.x, lever.y
    if ti.static(not w.clumps):
        arm_i = w.grains.radius[i]
    if ti.static(wall):
        arm_i += ti.select(gap < arm_i, gap, 0.0)
    else:
        if ti.static(not w.clumps):
            arm_j = w.grains.radius[j]
        arm_i += 0.5 * gap
        arm_j += 0.5 * gap
    return arm_i, arm_j


@ti.func
def tangential_mass(w: ti.template(), i, j, arm_i, arm_j, wall: ti.template()):
    """Effective mass of two grains along their tangent, with these levers [kg]. Before they touch the levers are longer than those that
    the pair's own `mass_t` is made with: across a gap of two radii an impulse by that would turn the slip around, six times as fast.
    """
    give = w.grains.mobility[i].x + w.grains.mobility[i].z * arm_i * arm_i
    if ti.static(not wall):
        give += w.grains.mobility[j].x + w.grains.mobility[j].z * arm_j * arm_j
    return 1.0 / give


@ti.func
def levers_of(w: ti.template(), p):
    """Levers of pair p at its present normal; of discs there is nothing to know."""
    lever = ti.Vector([0.0, 0.0, 0.0, 0.0])
    if ti.static(w.clumps):
        lever = w.pairs.levers[p]
    return lever


@ti.func
def speed_of(w: ti.template(), i, j, motion, normal, lever, wall: ti.template()):
    """Speed at which the surfaces of a pair part [m/s]."""
    speed = motion.dot(normal)
    if ti.static(w.clumps):
        speed += tilt(w, i, j, lever, wall)
    return speed


@ti.func
def meeting(w: ti.template(), p, wall: ti.template()):
    """Grains i and j of pair p (of a wall pair i twice), its normal and gap, the motion of the second as seen from the first, its levers,
    and the speed at which the surfaces part.
    """
    i = w.pairs.first[p]
    j = i if ti.static(wall) else w.pairs.second[p]
    normal, gap = w.pairs.normal[p], w.pairs.gap[p]
    motion = motion_of(w, p, i, j, gap + w.pairs.contact_distance[p], normal, wall)
    lever = levers_of(w, p)
    return i, j, normal, gap, motion, lever, speed_of(w, i, j, motion, normal, lever, wall)


@ti.func
def update_contact(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Normal and gap of pair p, where its grains have moved to."""
    i = w.pairs.first[p]
    distance, normal = distance_to_second(w, p, i, wall)
    if ti.static(wall):
        hand_on(w, p, i, distance, normal, False)
    w.pairs.normal[p], w.pairs.gap[p] = normal, distance - w.pairs.contact_distance[p]
    if ti.static(w.clumps):
        weigh_clumps(w, p, i, i if ti.static(wall) else w.pairs.second[p], wall)


@ti.func
def slip_of(w: ti.template(), i, j, motion, normal, arm_i, arm_j, wall: ti.template()):
    """Velocity of the second surface along the tangent, as seen from the first [m/s]."""
    slip = motion.dot(perp(normal)) - arm_i * spin(w, i)
    if ti.static(not wall):
        slip -= arm_j * spin(w, j)
    return slip


@ti.func
def slip_by(w: ti.template(), i, j, impulse, arm_i, arm_j, lever, wall: ti.template()):
    """Slip that a normal impulse [N s] makes by turning the grains: none of discs."""
    slip = 0.0
    if ti.static(w.clumps):
        slip = arm_i * lever.z * w.grains.mobility[i].z * impulse
        if ti.static(not wall):
            slip -= arm_j * lever.w * w.grains.mobility[j].z * impulse
    return slip


@ti.func
def give(w: ti.template(), s: ti.template(), i, j, impulse, normal, arm_i, arm_j, lever, moved: ti.template(), wall: ti.template()):
    """Applies an impulse (normal, tangential) [N s] to the second grain of a pair, and its opposite to the first: before they have `moved`
    in this step, or after.
    """
    push = impulse.x * normal + impulse.y * perp(normal)
    taken, given = torques(w, impulse, arm_i, arm_j, lever)
    strike(w, s, i, j, -wrench(push, taken), wrench(push, given), moved, wall)


@ti.func
def friction_bound(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template(), normal):
    """Largest tangential impulse for a normal one."""
    bound = 0.0
    for effect in ti.static(s.effects):
        if ti.static(offers(effect, "friction_bound")):
            bound += effect.friction_bound(w, c, p, wall, normal)
    return bound


@ti.func
def min_normal_impulse(w: ti.template(), s: ti.template(), c: ti.template(), p, gap, middle):
    """Lowest normal impulse, from the gap now and in the middle of the step: 0, or less where an effect can pull."""
    low = 0.0
    for effect in ti.static(s.effects):
        if ti.static(offers(effect, "min_normal_impulse")):
            low += effect.min_normal_impulse(w, c, p, gap, middle)
    return low


@ti.func
def resist_rolling(w: ti.template(), s: ti.template(), c: ti.template(), p, i, j, normal, wall: ti.template()):
    """Solves pair p for its angular impulses, each within its bound."""
    for effect in ti.static(s.effects):
        if ti.static(offers(effect, "rolling_bound")):
            roll, radius, inertia = rolling(w, p, i, j, wall)
            carried = effect.torque[p] * c.step
            new = within(effect.rolling_bound(w, c, p, normal, radius), carried - inertia * roll)
            strike(w, s, i, j, -couple(new - carried), couple(new - carried), False, wall)
            effect.torque[p] = new * c.rate


def pulls(solver: Any) -> bool:
    """Whether any effect can hold grains together."""
    return any(offers(effect, "min_normal_impulse") for effect in solver.effects)


@ti.func
def is_held(s: ti.template(), carried):
    """Whether a pair carries anything: where bridges pull, friction may hold two grains that do not push one another."""
    held = carried.x != 0.0
    if ti.static(pulls(s)):
        held = held or carried.y != 0.0
    return held


@ti.func
def load_of(w: ti.template(), s: ti.template(), c: ti.template(), p, i, j, carried, wall: ti.template()):
    """Impulses (x, y [N s], torque [N m s], 0) on both grains of pair p that carries this (normal, tangential), and its couples."""
    normal, lever = w.pairs.normal[p], levers_of(w, p)
    arm_i, arm_j = arms(w, i, j, w.pairs.gap[p], lever, wall)
    push = carried.x * normal + carried.y * perp(normal)
    taken, given = torques(w, carried, arm_i, arm_j, lever)
    first, second = -wrench(push, taken), wrench(push, given)
    for effect in ti.static(s.effects):
        if ti.static(offers(effect, "rolling_bound")):
            first -= couple(effect.torque[p] * c.step)
            second += couple(effect.torque[p] * c.step)
    return first, second


@ti.func
def store_impulse(w: ti.template(), s: ti.template(), c: ti.template(), p, carried, wall: ti.template(), anew: ti.template()):
    """Adds the impulse that pair p carries to what its grains start the next step with; `anew` in every step, once."""
    g = ti.static(w.grains)
    if is_held(s, carried):
        i = w.pairs.first[p]
        j = i if ti.static(wall) else w.pairs.second[p]
        first, second = load_of(w, s, c, p, i, j, carried, wall)
        if ti.static(anew):
            set_off(w, s, i, j, first, second, wall)
        add(g.wrench, i, first)
        if ti.static(not wall):
            add(g.wrench, j, second)
