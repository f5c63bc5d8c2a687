"""Optional physics, one module each; only those that a scene names are imported.

A module declares PARAMETERS (scene.parameters.Parameter), SOLVERS it fits, TURNS (whether it can turn a grain), memory(values, solver):
how many columns that follow a pair it needs, and build(values, columns, solver): the object whose ti.func methods the solver calls.
For md: tangent and release; for rigid: cone; for both: body(w, c, i), force and torque on grain i as a whole in every step. Their
argument c holds the live parameters too: `mu` of friction is c.friction_mu.
"""

import importlib
import pkgutil
from types import ModuleType
from typing import Any

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


def live(tables: dict[str, dict[str, Any]]) -> dict[str, float]:
    """Live parameters of the effects in `tables`, each by the name that kernels know it by."""
    return {f"{name}_{p.name}": tables[name][p.name] for name in tables for p in module(name).PARAMETERS if p.live}
