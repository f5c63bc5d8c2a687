"""Optional physics, one module each; only those that a scene names are imported. A user's own effect is a file like these.

A module declares PARAMETERS (scene.parameters.Parameter), SOLVERS (those it fits), and if need be TURNS = True (it can turn grains),
SLEEPS = True (it lets grains sleep), NEUTRAL (values at which it does nothing), memory(values, solver), how many columns that follow a
pair it needs, carried(values), names of the columns that follow a grain (w.carried.name) with what a grain starts with, reach(values),
how far apart grains act on one another, in mean diameters, links(values, grains), which grains of a scene.packing.Pack it ties together,
(n, 2), longest_step(values, world), up to which it is stable [s], pull(values), by which it holds grains together at most, in weights of
a mean grain, push(values, world), by which it presses a mean grain against others at most [N], steady(values, world), by which it presses
a single grain at most [N], resists(values), whether it keeps contacts from sliding, tables(values, scene, grains, world, solver), a tuple
of fields of its own, which `build` gets behind its columns, and misfit(scene), why it does not fit a scene, or "".
build(values, columns, solver) makes the object whose methods are the hooks. HOOKS is the closed list of them; all but `on_pause` are
ti.funcs that the solver folds into its own kernels. Their argument w is the world, c the numbers of the solver and the live parameters
(`mu` of friction is c.friction_mu), p a row of the neighbour list.
"""

import importlib
import importlib.util
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

from taichi_sand.errors import SandError, suggest
from taichi_sand.scene.parameters import Parameter, check_table

HOOKS = {
    "md": {
        "normal": "(w, c, p, overlap): normal force of pair p on top of the contact's, also apart (overlap < 0), within `reach` [N]",
        "tangent": "(w, c, p, wall, normal_force, slip, stiffness, dashpot): tangential force on the second grain of pair p [N]",
        "couple": "(w, c, p, normal_force, roll, radius, stiffness, inertia): torque on the second grain of pair p [N m]",
        "touch": "(w, i, j, normal, wall): grain i touches grain j, or a wall, along the unit vector `normal`",
        "release": "(w, p): pair p does not touch",
        "tighten": "(w, p, stretch, force): pair p has another stiffness: what is stretched in it, and what pulls, become so many times",
        "stored": "(w, c, p, overlap, stiffness): elastic energy that the effect holds in pair p [J]; asked for if some effect has `store`",
        "store": "(w, p, energy): pair p now holds this much elastic energy [J], effects included; returns what it held before",
    },
    "rigid": {
        "min_normal_impulse": "(w, c, p, gap, middle): lowest normal impulse [N s], for the gap now and amid the step; 0, 0 at an impact",
        "friction_bound": "(w, c, p, wall, normal): largest tangential impulse of pair p for a normal one [N s]",
        "rolling_bound": "(w, c, p, normal, radius): largest angular impulse [N m s]; the column `torque` keeps what is carried [N m]",
    },
    "both": {
        "heat": "(w, i, energy): contacts have turned so much energy of motion into heat of grain i [J]; see world.extras.energy_ledger",
        "link": "(w, c, k): force of link k, which is whole, on its second grain [N]",
        "snap": "(w, c, k): breaks link k by w.links.whole[k] = 0, or not; the impulse on its second grain with which it breaks [N s]",
        "kept": "(w, c, k): elastic energy that link k, which is whole, holds [J]; asked for if some effect has `heat`",
        "body": "(w, c, i): force and torque on grain i in every step, as a wrench [N, N, N m, 0]",
        "on_step": "(w, s): within a launch, between two steps, every `interval` seconds, the least of all such effects; s is the solver",
        "on_pause": "(world, solver): Python, between launches, every `interval` seconds of simulated time; of an effect without one "
        "before the first step, too, and it returns after how many steps again",
        "report": "(world, solver): Python, numbers of the report, by key",
    },
}
"""What an effect may do, by the solver that calls it; an effect with another public method is refused."""
ALL_HOOKS = {hook for hooks in HOOKS.values() for hook in hooks}
KINDS = ("md", "rigid")

own: dict[str, ModuleType] = {}
"""Effects that users brought, by name."""


def names() -> list[str]:
    """All effects there are, without importing any."""
    return sorted({*(m.name for m in pkgutil.iter_modules(__path__)), *own})


def module(name: str) -> ModuleType:
    """The module of effect `name`, imported."""
    return own[name] if name in own else importlib.import_module(f"{__name__}.{name}")


def add(path: str | PathLike[str]) -> str:
    """Makes the effect in a user's Python file known under the name of the file, which is returned.

    Raises:
        SandError: the file is not there, is not Python, or does not declare what an effect must.
    """
    path = Path(path)
    name = path.stem
    if path.suffix != ".py" or not path.is_file():
        raise SandError(f"--effect {path}: there is no such Python file")
    if not re.fullmatch(r"[a-z]\w*", name) or name in {m.name for m in pkgutil.iter_modules(__path__)}:
        raise SandError(f"--effect {path}: `{name}` cannot be its name; take one in small letters that no effect has yet")
    spec = importlib.util.spec_from_file_location(f"{__name__}.own.{name}", path)
    assert spec and spec.loader
    found = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = found
    try:
        spec.loader.exec_module(found)
    except Exception as error:
        raise SandError(f"--effect {path}: cannot be imported: {type(error).__name__}: {error}") from None
    _check_module(path, found)
    own[name] = found
    return name


def _check_module(path: Path, found: ModuleType) -> None:
    parameters, solvers = getattr(found, "PARAMETERS", None), getattr(found, "SOLVERS", None)
    if not isinstance(parameters, tuple) or not all(isinstance(p, Parameter) for p in parameters):
        raise SandError(f"--effect {path}: PARAMETERS must be a tuple of taichi_sand.scene.parameters.Parameter")
    if not isinstance(solvers, tuple) or not solvers or not set(solvers) <= set(KINDS):
        raise SandError(f'--effect {path}: SOLVERS must name the solvers it fits, such as ("md", "rigid")')
    if not callable(getattr(found, "build", None)):
        raise SandError(f"--effect {path}: build(values, columns, solver) is missing")


def fitting(kind: str) -> list[str]:
    """All effects that fit solver `kind`."""
    return [name for name in names() if kind in module(name).SOLVERS]


def check(scene: Any) -> dict[str, dict[str, Any]]:
    """Complete tables of the effects that `scene` names, defaults filled in; SandError if one does not exist or fit the solver.

    In the order of their names, whatever the scene's: kernels and bits are then the same.
    """
    tables = {}
    for name, table in sorted(scene.effects.items()):
        key = f"effects.{name}"
        if name not in names():
            raise scene.error(key, f"there is no such effect{suggest(name, names())} (there are: {', '.join(names())})")
        effect, kind = module(name), scene.solver.kind
        if kind not in effect.SOLVERS:
            raise scene.error(
                key, f"does not fit the {kind} solver, only {' and '.join(effect.SOLVERS)}; what fits {kind}: {', '.join(fitting(kind))}"
            )
        tables[name] = check_table(f"{scene.source}: {key}" if scene.source else key, table, effect.PARAMETERS)
    for name in tables:
        wrong = module(name).misfit(scene) if hasattr(module(name), "misfit") else ""
        if wrong:
            raise scene.error(f"effects.{name}", wrong)
    return tables


def live(tables: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Live parameters of the effects in `tables`, each by the name that kernels know it by."""
    return {f"{name}_{p.name}": tables[name][p.name] for name in tables for p in module(name).PARAMETERS if p.live}


def columns(name: str, values: dict[str, Any], kind: str) -> int:
    """How many columns that follow a pair effect `name` needs."""
    memory = getattr(module(name), "memory", None)
    return memory(values, kind) if memory else 0


def turns(tables: Mapping[str, Any]) -> bool:
    """Whether any of these effects can turn a grain."""
    return any(getattr(module(name), "TURNS", False) for name in tables)


def sleeps(tables: Iterable[str]) -> bool:
    """Whether any of these effects lets grains sleep."""
    return any(getattr(module(name), "SLEEPS", False) for name in tables)


def reach(tables: Mapping[str, Any]) -> float:
    """How far apart grains still act on one another, in mean diameters."""
    return max((module(name).reach(values) for name, values in tables.items() if hasattr(module(name), "reach")), default=0.0)


def carried(tables: Mapping[str, Any]) -> dict[str, float]:
    """Columns that follow a grain, and what a grain starts with."""
    found = {}
    for name, values in tables.items():
        if hasattr(module(name), "carried"):
            found |= module(name).carried(values)
    return found


def structure(tables: Mapping[str, Any], grains: Any) -> dict[str, Any]:
    """What the world of the pack `grains` must know of these effects, as keywords of make_world."""
    tied = [module(name).links(values, grains) for name, values in tables.items() if hasattr(module(name), "links")]
    found = {"sleeps": sleeps(tables), "reach": reach(tables), "carried": carried(tables)}
    return found | {"links": np.concatenate(tied) if tied else None}


def bed(tables: Mapping[str, Any], world: Any) -> dict[str, Any]:
    """What the dial must know of these effects, as fields of solvers.bed.Bed: longest step, pulls and pushes, and whether contacts resist
    sliding.
    """
    found = [(module(name), values) for name, values in tables.items()]
    steps = (effect.longest_step(values, world) for effect, values in found if hasattr(effect, "longest_step"))
    pulls = (effect.pull(values) for effect, values in found if hasattr(effect, "pull"))
    pushes = (effect.push(values, world) for effect, values in found if hasattr(effect, "push"))
    forces = (effect.steady(values, world) for effect, values in found if hasattr(effect, "steady"))
    rough = any(effect.resists(values) for effect, values in found if hasattr(effect, "resists"))
    loads = {"pull": sum(pulls), "push": sum(pushes), "steady": max(forces, default=0.0)}
    return {"longest_step": min(steps, default=math.inf), **loads, "rough": rough}


def tables(name: str, values: dict[str, Any], scene: Any, grains: Any, world: Any) -> tuple:
    """Fields of its own that effect `name` has beside columns, for `grains` in `world`."""
    make = getattr(module(name), "tables", None)
    return make(values, scene, grains, world, scene.solver.kind) if make else ()


def build(name: str, values: dict[str, Any], memory: Sequence[Any], kind: str) -> Any:
    """The object whose hooks the solver calls; SandError if it has none that solver `kind` calls, or a method that is no hook."""
    effect = module(name).build(values, tuple(memory), kind)
    for method in dir(type(effect)):
        if not method.startswith("_") and callable(getattr(type(effect), method)) and method not in ALL_HOOKS:
            raise SandError(
                f"effect {name}: no solver calls a hook `{method}`{suggest(method, ALL_HOOKS)} (a method of its own begins with _)"
            )
    known = {**HOOKS[kind], **HOOKS["both"]}
    if not any(hasattr(effect, hook) for hook in known):
        raise SandError(f"effect {name} has no hook that the {kind} solver calls; there are: {', '.join(known)}")
    return effect
