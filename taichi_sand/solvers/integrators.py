"""How molecular dynamics steps in time: symplectic Euler, velocity Verlet, RK4. Explicit Euler gains energy and is not offered.

An integrator is a ti.func of one step, f(w, s, c, pair): it sweeps the forces `pair` as often as it needs them. Velocities are those
at the end of the step with all three. Effects advance what they remember of a pair (the stretch of a tangential spring) by c.step:
that is the step where the forces are swept once, and with RK4, which sweeps four times, nothing, half a step, nothing and half a
step, so that a spring is of second order at most. Orders for spheres that only touch at times: physics.md A18.
"""

from typing import Any, NamedTuple

import taichi as ti

from taichi_sand.taichi_support import field_pool
from taichi_sand.world.blocks import going
from taichi_sand.world.clumps import head
from taichi_sand.world.extras.energy_ledger import settle_work
from taichi_sand.world.extras.links import pull_links, settle_links
from taichi_sand.world.geometry import add, movable, wrench
from taichi_sand.world.motion import check_speed, drift, fastest_spin, with_body
from taichi_sand.world.search.images import slide
from taichi_sand.world.sweep import each_grain, sweep
from taichi_sand.world.walls.motion import place_walls


class Stages(NamedTuple):
    """What RK4 keeps of a grain within a step; shape (capacity,), 4-vectors (x, y, angle, 0)."""

    place: Any  # shift and turn at the start
    twist: Any  # velocity and spin at the start
    moved: Any  # by the stages so far
    gained: Any  # velocity and spin, by the stages so far
    stage: Any  # 0-D i32, 0 … 3


def allocate_stages(real: Any, capacity: int) -> Stages:
    """Empty table for `capacity` grains."""
    return Stages(*(field_pool.vectors(4, real, capacity) for _ in range(4)), field_pool.scalars(ti.i32, ()))


@ti.func
def acceleration(w: ti.template(), load, gravity, i):
    """F / m + g and torque / inertia of grain i under `load`; `gravity` is a wrench."""
    return load * w.grains.mobility[i] + gravity * movable(w, i)


@ti.func
def kick(w: ti.template(), time, start, end):
    """Velocities change by `time` times the accelerations."""
    g = ti.static(w.grains)
    gravity = wrench(w.box[None].gravity, 0.0)
    for i in range(start, end):
        add(g.twist, i, time * acceleration(w, g.wrench[i], gravity, i))


@ti.func
def forget_forces(w: ti.template(), start, end):
    """Clears the loads for the sweep that sums the next ones."""
    for i in range(start, end):
        w.grains.wrench[i] = ti.Vector([0.0, 0.0, 0.0, 0.0])


@ti.func
def kick_and_drift(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """v += h a, then x += h v."""
    g = ti.static(w.grains)
    gravity = wrench(w.box[None].gravity, 0.0)
    h = c.step
    for i in range(start, end):
        change = h * acceleration(w, with_body(w, s, c, i, g.wrench[i], 1.0), gravity, i)
        settle_work(w, s, i, h * g.wrench[i], change)
        settle_links(w, s, i, h, change)
        add(g.twist, i, change)
        g.wrench[i] = ti.Vector([0.0, 0.0, 0.0, 0.0])
    drift(w, start, end)


@ti.func
def symplectic_euler(w: ti.template(), s: ti.template(), c: ti.template(), pair: ti.template()):
    """v += h a(x, v), then x += h v: first order, and no drift of energy."""
    if ti.static(w.moves):
        place_walls(w, 0.0, 0.0)
    s.run(w, s, c, 1.0, going)
    pull_links(w, s, c, going, True)
    sweep(w, pair, kick_and_drift, s, c, going)


@ti.func
def half_kick_and_drift(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """v += h/2 a, x += h v."""
    kick(w, 0.5 * c.step, start, end)
    forget_forces(w, start, end)
    drift(w, start, end)


@ti.func
def gather(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """Adds body forces to the loads."""
    for i in range(start, end):
        w.grains.wrench[i] = with_body(w, s, c, i, w.grains.wrench[i], 1.0)


@ti.func
def half_kick(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """v += h/2 a, with the forces where the grains have moved to; they are kept for the next step."""
    gather(w, s, c, start, end)
    kick(w, 0.5 * c.step, start, end)


@ti.func
def starting(w: ti.template()):
    """Whether this is the very first step, before which no forces are known."""
    return w.pace[None].spent == 0 and w.pace[None].done == 0


@ti.func
def velocity_verlet(w: ti.template(), s: ti.template(), c: ti.template(), pair: ti.template()):
    """Half a kick, drift, forces, half a kick: second order where forces depend on places alone; damping sees the velocity of the
    middle of the step, which is first order. The places are those of symplectic Euler.
    """
    h = c.step
    c.step = 0.0  # what pairs remember does not advance
    if ti.static(w.moves):
        place_walls(w, 0.0, 0.0)
    pull_links(w, s, c, starting, False)
    sweep(w, pair, gather, s, c, starting)
    c.step = h
    each_grain(w, half_kick_and_drift, s, c)
    slide(w, 1.0)
    if ti.static(w.moves):
        place_walls(w, 1.0, 1.0)
    s.run(w, s, c, 1.0, going)
    pull_links(w, s, c, going, True)
    sweep(w, pair, half_kick, s, c, going)


@ti.func
def runge_kutta(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """One of the four stages: adds its slope to the step, and goes to where the next one is taken; the last completes the step."""
    g, r = ti.static(w.grains, s.stages)
    gravity = wrench(w.box[None].gravity, 0.0)
    h = w.pace[None].step
    stage = r.stage[None]
    ahead = ti.select(stage == 2, h, 0.5 * h)
    weight = h / ti.select(stage == 0 or stage == 3, 6.0, 3.0)
    for i in range(start, end):
        v, a = g.twist[i], acceleration(w, with_body(w, s, c, i, g.wrench[i], 1.0), gravity, i)
        if stage == 0:
            r.place[i], r.twist[i] = ti.Vector([g.shift[i].x, g.shift[i].y, g.turn[i], 0.0]), v
            r.moved[i], r.gained[i] = ti.Vector([0.0, 0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0, 0.0])
        add(r.moved, i, weight * v)
        add(r.gained, i, weight * a)
        place = r.place[i]
        if stage < 3:
            place += ahead * v
            g.twist[i] = r.twist[i] + ahead * a
        else:
            g.twist[i] = r.moved[i] / h
        g.shift[i] = place.xy
        if ti.static(w.turns):
            g.turn[i] = place.z
        if ti.static(w.clumps):
            head(w, i)
    forget_forces(w, start, end)
    if stage == 3:
        drift(w, start, end)
        for i in range(start, end):
            g.twist[i] = r.twist[i] + r.gained[i]
            check_speed(w, i, w.pace[None].alert, fastest_spin(w))


@ti.func
def rk4(w: ti.template(), s: ti.template(), c: ti.template(), pair: ti.template()):
    """The classical Runge-Kutta scheme: four sweeps of forces a step; fourth order where forces are smooth."""
    h = c.step
    if ti.static(w.layout == "one"):
        for stage in range(4):
            s.stages.stage[None] = stage
            c.step = 0.5 * h * (stage % 2)
            slide(w, 0.5 * ((stage + 1) // 2))
            if ti.static(w.moves):
                place_walls(w, 0.5 * ((stage + 1) // 2), 0.5 * ((stage + 1) // 2))
            s.run(w, s, c, 0.5 * ((stage + 1) // 2), going)
            pull_links(w, s, c, going, stage == 0)
            sweep(w, pair, runge_kutta, s, c, going)
    else:
        for stage in ti.static(range(4)):
            s.stages.stage[None] = stage
            c.step = 0.5 * h * (stage % 2)
            if ti.static(w.moves):
                place_walls(w, 0.5 * ((stage + 1) // 2), 0.5 * ((stage + 1) // 2))
            s.run(w, s, c, 0.5 * ((stage + 1) // 2), going)
            pull_links(w, s, c, going, stage == 0)
            sweep(w, pair, runge_kutta, s, c, going)


INTEGRATORS = {"symplectic_euler": symplectic_euler, "velocity_verlet": velocity_verlet, "rk4": rk4}
