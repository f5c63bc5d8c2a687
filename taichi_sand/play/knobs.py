"""The numbers that can be changed while a simulation runs: which there are, from where to where, and what changing one does.

Every range, unit and line of help comes from where the number is declared: the scene's schema or the effect's PARAMETERS.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from taichi_sand import effects
from taichi_sand.run import live
from taichi_sand.scene.parameters import Parameter
from taichi_sand.scene.schema import Scene, Solver

GRAVITY, MOST_GRAVITY = 20.0, 1000.0
"""Largest component of gravity on a slider, unless the scene has more, and that can be typed [m/s2]."""
EXPERT = {"md": ("k_r", "k_d", "alpha", "beta", "stiffness"), "rigid": ("hertz",)}
"""Keys of [solver] that get a slider where the scene gives them."""
OPENED = {"solver.restitution": (0.0, 1.3)}
"""Ranges opened to the unphysical, where they are not simply symmetric about 0."""
UNDER = 0.5
"""How far below 0 a number that is never negative may be opened; below -1 friction would feed a pile without bound in a single sweep."""
SPAN, DECADES = 10.0, 100.0
"""A slider of a number without limits reaches from 1/SPAN of its first value to SPAN times it, of one whose decades matter from 1/DECADES
to DECADES times it."""
SIGNED, UPWARDS, USUAL = 1.8, 5.0, 5.0
"""A slider reaches to so many times the value of the scene: either way, or up from 0; and to as many times USUAL if that is 0."""
WHY = {
    "restitution": "above 1 every impact gives energy",
    "mu": "friction that pushes what slides gives energy",
    "damping": "a dashpot that pushes gives energy",
    "stiffness": "what is pulled would go along",
    "strength": "nothing holds by less than nothing",
    "bond_number": "bridges of liquid do not push",
    "density": "there is no negative mass",
    "coefficient": "air that pushes what moves gives energy",
}
"""Why a value beyond its range is unphysical, by the last word of its key."""


@dataclass(frozen=True)
class Knob:
    """One number with a slider."""

    key: str
    label: str
    group: str
    unit: str
    help: str
    low: float  # the ends of its slider
    high: float
    log: bool = False
    wide: tuple[float, float] | None = None  # the slider when it is opened to unphysical values
    least: float | None = None  # what it may be at all; None = the ends of its slider
    most: float | None = None
    home: float | None = None  # what the scene says

    def span(self, opened: bool) -> tuple[float, float]:
        """From where to where its slider goes."""
        return self.wide if opened and self.wide else (self.low, self.high)

    def limits(self) -> tuple[float, float]:
        """From where to where it is physical."""
        return self.low if self.least is None else self.least, self.high if self.most is None else self.most

    def bounded(self, value: float, opened: bool) -> float:
        """The nearest that it may be set to: by typing also beyond the ends of its slider."""
        least, most = self.limits()
        low, high = self.span(opened)
        return min(max(high, most), max(min(low, least), value)) if opened else min(most, max(least, value))

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
        least, most = self.limits()
        return least <= value <= most

    def why(self, value: float) -> str:
        """Why `value` is unphysical, or ""."""
        if self.physical(value):
            return ""
        least, most = self.limits()
        bound = f"at least {least:g}" if value < least else f"at most {most:g}"
        return WHY.get(self.key.rpartition(".")[2], f"it is {bound}")


def knobs_of(scene: Scene, home: Scene) -> list[Knob]:
    """All knobs of a scene that started as `home`: those of its solver, gravity, time, and of the effects that are on."""
    same = home.solver.kind == scene.solver.kind
    found = [_of_solver("tolerance", "accuracy", home.solver, log=True), _of_solver("restitution", "world", home.solver)]
    found += [_of_solver(name, "world", home.solver) for name in EXPERT[scene.solver.kind] if same and getattr(home.solver, name)]
    for axis, name in enumerate(("x", "y")):
        key, value = f"gravity.{axis}", home.gravity[axis]
        end = max(GRAVITY, nice(SIGNED * abs(value)))
        most = max(MOST_GRAVITY, end)
        told = "acceleration of everything"
        found.append(Knob(key, f"gravity {name}", "world", "m/s2", told, -end, end, least=-most, most=most, home=value))
    found.append(Knob("time", "time scale", "world", "x", "simulated time to wall time", 0.05, 4.0, log=True, home=1.0))
    for name in scene.effects:
        found += _of_effect(name, home.effects.get(name, {}))
    known = {"time", *live.keys(scene)}
    return [knob for knob in found if knob.key in known]


def _of_solver(name: str, group: str, solver: Solver, log: bool = False) -> Knob:
    """A key of [solver], with the limits that the schema gives it."""
    info, value = Solver.model_fields[name], getattr(solver, name)
    limits = {type(limit).__name__: getattr(limit, type(limit).__name__.lower(), None) for limit in info.metadata}
    least, most = limits.get("Ge", limits.get("Gt")), limits.get("Le")
    low, high = least, most
    if high is None and value:
        low, high, log = value / SPAN, value * SPAN, True
    more: Any = info.json_schema_extra or {}
    key = f"solver.{name}"
    bounds = {"least": float(least or 0.0), "most": math.inf if most is None else float(most), "home": value}
    help, unit = info.description or "", more.get("unit", "")
    return Knob(key, name, group, unit, help, float(low or 0.0), float(high or 0.0), log, OPENED.get(key), **bounds)


def _of_effect(name: str, table: Mapping[str, Any]) -> list[Knob]:
    """The live numbers that an effect declares, whose table in the scene is this."""
    found = []
    for p in effects.find(name).parameters:
        if not p.live or isinstance(p.default, bool | str) or p.default is None:
            continue
        value = float(table.get(p.name, p.default))
        low, high = reach(p, value)
        wide = (-min(UNDER, high), high) if p.low == 0 and not p.decades else None
        least, most = (-math.inf if p.low is None else p.low), (math.inf if p.high is None else p.high)
        limits = {"least": least, "most": most, "home": value}
        found.append(Knob(f"effects.{name}.{p.name}", f"{name} {p.name}", name, p.unit, p.help, low, high, p.decades, wide, **limits))
    return found


def reach(p: Parameter, value: float) -> tuple[float, float]:
    """From where to where the slider of a parameter goes, with `value` well inside: a range that is not much wider is shown whole."""
    usual = abs(float(p.default or 0.0))
    size = max(abs(value), usual) or USUAL
    least, most = (-math.inf if p.low is None else p.low), (math.inf if p.high is None else p.high)
    if p.decades:
        middle = abs(value) or usual or USUAL
        return max(least, middle / DECADES), min(most, middle * DECADES)
    if least < 0:
        end = nice(SIGNED * size)
        return max(least, -end), min(most, end)
    return least, most if most <= SPAN * size else float(f"{UPWARDS * size:.2g}")


def nice(value: float) -> float:
    """The smallest of 1, 2, 5 · 10^k that is not below `value`; 0 of 0."""
    if value <= 0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(float(f"{step * power:.1g}") for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9))
