"""The projection of a rigid contact: the impulse that it needs, soft or hard, within its bounds."""

import taichi as ti

from taichi_sand.solvers.flights import flight
from taichi_sand.solvers.impulses import arms, friction_bound, give, is_held, meeting, min_normal_impulse, resist_rolling, slip_by, slip_of
from taichi_sand.world.geometry import at_least, within
from taichi_sand.world.walls.servo import weightless

OVER_RELAXATION = 1.5
"""The second sweep corrects the velocity of a contact that bears a load by so many times what that contact alone would need.

What a sweep does to the velocities u of the contacts is u -> S u; as impulses are carried on, a step does u' = S (2 u - u_before). A
pattern with the eigenvalue s of S then dies out as z, z^2 = s (2 z - 1). The slow swing of a pile n deep has s = 1 - O(1/n^2), so
|z|^2 = s: it rings for n^2 steps. Over-relaxation by w multiplies 1 - s by w / (2 - w), at no cost: a pile comes to rest three times
as soon. But it also turns s of the short patterns into complex numbers, and these have to stay within |z| < 1: columns of up to 300
discs rest with 1.5, those of 100 explode with 1.8, those of 200 with 1.3 in both sweeps."""
TOUCHING = 1e-6
"""A contact is soft below this gap, over the distance of the centres. Were it hard at a gap of nothing, where grains are often laid, it
would stay so until rounding closed it, seconds later, and then give way all at once."""
NEAR = 0.5
"""No friction across a gap wider than this, over the distance of the centres when they touch: the levers would be longer than the pair's
effective mass reckons with, and the impulse too strong (by less than twice up to here)."""


@ti.func
def touches(w: ti.template(), p):
    """Whether pair p is closed."""
    return w.pairs.gap[p] < TOUCHING * w.pairs.contact_distance[p]


@ti.func
def project(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template(), soft: ti.template(), trial: ti.template()):
    """Solves pair p for its impulse: soft, pushing overlap out, or hard, for the velocity alone. Returns the impulse it carries, or with
    `trial` would carry.
    """
    pairs = ti.static(w.pairs)
    i, j, normal, gap, motion, lever, speed = meeting(w, p, wall)
    carried = pairs.force[p] * c.step
    low = min_normal_impulse(w, s, c, p, gap, gap + ti.static(0.5 if soft else -0.5) * c.step * speed)
    held = is_held(s, carried) or low < 0.0
    due = held or speed * c.step + gap < 0.0
    if ti.static(not soft):  # faster approaches are left to the impacts of the next step
        due = held or (speed * c.step + gap < 0.0 and (speed >= -c.threshold or weightless(w, p, wall)))
    elif ti.static(not wall):
        if due and not held:  # they may fly past one another
            due = flight(w, p, i, j, normal, gap, motion, speed) < c.step
    if due:
        want = pairs.mass[p] * (speed + at_least(0.0, gap) * c.rate)
        if ti.static(soft):
            if touches(w, p):
                bias = at_least(-c.push_cap, c.bias_rate * gap)
                want = pairs.mass[p] * c.mass_scale * (speed + bias)
                want += c.impulse_scale * (carried.x - s.reference[p] * c.step)
        elif s.reference[p] > 0.0:
            want *= OVER_RELAXATION
        if low < 0.0 and gap > 0.0 and want > carried.x:
            want = at_least(carried.x, draw(w, s, c, p, gap, speed, carried.x, soft))
        new = ti.Vector([at_least(low, carried.x - want), 0.0])
        arm_i, arm_j = arms(w, i, j, gap, lever, wall)
        if ti.static(w.turns):
            slip = slip_of(w, i, j, motion, normal, arm_i, arm_j, wall) + slip_by(w, i, j, new.x - carried.x, arm_i, arm_j, lever, wall)
            bound = ti.select(gap < NEAR * pairs.contact_distance[p], friction_bound(w, s, c, p, wall, new.x - low), 0.0)
            new.y = within(bound, carried.y - pairs.mass_t[p] * slip)
        if ti.static(not trial):
            give(w, s, i, j, new - carried, normal, arm_i, arm_j, lever, ti.static(not soft), wall)
            resist_rolling(w, s, c, p, i, j, new.x - low, wall)
        carried = new
        if ti.static(not trial):
            pairs.force[p] = carried * c.rate
    elif ti.static(not soft and not trial):
        if ti.max(speed + 0.5 * c.threshold, 2.0 * speed * c.step + gap) < 0.0:  # as one, as in impacts.hard
            w.pace[None].impacts = 1
    return carried


@ti.func
def draw(w: ti.template(), s: ti.template(), c: ti.template(), p, gap, speed, carried, soft: ti.template()):
    """By how much the impulse of pair p changes where a bridge draws two grains together that are apart: as softly as an overlap is
    pushed out. Were the gap to close within the step, bridges that pull against one another would shake a pile for good.
    """
    change = w.pairs.mass[p] * speed
    if ti.static(soft):
        change = c.mass_scale * (change + w.pairs.mass[p] * c.bias_rate * gap) + c.impulse_scale * (carried - s.reference[p] * c.step)
    return change
