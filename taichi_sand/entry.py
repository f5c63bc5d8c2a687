"""The doors of a simulation: who comes in through one has Taichi to itself meanwhile, see world.turns."""

import contextlib
import functools
import threading
from collections.abc import Callable, Iterator
from typing import Any, Concatenate, ParamSpec, TypeVar

from taichi_sand.scene.errors import SandError
from taichi_sand.world.turns import turn

P, R, S = ParamSpec("P"), TypeVar("R"), TypeVar("S", bound=Any)


def reads(method: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """A method that looks at the simulation: between two launches, if another thread is advancing it."""

    @functools.wraps(method)
    def looking(self: S, /, *args: P.args, **kwargs: P.kwargs) -> R:
        with turn:
            return method(self, *args, **kwargs)

    return looking


def changes(method: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """A method that changes it: SandError if another thread is advancing it."""

    @functools.wraps(method)
    def changing(self: S, /, *args: P.args, **kwargs: P.kwargs) -> R:
        with turn:
            check_runner(self)
            return method(self, *args, **kwargs)

    return changing


def check_runner(sim: Any) -> None:
    """SandError if another thread is advancing `sim`."""
    if sim.runner not in (None, threading.get_ident()):
        raise SandError("another thread is advancing this simulation: wait until it has, or use one simulation a thread")


@contextlib.contextmanager
def running(sim: Any) -> Iterator[None]:
    """While this thread advances `sim`; SandError if another one does."""
    me, before = threading.get_ident(), None
    try:
        with turn:  # at whose end an interrupt may come
            check_runner(sim)
            before, sim.runner = sim.runner, me
        yield
    finally:
        if sim.runner == me:
            sim.runner = before
