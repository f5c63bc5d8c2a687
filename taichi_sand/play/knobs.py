"""The numbers that can be changed while a simulation runs: which there are, from where to where, and what changing one does.

Every range, unit and line of help comes from where the number is declared: the scene's schema or the effect's PARAMETERS.
"""

import math
from dataclasses import dataclass
from typing import Any

from taichi_sand import effects
from taichi_sand.run import live
from taichi_sand.scene.schema import Scene, Solver

GRAVITY = 20.0
"""Largest component of gravity on a slider [m/s2]."""
EXPERT = {"md": ("k_r", "k_d", "alpha", "beta", "stiffness"), "rigid": ("hertz",)}
"""Keys of [solver] that get a slider where the scene gives them."""
OPENED = {"solver.restitution": (0.0, 1.3)}
"""Ranges opened to the unphysical, where they are not simply symmetric about 0."""
UNDER = 0.5
"""How far below 0 a number that is never negative may be opened; below -1 friction would feed a pile without bound in a single sweep."""
SPAN = 10.0
"""A slider of a number without limits reaches from 1/SPAN of its first value to SPAN times it."""


@dataclass(frozen=True)
class Knob:
    """One number with a slider."""

    key: str
    label: str
    group: str
    unit: str
    help: str
    low: float
    high: float
    log: bool = False
    wide: tuple[float, float] | None = None  # the range when it is opened to unphysical values

    def span(self, opened: bool) -> tuple[float, float]:
        """From where to where it goes."""
        return self.wide if opened and self.wide else (self.low, self.high)

    def share(self, value: float, opened: bool) -> float:
        """Where `value` lies on the slider, 0 .. 1."""
        low, high = self.span(opened)
        if self.log:
            share = math.log(max(value, 1e-30) / low) / math.log(high / low)
        else:
            share = (value - low) / (high - low)
        return min(1.0, max(0.0, share))

    def value(self, share: float, opened: bool) -> float:
        """The value at this place of the slider, in three or four digits."""
        low, high = self.span(opened)
        share = min(1.0, max(0.0, share))
        exact = low * (high / low) ** share if self.log else low + (high - low) * share
        fine = abs(exact) if self.log else (high - low) / 10
        return round(exact, 2 - math.floor(math.log10(fine))) if fine else exact

    def physical(self, value: float) -> bool:
        """Whether `value` lies within the declared range."""
        return self.low <= value <= self.high


def knobs_of(scene: Scene, home: Scene) -> list[Knob]:
    """All knobs of a scene that started as `home`: those of its solver, gravity, time, and of the effects that are on."""
    found = [_of_solver("tolerance", "accuracy", log=True), _of_solver("restitution", "world")]
    for name in EXPERT[scene.solver.kind]:
        value = getattr(home.solver, name)
        if value and home.solver.kind == scene.solver.kind:
            found.append(_of_solver(name, "world", value))
    for axis, name in enumerate(("x", "y")):
        found.append(Knob(f"gravity.{axis}", f"gravity {name}", "world", "m/s2", "acceleration of everything", -GRAVITY, GRAVITY))
    found.append(Knob("time", "time scale", "world", "x", "simulated time to wall time", 0.05, 4.0, log=True))
    for name in scene.effects:
        found += _of_effect(name)
    known = {"time", *live.keys(scene)}
    return [knob for knob in found if knob.key in known]


def _of_solver(name: str, group: str, value: float | None = None, log: bool = False) -> Knob:
    """A key of [solver], with the limits that the schema gives it."""
    info = Solver.model_fields[name]
    limits = {type(limit).__name__: getattr(limit, type(limit).__name__.lower(), None) for limit in info.metadata}
    low, high = limits.get("Ge", limits.get("Gt")), limits.get("Le")
    if high is None and value is not None:
        low, high, log = value / SPAN, value * SPAN, True
    more: Any = info.json_schema_extra or {}
    key = f"solver.{name}"
    return Knob(key, name, group, more.get("unit", ""), info.description or "", float(low or 0.0), float(high or 0.0), log, OPENED.get(key))


def _of_effect(name: str) -> list[Knob]:
    """The live numbers that an effect declares."""
    found = []
    for p in effects.find(name).parameters:
        if not p.live or isinstance(p.default, bool | str) or p.default is None:
            continue
        low = p.low if p.low is not None else -SPAN * abs(p.default or 1.0)
        high = p.high if p.high is not None and p.high <= SPAN * abs(p.default or 1.0) else max(1.0, 4 * abs(p.default))
        wide = (-min(UNDER, high), high) if low == 0 else None
        found.append(Knob(f"effects.{name}.{p.name}", f"{name} {p.name}", name, p.unit, p.help, low, high, wide=wide))
    return found
