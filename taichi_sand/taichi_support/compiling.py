"""How long Taichi has compiled: kernels are compiled when they are first called, in the middle of whatever calls them.

The whole first call counts, as the last part of compiling (to the code of the processor, 20 to 200 ms) cannot be told from the run that
follows it. The steps themselves are first called when a simulation is made, for no step at all; all other kernels run for milliseconds.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from taichi.lang import impl
from taichi.lang.kernel_impl import Kernel

from taichi_sand.taichi_support import launching
from taichi_sand.taichi_support.host_access import PLAIN

spent = {"seconds": 0.0}
"""What first calls have taken in this process, of kernels from the cache on disk too [s]."""
call, materialize = Kernel.__call__, Kernel.materialize
listeners: list[Callable[[str], None]] = []
"""Are told the name of every kernel that is about to be compiled, the last only; what it raises comes out of the call of the kernel, which
is then not compiled."""


def seconds() -> float:
    """Time that first calls of kernels have taken so far, in all simulations of this process [s]."""
    return spent["seconds"]


def timed(self: Kernel, *args: Any, **kwargs: Any) -> Any:
    """In place of `Kernel.__call__`."""
    if not kwargs and launching.start(self, args):
        return None
    known, start = len(self.compiled_kernels), time.perf_counter()
    try:
        with as_ours(self):
            found = call(self, *args, **kwargs)
    finally:
        if len(self.compiled_kernels) > known:
            spent["seconds"] += time.perf_counter() - start
    if not kwargs:
        launching.remember(self, args)
    return found


@contextmanager
def as_ours(kernel: Kernel) -> Iterator[None]:
    """While Taichi's optimiser of control flow is off if `kernel` is one of this package, in a Taichi that somebody else has started too:
    it keeps numbers over the calls of functions that are compiled by themselves (taichi_support.noinline) and that change them, so that a
    loop that waits for such a change never ends. LLVM finds all else that it does.
    """
    config = impl.current_cfg()
    theirs = config.cfg_optimization and kernel.func.__module__.startswith(f"{__package__.split('.')[0]}.")
    if theirs:
        config.cfg_optimization = False
    try:
        yield
    finally:
        if theirs:
            config.cfg_optimization = True


def told(self: Kernel, key: Any = None, args: Any = None, arg_features: Any = None) -> None:
    """In place of `Kernel.materialize`."""
    if listeners and key is not None and key not in self.compiled_kernels:
        listeners[-1](self.func.__name__)
    materialize(self, key, args, arg_features)


@contextmanager
def heard_by(listener: Callable[[str], None]) -> Iterator[None]:
    """While `listener` is told of every kernel that is about to be compiled."""
    listeners.append(listener)
    try:
        yield
    finally:
        listeners.remove(listener)


def watch() -> None:
    """Times what is compiled from now on in this process, and starts quickly what is; unless PLAIN: then only what a simulation compiles
    as it is made is known.
    """
    if not PLAIN:
        Kernel.__call__, Kernel.materialize = timed, told
