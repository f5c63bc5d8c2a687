"""The doors of a simulation: who comes in through one has Taichi to itself meanwhile, see taichi_support.turns."""

import contextlib
import functools
import threading
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

from taichi_sand.errors import SandError
from taichi_sand.taichi_support.turns import turn

M = TypeVar("M", bound=Callable[..., Any])


def reads(method: M) -> M:
    """A method that looks at the simulation: between two launches, if another thread is advancing it."""

    @functools.wraps(method)
    def looking(self: Any, /, *args: Any, **kwargs: Any) -> Any:
        with turn:
            return method(self, *args, **kwargs)

    return cast("M", looking)


def changes(method: M) -> M:
    """A method that changes it: SandError if another thread is advancing it. Who listens is told of it, but neither of what it calls itself
    nor of what the simulation does as it advances.
    """

    @functools.wraps(method)
    def changing(self: Any, /, *args: Any, **kwargs: Any) -> Any:
        with turn:
            check_runner(self)
            heard, self.heard = self.heard, None
            try:
                found = method(self, *args, **kwargs)
            finally:
                self.heard = heard
            if heard and (self.runner is None or self.calls.calling):
                heard(method.__name__, args, kwargs)
            return found

    changing.changes = True  # type: ignore[attr-defined]
    return cast("M", changing)


def check_runner(sim: Any) -> None:
    """SandError if another thread is advancing `sim`."""
    if sim.runner not in (None, threading.get_ident()):
        raise SandError("another thread is advancing this simulation: wait until it has, or use one simulation a thread")


guard = threading.Lock()
"""Of who looks whether another thread is advancing a simulation, to do so itself."""


@contextlib.contextmanager
def running(sim: Any) -> Iterator[None]:
    """While this thread advances `sim`; SandError if another one does."""
    me, before = threading.get_ident(), None
    try:
        with guard:  # at whose end an interrupt may come
            check_runner(sim)
            before, sim.runner = sim.runner, me
        yield
    finally:
        if sim.runner == me:
            sim.runner = before
            if before is None:
                sim.flush_recorders()
