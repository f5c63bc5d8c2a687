"""Rigid discs: Gauss-Seidel projection of contacts in soft sub-steps.

Each step: kick (gravity, and the impulses that the contacts carried last), one sweep that solves every contact as a stiff, strongly
damped spring (Catto's soft step, as in Solver2D), drift, one sweep without the spring that takes out the velocity the spring put in.
The spring lets a pile sag by 0.81 n g h^2 (physics.md D3); a slow reference impulse, which creeps after the carried one, takes over the
load in time, so that the sag fades while the pile rests. An approach faster than the threshold is an impact: it is answered at once
with restitution and friction (Walton's hard disc, physics.md A4), and is not remembered as a carried force.
"""

from dataclasses import dataclass
from typing import Any

import taichi as ti

from taichi_sand.solvers.tolerance import Bed, rigid_numbers
from taichi_sand.world.geometry import distance_to_second, perp
from taichi_sand.world.motion import drift, movable
from taichi_sand.world.sweep import each_grain, going, nothing, sweep
from taichi_sand.world.tables import fill_struct

MEMORY = 1
KEEP_FORCE = True
REFERENCE_SHARE = 0.95
"""The reference stays below this share of the carried impulse, so that the soft contact keeps its damping."""


def constants_type(real: Any) -> Any:
    """Struct of the numbers of the solver; all may change while it runs."""
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
    )


ROUNDS = 8
"""Most rounds of impacts in a step."""


@dataclass(frozen=True, eq=False)
class Rigid:
    """The solver as kernels see it."""

    constants: Any  # 0-D field of constants_type
    reference: Any  # column of the pair table: slow reference of the normal force [N]
    effects: tuple
    step: Any  # ti.func of one step


@ti.func
def kick(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """Gravity, and the contact impulses of the step before as a first guess of this one's."""
    g = ti.static(w.grains)
    gravity = w.box[None].gravity * c.step
    for i in range(start, end):
        g.velocity[i] += g.load[i] * g.inverse_mass[i] + gravity * movable(w, i)
    if ti.static(w.turns):
        for i in range(start, end):
            g.spin[i] += g.torque[i] * g.inverse_inertia[i]


@ti.func
def move(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """Drift, as the grain function of a sweep; clears the loads for the sweep that follows."""
    g = ti.static(w.grains)
    drift(w, start, end)
    for i in range(start, end):
        g.load[i] = ti.Vector([0.0, 0.0])
    if ti.static(w.turns):
        for i in range(start, end):
            g.torque[i] = 0.0


@ti.func
def free(w: ti.template(), i):
    """Whether grain i can move and carried no contact in the last step."""
    load = w.grains.load[i]
    return w.grains.inverse_mass[i] > 0.0 and load.x == 0.0 and load.y == 0.0


@ti.func
def cone(w: ti.template(), s: ti.template(), p, normal):
    """Largest tangential impulse for a normal one."""
    bound = 0.0
    for effect in ti.static(s.effects):
        if ti.static(hasattr(effect, "cone")):
            bound += effect.cone(w, p, normal)
    return bound


@ti.func
def slip_and_arms(w: ti.template(), p, i, j, velocity, normal, gap, wall: ti.template()):
    """Slip of the second surface along the tangent [m/s], and the levers of both, which add up to the distance of the centres."""
    g = ti.static(w.grains)
    arm_i = g.radius[i] + (gap if ti.static(wall) else 0.5 * gap)
    arm_j = 0.0 if ti.static(wall) else g.radius[j] + 0.5 * gap
    slip = velocity.dot(perp(normal)) - arm_i * g.spin[i]
    if ti.static(not wall):
        slip -= arm_j * g.spin[j]
    return slip, arm_i, arm_j


@ti.func
def give(w: ti.template(), i, j, impulse, normal, arm_i, arm_j, wall: ti.template()):
    """Applies an impulse (normal, tangential) [N s] to the second grain of a pair, and its opposite to the first."""
    g = ti.static(w.grains)
    push = impulse.x * normal + impulse.y * perp(normal)
    g.velocity[i] -= push * g.inverse_mass[i]
    if ti.static(not wall):
        g.velocity[j] += push * g.inverse_mass[j]
    if ti.static(w.turns):
        g.spin[i] -= arm_i * impulse.y * g.inverse_inertia[i]
        if ti.static(not wall):
            g.spin[j] -= arm_j * impulse.y * g.inverse_inertia[j]


@ti.func
def collide(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Answers the impact of pair p, if it would touch within the step faster than the threshold (physics.md A2, A4).

    One of its grains must be free: in a pile that closes under load the impulses have to be remembered, not answered and forgotten.
    """
    pairs = ti.static(w.pairs)
    g = ti.static(w.grains)
    i = pairs.first[p]
    j = i if ti.static(wall) else pairs.second[p]
    normal, gap = pairs.normal[p], pairs.gap[p]
    velocity = -g.velocity[i] if ti.static(wall) else g.velocity[j] - g.velocity[i]
    speed = velocity.dot(normal)
    if speed < -c.threshold and speed * c.step + gap < 0.0 and (free(w, i) or free(w, j)):
        slip, arm_i, arm_j = 0.0, 0.0, 0.0
        impulse = ti.Vector([-(1.0 + c.restitution) * pairs.mass[p] * speed, 0.0])
        if ti.static(w.turns):
            slip, arm_i, arm_j = slip_and_arms(w, p, i, j, velocity, normal, gap, wall)
            bound = cone(w, s, p, impulse.x)
            impulse.y = ti.min(ti.max(-pairs.mass_t[p] * slip, -bound), bound)
        give(w, i, j, impulse, normal, arm_i, arm_j, wall)
        w.pace[None].hit = 1


@ti.func
def project(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template(), soft: ti.template()):
    """Solves pair p for its impulse: soft, pushing overlap out, or hard, for the velocity alone. Returns the impulse it carries."""
    pairs = ti.static(w.pairs)
    g = ti.static(w.grains)
    i = pairs.first[p]
    j = i if ti.static(wall) else pairs.second[p]
    normal, gap = pairs.normal[p], pairs.gap[p]
    velocity = -g.velocity[i] if ti.static(wall) else g.velocity[j] - g.velocity[i]
    speed = velocity.dot(normal)
    carried = pairs.force[p] * c.step
    if carried.x > 0.0 or speed * c.step + gap < 0.0:
        want = pairs.mass[p] * (speed + ti.max(gap, 0.0) * c.rate)
        if ti.static(soft):
            if gap < 0.0:
                bias = ti.max(c.bias_rate * gap, -c.push_cap)
                want = pairs.mass[p] * c.mass_scale * (speed + bias)
                want += c.impulse_scale * (carried.x - s.reference[p] * c.step)
        new = ti.Vector([ti.max(carried.x - want, 0.0), 0.0])
        slip, arm_i, arm_j = 0.0, 0.0, 0.0
        if ti.static(w.turns):
            slip, arm_i, arm_j = slip_and_arms(w, p, i, j, velocity, normal, gap, wall)
            bound = cone(w, s, p, new.x)
            new.y = ti.min(ti.max(carried.y - pairs.mass_t[p] * slip, -bound), bound)
        give(w, i, j, new - carried, normal, arm_i, arm_j, wall)
        carried = new
        pairs.force[p] = carried * c.rate
    elif ti.static(not soft):
        if speed < -0.5 * c.threshold and 2.0 * speed * c.step + gap < 0.0:
            w.pace[None].impacts = 1
    return carried


@ti.func
def solve(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """First sweep of a step, before the grains move."""
    project(w, s, c, p, wall, True)


@ti.func
def look(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Normal and gap of pair p, where its grains have moved to."""
    distance, normal = distance_to_second(w, p, w.pairs.first[p], wall)
    w.pairs.normal[p], w.pairs.gap[p] = normal, distance - w.pairs.contact_distance[p]


@ti.func
def relax(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Second sweep, where the grains have moved to; lays by what the pair carries for the next step."""
    pairs = ti.static(w.pairs)
    g = ti.static(w.grains)
    i = pairs.first[p]
    normal, gap = pairs.normal[p], pairs.gap[p]
    carried = project(w, s, c, p, wall, False)
    goal = REFERENCE_SHARE * carried.x * c.rate
    s.reference[p] = ti.min(goal, s.reference[p] + c.reference_rate * (goal - s.reference[p]))
    if carried.x > 0.0:
        push = carried.x * normal + carried.y * perp(normal)
        g.load[i] -= push
        if ti.static(not wall):
            g.load[pairs.second[p]] += push
        if ti.static(w.turns):
            g.torque[i] -= (g.radius[i] + (gap if ti.static(wall) else 0.5 * gap)) * carried.y
            if ti.static(not wall):
                j = pairs.second[p]
                g.torque[j] -= (g.radius[j] + 0.5 * gap) * carried.y


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
            close_round(w)
    else:
        for _round in ti.static(range(2)):
            sweep(w, (collide,), nothing, s, c, colliding)
            close_round(w)
    w.pace[None].impacts = 0


@ti.func
def step(w: ti.template(), s: ti.template()):
    """One sub-step."""
    c = s.constants[None]
    each_grain(w, kick, s, c)
    collide_all(w, s, c)
    sweep(w, (solve,), move, s, c, going)
    sweep(w, (look, relax), nothing, s, c, going)


def numbers(scene: Any, bed: Bed) -> dict[str, float]:
    """Numbers of `constants_type`, and the speed cap [m/s]."""
    return rigid_numbers(scene.solver, bed)


def build(scene: Any, values: dict[str, float], own: list, effects: tuple, real: Any) -> Rigid:
    """The solver for a world; `own` holds the columns of the pair table that MEMORY asked for."""
    return Rigid(fill_struct(constants_type(real), values), own[0], effects, step)
