"""Molecular dynamics: soft discs, forces summed pair by pair, small explicit steps.

The law of the normal force is f_n = k_d ζ^α ζ' + k_r ζ^β, ζ the overlap, never attractive; `linear` is α, β = 0, 1, `hertz` 1/4, 3/2,
the choice α = (β - 1)/2 for which restitution does not depend on speed (physics.md A3). k_d is `damping` times the root of the effective
mass of the pair, so that pairs of all sizes have the same restitution.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_sand.solvers.bed import Bed
from taichi_sand.solvers.impulses import slip_of
from taichi_sand.solvers.integrators import INTEGRATORS, Stages, allocate_stages
from taichi_sand.solvers.tighten import follow
from taichi_sand.solvers.tolerance import md_damping, md_numbers
from taichi_sand.world.clumps import levers, rim, tilt, torques
from taichi_sand.world.extras.energy_ledger import set_off, split
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.extras.materials import bounce_of
from taichi_sand.world.geometry import add, at_least, couple, distance_to_second, motion_of, perp, rolling, wrench
from taichi_sand.world.search.pair_history import hand_on
from taichi_sand.world.tables import World, fill_struct
from taichi_sand.world.walls.servo import along_course, balance, carried, drives, pressed, run_at, swinging, thrust
from taichi_sand.world.walls.wedge import feel

MEMORY = 0
__all__ = ["MEMORY", "bounces", "build", "follow", "numbers"]


def constants_type(real: Any, live: Iterable[str]) -> Any:
    """Struct of the numbers of the solver, and of the live parameters of the effects; all may change while it runs."""
    return ti.types.struct(
        step=real,  # h [s]
        stiffness=real,  # k_r [N/m^beta]
        damping=real,  # k_d / sqrt(effective mass), or k_d itself where the scene gives it
        alpha=real,
        beta=real,
        **dict.fromkeys(live, real),
    )


@dataclass(frozen=True, eq=False)
class MolecularDynamics:
    """The solver as kernels see it."""

    constants: Any  # 0-D field of constants_type
    law: str  # linear, hertz or custom
    weighted: bool  # whether `damping` is to be multiplied by the root of the effective mass; if not it is k_d itself
    integrator: Any  # ti.func of solvers.integrators
    run: Any  # ti.func that has the walls with force run
    stages: Stages | None  # what RK4 keeps within a step
    effects: tuple
    step: Any  # ti.func of one step
    books: bool  # whether an effect has the hook `heat`
    lags: bool  # whether the forces of a step are those of where the grains were at its start
    meets: ClassVar[bool] = False  # whether some steps have impacts, and others none


@ti.func
def elastic_stiffness(s: ti.template(), c: ti.template(), overlap):
    """f_n / overlap of the elastic part [N/m]."""
    stiffness = c.stiffness
    if ti.static(s.law == "hertz"):
        stiffness *= ti.sqrt(overlap)
    elif ti.static(s.law == "custom"):
        stiffness *= overlap ** (c.beta - 1.0)
    return stiffness


@ti.func
def damping(w: ti.template(), s: ti.template(), c: ti.template(), p, root_mass, overlap, wall: ti.template()):
    """k_d ζ^α of pair p [N s/m]."""
    coefficient = c.damping
    if ti.static(w.mixed and s.weighted):
        coefficient = bounce_of(w, p, c.damping, wall) * ti.sqrt(c.stiffness)
    if ti.static(s.weighted):
        coefficient *= root_mass
    if ti.static(s.law == "hertz"):
        coefficient *= ti.sqrt(ti.sqrt(overlap))
    elif ti.static(s.law == "custom"):
        coefficient *= overlap**c.alpha
    return coefficient


@ti.func
def load(w: ti.template(), s: ti.template(), c: ti.template(), i, j, force, normal, arm_i, arm_j, lever, wall: ti.template()):
    """Adds a force (normal, tangential) on the second grain, and its opposite on the first, to their loads."""
    push = force.x * normal + force.y * perp(normal)
    taken, given = torques(w, force, arm_i, arm_j, lever)
    set_off(w, s, i, j, -c.step * wrench(push, taken), c.step * wrench(push, given), wall)
    add(w.grains.wrench, i, -wrench(push, taken))
    if ti.static(not wall):
        add(w.grains.wrench, j, wrench(push, given))


@ti.func
def turn(w: ti.template(), s: ti.template(), c: ti.template(), i, j, torque, wall: ti.template()):
    """Adds a torque on the second grain, and its opposite on the first, to their loads."""
    set_off(w, s, i, j, -c.step * couple(torque), c.step * couple(torque), wall)
    add(w.grains.wrench, i, -couple(torque))
    if ti.static(not wall):
        add(w.grains.wrench, j, couple(torque))


@ti.func
def resist(
    w: ti.template(),
    s: ti.template(),
    c: ti.template(),
    p,
    i,
    j,
    normal_force,
    slip,
    stiffness,
    dashpot,
    wall: ti.template(),
    trial: ti.template(),
):
    """Tangential force of pair p, which slips by `slip` [m/s]; adds what resists rolling to the loads, unless it is a trial."""
    force = 0.0
    for effect in ti.static(s.effects):
        if ti.static(offers(effect, "tangent")):
            force += effect.tangent(w, c, p, wall, normal_force, slip, stiffness, dashpot)
        if ti.static(offers(effect, "couple") and not trial):
            roll, radius, inertia = rolling(w, p, i, j, wall)
            turn(w, s, c, i, j, effect.couple(w, c, p, normal_force, roll, radius, stiffness, inertia), wall)
    return force


@ti.func
def pushed(w: ti.template(), s: ti.template(), c: ti.template(), p, i, j, distance, normal, wall: ti.template(), trial: ti.template()):
    """Force of pair p, which overlaps (normal, tangential) [N], levers of both grains for it (four, and the first two of discs as
    well), and how fast the force grows with the overlap [N/m] and with the speed of approach [N s/m]. Effects remember what they
    need; with `trial` nothing else is changed.
    """
    pairs = ti.static(w.pairs)
    overlap = pairs.contact_distance[p] - distance
    force = ti.Vector([0.0, 0.0])
    motion = motion_of(w, p, i, j, distance, normal, wall)
    stiffness = elastic_stiffness(s, c, overlap)
    dashpot = damping(w, s, c, p, swinging(w, p, normal, wall), overlap, wall)
    speed = motion.dot(normal)
    arm_i = rim(w, p, i) - (overlap if ti.static(wall) else 0.5 * overlap)
    arm_j = 0.0 if ti.static(wall) else distance - arm_i
    lever = ti.Vector([0.0, 0.0, 0.0, 0.0])
    if ti.static(w.clumps):
        lever = levers(w, p, i, j, normal, arm_i, arm_j, wall)
        arm_i, arm_j = lever.x, lever.y
        speed += tilt(w, i, j, lever, wall)
    force.x = at_least(0.0, stiffness * overlap - dashpot * speed)
    if ti.static(w.turns):
        slip = slip_of(w, i, j, motion, normal, arm_i, arm_j, wall)
        force.y = resist(w, s, c, p, i, j, force.x, slip, stiffness, dashpot, wall, trial)
    for effect in ti.static(s.effects):
        if ti.static(offers(effect, "normal")):
            force.x += effect.normal(w, c, p, overlap)
    return force, arm_i, arm_j, lever, c.beta * stiffness, dashpot


@ti.func
def contact(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Adds the forces of pair p to the loads of its grains."""
    pairs = ti.static(w.pairs)
    i = pairs.first[p]
    j = i if ti.static(wall) else pairs.second[p]
    distance, normal = distance_to_second(w, p, i, wall)
    if ti.static(wall):
        hand_on(w, p, i, distance, normal, True)
    overlap = pairs.contact_distance[p] - distance
    force = ti.Vector([0.0, 0.0])
    if overlap > 0.0:
        force, arm_i, arm_j, lever, _stiffness, _dashpot = pushed(w, s, c, p, i, j, distance, normal, wall, False)
        for effect in ti.static(s.effects):
            if ti.static(offers(effect, "touch")):
                effect.touch(w, i, j, normal, wall)
        load(w, s, c, i, j, force, normal, arm_i, arm_j, lever, wall)
        feel(w, s, c, p, distance, normal, force, overlap, wall)
    else:
        for effect in ti.static(s.effects):
            if ti.static(offers(effect, "release")):
                effect.release(w, p)
            if ti.static(offers(effect, "normal")):
                force.x += effect.normal(w, c, p, overlap)
                lever = ti.Vector([0.0, 0.0, 0.0, 0.0])
                if ti.static(w.clumps):
                    lever = levers(w, p, i, j, normal, 0.0, 0.0, wall)
                load(w, s, c, i, j, force, normal, 0.0, 0.0, lever, wall)
    pairs.force[p] = force
    hold(w, s, c, p, i, j, overlap, wall)


@ti.func
def press(w: ti.template(), s: ti.template(), c: ti.template(), p, m, time):
    """What wall pair p resists the course of wall m with as that runs now [N], and by how much that grows with its speed [N s/m] if it
    has moved on for `time`. Nothing is changed.
    """
    memory = ti.static(w.pairs.memory[1:])
    kept = ti.Vector([0.0 for _ in range(ti.static(len(memory) + 1))])
    for k in ti.static(range(len(memory))):
        kept[k] = memory[k][p]
    i = w.pairs.first[p]
    distance, normal = distance_to_second(w, p, i, True)
    overlap = w.pairs.contact_distance[p] - distance
    part = ti.Vector([0.0, 0.0])
    if overlap > 0.0:
        force, _arm_i, _arm_j, _lever, stiffness, dashpot = pushed(w, s, c, p, i, i, distance, normal, True, True)
        part.x, part.y = along_course(w, m, force, normal), ti.select(force.x > 0.0, stiffness * time + dashpot, 0.0)
        if ti.static(not w.turns):
            part.y *= w.movers.way[m].dot(normal) ** 2
    else:
        force = ti.Vector([0.0, 0.0])
        for effect in ti.static(s.effects):
            if ti.static(offers(effect, "normal")):
                force.x += effect.normal(w, c, p, overlap)
        part.x = along_course(w, m, force, normal)
    for k in ti.static(range(len(memory))):
        memory[k][p] = kept[k]
    return part


@ti.func
def run_walls(w: ti.template(), s: ti.template(), c: ti.template(), ahead, when: ti.template()):
    """Has the walls with `force` run up to `ahead` of this step, 0 … 1, so that the contacts of the sweep to come bear what they press.

    One with mass M answers to the forces P' of the sweep before where that is stable, as grains do: u' = u + h (F - P') / M. Where M
    is less than what one step makes of the contacts, h dP/du, the share 1 - M / (h dP/du) of P' is replaced by what they will press.
    """
    if ti.static(drives(w)):
        movers = ti.static(w.movers)
        ti.loop_config(serialize=True)
        for _run in range(1):
            if when(w):
                time = ahead * w.pace[None].step
                for m in range(movers.walls[None]):
                    if movers.force[m] > 0.0:
                        force, mass, start = thrust(w, m), movers.mass[m], movers.onward[m]
                        rate, share = movers.rate[m], 1.0
                        if mass > 0.0:
                            run_at(w, m, start, 0.0)
                            kick = time * (force - carried(w, m))
                            run_at(w, m, start, time)
                            share = at_least(0.0, 1.0 - mass / (time * pressed(w, s, c, m, press, time).y + 1e-30))
                            rate = ti.max(-1.0, ti.min(1.0, start + kick / (mass * movers.speed[m])))
                            force += (1.0 / (share + 1e-30) - 1.0) * kick / time
                        if share > 0.0:
                            rate = balance(w, s, c, m, press, time, force, mass / (share * time), start, rate)
                        run_at(w, m, rate, time)
                        movers.rate[m] = rate
                        if ahead == 1.0:
                            movers.onward[m] = rate


@ti.func
def hold(w: ti.template(), s: ti.template(), c: ti.template(), p, i, j, overlap, wall: ti.template()):
    """Books what springs of pair p have taken up or given back since the last step: that is no heat."""
    if ti.static(s.books):
        stiffness, energy = 0.0, 0.0
        if overlap > 0.0:
            stiffness = elastic_stiffness(s, c, overlap)
            energy = stiffness * overlap * overlap / (c.beta + 1.0)
        for effect in ti.static(s.effects):
            if ti.static(offers(effect, "stored")):
                energy += effect.stored(w, c, p, overlap, stiffness)
        for effect in ti.static(s.effects):
            if ti.static(offers(effect, "store")):
                split(w, s, i, j, effect.store(w, p, energy) - energy, wall)


@ti.func
def step(w: ti.template(), s: ti.template(), impacts: ti.template()):
    """One step: the integrator sweeps the forces of all pairs, and moves the grains; `impacts` are forces like others."""
    c = s.constants[None]
    s.integrator(w, s, c, (contact,))


def numbers(scene: Any, bed: Bed) -> dict[str, float]:
    """Numbers of `constants_type`, and the speed cap [m/s]; SandError if the step asked for is not stable."""
    return md_numbers(scene, bed)


def bounces(scene: Any, numbers: dict[str, float], bed: Bed, restitution: np.ndarray) -> np.ndarray:
    """Dashpots, over the root of stiffness and mass, of contacts with these restitutions (n, n)."""
    return md_damping(scene, numbers, bed, restitution)


def build(scene: Any, values: dict[str, float], live: dict[str, float], own: list, effects: tuple, world: World) -> MolecularDynamics:
    """The solver for a world; `own` holds the columns of the neighbour list that MEMORY asked for, `live` the effects' live parameters."""
    solver = scene.solver
    constants = fill_struct(constants_type(world.real, live), {**values, **live})
    stages = allocate_stages(world.real, world.capacity) if solver.integrator == "rk4" else None
    books = any(offers(effect, "heat") for effect in effects)
    weighted, lags = solver.k_d is None, solver.integrator == "symplectic_euler"
    return MolecularDynamics(constants, solver.law, weighted, INTEGRATORS[solver.integrator], run_walls, stages, effects, step, books, lags)
