"""Safe direction: an experiment of the student report that this project grew from. It is not physical, and said so there too.

The safe direction of a grain is away from all that it touches, against the sum b of the unit normals towards its contacts (shorter than 1
where they are balanced, as inside a packing). `force`: what the contact forces on the grain push it along b is left out. `velocity`: what
the grain would move along b after the step is left out, gravity included. So no grain presses into others, and piles behave as jelly does.
But nobody gets what is left out: momentum is not conserved, nor energy. The report sums up what has been taken (`momentum_taken_Ns`).
The rule of the report itself is not on record in detail; this is its simplest reading.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.geometry import add, at_least, velocity, wrench


@dataclass(frozen=True)
class SafeDirection(Effect):
    """The effect."""

    parameters = (
        Parameter("variant", "velocity", "what is left out along unsafe directions", choices=("force", "velocity"), live=False),
        Parameter("share", 1.0, "how much of it is left out", low=0.0, high=1.0),
    )
    solvers = ("md",)
    neutral: ClassVar = {"share": 0.0}

    variant: str

    @classmethod
    def misfit(cls, scene: Any) -> str:
        """Why it does not fit `scene`, or ""."""
        fits = scene.solver.integrator == "symplectic_euler"
        return "" if fits else f'does not fit the integrator {scene.solver.integrator}, only "symplectic_euler"'

    @classmethod
    def carried(cls, values: dict[str, Any]) -> dict[str, float]:
        """Columns that follow a grain: the normals towards its contacts, summed, and the momentum taken from it so far [N s]."""
        return dict.fromkeys(("unsafe_x", "unsafe_y", "taken_x", "taken_y"), 0.0)

    @classmethod
    def build(cls, values: dict[str, Any], columns: tuple, solver: str) -> "SafeDirection":
        """The effect for a world."""
        return cls(values["variant"])

    @ti.func
    def touch(self, w: ti.template(), i, j, normal, wall: ti.template()):
        """Grains i and j touch, or grain i and a wall; `normal` points from i."""
        self._lean(w, i, normal)
        if ti.static(not wall):
            self._lean(w, j, -normal)

    @ti.func
    def _lean(self, w: ti.template(), i, normal):
        """Adds a contact to those of grain i."""
        add(w.carried.unsafe_x, i, normal.x)
        add(w.carried.unsafe_y, i, normal.y)

    @ti.func
    def body(self, w: ti.template(), c: ti.template(), i):
        """Force on grain i that takes away what is not safe, and forgets its contacts for the next step."""
        unsafe = ti.Vector([w.carried.unsafe_x[i], w.carried.unsafe_y[i]])
        w.carried.unsafe_x[i], w.carried.unsafe_y[i] = 0.0, 0.0
        unsafe /= at_least(1.0, unsafe.norm())
        mobility = w.grains.mobility[i].x
        force = ti.Vector([0.0, 0.0])
        if mobility > 0.0:
            push = w.grains.wrench[i].xy
            if ti.static(self.variant == "velocity"):
                push += (velocity(w, i) / c.step + w.box[None].gravity) / mobility
            force = -c.safe_direction_share * at_least(0.0, push.dot(unsafe)) * unsafe
            add(w.carried.taken_x, i, -force.x * c.step)
            add(w.carried.taken_y, i, -force.y * c.step)
        return wrench(force, 0.0)
