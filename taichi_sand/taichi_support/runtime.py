"""Taichi, of which a process has one: who started it, whether it fits, and whether it is still the same.

Where nobody has started it, we do. Where somebody has, a simulation lives in what there is if it fits, and leaves their fields alone:
Taichi is started afresh only if we started it, nobody uses a simulation, and nobody else has fields in it.
"""

import contextlib
import ctypes
import os
import sys
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import taichi as ti
from taichi.lang import impl, misc

from taichi_sand.errors import SandError
from taichi_sand.taichi_support import compiling, field_pool, home
from taichi_sand.taichi_support.host_access import CPUS
from taichi_sand.taichi_support.tracing import trace_quickly
from taichi_sand.taichi_support.turns import turn

GPUS = {"cuda": ti.cuda, "metal": ti.metal, "vulkan": ti.vulkan}
"""In the order in which `gpu` tries them. Not OpenGL, which `ti.gpu` tries too: where there is none, that ends the process."""
ARCHES = ("cpu", *GPUS, "gpu")
ROOM = 500_000_000
"""Numbers that fields may hold before Taichi is started afresh: it frees no field on its own."""
IDLE = 50_000_000
"""Numbers in fields that nobody uses any more, before it is started afresh when the last simulation is closed."""
MOST_KERNELS = 200
"""Kernels that may be compiled before it is, those of some fourteen structures of 15 to 20 MB each."""
ANY = ("arch", "cpu_max_num_threads", "default_fp", "cfg_optimization", "random_seed", "kernel_profiler", "timeline", "num_compile_threads")
ANY_OF = ("offline_cache", "print_", "verbose", "device_memory", "cuda_stack", "max_block_dim", "default_gpu_block_dim", "gpu_max_reg")
"""Settings of Taichi, and beginnings of their names, that may be as they are, or are looked at by themselves. All others are to be what
they are unless somebody sets them, as results depend on them (`fast_math`, `default_ip`), or what is allowed (`debug` refuses to read rows
beyond the end, as we do without using them)."""


class State:
    """What Taichi is to us."""

    program: Any = None  # the runtime that we live in
    ours: bool = False  # whether we started it
    stale: bool = False  # whether it is to be started afresh when it can be
    forked: bool = False  # whether this process is a fork of one in which it ran


state = State()
alive: weakref.WeakSet = weakref.WeakSet()


def start(user: Any, arch: str, threads: int | None, precision: int) -> Any:
    """Makes sure that Taichi runs on `arch` with `threads` CPU threads (None: with all, or as it runs) for numbers of `precision` bits, for
    the simulation `user`. Returns what `check` takes.

    Raises:
        SandError: the backend is not there, or Taichi runs with other settings, and cannot be started afresh.
    """
    if arch not in ARCHES:
        raise SandError(f"--arch {arch}: must be one of {', '.join(ARCHES)}", "arch")
    if state.forked:
        raise SandError(FORKED)
    running = impl.get_runtime()
    if running is not state.program or running.prog is None:
        leave()
    if running.prog is None:
        launch(arch, threads, precision)
    elif state.program is None:
        if wrong := misfit(arch, threads, precision):
            raise SandError(f"this program has started Taichi with {wrong}. Start it so, or not at all, or call ti.reset() first")
        home.enter()
        settle(ours=False)
    else:
        renew(arch, threads, precision)
    if not home.here():
        raise SandError("Taichi was started in another thread: make simulations in that one, or leave it to them to start it")
    alive.add(user)
    return state.program


def renew(arch: str, threads: int | None, precision: int) -> None:
    """Starts Taichi afresh if it must be, or is full of what nobody uses any more; SandError if it must be and cannot."""
    wrong = misfit(arch, threads if threads or alive or not state.ours else cores(), precision)
    if not wrong and (alive or not full()):
        return
    if alive:
        raise SandError(
            f"a simulation is still in use for which Taichi runs with {wrong}; it runs one such setting at a time: close that first"
        )
    if state.ours and not field_pool.others():
        launch(arch, threads, precision)
    elif wrong:
        whose = "somebody has fields in it, which would be lost" if state.ours else "this program has started it"
        raise SandError(f"Taichi runs with {wrong}, and {whose}. Start it so, or call ti.reset() first")


def misfit(arch: str, threads: int | None, precision: int) -> str:
    """In which setting the Taichi that runs is another than is needed; "" if in none."""
    config, usual = impl.current_cfg(), ti._lib.core.CompileConfig()
    wanted = {"cpu": CPUS, "gpu": tuple(GPUS.values())}.get(arch) or (GPUS[arch],)
    if config.arch not in wanted:
        return f"arch = {ti._lib.core.arch_name(config.arch)}, and --arch {arch} is needed"
    if config.default_fp != real(precision):
        return f"default_fp = ti.{config.default_fp}, and ti.{real(precision)} is needed for solver.precision = {precision}"
    if threads and arch == "cpu" and config.cpu_max_num_threads != threads:
        return f"cpu_max_num_threads = {config.cpu_max_num_threads}, and --threads {threads} is needed"
    if state.ours:
        return ""  # the rest is as we, and the environment, have it
    for name in ["debug", *dir(config)]:  # others follow from the first
        if name.startswith("_") or name in ANY or name.startswith(ANY_OF):
            continue
        found, needed = getattr(config, name), getattr(usual, name)
        if found != needed:
            return f"{name} = {found}, and {needed} is needed"
    if not impl.get_runtime().short_circuit_operators:
        return "short_circuit_operators = False, and True is needed"
    return ""


def real(precision: int) -> Any:
    """Type of the numbers."""
    return ti.f64 if precision == 64 else ti.f32


def cores() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads() -> int:
    """CPU threads that Taichi runs on."""
    return int(impl.current_cfg().cpu_max_num_threads)


FORKED = (
    "this process was forked from one in which Taichi runs, whose threads do not come along; start processes by `spawn`, as "
    'multiprocessing.get_context("spawn") does'
)


def check(program: Any) -> None:
    """SandError unless what `start` returned is still what runs."""
    if state.forked:
        raise SandError(FORKED)
    if impl.get_runtime() is not program or program.prog is None:
        raise SandError("Taichi has been started afresh, or reset, since this simulation was made, and its memory is gone: make a new one")


def compiled() -> int:
    """Kernels compiled since Taichi was started."""
    return impl.get_runtime().get_num_compiled_functions()


def full() -> bool:
    """Whether fields and kernels have taken as much memory as they may before Taichi is started afresh."""
    return state.stale or field_pool.pool.numbers > ROOM or compiled() > MOST_KERNELS


def on_gpu() -> bool:
    """Whether Taichi runs on a GPU."""
    return impl.current_cfg().arch not in CPUS


def forget() -> None:
    """Lets the next simulation start Taichi afresh, which frees the fields of those that are gone, if that can be."""
    state.stale = True


def abandon() -> None:
    """Forgets Taichi as `forget` does, and simulations that somebody still holds are none any more."""
    alive.clear()
    forget()


def leave() -> None:
    """The Taichi that we lived in is gone."""
    alive.clear()
    field_pool.start_afresh()
    state.program, state.ours, state.stale = None, False, False


def settle(ours: bool) -> None:
    """From now on we live in the Taichi that runs."""
    leave()
    trace_quickly()
    compiling.watch()
    state.program, state.ours = impl.get_runtime(), ours


def done(user: Any) -> None:
    """`user` is closed. The memory of what nobody uses any more goes back to the system if it is much and nobody else has fields."""
    alive.discard(user)
    if not alive and state.ours and field_pool.pool.idle() > IDLE and not field_pool.others():
        ti.reset()
        leave()
        give_memory_back()


def give_memory_back() -> None:
    """What has been freed goes back to the system, where the C library can be told to (it keeps half of what compiled kernels took)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def launch(arch: str, threads: int | None, precision: int) -> None:
    """ti.init, with an error in words if the backend is not there."""
    kinds = {"cpu": [ti.cpu], "gpu": list(GPUS.values())}.get(arch) or [GPUS[arch]]
    # Taichi's own optimiser of control flow doubles the time to compile (rigid: 3.2 -> 8.6 s), and LLVM's finds all that it does: the
    # kernels run as fast, to the same bits. (In a Taichi of somebody else it is off while ours are compiled: see compiling.as_ours.)
    options = {"cfg_optimization": False, "log_level": ti.ERROR, "random_seed": 0, **cache_place()}
    options |= {"arch": kinds, "cpu_max_num_threads": threads or cores(), "default_fp": real(precision)}
    with silence():
        home.start(lambda: ti.init(**options), kept=arch == "cpu")
    settle(ours=True)
    give_memory_back()
    if not on_gpu() and arch != "cpu":
        ti.reset()
        leave()
        raise SandError(f"--arch {arch}: this machine has no such backend for Taichi; take --arch cpu", "arch")


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Taichi announces itself on stdout, whatever the log level. It prints nothing here; other threads go on to print."""
    misc.print = lambda *_, **__: None  # type: ignore[attr-defined]
    try:
        yield
    finally:
        del misc.print  # type: ignore[attr-defined]


def cache_place() -> dict[str, str]:
    """Where Taichi is to keep its compiled kernels, unless it can do so in its own place: it ends the process where it cannot write."""
    own = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH") or ti._lib.core.CompileConfig().offline_cache_file_path
    if writable(Path(own)):
        return {}
    user = os.getuid() if hasattr(os, "getuid") else 0
    place = Path(tempfile.gettempdir()) / f"taichi-sand-{user}"
    if not writable(place) or (place.stat().st_uid, place.stat().st_mode & 0o077) != (user, 0):  # others must not put kernels there
        place = Path(tempfile.mkdtemp(prefix="taichi-sand-"))
    if own not in told:
        told.append(own)
        print(f"taichi-sand: {own} cannot be written to; compiled kernels are kept in {place}", file=sys.stderr)
    return {"offline_cache_file_path": str(place)}


told: list[str] = []
"""Places of which it has been said that they cannot be written to."""


def writable(place: Path) -> bool:
    """Whether a folder is there, or can be made, and files in it."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=place):
            return True
    except OSError:
        return False


def after_fork() -> None:
    """In a child process: Taichi is of no use if it ran, and its end would wait for threads that are not there."""
    turn.after_fork()
    home.after_fork()
    program = impl.get_runtime().prog
    if program is not None:
        state.forked = True
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(program))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=after_fork)
