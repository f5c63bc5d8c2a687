"""Starts Taichi, once for all simulations that share backend, threads and precision."""

import contextlib
import ctypes
import gc
import os
import weakref
from typing import Any

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

import taichi as ti

from taichi_sand.scene.errors import SandError
from taichi_sand.world import compiling, fields
from taichi_sand.world.direct import CPUS, reach_in
from taichi_sand.world.haste import hasten

ARCHES = ("cpu", "cuda", "vulkan", "metal", "gpu")
ROOM = 500_000_000
"""Numbers that fields may hold before Taichi is started afresh: it frees no field on its own."""
MOST_KERNELS = 200
"""Kernels that may be compiled before it is, those of some fourteen structures of 15 to 20 MB each."""

alive: weakref.WeakSet = weakref.WeakSet()
state: dict[str, Any] = {"key": None}


def start(user: Any, arch: str, threads: int | None, precision: int) -> None:
    """Makes sure that Taichi runs on `arch` with `threads` CPU threads for numbers of `precision` bits, for the simulation `user`.

    Raises:
        SandError: the backend is not there, or another simulation with other settings is still in use.
    """
    if arch not in ARCHES:
        raise SandError(f"--arch {arch}: must be one of {', '.join(ARCHES)}", "arch")
    threads = threads or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else threads or os.cpu_count()
    key = (arch, threads, precision)
    gc.collect()
    if state["key"] != key or (not alive and (fields.shelf.numbers > ROOM or compiled() > MOST_KERNELS)):
        if alive:
            raise SandError(
                f"a simulation on {state['key'][0]} with {state['key'][1]} threads and {state['key'][2]} bits is still in use; "
                "Taichi runs one such setting at a time: delete that simulation first"
            )
        launch(arch, threads, precision)
        state["key"] = key
    alive.add(user)


def compiled() -> int:
    """Kernels compiled since Taichi was started."""
    return ti.lang.impl.get_runtime().get_num_compiled_functions()


def on_gpu() -> bool:
    """Whether Taichi runs on a GPU."""
    return ti.lang.impl.current_cfg().arch not in CPUS


def forget() -> None:
    """Lets the next simulation start Taichi afresh, which frees the fields of those that are gone."""
    state["key"] = None


def give_memory_back() -> None:
    """What has been freed goes back to the system, where the C library can be told to (it keeps half of what compiled kernels took)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def launch(arch: str, threads: int, precision: int) -> None:
    """ti.init, with an error in words if the backend is not there."""
    hasten()
    reach_in()
    compiling.watch()
    kind = getattr(ti, arch)
    real = ti.f64 if precision == 64 else ti.f32
    with contextlib.redirect_stdout(None):  # it announces itself there, whatever the log level
        # Taichi's own optimiser of control flow doubles the time to compile (rigid: 3.2 -> 8.6 s), and LLVM's finds all that it does: the
        # kernels run as fast, to the same bits.
        options = {"cfg_optimization": False, "log_level": ti.ERROR, "random_seed": 0}
        ti.init(arch=kind, cpu_max_num_threads=threads, default_fp=real, **options)
    fields.start_afresh()
    give_memory_back()
    if not on_gpu() and arch != "cpu":
        raise SandError(f"--arch {arch}: this machine has no such backend for Taichi; take --arch cpu", "arch")
