"""Rolling resistance: a couple against rolling, at most mu_r R N for a normal force N (physics.md A8).

R is the radius of a grain on a wall, R_i R_j / (R_i + R_j) between two grains. Molecular dynamics: type C of Ai et al. (2011), an
elastic-plastic spring of stiffness 2.25 mu_r² k R² with a dashpot, both together within the bound; unlike a plain couple against the
spin it comes to rest. Rigid: the accumulated angular impulse is kept within the bound, as in Box2D.
A grain stands on a slope up to tan θ = mu_r, and rolls 3 v² / (4 mu_r g) far on a floor.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.geometry import within

STIFFNESS = 2.25
"""Rolling stiffness over mu_r² k R² (Ai et al. 2011)."""
MOST_STIFFNESS = 0.25
"""Largest rolling stiffness over k R²: the spring never asks for a smaller step than the contact itself."""
DASHPOT = 0.3
"""Damping ratio of the rolling spring; Ai et al. use 0.3 too."""
ABOUT_CONTACT = 3.0
"""Moment of inertia of a disc about its contact over that about its centre."""


@dataclass(frozen=True, eq=False)
class Rolling(Effect):
    """The effect."""

    parameters = (Parameter("mu", 0.1, "largest couple over normal force times radius", low=0.0, high=1.0),)
    neutral: ClassVar = {"mu": 0.0}
    turns = True

    torque: Any  # column of the neighbour list: couple on the second grain, of the spring (md) or carried (rigid) [N m]

    @classmethod
    def memory(cls, values: dict, solver: str) -> int:
        """Columns of the neighbour list that the effect needs."""
        return 1

    @classmethod
    def build(cls, values: dict, columns: tuple, solver: str) -> "Rolling":
        """The effect for a world; `columns` are those that `memory` asked for."""
        return cls(columns[0])

    @ti.func
    def couple(self, w: ti.template(), c: ti.template(), p, normal_force, roll, radius, stiffness, inertia):
        """Couple [N m] on the second grain of pair p, which turns by `roll` [rad/s] as seen from the first."""
        bound = c.rolling_mu * radius * normal_force
        share = STIFFNESS * c.rolling_mu * c.rolling_mu
        spring = ti.select(share < MOST_STIFFNESS, share, MOST_STIFFNESS) * stiffness * radius * radius
        held = within(bound, self.torque[p] - spring * roll * c.step)
        self.torque[p] = held
        return within(bound, held - 2.0 * DASHPOT * ti.sqrt(ABOUT_CONTACT * inertia * spring) * roll)

    @ti.func
    def release(self, w: ti.template(), p):
        """The grains of pair p are apart: the spring is slack."""
        self.torque[p] = 0.0

    @ti.func
    def tighten(self, w: ti.template(), p, stretch, force):
        """The stiffness of pair p has changed: the spring goes on."""
        self.torque[p] *= force

    @ti.func
    def rolling_bound(self, w: ti.template(), c: ti.template(), p, normal, radius):
        """Largest angular impulse for a normal one."""
        return c.rolling_mu * radius * normal
