"""How molecular dynamics steps in time."""

import taichi as ti

from taichi_sand.world.motion import drift, movable


@ti.func
def symplectic_euler(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """v += h (F/m + g), then x += h v: first order, and no drift of energy (physics.md A18)."""
    g = ti.static(w.grains)
    h = c.step
    gravity = w.box[None].gravity
    for i in range(start, end):
        g.velocity[i] += h * (g.load[i] * g.inverse_mass[i] + gravity * movable(w, i))
        g.load[i] = ti.Vector([0.0, 0.0])
    if ti.static(w.turns):
        for i in range(start, end):
            g.spin[i] += h * g.torque[i] * g.inverse_inertia[i]
            g.torque[i] = 0.0
    drift(w, start, end)
