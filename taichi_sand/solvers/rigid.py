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

import numpy as np
import taichi as ti

from taichi_sand.solvers.bed import Bed
from taichi_sand.solvers.impacts import collide_all, warm_start
from taichi_sand.solvers.impulses import (
    store_impulse,
    update_contact,
)
from taichi_sand.solvers.noting import AFTER, BEFORE, WIPE, WIPE_UNLESS_HIT
from taichi_sand.solvers.projection import OVER_RELAXATION, project, touches
from taichi_sand.solvers.tolerance import rigid_numbers
from taichi_sand.taichi_support import field_pool
from taichi_sand.world.blocks import going, nothing
from taichi_sand.world.extras.energy_ledger import settle_work
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.extras.links import pull_links, settle_links
from taichi_sand.world.geometry import add, at_least, movable, wrench
from taichi_sand.world.motion import drift, with_body
from taichi_sand.world.search.images import slide
from taichi_sand.world.sweep import each_grain, each_pair, sweep, sweep_twice, sweeps_join
from taichi_sand.world.tables import World, fill_struct
from taichi_sand.world.walls.motion import place_walls
from taichi_sand.world.walls.servo import along_course, apart, bear, drives, nobody
from taichi_sand.world.walls.wedge import feel, holds

MEMORY = 3
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
        reference_share=real,  # of the carried impulse, that it creeps to
        **dict.fromkeys(live, real),
    )


@dataclass(frozen=True, eq=False)
class Rigid:
    """The solver as kernels see it."""

    constants: Any  # 0-D field of constants_type
    reference: Any  # column of the neighbour list: slow reference of the normal force [N]
    struck: Any  # of a grain: twice the last round of impacts of this step in which it was hit, plus 1 if they moved it; 0 = none, i32
    passed: tuple  # columns of the neighbour list: x, y of what a pair passed on in the last step beside its force, see solvers.noting [N]
    near: Any  # of a cell: twice the last round in which its grains may have got pairs of a grain that was hit
    effects: tuple
    step: Any  # ti.func of one step
    renew: Any  # ti.func that starts it anew after grains, walls, the step or who sleeps have changed
    books: bool  # whether an effect has the hook `heat`
    lags: ClassVar[bool] = False  # see MolecularDynamics
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
    goal = ti.select(touches(w, p), c.reference_share * at_least(0.0, carried.x) * c.rate, 0.0)
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


SOLVE, SOLVE_AFTER_IMPACTS = (WIPE, solve), (WIPE_UNLESS_HIT, solve)
FOLLOW = (BEFORE, update_contact, AFTER)
FOLLOW_AND_RELAX = (*FOLLOW, relax)


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
    first = ti.static(SOLVE_AFTER_IMPACTS if impacts else SOLVE)
    if ti.static(sweeps_join(w)):
        sweep_twice(w, warm_start if ti.static(impacts) else kick, first, move, FOLLOW_AND_RELAX, s, going)
    else:
        each_grain(w, warm_start if ti.static(impacts) else kick, s, c)
        if ti.static(drives(w)):
            sweep(w, first, nothing, s, c, going)
            bear(w, s, press_softly, solve_driven, nobody, True)
            each_grain(w, move, s, c)
        else:
            sweep(w, first, move, s, c, going)
        slide(w, 1.0)
        if ti.static(w.moves):
            place_walls(w, 1.0, 0.5)
        if ti.static(w.layout == "cells"):
            each_pair(w, FOLLOW, s, c, going)
            sweep(w, (relax,), nothing, s, c, going)
        else:
            sweep(w, FOLLOW_AND_RELAX, nothing, s, c, going)
        if ti.static(drives(w)):
            bear(w, s, press_hard, relax_driven, keep_driven, False)


def numbers(scene: Any, bed: Bed) -> dict[str, float]:
    """Numbers of `constants_type`, and the speed cap [m/s]."""
    return rigid_numbers(scene, bed)


def bounces(scene: Any, numbers: dict[str, float], bed: Bed, restitution: np.ndarray) -> np.ndarray:
    """Restitutions as they are."""
    return restitution


def build(scene: Any, values: dict[str, float], live: dict[str, float], own: list, effects: tuple, world: World) -> Rigid:
    """The solver for a world; `own` holds the columns of the neighbour list that MEMORY asked for, `live` the effects' live parameters."""
    constants = fill_struct(constants_type(world.real, live), {**values, **live})
    struck, near = field_pool.scalars(ti.i32, world.capacity), field_pool.scalars(ti.i32, world.grid.start.shape[0])
    return Rigid(constants, own[0], struck, tuple(own[1:]), near, effects, step, renew, any(offers(effect, "heat") for effect in effects))
