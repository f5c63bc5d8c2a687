"""Materials: which one a grain or a part of a wall is made of, and how two of them meet. Only scenes with [[materials]] have tables."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.scene.materials import MOST, number_of
from taichi_sand.taichi_support import field_pool
from taichi_sand.world.tables import World, round_up, write_rows

SIDE = MOST + 1
"""Rows and columns of the matrices, the scene's own material included: so every scene has tables of one size."""


class Materials(NamedTuple):
    """Tables; of those of two materials the entry of numbers a and b is SIDE a + b."""

    of: Any  # of a kind of grain: number of its material, i32; shape (more than kinds,)
    friction: Any  # coefficient of friction of two
    bounce: Any  # what the solver makes of their restitution: rigid: that itself; md: dashpot over the root of stiffness and mass


def lay_materials(scene: Any, real: Any) -> dict[str, Any]:
    """The tables of `scene` and whether it has any, as members of a world."""
    if not scene.materials:
        return {"materials": None, "mixed": False}
    kinds = (*scene.grains, *scene.sources)
    of = field_pool.scalars(ti.i32, round_up(len(kinds) + 1))
    write_rows(of, np.array([number_of(scene, table.material) for table in kinds], np.int32))
    tables = Materials(of, field_pool.scalars(real, SIDE * SIDE), field_pool.scalars(real, SIDE * SIDE))
    return {"materials": tables, "mixed": True}


def write_materials(world: World, friction: Sequence[Any] | np.ndarray, bounce: Sequence[Any] | np.ndarray) -> None:
    """Puts the matrices (n, n) of friction and of what the solver makes of restitution into the tables."""
    for field, values in ((world.materials.friction, friction), (world.materials.bounce, bounce)):
        whole = np.zeros((SIDE, SIDE))
        whole[: len(values), : len(values)] = values
        write_rows(field, whole.ravel())


@ti.func
def both(w: ti.template(), p, wall: ti.template()):
    """Entry of the materials of pair p."""
    other = w.pairs.second[p]
    one = w.materials.of[w.grains.kind[w.pairs.first[p]]]
    return SIDE * one + (w.walls.material[other] if ti.static(wall) else w.materials.of[w.grains.kind[other]])


@ti.func
def friction_of(w: ti.template(), p, own, wall: ti.template()):
    """Coefficient of friction of pair p; `own` if the scene has no materials."""
    mu = own
    if ti.static(w.mixed):
        mu = w.materials.friction[both(w, p, wall)]
    return mu


@ti.func
def bounce_of(w: ti.template(), p, own, wall: ti.template()):
    """What the solver makes of the restitution of pair p; `own` if the scene has no materials."""
    bounce = own
    if ti.static(w.mixed):
        bounce = w.materials.bounce[both(w, p, wall)]
    return bounce
