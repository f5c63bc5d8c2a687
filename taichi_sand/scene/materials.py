"""The tables [[materials]] and [[material_pairs]]: friction and restitution of what touches, by what both are made of.

What names no material is made of the scene's own: [effects.friction] and `solver.restitution` say how that is.
"""

from typing import Any, Self

import numpy as np
from pydantic import model_validator

from taichi_sand.errors import Wrong, show, suggest
from taichi_sand.scene.kinds import Name, Number, Table, key

MOST = 15
"""Materials of a scene, beside its own."""


class Material(Table):
    """What grains, walls and edges may be made of, by its name in their key `material`."""

    name: Name = key(..., "what `material` calls it", min_length=1)
    friction: Number | None = key(None, "coefficient of friction with itself; that of [effects.friction] if not given", ge=0, le=10)
    restitution: Number | None = key(None, "restitution with itself; that of [solver] if not given", ge=0, le=1)


class MaterialPair(Table):
    """How two materials meet, where that is not the geometric mean of how each meets itself."""

    between: tuple[str, str] = key(..., "the names of both")
    friction: Number | None = key(None, "coefficient of friction; the geometric mean if not given", ge=0, le=10)
    restitution: Number | None = key(None, "restitution; the geometric mean if not given", ge=0, le=1)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.friction is None and self.restitution is None:
            raise Wrong("", " needs `friction` or `restitution`")
        return self


def number_of(scene: Any, name: str) -> int:
    """Number of a material in the matrices below: 0 of the scene's own, from 1 on as they stand."""
    return next((number for number, material in enumerate(scene.materials, 1) if material.name == name), 0)


def matrices(scene: Any, friction: float, restitution: float) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of friction, and restitutions, between materials (n, n), the scene's own first, which has these."""
    found = []
    for name, own in (("friction", friction), ("restitution", restitution)):
        given = [own] + [own if getattr(material, name) is None else getattr(material, name) for material in scene.materials]
        matrix = np.sqrt(np.outer(given, given))
        np.fill_diagonal(matrix, given)  # the root of a square is not always the number
        for pair in scene.material_pairs:
            if getattr(pair, name) is not None:
                one, other = (number_of(scene, material) for material in pair.between)
                matrix[one, other] = matrix[other, one] = getattr(pair, name)
        found.append(matrix)
    return found[0], found[1]


def restitutions(scene: Any) -> list[float]:
    """All that contacts may have, that of [solver] first."""
    own = scene.solver.restitution
    return [own, *matrices(scene, 0.0, own)[1].ravel().tolist()] if scene.materials else [own]


def check_materials(scene: Any) -> None:
    """Wrong unless names are there, and once, and what they ask for can be had."""
    known = [material.name for material in scene.materials]
    if len(known) > MOST:
        raise Wrong("materials", f" has {len(known)} tables, at most {MOST} may be given")
    for index, name in enumerate(known):
        if known.index(name) < index:
            raise Wrong(f"materials[{index}].name", f" = {show(name)} is the name of two materials")
    _check_pairs(scene, known)
    _check_effects(scene)
    users = [(kind, index, table) for kind in ("grains", "sources", "walls") for index, table in enumerate(getattr(scene, kind))]
    for where, table in [*((f"{kind}[{index}]", table) for kind, index, table in users), ("edges", scene.edges)]:
        if table.material and table.material not in known:
            _unknown(f"{where}.material", table.material, known)
    for index, wall in enumerate(scene.walls):
        if wall.material and wall.friction is not None:
            raise Wrong(f"walls[{index}].friction", f" = {wall.friction:g} and `material` exclude each other")


def _unknown(where: str, name: str, known: list[str]) -> None:
    names = f"{suggest(name, known)} (there are: {', '.join(known) or 'none'})"
    raise Wrong(where, f" = {show(name)} must be the name of one of the [[materials]]{names}")


def _check_pairs(scene: Any, known: list[str]) -> None:
    seen: list[set[str]] = []
    for index, pair in enumerate(scene.material_pairs):
        for name in pair.between:
            if name not in known:
                _unknown(f"material_pairs[{index}].between", name, known)
        if set(pair.between) in seen:
            raise Wrong(f"material_pairs[{index}].between", f" = {show(pair.between)} names two that another pair names")
        seen.append(set(pair.between))


def _check_effects(scene: Any) -> None:
    for kind in ("materials", "material_pairs"):
        for index, table in enumerate(getattr(scene, kind)):
            if table.friction is not None and "friction" not in scene.effects:
                raise Wrong(f"{kind}[{index}].friction", f" = {table.friction:g} needs a table [effects.friction]")
            if table.restitution is not None and scene.solver.k_d is not None:
                text = f" = {table.restitution:g} cannot be had beside solver.k_d, which damps all contacts alike"
                raise Wrong(f"{kind}[{index}].restitution", text)
