"""How grains move: the kick (velocities), the guard (no speed that cannot be followed) and the drift (positions)."""

from typing import Any

import taichi as ti

from taichi_sand.world.clumps import head, off_arc, span
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.extras.links import pull_of
from taichi_sand.world.flags import NOT_FINITE, TOO_FAST, flag
from taichi_sand.world.geometry import add, at_least, spin, velocity
from taichi_sand.world.search.images import slide
from taichi_sand.world.walls.motion import close_walls

LARGEST_SQUARE = 1e36
"""32 bits hold no more than 3e38."""
GROWTH_STEPS, SETTLING_STEPS = 8, 128
"""Steps between two list builds while pairs that were deep in each other grow into place, or those whose stiffness has changed settle:
a list build is what makes them."""
FASTEST_SURFACE = 4.0
"""No surface turns faster than this times the speed cap: between physical limits never met, it keeps what is not physical finite."""


@ti.func
def speed_squared(w: ti.template(), i):
    """Square of the speed of the fastest part of grain i, but for the spin of a disc [m2/s2]."""
    v = velocity(w, i)
    square = v.dot(v)
    if ti.static(w.clumps):
        square += (spin(w, i) * span(w, i)) ** 2
    return square


@ti.func
def guarded(w: ti.template(), i):
    """Twist of grain i that can be followed: stopped if it is no number, slowed down if it is too fast; flags both. One that is only
    faster than contacts and step are made for has them follow (solvers.tolerance).
    """
    g = ti.static(w.grains)
    cap = w.pace[None].speed_cap
    v, square = velocity(w, i), speed_squared(w, i)
    twist = g.twist[i]
    if not (square >= 0.0) or not (spin(w, i) * spin(w, i) >= 0.0):
        twist = ti.Vector([0.0, 0.0, 0.0, 0.0])
        flag(w, NOT_FINITE, g.id[i])
    elif square > cap * cap or ti.abs(spin(w, i)) > fastest_spin(w):
        share = ti.min(1.0, cap / ti.sqrt(square + 1e-30))
        turn, most = spin(w, i), fastest_spin(w)
        if ti.static(w.clumps):
            turn *= share
        twist = ti.Vector([v.x * share, v.y * share, ti.min(most, ti.max(-most, turn)), 0.0])
        flag(w, TOO_FAST, g.id[i])
    if square > w.pace[None].alert ** 2:
        w.pace[None].hasty = 1
    return twist


@ti.func
def fastest_spin(w: ti.template()):
    """No grain turns faster [rad/s]; the surface of a mean one then moves FASTEST_SURFACE times as fast as a grain may."""
    return 2.0 * FASTEST_SURFACE * w.pace[None].speed_cap / w.box[None].diameter


def pushes(solver: Any) -> bool:
    """Whether any effect is a force on grains."""
    return any(offers(effect, "body") for effect in solver.effects)


@ti.func
def with_body(w: ti.template(), s: ti.template(), c: ti.template(), i, load, time: ti.template()):
    """`load` on grain i and what the effects add to it as a body force (x, y, torque, 0) [N, N, N m], or by links, times `time`."""
    total = load
    if ti.static(w.linked):
        total += time * pull_of(w, i)
    if ti.static(pushes(s)):
        push = ti.Vector([0.0, 0.0, 0.0, 0.0])
        for effect in ti.static(s.effects):
            if ti.static(offers(effect, "body")):
                push += effect.body(w, c, i)
        total += time * followed(w, i, push)
    return total


@ti.func
def followed(w: ti.template(), i, push):
    """The part of a body force on grain i that a step can follow: none if it is no number, as much as makes the speed cap in one step."""
    change = push * w.grains.mobility[i] * w.pace[None].step
    square, turn, cap = change.xy.dot(change.xy), ti.abs(change.z), w.pace[None].speed_cap
    part = push
    if not (square < LARGEST_SQUARE) or not (turn < LARGEST_SQUARE):
        part = ti.Vector([0.0, 0.0, 0.0, 0.0])
        flag(w, NOT_FINITE, w.grains.id[i])
    elif square > cap * cap:
        part *= cap / ti.sqrt(square)
        flag(w, TOO_FAST, w.grains.id[i])
    return part


@ti.func
def check_speed(w: ti.template(), i, alert, most_spin):
    """Sees to it that the motion of grain i can be followed, if it is faster than `alert` [m/s] or `most_spin` [rad/s]."""
    square = speed_squared(w, i)
    if not (square <= alert * alert) or not (spin(w, i) * spin(w, i) <= most_spin * most_spin):
        w.grains.twist[i] = guarded(w, i)


@ti.func
def drift(w: ti.template(), start, end):
    """Moves and turns the grains start .. end-1 for one step, and notes if one is too far off the path that the search foresaw."""
    g = ti.static(w.grains)
    step = w.pace[None].step
    alert = w.pace[None].alert
    most_spin = fastest_spin(w)
    time = ti.cast(w.pace[None].since + 1, w.real) * step
    off_path = 0.0
    for i in range(start, end):
        check_speed(w, i, alert, most_spin)
        v = velocity(w, i)
        shift = g.shift[i] + v * step
        g.shift[i] = shift
        off = shift - g.start_velocity[i] * time
        away = off.dot(off)
        if ti.static(w.turns):
            add(g.turn, i, spin(w, i) * step)
        if ti.static(w.clumps):
            head(w, i)
            away = (ti.sqrt(away) + off_arc(w, i, time)) ** 2
        off_path = at_least(off_path, away)
    if 4.0 * off_path > w.pace[None].skin * w.pace[None].skin:
        w.pace[None].strayed = 1


@ti.func
def close_step(w: ti.template()):
    """Counts the step, and says whether the next one needs a list build first."""
    pace = ti.static(w.pace)
    if pace[None].spent == 0:
        if ti.static(w.moves):
            close_walls(w)
        slide(w, 1.0)
        pace[None].since += 1
        pace[None].done += 1
        late = ti.cast(pace[None].since + 1, w.real) * pace[None].step > pace[None].horizon
        if ti.static(w.yields):
            patience = ti.select(pace[None].short == 2, GROWTH_STEPS, SETTLING_STEPS)
            late = late or (pace[None].short > 0 and pace[None].since >= patience)
        if late or pace[None].strayed == 1 or pace[None].hasty == 1:
            pace[None].spent = 1
