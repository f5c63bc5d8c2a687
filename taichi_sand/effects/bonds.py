"""Bonds: springs and dashpots that hold grains together, until they break.

Which grains are bonded says the key `bonded` of a [[grains]] table: the discs of each of its shapes, or of discs all of the table; of
those, neighbours whose surfaces are at most `reach` of their mean diameter apart. A bond pulls its two grains along the line of their
centres, one as the other, as an elastic spring k x with a dashpot: momentum and angular momentum stay, and a free body keeps its motion
(physics.md A20). k is in weights of a mean grain a mean diameter, so that a bond that bears n grains gives by n / `stiffness` of d.

Springs are explicit, so the step follows the stiffest: with k (z_i/m_i + z_j/m_j) >= omega^2 for grains with z bonds, no more than
STEP_SHARE of the limit of stability 2 / omega (physics.md C12, D1).
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.scene.bodies import neighbours
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.extras.links import link_way
from taichi_sand.world.geometry import at_least, at_most

STEP_SHARE = 0.5
"""Of the longest stable step: the contacts need the rest, and a pair at it oscillates 5 % too fast."""


@ti.func
def overdone(w: ti.template(), beyond, stretch, speed, stiffness, dashpot):
    """What the dashpot has taken, over the mass, in the part of the last step in which the bond was `beyond` where it broke [m].

    It went by the velocity at the start of that step, as velocities are half a step behind; the first step of velocity Verlet is a half.
    """
    step = w.pace[None].step
    way = step * speed
    share = step * dashpot * ti.select(w.pace[None].done == 0, 0.5, 1.0)
    before = (speed + step * stiffness * (stretch - way)) / (1.0 - share)
    taken = share * before * 0.5 * (before + speed)
    return ti.select(beyond > 0.0 and way > 0.0, at_most(1.0, beyond / (way + 1e-30)) * taken, 0.0)


@dataclass(frozen=True, eq=False)
class Bonds(Effect):
    """The effect."""

    parameters = (
        Parameter("stiffness", 1000.0, "force of a bond over how much longer it is", "weights/d", low=0.0, high=1e7, decades=True),
        Parameter("damping", 0.1, "damping ratio of two grains and their bond", low=0.0, high=1.0),
        Parameter("strength", 0.0, "pull at which a bond breaks, in weights of a mean grain; 0 = never", "weights", low=0.0, high=1e9),
        Parameter("reach", 0.5, "bonded are grains up to this far apart, surface to surface", "d", low=0.0, high=4.0, live=False),
    )
    neutral: ClassVar = {"stiffness": 0.0}

    @classmethod
    def misfit(cls, scene: Any) -> str:
        """Why bonds do not fit a scene, or ""."""
        both = "sleeping" in scene.effects and any(table.bonded for table in scene.grains)
        return "does not fit [effects.sleeping]: sleepers would not feel their bonds" if both else ""

    @classmethod
    def links(cls, values: dict[str, Any], grains: Any) -> np.ndarray:
        """Which grains of a pack are bonded, (n, 2)."""
        return neighbours(grains, values["reach"])

    @classmethod
    def longest_step(cls, values: dict[str, Any], world: Any) -> float:
        """Longest step that the bonds of a world allow [s]."""
        box = world.box[None]
        stiffness = values["stiffness"] * box.weight / box.diameter
        if not world.linked or not stiffness or not world.links.give[None]:
            return math.inf
        omega = math.sqrt(stiffness * world.links.give[None])
        ratio = values["damping"] * math.sqrt(world.links.heaviest[None] * world.links.give[None])
        return STEP_SHARE * 2 / omega * (math.sqrt(1 + ratio**2) - ratio)

    @ti.func
    def link(self, w: ti.template(), c: ti.template(), k):
        """Force of bond k on its second grain [N]."""
        stretch, speed, normal, stiffness, dashpot = self._state(w, c, k)
        return -(stiffness * stretch + dashpot * speed) * normal

    @ti.func
    def snap(self, w: ti.template(), c: ti.template(), k):
        """Breaks bond k if it has been stretched to its strength; returns the impulse on its second grain with which it does [N s].

        A bond is looked at once a step, later than it broke and after forces that were those of the starts of steps. The impulse makes up
        for both: with it the bond has taken S^2 / 2k out of the motion of its grains, and its dashpot what it takes until then. Where
        velocities are half a step behind (c.step / 2), a spring has so far taken k x^2 / 2 - h k x v / 2: that is what symplectic Euler
        exchanges for kinetic energy without error. RK4, whose stages would see a bond that is long broken, looks ahead.
        """
        stretch, speed, normal, stiffness, dashpot = self._state(w, c, k)
        impulse = 0.0
        strength, step = c.bonds_strength * w.box[None].weight, w.pace[None].step
        foreseen = stretch + (step - c.step) * at_least(0.0, speed)
        if strength > 0.0 and stiffness * foreseen > strength:
            most, mass = strength / stiffness, w.links.mass[k]
            missing = 0.5 * stiffness * (most * most - stretch * stretch + c.step * stretch * speed)
            missing += at_least(0.0, most - stretch) * dashpot * speed
            missing -= overdone(w, stretch - most, stretch, speed, stiffness / mass, dashpot / mass) * mass
            square = speed * speed - 2.0 * missing / mass
            if square >= 0.0:
                w.links.whole[k] = 0
                impulse = mass * (ti.select(speed < 0.0, -ti.sqrt(square), ti.sqrt(square)) - speed)
        return impulse * normal

    @ti.func
    def kept(self, w: ti.template(), c: ti.template(), k):
        """Elastic energy of bond k [J]."""
        stretch, _speed, _normal, stiffness, _dashpot = self._state(w, c, k)
        return 0.5 * stiffness * stretch * stretch

    @ti.func
    def _state(self, w: ti.template(), c: ti.template(), k):
        """How much longer than at rest bond k is [m], how fast it becomes so [m/s], its direction, stiffness [N/m] and dashpot [N s/m]."""
        box = w.box[None]
        way, motion = link_way(w, k)
        distance = way.norm() + 1e-30
        normal = way / distance
        stiffness = c.bonds_stiffness * box.weight / box.diameter
        dashpot = 2.0 * c.bonds_damping * ti.sqrt(stiffness * w.links.mass[k])
        return distance - w.links.rest[k], motion.dot(normal), normal, stiffness, dashpot
