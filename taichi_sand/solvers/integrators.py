"""How molecular dynamics steps in time."""

import taichi as ti

from taichi_sand.world.geometry import movable, wrench
from taichi_sand.world.motion import drift, with_body


@ti.func
def symplectic_euler(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """v += h (F/m + g), then x += h v: first order, and no drift of energy (physics.md A18)."""
    g = ti.static(w.grains)
    h = c.step
    gravity = wrench(w.box[None].gravity, 0.0)
    for i in range(start, end):
        g.twist[i] += h * (with_body(w, s, c, i, g.wrench[i], 1.0) * g.mobility[i] + gravity * movable(w, i))
        g.wrench[i] = ti.Vector([0.0, 0.0, 0.0, 0.0])
    drift(w, start, end)
