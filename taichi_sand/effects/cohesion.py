"""Cohesion of wet grains: liquid bridges that form where two grains touch, and rupture at a distance.

A bridge pulls with F_c, Bo times the weight of a mean grain (of its weight on earth, 9.81 m/s2, in a scene without gravity), and beyond
contact with F_c (1 - S/S_c) at the distance S: it takes the energy F_c S_c / 2 to tear (physics.md D7). Friction goes with the force
between the surfaces, the pull of the bridge included. Two dimensions know no true capillary bridge: real water means Bo = 17 for grains
of 1 mm and 0.17 for 1 cm; sandcastles of centimetre grains need 5 to 20. With the effect `moisture` the pull goes with the wetness.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.extras.wetness import bridge_share
from taichi_sand.world.geometry import at_least


@dataclass(frozen=True, eq=False)
class Cohesion(Effect):
    """The effect."""

    parameters = (
        Parameter("bond_number", 5.0, "Bond number: pull of a bridge over the weight of a mean grain", low=0.0, high=1e4),
        Parameter("rupture", 0.1, "distance at which a bridge ruptures", "d", low=0.001, high=0.5, live=False),
    )
    neutral: ClassVar = {"bond_number": 0.0}

    bridge: Any  # column of the neighbour list: 1 = there is a bridge

    @classmethod
    def memory(cls, values: dict, solver: str) -> int:
        """Columns of the neighbour list that the effect needs."""
        return 1

    @classmethod
    def build(cls, values: dict, columns: tuple, solver: str) -> "Cohesion":
        """The effect for a world; `columns` are those that `memory` asked for."""
        return cls(columns[0])

    @classmethod
    def reach(cls, values: dict) -> float:
        """How far apart grains still act on one another, in mean diameters."""
        return values["rupture"]

    @classmethod
    def pull(cls, values: dict) -> float:
        """Strongest pull of a bridge, in weights of a mean grain."""
        return values["bond_number"]

    @ti.func
    def _pull(self, w: ti.template(), c: ti.template(), p, gap, middle):
        """Pull of the bridge of pair p at the gap `middle` [N], >= 0; a bridge forms or ruptures where the gap says so."""
        reach = w.box[None].bridge
        if gap <= 0.0:
            self.bridge[p] = 1.0
        elif gap > reach:
            self.bridge[p] = 0.0
        share = ti.select(middle > 0.0, at_least(0.0, 1.0 - middle / reach), 1.0)
        if ti.static(hasattr(w.carried, "wetness")):
            share *= bridge_share(w, p)
        return ti.select(self.bridge[p] > 0.0, share * c.cohesion_bond_number * w.box[None].weight, 0.0)

    @ti.func
    def normal(self, w: ti.template(), c: ti.template(), p, overlap):
        """Normal force on top of the contact's [N]."""
        return -self._pull(w, c, p, -overlap, -overlap)

    @ti.func
    def stored(self, w: ti.template(), c: ti.template(), p, overlap, stiffness):
        """Energy that it takes to bring the bridge from touch to where it is [J]."""
        gap = at_least(0.0, -overlap)
        way = ti.select(overlap > 0.0, -overlap, gap - 0.5 * gap * gap / w.box[None].bridge)
        if ti.static(hasattr(w.carried, "wetness")):
            way *= bridge_share(w, p)
        return ti.select(self.bridge[p] > 0.0, c.cohesion_bond_number * w.box[None].weight * way, 0.0)

    @ti.func
    def min_normal_impulse(self, w: ti.template(), c: ti.template(), p, gap, middle):
        """Lowest normal impulse."""
        return -c.step * self._pull(w, c, p, gap, middle)
