"""How grains move: the kick (velocities), the guard (no speed that cannot be followed) and the drift (positions)."""

import taichi as ti

from taichi_sand.world.flags import NOT_FINITE, TOO_FAST, flag
from taichi_sand.world.geometry import spin, velocity


@ti.func
def guard(w: ti.template(), start, end):
    """Stops grains whose motion is no number, slows down those that are too fast, and flags both."""
    g = ti.static(w.grains)
    cap = w.pace[None].speed_cap
    fine = 1
    for i in range(start, end):
        v = velocity(w, i)
        turning = spin(w, i) * spin(w, i)
        fine = ti.min(fine, ti.select(v.dot(v) <= cap * cap, 1, 0), ti.select(turning >= 0.0, 1, 0))
    if fine == 0:
        for i in range(start, end):
            v = velocity(w, i)
            square = v.dot(v)
            if not (square >= 0.0) or not (spin(w, i) * spin(w, i) >= 0.0):
                g.twist[i] = ti.Vector([0.0, 0.0, 0.0, 0.0])
                flag(w, NOT_FINITE, g.id[i])
            elif not square <= cap * cap:
                slow = v * (cap / ti.sqrt(square))
                g.twist[i] = ti.Vector([slow.x, slow.y, spin(w, i), 0.0])
                flag(w, TOO_FAST, g.id[i])


@ti.func
def drift(w: ti.template(), start, end):
    """Moves and turns the grains start .. end-1 for one step, and notes how far they are off the paths that the search foresaw."""
    g = ti.static(w.grains)
    step = w.pace[None].step
    guard(w, start, end)
    time = ti.cast(w.pace[None].since + 1, w.real) * step
    off_path = 0.0
    for i in range(start, end):
        shift = g.shift[i] + velocity(w, i) * step
        g.shift[i] = shift
        off = shift - g.start_velocity[i] * time
        off_path = ti.max(off_path, off.dot(off))
    if ti.static(w.turns):
        for i in range(start, end):
            g.turn[i] += spin(w, i) * step
    ti.atomic_max(w.pace[None].off_path, off_path)


@ti.func
def close_step(w: ti.template()):
    """Counts the step, and says whether the next one needs a search first."""
    pace = ti.static(w.pace)
    if pace[None].spent == 0:
        pace[None].since += 1
        pace[None].done += 1
        late = ti.cast(pace[None].since + 1, w.real) * pace[None].step > pace[None].horizon
        if late or 4.0 * pace[None].off_path > pace[None].skin * pace[None].skin:
            pace[None].spent = 1
