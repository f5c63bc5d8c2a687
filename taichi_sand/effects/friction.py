"""Coulomb friction between grains, and between grains and walls.

Molecular dynamics knows three models: `spring`, a tangential spring that slides at the Coulomb bound (Cundall & Strack 1979) and
holds a pile at rest; `viscous`, a dashpot capped by the bound, and `sign`, the full bound against the slip (eq. 3 of the student
report this project grew from): these two have no static state, and piles creep (physics.md A10). The rigid solver bounds the
accumulated tangential impulse, which is static friction too; there the model makes no difference. A wall may have a mu of its own.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.extras.materials import friction_of
from taichi_sand.world.geometry import within

SPRING = 2.0 / 7.0
"""Tangential over normal stiffness, the value for which a sphere's tangential and normal oscillations keep pace (Walton & Braun 1986)."""
SPRING_DASHPOT = 0.31
"""Tangential over normal damping: the same damping ratio for a disc's tangential oscillation, sqrt(SPRING / 3)."""
VISCOUS = 0.7
"""Slope of the viscous model, over the root of stiffness times effective mass."""


@dataclass(frozen=True, eq=False)
class Friction(Effect):
    """The effect."""

    parameters = (
        Parameter("mu", 0.5, "coefficient of friction: largest tangential force over the normal one", low=0.0, high=10.0),
        Parameter(
            "model",
            "spring",
            "md only: spring (static friction), viscous or sign (both creep)",
            choices=("spring", "viscous", "sign"),
            live=False,
        ),
    )
    neutral: ClassVar = {"mu": 0.0}
    turns = True

    model: str
    spring: Any  # column of the neighbour list: stretch of the tangential spring [m]

    @classmethod
    def memory(cls, values: dict, solver: str) -> int:
        """Columns of the neighbour list that the effect needs."""
        return 1 if solver == "md" and values["model"] == "spring" else 0

    @classmethod
    def build(cls, values: dict, columns: tuple, solver: str) -> "Friction":
        """The effect for a world; `columns` are those that `memory` asked for."""
        return cls(values["model"] if solver == "md" else "", columns[0] if columns else None)

    @classmethod
    def resists(cls, values: dict[str, Any]) -> bool:
        """Whether contacts resist sliding."""
        return values["mu"] > 0.0

    @ti.func
    def _coefficient(self, w: ti.template(), c: ti.template(), p, wall: ti.template()):
        """mu of pair p: that of the wall, if it names one; of its materials, if there are any."""
        mu = friction_of(w, p, c.friction_mu, wall)
        if ti.static(wall and w.walls.rough):
            own = w.walls.friction[w.pairs.second[p]]
            mu = ti.select(own < 0.0, mu, own)
        return mu

    @ti.func
    def tangent(self, w: ti.template(), c: ti.template(), p, wall: ti.template(), normal_force, slip, stiffness, dashpot):
        """Tangential force [N] on the second grain of pair p that slips by `slip` [m/s]."""
        bound = self._coefficient(w, c, p, wall) * normal_force
        force = 0.0
        if ti.static(self.model == "spring"):
            k = SPRING * stiffness
            pull = within(bound, -k * (self.spring[p] + slip * c.step))
            self.spring[p] = -pull / k  # the spring alone slides at the bound: the dashpot must not stretch it backwards
            force = within(bound, pull - SPRING_DASHPOT * dashpot * slip)
        elif ti.static(self.model == "viscous"):
            force = within(bound, -VISCOUS * ti.sqrt(stiffness) * w.pairs.root_mass[p] * slip)
        else:
            force = -bound * ti.math.sign(slip)
        return force

    @ti.func
    def release(self, w: ti.template(), p):
        """The grains of pair p are apart: nothing is stretched."""
        if ti.static(self.model == "spring"):
            self.spring[p] = 0.0

    @ti.func
    def tighten(self, w: ti.template(), p, stretch, force):
        """The stiffness of pair p has changed: the tangential spring goes on."""
        if ti.static(self.model == "spring"):
            self.spring[p] *= stretch

    @ti.func
    def stored(self, w: ti.template(), c: ti.template(), p, overlap, stiffness):
        """Energy of the tangential spring [J]."""
        energy = 0.0
        if ti.static(self.model == "spring"):
            energy = 0.5 * SPRING * stiffness * self.spring[p] * self.spring[p]
        return energy

    @ti.func
    def friction_bound(self, w: ti.template(), c: ti.template(), p, wall: ti.template(), normal):
        """Largest tangential impulse for a normal one."""
        return self._coefficient(w, c, p, wall) * normal
