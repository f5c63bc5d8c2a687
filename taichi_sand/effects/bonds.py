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
from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.scene.bodies import neighbours
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.links import link_way

PARAMETERS = (
    Parameter("stiffness", 1000.0, "force of a bond over how much longer it is", "weights/d", low=0.0, high=1e7),
    Parameter("damping", 0.1, "damping ratio of two grains and their bond", low=0.0, high=1.0),
    Parameter("strength", 0.0, "pull at which a bond breaks, in weights of a mean grain; 0 = never", "weights", low=0.0, high=1e9),
    Parameter("reach", 0.5, "bonded are grains up to this far apart, surface to surface", "d", low=0.0, high=4.0, live=False),
)
SOLVERS = ("md", "rigid")
NEUTRAL = {"stiffness": 0.0}

STEP_SHARE = 0.5
"""Of the longest stable step: the contacts need the rest, and a pair at it oscillates 5 % too fast."""


@dataclass(frozen=True, eq=False)
class Bonds:
    """The effect as kernels see it."""

    @ti.func
    def link(self, w: ti.template(), c: ti.template(), k):
        """Force of bond k on its second grain [N]; breaks it if it pulls too hard."""
        box = w.box[None]
        way, motion = link_way(w, k)
        distance = way.norm() + 1e-30
        normal = way / distance
        stiffness = c.bonds_stiffness * box.weight / box.diameter
        pull = stiffness * (distance - w.links.rest[k])
        dashpot = 2.0 * c.bonds_damping * ti.sqrt(stiffness * w.links.mass[k])
        force = -(pull + dashpot * motion.dot(normal)) * normal
        if c.bonds_strength > 0.0 and pull > c.bonds_strength * box.weight:
            w.links.whole[k] = 0
            force = ti.Vector([0.0, 0.0])
        return force


def misfit(scene: Any) -> str:
    """Why bonds do not fit a scene, or ""."""
    both = "sleeping" in scene.effects and any(table.bonded for table in scene.grains)
    return "does not fit [effects.sleeping]: sleepers would not feel their bonds" if both else ""


def links(values: dict[str, Any], grains: Any) -> np.ndarray:
    """Which grains of a pack are bonded, (n, 2)."""
    return neighbours(grains, values["reach"])


def longest_step(values: dict[str, Any], world: Any) -> float:
    """Longest step that the bonds of a world allow [s]."""
    box = world.box[None]
    stiffness = values["stiffness"] * box.weight / box.diameter
    if not world.linked or not stiffness or not world.links.give[None]:
        return math.inf
    omega = math.sqrt(stiffness * world.links.give[None])
    ratio = values["damping"] * math.sqrt(world.links.heaviest[None] * world.links.give[None])
    return STEP_SHARE * 2 / omega * (math.sqrt(1 + ratio**2) - ratio)


def build(values: dict[str, Any], columns: tuple, solver: str) -> Bonds:
    """The effect for a world."""
    return Bonds()
