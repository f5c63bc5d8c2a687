"""Forces and torques that grains carry about with them, where the effect `push` is on: steady, until they are changed by hand."""

from typing import Any

import numpy as np
import taichi as ti

COLUMNS = ("push_x", "push_y", "push_torque")
"""[N, N, N m]."""


@ti.func
def steady_force(w: ti.template(), i):
    """Force x, y and torque on grain i [N, N, N m, 0]."""
    push = ti.Vector([0.0, 0.0, 0.0, 0.0])
    if ti.static(hasattr(w.carried, "push_x")):
        push = ti.Vector([w.carried.push_x[i], w.carried.push_y[i], w.carried.push_torque[i], 0.0])
    return push


@ti.kernel
def exert(w: ti.template(), slots: ti.types.ndarray(), push: ti.types.ndarray()):
    """From now on the grains in `slots` (n,) carry the forces and torques `push` (n, 3)."""
    ti.loop_config(serialize=True)
    for k in range(slots.shape[0]):
        i = slots[k]
        w.carried.push_x[i], w.carried.push_y[i], w.carried.push_torque[i] = push[k, 0], push[k, 1], push[k, 2]


def largest_force(world: Any) -> float:
    """The largest there is [N]."""
    x, y = (column.to_numpy()[: world.count[None]] for column in (world.carried.push_x, world.carried.push_y))
    return float(np.hypot(x, y).max(initial=0.0))
