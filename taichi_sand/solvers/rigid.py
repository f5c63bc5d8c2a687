"""Rigid discs: Gauss-Seidel projection of contacts in soft sub-steps.

Each step: kick (gravity, and the impulses that the contacts carried last), one sweep that solves every contact as a stiff, strongly
damped spring (Catto's soft step, as in Solver2D), drift, one sweep without the spring that takes out the velocity the spring put in.
The spring lets a pile sag by 0.81 n g h^2 (physics.md D3); a slow reference impulse, which creeps after the carried one, takes over the
load in time, so that the sag fades while the pile rests. The second sweep is over-relaxed: a deep pile comes to rest sooner. An approach
faster than the threshold is an impact: it is answered at once with restitution and friction (Walton's hard disc, physics.md A4), and is
not remembered as a carried force.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.solvers.bed import Bed
from taichi_sand.solvers.flights import flight
from taichi_sand.solvers.impacts import collide_all, warm_start
from taichi_sand.solvers.impulses import (
    arms,
    friction_bound,
    give,
    meeting,
    min_normal_impulse,
    resist_rolling,
    slip_by,
    slip_of,
    store_impulse,
    update_contact,
)
from taichi_sand.solvers.tolerance import rigid_numbers
from taichi_sand.taichi_support import field_pool
from taichi_sand.world.extras.energy_ledger import settle_work
from taichi_sand.world.extras.links import pull_links, settle_links
from taichi_sand.world.geometry import add, at_least, movable, within, wrench
from taichi_sand.world.motion import drift, with_body
from taichi_sand.world.sweep import each_grain, each_pair, going, nothing, sweep, sweep_twice, sweeps_join
from taichi_sand.world.tables import World, fill_struct
from taichi_sand.world.walls.motion import place_walls
from taichi_sand.world.walls.servo import along_course, apart, bear, drives, nobody, weightless
from taichi_sand.world.walls.wedge import feel, holds

MEMORY = 1
REFERENCE_SHARE = 0.83
"""The reference takes over this share of the carried impulse at most: the sag falls to the rest of it, and the soft contact keeps
enough of the load to damp. With 0.95 piles 45 grains deep shake."""
OVER_RELAXATION = 1.5
"""The second sweep corrects the velocity of a contact that bears a load by so many times what that contact alone would need.

What a sweep does to the velocities u of the contacts is u -> S u; as impulses are carried on, a step does u' = S (2 u - u_before). A
pattern with the eigenvalue s of S then dies out as z, z^2 = s (2 z - 1). The slow swing of a pile n deep has s = 1 - O(1/n^2), so
|z|^2 = s: it rings for n^2 steps. Over-relaxation by w multiplies 1 - s by w / (2 - w), at no cost: a pile comes to rest three times
as soon. But it also turns s of the short patterns into complex numbers, and these have to stay within |z| < 1: columns of up to 300
discs rest with 1.5, those of 100 explode with 1.8, those of 200 with 1.3 in both sweeps."""
UNLOADED = 3.0
"""A moving wall feels at least a third of the overlap that its force would make without the reference: by the overlap alone it would go on
for as long as the reference takes the load over, up to six times the force that stops it when it presses fast."""


def constants_type(real: Any, live: Iterable[str]) -> Any:
    """Struct of the numbers of the solver, and of the live parameters of the effects; all may change while it runs."""
    return ti.types.struct(
        step=real,  # h [s]
        rate=real,  # 1 / h [1/s]
        mass_scale=real,  # of the soft contact
        impulse_scale=real,
        bias_rate=real,  # [1/s]
        push_cap=real,  # fastest separation of overlapping grains [m/s]
        restitution=real,
        threshold=real,  # slowest impact [m/s]
        reference_rate=real,  # share of the way that the reference impulse creeps in a step
        **dict.fromkeys(live, real),
    )


TOUCHING = 1e-6
"""A contact is soft below this gap, over the distance of the centres. Were it hard at a gap of nothing, where grains are often laid, it
would stay so until rounding closed it, seconds later, and then give way all at once."""
NEAR = 0.5
"""No friction across a gap wider than this, over the distance of the centres when they touch: the levers would be longer than the pair's
effective mass reckons with, and the impulse too strong (by less than twice up to here)."""


@dataclass(frozen=True, eq=False)
class Rigid:
    """The solver as kernels see it."""

    constants: Any  # 0-D field of constants_type
    reference: Any  # column of the neighbour list: slow reference of the normal force [N]
    struck: Any  # of a grain: twice the last round of impacts of this step in which it was hit, plus 1 if they moved it; 0 = none, i32
    near: Any  # of a grain: twice the last round in which it may have got pairs of a grain that was hit
    effects: tuple
    step: Any  # ti.func of one step
    renew: Any  # ti.func that starts it anew after grains, walls, the step or who sleeps have changed
    books: bool  # whether an effect has the hook `heat`
    meets: ClassVar[bool] = True  # whether some steps have impacts, and others none


@ti.func
def kick(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """Gravity, and the contact impulses of the step before as a first guess of this one's: after the impacts, if there may be any, which
    are to meet real velocities, not guesses (300 discs poured at restitution 1 heated up by 0.3 m g H otherwise).
    """
    g = ti.static(w.grains)
    gravity = wrench(w.box[None].gravity * c.step, 0.0)
    early = 1.0 - ti.cast(w.pace[None].impacts, w.real)
    for i in range(start, end):
        change = with_body(w, s, c, i, early * g.wrench[i], c.step) * g.mobility[i] + gravity * movable(w, i)
        settle_work(w, s, i, early * g.wrench[i], change)
        settle_links(w, s, i, c.step, change)
        add(g.twist, i, change)


@ti.func
def move(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """Drift, as the grain function of a sweep; clears the impulses for the sweep that follows."""
    drift(w, start, end)
    clear_stored_impulse(w, s, c, start, end)


@ti.func
def clear_stored_impulse(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """Clears the impulses, as a grain function of a sweep."""
    for i in range(start, end):
        w.grains.wrench[i] = ti.Vector([0.0, 0.0, 0.0, 0.0])


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
    held = carried.x != 0.0 or low < 0.0
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
        if speed < -0.5 * c.threshold and 2.0 * speed * c.step + gap < 0.0:
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


@ti.func
def solve(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """First sweep of a step, before the grains move."""
    if not apart(w, p, wall):
        project(w, s, c, p, wall, True, False)


@ti.func
def relax(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Second sweep, where the grains have moved to; stores what the pair carries for the next step."""
    if not apart(w, p, wall):
        keep(w, s, c, p, project(w, s, c, p, wall, False, False), wall)


@ti.func
def keep(w: ti.template(), s: ti.template(), c: ti.template(), p, carried, wall: ti.template()):
    """Stores the impulse that pair p carries for the next step."""
    goal = ti.select(touches(w, p), REFERENCE_SHARE * at_least(0.0, carried.x) * c.rate, 0.0)
    crept = s.reference[p] + c.reference_rate * (goal - s.reference[p])
    s.reference[p] = ti.select(crept < goal, crept, goal)
    store_impulse(w, s, c, p, carried, wall, True)
    pairs = ti.static(w.pairs)
    gap, felt = pairs.gap[p], 0.0
    if ti.static(w.moves):
        if holds(w, p, wall):
            stiffness = c.bias_rate * c.rate * c.mass_scale / c.impulse_scale * pairs.mass[p]
            felt = at_least(-gap, (s.reference[p] / stiffness - gap) / UNLOADED)
    feel(w, s, c, p, gap + pairs.contact_distance[p], pairs.normal[p], carried * c.rate, felt, wall)


@ti.func
def press(w: ti.template(), s: ti.template(), c: ti.template(), p, m, soft: ti.template()):
    """The impulse by which wall pair p would resist the course of wall m as that runs now [N s], and by how much that grows with its
    speed [kg].
    """
    pairs = ti.static(w.pairs)
    new = project(w, s, c, p, True, soft, True)
    gain = ti.select(new.x > 0.0, pairs.mass[p], 0.0)
    if ti.static(soft):
        gain *= c.mass_scale
    elif s.reference[p] > 0.0:
        gain *= OVER_RELAXATION
    if ti.static(not w.turns):
        gain *= w.movers.way[m].dot(pairs.normal[p]) ** 2
    return ti.Vector([along_course(w, m, new, pairs.normal[p]), gain])


@ti.func
def press_softly(w: ti.template(), s: ti.template(), c: ti.template(), p, m, time):
    """What wall pair p resists the course of wall m with in the first sweep, see `press`."""
    return press(w, s, c, p, m, True)


@ti.func
def press_hard(w: ti.template(), s: ti.template(), c: ti.template(), p, m, time):
    """What wall pair p resists the course of wall m with in the second sweep, see `press`."""
    return press(w, s, c, p, m, False)


@ti.func
def solve_driven(w: ti.template(), s: ti.template(), c: ti.template(), p):
    """Solves pair p of a wall with `force`."""
    project(w, s, c, p, True, True, False)


@ti.func
def relax_driven(w: ti.template(), s: ti.template(), c: ti.template(), p):
    """Solves pair p of a wall with `force` in the second sweep."""
    project(w, s, c, p, True, False, False)


@ti.func
def keep_driven(w: ti.template(), s: ti.template(), c: ti.template(), p):
    """Stores what the pair of a wall with `force` carries."""
    keep(w, s, c, p, w.pairs.force[p] * c.step, True)


@ti.func
def store_impulse_again(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Stores the impulse that pair p carried last, as a pair function of a sweep."""
    store_impulse(w, s, c, p, w.pairs.force[p] * c.step, wall, False)


@ti.func
def renew(w: ti.template(), s: ti.template()):
    """What the grains start the next step with, from the pairs there are: after grains, walls or the step have been changed by hand."""
    c = s.constants[None]
    each_grain(w, clear_stored_impulse, s, c)
    sweep(w, (store_impulse_again,), nothing, s, c, going)


@ti.func
def step(w: ti.template(), s: ti.template(), impacts: ti.template()):
    """One sub-step; `impacts` unless it is known that there are none."""
    c = s.constants[None]
    if ti.static(w.moves):
        place_walls(w, 0.0, 0.5)
    pull_links(w, s, c, going, True)
    if ti.static(impacts):
        if w.pace[None].spent == 0:
            w.pace[None].warm_start = w.pace[None].impacts
            w.pace[None].round = 1
            w.pace[None].moved = 0
        each_grain(w, kick, s, c)
        collide_all(w, s, c)
    if ti.static(sweeps_join(w)):
        sweep_twice(w, warm_start if ti.static(impacts) else kick, (solve,), move, (update_contact, relax), s, going)
    else:
        each_grain(w, warm_start if ti.static(impacts) else kick, s, c)
        if ti.static(drives(w)):
            sweep(w, (solve,), nothing, s, c, going)
            bear(w, s, press_softly, solve_driven, nobody, True)
            each_grain(w, move, s, c)
        else:
            sweep(w, (solve,), move, s, c, going)
        if ti.static(w.moves):
            place_walls(w, 1.0, 0.5)
        if ti.static(w.layout == "cells"):
            each_pair(w, update_contact, s, c, going)
            sweep(w, (relax,), nothing, s, c, going)
        else:
            sweep(w, (update_contact, relax), nothing, s, c, going)
        if ti.static(drives(w)):
            bear(w, s, press_hard, relax_driven, keep_driven, False)


def numbers(scene: Any, bed: Bed) -> dict[str, float]:
    """Numbers of `constants_type`, and the speed cap [m/s]."""
    return rigid_numbers(scene, bed)


def build(scene: Any, values: dict[str, float], live: dict[str, float], own: list, effects: tuple, world: World) -> Rigid:
    """The solver for a world; `own` holds the columns of the neighbour list that MEMORY asked for, `live` the effects' live parameters."""
    constants = fill_struct(constants_type(world.real, live), {**values, **live})
    struck, near = field_pool.scalars(ti.i32, world.capacity), field_pool.scalars(ti.i32, world.capacity)
    return Rigid(constants, own[0], struck, near, effects, step, renew, any(hasattr(effect, "heat") for effect in effects))
