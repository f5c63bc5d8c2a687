"""The thread in which Taichi lays out fields: the one in which it was started. In any other that ends in an assertion.

So we start it in a thread of our own, to which the fields of all threads go, somebody else's too; kernels are compiled, and run, in any.
Where that cannot be (Taichi is to be left as it is, runs on a GPU, or was started by somebody else), simulations are made in the thread in
which it was started.
"""

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import taichi as ti
from taichi._snode.fields_builder import FieldsBuilder
from taichi.lang import impl

from taichi_sand.taichi_support.host_access import PLAIN
from taichi_sand.taichi_support.turns import turn


class Home:
    """Where Taichi was started."""

    keeper: ThreadPoolExecutor | None = None  # our thread
    runtime: Any = None  # that was started there
    thread: int | None = None  # in which the Taichi that runs was started, if not there; None: not known


home = Home()
original = FieldsBuilder._finalize


def finalize(self: FieldsBuilder, *given: Any, **named: Any) -> Any:
    """In place of `FieldsBuilder._finalize`."""
    if home.keeper is None or impl.get_runtime() is not home.runtime:
        return original(self, *given, **named)
    with turn:
        return home.keeper.submit(original, self, *given, **named).result()


def start(launch: Callable[[], None], kept: bool) -> None:
    """Starts Taichi by `launch`, in our thread if `kept`."""
    if not kept or PLAIN:
        launch()
        home.runtime, home.thread = None, threading.get_ident()
        return
    home.keeper = home.keeper or ThreadPoolExecutor(1, "taichi")
    home.keeper.submit(launch).result()
    home.runtime = impl.get_runtime()
    FieldsBuilder._finalize = finalize


def enter() -> None:
    """Somebody else has started Taichi."""
    home.runtime = home.thread = None


def here() -> bool:
    """Whether fields can be laid out from this thread."""
    if home.runtime is not None:
        return True
    if home.thread is None:
        with contextlib.suppress(RuntimeError):
            probe()
            home.thread = threading.get_ident()
    return home.thread == threading.get_ident()


def probe() -> None:
    """Lays out a number; RuntimeError if that cannot be."""
    builder = ti.FieldsBuilder()
    builder.place(ti.field(ti.i32))
    builder.finalize()


def after_fork() -> None:
    """In a child process our thread is no more."""
    home.keeper = home.runtime = None
