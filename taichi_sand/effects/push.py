"""Push: a steady force and torque on single grains, each its own, as `Simulation.push` sets them; none to start with.

It is a force like gravity: in every step v += h F/m and ω += h T/I, so that a free grain gains the momentum F t exactly. `push` switches
it on when it is first called, which compiles the steps anew; a scene that has its table is compiled with it from the start.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.world.extras.steady_force import COLUMNS, largest_force, steady_force


@dataclass(frozen=True)
class Push(Effect):
    """The effect."""

    neutral: ClassVar = {}
    turns = True

    @classmethod
    def carried(cls, values: dict[str, Any]) -> dict[str, float]:
        """Columns that follow a grain: its force [N] and torque [N m]."""
        return dict.fromkeys(COLUMNS, 0.0)

    @classmethod
    def steady(cls, values: dict[str, Any], world: Any) -> float:
        """Largest force on a single grain [N]."""
        return largest_force(world)

    @ti.func
    def body(self, w: ti.template(), c: ti.template(), i):
        """Force and torque on grain i."""
        return steady_force(w, i)
