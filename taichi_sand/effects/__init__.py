"""Optional physics, one module each; only those that a scene names are imported. A user's own effect is a file like these.

What an effect is, says `base.Effect`; here is what the simulation asks of those that a scene has.
"""

import importlib
import importlib.util
import inspect
import math
import pkgutil
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from taichi_sand.effects.base import HOOKS, Effect
from taichi_sand.errors import SandError, suggest
from taichi_sand.scene.parameters import check_table
from taichi_sand.world.extras.hooks import offers

__all__ = ["HOOKS", "Effect"]

own: dict[str, type[Effect]] = {}
"""Effects that users brought, by name."""


def bundled() -> list[str]:
    """Those of the package, without importing any."""
    return [m.name for m in pkgutil.iter_modules(__path__) if m.name != "base"]


def names() -> list[str]:
    """All effects there are, without importing any."""
    return sorted({*bundled(), *own})


def find(name: str) -> type[Effect]:
    """The effect `name`; its module is imported."""
    return own[name] if name in own else effect_of(importlib.import_module(f"{__name__}.{name}"))


def effect_of(module: ModuleType) -> type[Effect]:
    """The effect that a module defines; SandError unless it is one."""
    found = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Effect) and kind is not Effect]
    found = [kind for kind in found if kind.__module__ == module.__name__]
    if len(found) != 1:
        raise SandError(f"it must define one class that derives from taichi_sand.effects.Effect, not {len(found)}")
    return found[0]


def about(name: str) -> str:
    """What effect `name` is: the docstring of its module."""
    return inspect.getdoc(sys.modules[find(name).__module__]) or ""


def add(path: str | PathLike[str]) -> str:
    """Makes the effect in a user's Python file known under the name of the file, which is returned.

    Raises:
        SandError: the file is not there, is not Python, or does not define what an effect is.
    """
    path = Path(path)
    name = path.stem
    if path.suffix != ".py" or not path.is_file():
        raise SandError(f"--effect {path}: there is no such Python file")
    if not re.fullmatch(r"[a-z]\w*", name) or name in bundled():
        raise SandError(f"--effect {path}: `{name}` cannot be its name; take one in small letters that no effect has yet")
    spec = importlib.util.spec_from_file_location(f"{__name__}.own.{name}", path)
    assert spec and spec.loader
    found = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = found
    try:
        spec.loader.exec_module(found)
        own[name] = effect_of(found)
    except SandError as error:
        raise SandError(f"--effect {path}: {error}") from None
    except Exception as error:
        raise SandError(f"--effect {path}: cannot be imported: {type(error).__name__}: {error}") from None
    return name


def fitting(kind: str) -> list[str]:
    """All effects that fit solver `kind`."""
    return [name for name in names() if kind in find(name).solvers]


def check(scene: Any) -> dict[str, dict[str, Any]]:
    """Complete tables of the effects that `scene` names, defaults filled in; SandError if one does not exist or fit the solver.

    In the order of their names, whatever the scene's: kernels and bits are then the same.
    """
    tables = {}
    for name, table in sorted(scene.effects.items()):
        key = f"effects.{name}"
        if name not in names():
            raise scene.error(key, f"there is no such effect{suggest(name, names())} (there are: {', '.join(names())})")
        effect, kind = find(name), scene.solver.kind
        if kind not in effect.solvers:
            raise scene.error(
                key, f"does not fit the {kind} solver, only {' and '.join(effect.solvers)}; what fits {kind}: {', '.join(fitting(kind))}"
            )
        tables[name] = check_table(f"{scene.source}: {key}" if scene.source else key, table, effect.parameters)
    for name in tables:
        wrong = find(name).misfit(scene)
        if wrong:
            raise scene.error(f"effects.{name}", wrong)
    return tables


def live(tables: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Live parameters of the effects in `tables`, each by the name that kernels know it by."""
    return {f"{name}_{p.name}": tables[name][p.name] for name in tables for p in find(name).parameters if p.live}


def columns(name: str, values: dict[str, Any], kind: str) -> int:
    """How many columns that follow a pair effect `name` needs."""
    return find(name).memory(values, kind)


def turns(tables: Mapping[str, Any]) -> bool:
    """Whether any of these effects can turn a grain."""
    return any(find(name).turns for name in tables)


def sleeps(tables: Iterable[str]) -> bool:
    """Whether any of these effects lets grains sleep."""
    return any(find(name).sleeps for name in tables)


def reach(tables: Mapping[str, Any]) -> float:
    """How far apart grains still act on one another, in mean diameters."""
    return max((find(name).reach(values) for name, values in tables.items()), default=0.0)


def carried(tables: Mapping[str, Any]) -> dict[str, float]:
    """Columns that follow a grain, and what a grain starts with."""
    found: dict[str, float] = {}
    for name, values in tables.items():
        found |= find(name).carried(values)
    return found


def structure(tables: Mapping[str, Any], grains: Any) -> dict[str, Any]:
    """What the world of the pack `grains` must know of these effects, as keywords of make_world."""
    tied = [links for name, values in tables.items() if (links := find(name).links(values, grains)) is not None]
    found = {"sleeps": sleeps(tables), "reach": reach(tables), "carried": carried(tables)}
    return found | {"links": np.concatenate(tied) if tied else None}


def bed(tables: Mapping[str, Any], world: Any) -> dict[str, Any]:
    """What the dial must know of these effects, as fields of solvers.bed.Bed: longest step, pulls and pushes, and whether contacts resist
    sliding.
    """
    found = [(find(name), values) for name, values in tables.items()]
    return {
        "longest_step": min((effect.longest_step(values, world) for effect, values in found), default=math.inf),
        "pull": sum(effect.pull(values) for effect, values in found),
        "push": sum(effect.push(values, world) for effect, values in found),
        "steady": max((effect.steady(values, world) for effect, values in found), default=0.0),
        "lift": lift(tables, world),
        "rough": any(effect.resists(values) for effect, values in found) or (world.mixed and "friction" in tables),
    }


def lift(tables: Mapping[str, Any], world: Any) -> float:
    """By how much of their weight these effects make all grains lighter at the moment, 0 … 1."""
    return min(1.0, sum(find(name).lift(values, world) for name, values in tables.items()))


def tables(name: str, values: dict[str, Any], scene: Any, grains: Any, world: Any) -> tuple:
    """Fields of its own that effect `name` has beside columns, for `grains` in `world`."""
    return find(name).tables(values, scene, grains, world, scene.solver.kind)


def build(name: str, values: dict[str, Any], memory: Sequence[Any], kind: str) -> Effect:
    """The object whose hooks the solver calls; SandError if it has none that solver `kind` calls."""
    effect = find(name).build(values, tuple(memory), kind)
    known = {**HOOKS[kind], **HOOKS["both"]}
    if not any(offers(effect, hook) for hook in known):
        raise SandError(f"effect {name} has no hook that the {kind} solver calls; there are: {', '.join(known)}")
    return effect
