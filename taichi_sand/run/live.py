"""The live numbers of a scene: what of it may change while it is simulated, by dotted key; the rest is structure, and stays.

A value within the range that its key declares becomes part of the scene. One beyond it, which no scene may have, is kept apart (`over`),
and the scene has the nearest that it may.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from taichi_sand import effects
from taichi_sand.errors import SandError, show, suggest
from taichi_sand.scene.checks import foreign
from taichi_sand.scene.parameters import Parameter, check_table
from taichi_sand.scene.schema import Scene, Solver

COMPILED = ("kind", "precision", "integrator", "law")
"""Keys of [solver] that are compiled into the kernels; `k_d` is there or not."""
FREE = {"title", "about", "duration", "view", "record", "events", "checks", "gravity", "solver", "effects", "walls"}
"""Keys of a scene that may differ from those of the scene that is simulated; of `solver` and `effects` only what is live, and walls as far
as `Simulation.set_walls` allows; events that have come do not come again."""
MOST_RESTITUTION = 1.0


def keys(scene: Scene) -> list[str]:
    """Every live key of `scene`."""
    solver = scene.solver
    closed = {*COMPILED, *foreign(solver.kind)}
    closed |= {"k_d"} if solver.k_d is None else {"restitution"} if solver.kind == "md" else set()
    closed |= set() if solver.law == "custom" else {"alpha", "beta"}
    found = ["gravity", "gravity.0", "gravity.1", *(f"solver.{name}" for name in Solver.model_fields if name not in closed)]
    return found + [f"effects.{name}.{p.name}" for name in sorted(scene.effects) for p in effects.find(name).parameters if p.live]


def known(scene: Scene, key: str) -> str:
    """`key`, if it is live; SandError with all that are, if not."""
    found = keys(scene)
    if key not in found:
        raise SandError(f"{show(key)} cannot be changed while it runs{suggest(key, found)} (what can: {', '.join(found)})", str(key))
    return key


def parameter_of(key: str) -> Parameter:
    """What an effect declares of `key`."""
    _, name, parameter = key.split(".")
    return next(p for p in effects.find(name).parameters if p.name == parameter)


def read(scene: Scene, key: str) -> Any:
    """The value that `scene` has for a live key, or its default; None for one of [solver] that follows from the tolerance."""
    head, _, rest = known(scene, key).partition(".")
    if head == "gravity":
        return scene.gravity[int(rest)] if rest else scene.gravity
    if head == "solver":
        return getattr(scene.solver, rest)
    name, _, parameter = rest.partition(".")
    return scene.effects[name].get(parameter, parameter_of(key).default)


def written(scene: Scene, key: str, value: Any) -> Scene:
    """`scene` with another value for a live key; SandError if it may not have that one."""
    head, _, rest = known(scene, key).partition(".")
    value = value.tolist() if isinstance(value, np.generic | np.ndarray) else value
    try:
        if head == "gravity":
            gravity = [value if str(axis) == rest else old for axis, old in enumerate(scene.gravity)] if rest else value
            return scene.model_copy(update={"gravity": Scene(size=scene.size, gravity=gravity).gravity})
        if head == "solver":
            table = {**scene.solver.model_dump(exclude_unset=True), rest: value}
            table = {name: number for name, number in table.items() if number is not None}
            return scene.model_copy(update={"solver": Scene(size=scene.size, solver=table).solver})
    except SandError as error:
        raise SandError(f"{scene.source}: {error}" if scene.source else str(error), error.key) from None
    name, _, parameter = rest.partition(".")
    table = {**scene.effects[name], parameter: value}
    where = f"effects.{name}"
    check_table(f"{scene.source}: {where}" if scene.source else where, table, effects.find(name).parameters)
    new = scene.model_copy(update={"effects": {**scene.effects, name: table}})
    effects.check(new)  # whether it still fits the scene
    return new


def limits(key: str) -> tuple[float, float] | None:
    """The physical range of a key that may be set beyond it; None for one that may not."""
    if key == "solver.restitution":
        return 0.0, MOST_RESTITUTION
    if not key.startswith("effects."):
        return None
    p = parameter_of(key)
    if isinstance(p.default, bool | str) or p.default is None:
        return None
    return -math.inf if p.low is None else p.low, math.inf if p.high is None else p.high


def beyond(scene: Scene, key: str, value: Any) -> tuple[float, float] | None:
    """`value` as a number and the nearest that a scene may have, if the key may be set beyond its range and the value is; else None."""
    span = limits(known(scene, key))
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not span or not number or not math.isfinite(value) or span[0] <= value <= span[1]:
        return None
    if key == "solver.restitution" and value < 0:
        return None
    return float(value), min(span[1], max(span[0], float(value)))


def structure(scene: Scene) -> str:
    """What of a scene is compiled into its kernels, as a key."""
    solver = scene.solver
    fixed = {
        name: {p.name: table[p.name] for p in effects.find(name).parameters if not p.live} for name, table in effects.check(scene).items()
    }
    return json.dumps([solver.kind, solver.law, solver.integrator, solver.k_d is None, solver.precision, fixed])


def same_box(one: Scene, other: Scene) -> bool:
    """Whether two scenes are of the same box, grains and sources, and differ at most in what may change while they are simulated, in
    solver and effects.
    """
    return all(name in FREE or getattr(one, name) == getattr(other, name) for name in Scene.model_fields)


def check_live(now: Scene, new: Scene) -> None:
    """SandError if `new` differs from `now` in more than what may change while it runs."""
    effects.check(new)
    if new.solver.kind != now.solver.kind:
        raise new.error("solver.kind", "cannot change while it runs; make a new Simulation")
    if structure(now) != structure(new):
        raise new.error("solver, effects", "another law, integrator, precision or set of effects is compiled anew; make a new Simulation")
    for name in Scene.model_fields:
        one, other = getattr(now, name), getattr(new, name)
        if name not in FREE and one is not other and one != other:
            raise new.error(name, "cannot change while it runs; make a new Simulation")


def kept(over: Mapping[str, float], now: Scene, new: Scene) -> dict[str, float]:
    """Those of the values `over` beyond their range that `new` has not got another value for."""
    live = set(keys(new))
    return {key: value for key, value in over.items() if key in live and read(new, key) == read(now, key)}


def kernel_numbers(scene: Scene, over: Mapping[str, float], numbers: Mapping[str, float]) -> dict[str, float]:
    """All live numbers by the names that kernels know them by; `numbers` are those of the solver, without `over`."""
    found = {**numbers, **effects.live(effects.check(scene))}
    for key, value in over.items():
        if key == "solver.restitution":
            found |= _bouncy(value, numbers)
        else:
            found[key.removeprefix("effects.").replace(".", "_")] = value
    return found


def _bouncy(restitution: float, numbers: Mapping[str, float]) -> dict[str, float]:
    """A restitution above 1: an impact gives energy. For md a dashpot that pushes: of a linear one e = exp(-π ζ / sqrt(1 - ζ²))."""
    if "restitution" in numbers:
        return {"restitution": restitution}
    zeta = -math.log(restitution) / math.hypot(math.pi, math.log(restitution))
    return {"damping": 2 * zeta * math.sqrt(numbers["stiffness"])}
