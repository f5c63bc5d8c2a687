"""What an effect is: a class that derives from `Effect`, alone in a module whose name is the effect's and whose docstring is its page.

The class says what the effect needs (class methods, asked before anything is built), and its objects do it (hooks, called by the solvers).
"""

import inspect
import math
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from taichi_sand.errors import SandError, suggest
from taichi_sand.scene.parameters import Parameter

KINDS = ("md", "rigid")
"""Solvers that an effect may fit."""


def hook(kind: str) -> Callable:
    """Declares a hook that the solver `kind` calls, or any if "both"."""

    def declare(function: Callable) -> Callable:
        function.declared_for = kind  # type: ignore[attr-defined]
        return function

    return declare


class Effect:
    """An effect. What a class does not have of the following has the default shown, and costs nothing; other public methods are refused.

    All hooks but `on_pause` and `report` are ti.funcs that the solver folds into its own kernels. There w is the world, c the numbers of
    the solver and the live parameters (`mu` of friction is c.friction_mu), p a row of the neighbour list, i and j grains; `wall` says at
    compile time whether the second of a pair is a wall.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = ()
    """Its keys in a scene."""
    solvers: ClassVar[tuple[str, ...]] = KINDS
    """Those it fits."""
    turns: ClassVar[bool] = False
    """Whether it can turn a grain: without an effect that does, spins are not computed."""
    sleeps: ClassVar[bool] = False
    """Whether it lets grains sleep."""
    neutral: ClassVar[dict[str, Any] | None] = None
    """Parameters at which it does nothing; None = there are none known."""
    interval: ClassVar[float | None] = None
    """Simulated time between two calls of `on_pause` or `on_step` [s]; None = `on_pause` returns after how many steps it is due again."""

    # what it needs; `values` are its parameters, `solver` is "md" or "rigid"

    @classmethod
    def misfit(cls, scene: Any) -> str:
        """Why it does not fit `scene`, or ""."""
        return ""

    @classmethod
    def memory(cls, values: dict[str, Any], solver: str) -> int:
        """How many columns that follow a pair from list build to list build it needs."""
        return 0

    @classmethod
    def carried(cls, values: dict[str, Any]) -> dict[str, float]:
        """Names of the columns that follow a grain (w.carried.name), and what a grain starts with."""
        return {}

    @classmethod
    def tables(cls, values: dict[str, Any], scene: Any, grains: Any, world: Any, solver: str) -> tuple:
        """Fields of its own, for the scene.packing.Pack `grains` in `world`; `build` gets them behind its columns."""
        return ()

    @classmethod
    def build(cls, values: dict[str, Any], columns: tuple, solver: str) -> "Effect":
        """The effect for a world; `columns` are those that `memory` asked for, and what `tables` has made."""
        return cls()

    # what the world and the dial must know of it

    @classmethod
    def reach(cls, values: dict[str, Any]) -> float:
        """How far apart grains act on one another [mean diameters]."""
        return 0.0

    @classmethod
    def links(cls, values: dict[str, Any], grains: Any) -> np.ndarray | None:
        """Which grains of the scene.packing.Pack `grains` it ties together, (n, 2); None = it ties none in any scene."""
        return None

    @classmethod
    def longest_step(cls, values: dict[str, Any], world: Any) -> float:
        """Longest step at which it is stable [s]."""
        return math.inf

    @classmethod
    def pull(cls, values: dict[str, Any]) -> float:
        """How strongly it holds grains together at most [weights of a mean grain]."""
        return 0.0

    @classmethod
    def push(cls, values: dict[str, Any], world: Any) -> float:
        """How strongly it presses a mean grain against others at most [N]."""
        return 0.0

    @classmethod
    def steady(cls, values: dict[str, Any], world: Any) -> float:
        """How strongly it presses a single grain at most [N]."""
        return 0.0

    @classmethod
    def lift(cls, values: dict[str, Any], world: Any) -> float:
        """By how much of their weight it makes all grains lighter at the moment, 0 … 1."""
        return 0.0

    @classmethod
    def resists(cls, values: dict[str, Any]) -> bool:
        """Whether it keeps contacts from sliding."""
        return False

    # hooks of md

    @hook("md")
    def normal(self, w, c, p, overlap) -> Any:
        """Normal force of pair p on top of the contact's, also apart (overlap < 0), within `reach` [N]."""

    @hook("md")
    def tangent(self, w, c, p, wall, normal_force, slip, stiffness, dashpot) -> Any:
        """Tangential force on the second grain of pair p, which slips by `slip` [m/s] [N]."""

    @hook("md")
    def couple(self, w, c, p, normal_force, roll, radius, stiffness, inertia) -> Any:
        """Torque on the second grain of pair p, which turns by `roll` [rad/s] as seen from the first [N m]."""

    @hook("md")
    def touch(self, w, i, j, normal, wall) -> Any:
        """Grain i touches grain j, or a wall, along the unit vector `normal`."""

    @hook("md")
    def release(self, w, p) -> Any:
        """Pair p does not touch."""

    @hook("md")
    def tighten(self, w, p, stretch, force) -> Any:
        """Pair p has another stiffness: what is stretched in it, and what pulls, become so many times."""

    @hook("md")
    def stored(self, w, c, p, overlap, stiffness) -> Any:
        """Elastic energy that it holds in pair p [J]; asked for if some effect has `store`."""

    @hook("md")
    def store(self, w, p, energy) -> Any:
        """Pair p now holds this much elastic energy, effects included; returns what it held before [J]."""

    # hooks of rigid

    @hook("rigid")
    def min_normal_impulse(self, w, c, p, gap, middle) -> Any:
        """Lowest normal impulse of pair p, for the gap now and amid the step; 0, 0 at an impact [N s]."""

    @hook("rigid")
    def friction_bound(self, w, c, p, wall, normal) -> Any:
        """Largest tangential impulse of pair p for a normal one [N s]."""

    @hook("rigid")
    def rolling_bound(self, w, c, p, normal, radius) -> Any:
        """Largest angular impulse of pair p [N m s]; its column `torque` keeps what is carried [N m]."""

    # hooks of both

    @hook("both")
    def heat(self, w, i, energy) -> Any:
        """Contacts have turned so much energy of motion into heat of grain i [J]; see world.extras.energy_ledger."""

    @hook("both")
    def link(self, w, c, k) -> Any:
        """Force of link k, which is whole, on its second grain [N]."""

    @hook("both")
    def snap(self, w, c, k) -> Any:
        """Breaks link k by w.links.whole[k] = 0, or not; the impulse on its second grain with which it breaks [N s]."""

    @hook("both")
    def kept(self, w, c, k) -> Any:
        """Elastic energy that link k, which is whole, holds [J]; asked for if some effect has `heat`."""

    @hook("both")
    def body(self, w, c, i) -> Any:
        """Force and torque on grain i in every step, as a wrench [N, N, N m, 0]."""

    @hook("both")
    def on_step(self, w, s) -> Any:
        """Within a launch, between two steps, every `interval`, the least of all such effects; s is the solver."""

    @hook("both")
    def on_pause(self, world, solver) -> Any:
        """Python, between launches, every `interval`; of an effect without one before the first step, too."""

    @hook("both")
    def report(self, world, solver) -> Any:
        """Python: numbers of the report, by key."""

    def __init_subclass__(cls) -> None:
        """Refuses what no solver would ever ask for, or call with other arguments."""
        name = cls.__name__
        if not isinstance(cls.parameters, tuple) or not all(isinstance(p, Parameter) for p in cls.parameters):
            raise SandError(f"effect {name}: `parameters` must be a tuple of taichi_sand.scene.parameters.Parameter")
        if not isinstance(cls.solvers, tuple) or not cls.solvers or not set(cls.solvers) <= set(KINDS):
            raise SandError(f'effect {name}: `solvers` must name those it fits, such as ("md", "rigid")')
        known = [public for public in vars(Effect) if not public.startswith("_")]
        for own, value in vars(cls).items():
            method = callable(value) or isinstance(value, classmethod | staticmethod)
            if own.startswith("_") or not method:
                continue
            if own not in known:
                raise SandError(f"effect {name}: there is no hook `{own}`{suggest(own, known)} (a method of its own begins with _)")
            if own in ALL_HOOKS and (given := _arguments(cls, own)) != (wanted := _arguments(Effect, own)):
                raise SandError(f"effect {name}: the hook `{own}` takes ({', '.join(wanted)}), not ({', '.join(given)})")


def _arguments(kind: type, name: str) -> list[str]:
    """Names of what a method takes, but for the object."""
    method = inspect.getattr_static(kind, name)
    taken = list(inspect.signature(getattr(kind, name)).parameters)
    return taken if isinstance(method, staticmethod) else taken[1:]


def hooks_of(kind: str) -> dict[str, str]:
    """Hooks that the solver `kind` calls, or any if "both": what each is given and does, by name."""
    found = {name: value for name, value in vars(Effect).items() if getattr(value, "declared_for", "") == kind}
    return {name: f"({', '.join(_arguments(Effect, name))}): {inspect.getdoc(value)}" for name, value in found.items()}


HOOKS = {kind: hooks_of(kind) for kind in (*KINDS, "both")}
ALL_HOOKS = {name for hooks in HOOKS.values() for name in hooks}
