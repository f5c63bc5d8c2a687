"""Optional physics, one module each; only those that a scene names are imported.

A module declares PARAMETERS (scene.parameters.Parameter), SOLVERS it fits, TURNS (whether it can turn a grain), memory(values, solver):
how many columns that follow a pair it needs, and build(values, live, columns, solver): the object whose ti.func methods the solver calls.
For md: tangent and release; for rigid: cone.
"""

import importlib
import pkgutil
from types import ModuleType
from typing import Any

import taichi as ti

from taichi_sand.scene.errors import suggest
from taichi_sand.scene.parameters import check_table


def names() -> list[str]:
    """All effects there are, without importing any."""
    return sorted(m.name for m in pkgutil.iter_modules(__path__))


def module(name: str) -> ModuleType:
    """The module of effect `name`, imported."""
    return importlib.import_module(f"{__name__}.{name}")


def check(scene: Any) -> dict[str, dict[str, Any]]:
    """Complete tables of the effects that `scene` names, defaults filled in; SandError if one does not exist or fit the solver."""
    tables = {}
    for name, table in scene.effects.items():
        key = f"effects.{name}"
        if name not in names():
            raise scene.error(key, f"there is no such effect{suggest(name, names())} (there are: {', '.join(names())})")
        effect = module(name)
        if scene.solver.kind not in effect.SOLVERS:
            raise scene.error(key, f"does not fit the {scene.solver.kind} solver; it fits {' and '.join(effect.SOLVERS)}")
        tables[name] = check_table(f"{scene.source}: {key}" if scene.source else key, table, effect.PARAMETERS)
    return tables


def live_field(name: str, values: dict[str, Any], real: Any) -> Any:
    """0-D field of the live parameters of effect `name`, so that changing one recompiles nothing."""
    live = [p.name for p in module(name).PARAMETERS if p.live]
    field = ti.types.struct(**dict.fromkeys(live, real)).field(shape=())
    field[None] = {key: values[key] for key in live}
    return field
