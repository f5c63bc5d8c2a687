"""The march: steps, with the list builds, looks and wakings that they need in between, in as few launches as the layout allows."""

import time
from typing import Any

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.motion import close_step
from taichi_sand.world.search.neighbour_list import build_neighbour_list, progress
from taichi_sand.world.sleep.fall_asleep import rearrange, rebuild_neighbour_list
from taichi_sand.world.sleep.state import called, due_to_sleep
from taichi_sand.world.sleep.wake import clear_stale_rows, wake_some

BATCH = 8
"""Steps of a large world between two looks at whether its list build still holds; steps that find it spent do nothing."""
LAUNCH = 0.1
"""About so long may a launch take [s]: nobody can interrupt it, nor read what is simulated meanwhile."""
DEAREST = 300e-9
"""What a grain and step may cost with all that belongs to it, until it has been measured [s] (measured: 20 to 80 ns, and 240 more where
every step needs a list build)."""
FIRST, KNOWN, MANY_WOKEN = 16, 2, 4
"""The first launch gets a FIRST-th of the steps that would take so long if all were as dear, the others, whose cost is known, KNOWN times
as many at most: what comes between two launches takes 0.4 ms, as nothing of it is in the caches any more. One ends early when MANY_WOKEN
times as many grains are awake as at its start, and 64 more."""
DONE, TO_SLEEP, EARLY, LACKING = range(4)
"""Why `steps_in_one` ended: all is done; somebody is to fall asleep; many have woken up; a table is too small."""


class Cadence:
    """How many steps fit into a launch, by what they have cost so far."""

    def __init__(self) -> None:
        self.cost = 0.0  # of a step, in the last launches [s]

    def steps(self, grains: int) -> int:
        """So many for so many grains awake."""
        most = LAUNCH / (DEAREST * max(1, grains))
        return max(1, int(min(KNOWN * most, LAUNCH / self.cost) if self.cost else most / FIRST))

    def took(self, steps: int, seconds: float) -> None:
        """What a launch has cost; cheaper ones are believed by and by."""
        if steps:
            self.cost = max(seconds / steps, 0.5 * self.cost)


@noinline
def make_ready(w: ti.template(), s: ti.template()):
    """Wakes who is called, and makes the list build that is due."""
    if ti.static(w.sleeps):
        woken = called(w)
        if woken:
            wake_some(w)
        if w.pace[None].spent == 1:
            build_neighbour_list(w)
        if woken:
            if w.pace[None].lacking == 0:
                clear_stale_rows(w)
                start_anew(w, s)
            else:
                w.pace[None].lacking = 2
    elif w.pace[None].spent == 1:
        build_neighbour_list(w)


@ti.func
def start_anew(w: ti.template(), s: ti.template()):
    """After a change by hand or of who sleeps the solver starts from the pairs there are."""
    if ti.static(hasattr(s, "renew")):
        s.renew(w, s)


def step_effects(solver: Any) -> list[Any]:
    """Effects with the hook `on_step`."""
    return [effect for effect in solver.effects if offers(effect, "on_step")]


@ti.func
def on_step(w: ti.template(), s: ti.template()):
    """Runs that hook."""
    for effect in ti.static(step_effects(s)):
        effect.on_step(w, s)


@ti.func
def going_on(w: ti.template(), end):
    """Whether there is a step to be made before step `end`."""
    return w.pace[None].done < end and w.pace[None].hasty == 0


@ti.func
def many_woken(w: ti.template(), most):
    """Whether more than `most` grains are awake."""
    crowd = False
    if ti.static(w.sleeps):
        crowd = w.sleep.state[None].awake > most
    return crowd


@ti.kernel
def steps_in_one(w: ti.template(), s: ti.template(), steps: ti.i32, most: ti.i32) -> ti.i32:
    """`steps` steps with all list builds they need, in one launch, on one thread (layout "one"); leaves the pairs of the moment. Fewer if
    a grain gets too fast for their length (world.motion.guarded).

    Returns TO_SLEEP, EARLY or LACKING if it stopped early: somebody is to fall asleep, more than `most` are awake, or a table is too small
    for what a list build found.
    """
    why = DONE
    ti.loop_config(serialize=True)
    for _run in range(1):
        start = w.pace[None].done
        end = start + steps
        while w.pace[None].lacking == 0 and not due_to_sleep(w) and (called(w) or w.pace[None].spent == 1 or going_on(w, end)):
            make_ready(w, s)
            if many_woken(w, most) and w.pace[None].done > start:
                end = w.pace[None].done
                why = EARLY
            if going_on(w, end) and not called(w) and w.pace[None].lacking == 0:
                w.pace[None].noted = ti.cast(w.pace[None].done + 1 == end, ti.i32)
                s.step(w, s, True)
                close_step(w)
                if ti.static(len(step_effects(s)) > 0):
                    if w.pace[None].done % w.pace[None].on_step == 0:
                        on_step(w, s)
        if due_to_sleep(w):
            why = TO_SLEEP
        if w.pace[None].lacking != 0:
            why = LACKING
    return why


@ti.kernel
def step_alone(w: ti.template(), s: ti.template(), impacts: ti.template()):
    """One step, its loops over blocks in parallel; nothing happens if a list build is due. `impacts`: see solvers.rigid.step."""
    s.step(w, s, impacts)
    close_step(w)


@ti.kernel
def on_step_alone(w: ti.template(), s: ti.template()):
    """Runs the hook `on_step` of effects, between steps."""
    on_step(w, s)


@ti.kernel
def renew_alone(w: ti.template(), s: ti.template()):
    """The solver starts anew, between steps."""
    start_anew(w, s)


def may_be_calm(world: Any, solver: Any) -> bool:
    """Whether steps without impacts are launched as such. Soft contacts know none, and a GPU would have to be waited for at every step."""
    return world.layout == "strips" and solver.meets


def compile_steps(world: Any, solver: Any) -> None:
    """Compiles the steps of a large world: one that finds its list build spent does nothing."""
    if world.layout != "one":
        for impacts in (True, False)[: 1 + may_be_calm(world, solver)]:
            step_alone(world, solver, impacts)


def warm(world: Any, solver: Any) -> None:
    """Compiles the steps of a world in the middle of a run; nothing happens."""
    pace = world.pace[None]
    spent = pace.spent
    pace.spent = pace.lacking = 1
    compile_steps(world, solver)
    if world.layout == "one":
        steps_in_one(world, solver, 0, 0)
    pace.spent, pace.lacking = spent, 0


def renew(world: Any, solver: Any) -> None:
    """The solver starts anew, between launches."""
    if hasattr(solver, "renew"):
        renew_alone(world, solver)
        ti.sync()


def awake(world: Any) -> int:
    """Grains that are computed."""
    return int(world.sleep.state[None].awake if world.sleeps else world.count[None])


def march(sim: Any, done: int, end: int) -> None:
    """From step `done` to step `end`, or less far if it takes longer than a launch may, or a grain gets too fast for such steps; leaves the
    pairs of the moment. The world and the solver of `sim` may be others then: see growing.
    """
    (march_in_one if sim.world.layout == "one" else march_alone)(sim, done, end)


def march_in_one(sim: Any, done: int, end: int) -> None:
    """March of the layout "one": one launch, or a few."""
    most = MANY_WOKEN * awake(sim.world) + 64
    while (why := steps_in_one(sim.world, sim.solver, end - done, most)) in (TO_SLEEP, LACKING):
        if why == LACKING:
            sim.fit_tables()
        else:
            rearrange(sim)
            renew(sim.world, sim.solver)
        done = sim.world.pace[None].done


def march_alone(sim: Any, done: int, end: int) -> None:
    """March of the other layouts: launches of single steps."""
    every, looked, start, before = sim.world.pace[None].on_step, done, time.perf_counter(), done
    while True:
        spent, done, hasty = progress(sim.world)
        if every and done % every == 0 and done != looked:
            on_step_alone(sim.world, sim.solver)
            looked = done
        if spent:
            rebuild_neighbour_list(sim)
        if sim.world.sleeps and sim.world.sleep.state[None].due:
            rearrange(sim)
            renew(sim.world, sim.solver)
            continue
        if done == end or hasty or (done > before and time.perf_counter() - start > LAUNCH):
            break
        left = end - done
        sim.world.pace[None].noted = int(left == 1)
        calms, impacts = may_be_calm(sim.world, sim.solver), sim.world.pace.get_member_field("impacts")
        for _ in range(min(BATCH, max(1, left - 1), every - done % every if every else BATCH)):
            step_alone(sim.world, sim.solver, not calms or bool(impacts[None]))
