"""Functions compiled by themselves: they give what functions that are copied into the kernel give, in every Taichi of a process."""

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import taichi as ti
from helpers import fresh_taichi
from taichi.lang import impl

from taichi_sand.taichi_support import compiling, field_pool, runtime
from taichi_sand.taichi_support.noinline import noinline


@noinline
def build(pace: ti.template()):
    pace[None].spent = 0
    pace[None].astray = 0


@noinline
def make_ready(pace: ti.template()):
    if pace[None].astray == 1 and pace[None].spent == 0:
        build(pace)
    if pace[None].spent == 1:
        build(pace)


@ti.func
def listing(pace: ti.template()):
    due = pace[None].spent == 1
    due = due or pace[None].astray == 1
    return due


@ti.kernel
def march(pace: ti.template(), steps: ti.i32) -> ti.i32:
    """Rounds of a loop like that of run.stepping: it goes on while `spent`, which functions that are compiled by themselves take back."""
    rounds = 0
    ti.loop_config(serialize=True)
    for _run in range(1):
        end = pace[None].done + steps
        while rounds < 1000 and (listing(pace) or pace[None].done < end):
            make_ready(pace)
            if pace[None].done < end:
                if pace[None].spent == 0:
                    pace[None].done += 1
                    if pace[None].done % 3 == 0:
                        pace[None].spent = 1
            rounds += 1
    return rounds


class User:
    """Somebody who starts Taichi."""


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """Fields of a test, which kernels hold, would keep Taichi from being started afresh."""
    yield
    ti.reset()


@ti.func
def rise(column: ti.template(), k, by):
    """Control flow of a copied function goes into whoever calls it, too."""
    for _ in range(by):
        if column[k] >= 0.0:
            column[k] += 1.0


@noinline
def lift(column: ti.template(), twice: ti.template(), k: ti.i32, by: ti.i32, share: ti.f64) -> ti.i32:
    rise(column, k, by)
    if ti.static(twice):
        rise(column, k, by)
    column[k] += ti.cast(share, ti.f32)
    return k + by


@ti.kernel
def lift_all(column: ti.template(), found: ti.template()):
    for k in range(column.shape[0]):
        found[k] = lift(column, False, k, k, 0.25) + lift(column, True, k, 1, 0.0)


class Fault:
    """A part of a function that cannot be compiled at first."""

    def __init__(self) -> None:
        self.tries = 0

    def mended(self) -> bool:
        self.tries += 1
        if self.tries == 1:
            raise ValueError("not yet")
        return True


@noinline
def rise_when_mended(column: ti.template(), fault: ti.template(), k: ti.i32):
    column[k] += 1.0
    if ti.static(fault.mended()):
        column[k] += 2.0


@ti.kernel
def rise_all(column: ti.template(), fault: ti.template()):
    for k in range(column.shape[0]):
        rise_when_mended(column, fault, k)


def test_half_a_function_is_never_called() -> None:
    """One that could not be compiled is compiled as a whole when it is tried again, as a user's effect may be."""
    fresh_taichi()
    user, fault = User(), Fault()
    runtime.start(user, "cpu", 1, 32)
    column = field_pool.scalars(ti.f32, 4)
    with pytest.raises(ti.TaichiCompilationError, match="not yet"):
        rise_all(column, fault)
    rise_all(column, fault)
    assert column.to_numpy().tolist() == [3.0] * 4


@pytest.mark.parametrize("threads", [1, 2])
def test_called_in_every_taichi_of_a_process(threads: int) -> None:
    """With templates, numbers and a value that is returned; again after Taichi has been started anew, with other fields."""
    for size in (5, 8, 5):
        fresh_taichi()
        user = User()
        runtime.start(user, "cpu", threads, 32)
        column, found = field_pool.scalars(ti.f32, size), field_pool.scalars(ti.i32, size)
        column[size - 1] = -math.inf
        lift_all(column, found)
        risen = [k + 2 + 0.25 for k in range(size - 1)]
        assert column.to_numpy().tolist() == [*risen, -math.inf]
        assert found.to_numpy().tolist() == [3 * k + 1 for k in range(size)]
        runtime.forget()


FILED = """
import sys
import numpy as np
import taichi as ti
from taichi_sand.taichi_support import field_pool, runtime
from taichi_sand.taichi_support.noinline import noinline

class User: pass

def rise(by):
    @noinline
    def one(column: ti.template(), k: ti.i32):
        column[k] += float(by)
    one.func.func.__qualname__ = f"rise_by_{by}"
    return one

rises = [rise(by) for by in range(12)]

@ti.kernel
def rise_all(column: ti.template()):
    for k in range(column.shape[0]):
        for rise in ti.static(rises):
            rise(column, k)

user = User()
runtime.start(user, "cpu", 1, 32)
litter = [bytearray(n) for n in np.random.default_rng(int(sys.argv[1])).integers(1, 1000, 5000)]
del litter[::2]
column = field_pool.scalars(ti.f32, 2)
rise_all(column)
assert column.to_numpy().tolist() == [66.0, 66.0]
"""


def test_compiled_kernels_are_found_again(tmp_path: Path) -> None:
    """By other processes, where functions lie elsewhere in memory."""
    filed = []
    for seed in range(3):
        (tmp_path / "filed.py").write_text(FILED)
        environment = os.environ | {"TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path / "cache"), "PYTHONPATH": str(Path(__file__).parents[1])}
        subprocess.run([sys.executable, tmp_path / "filed.py", str(seed)], check=True, env=environment, stdout=subprocess.DEVNULL)
        filed.append(sorted(path.name for path in (tmp_path / "cache").rglob("*.tic")))
    assert filed[0]
    assert filed[0] == filed[1] == filed[2]


def test_loops_see_what_functions_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a Taichi that somebody else has started its optimiser of control flow is on, and keeps `spent` over the calls: such a loop of ours
    would go round for ever.
    """
    ti.init(arch=ti.cpu, log_level=ti.ERROR, offline_cache=False)
    assert impl.current_cfg().cfg_optimization
    compiling.watch()
    monkeypatch.setattr(march._primal.func, "__module__", "taichi_sand.tried")  # as a kernel of the package
    pace = ti.Struct.field(dict.fromkeys(("spent", "done", "astray"), ti.i32), shape=())
    for steps, rounds in ((0, 1), (5, 5)):
        pace[None].spent, pace[None].done = 1, 0
        assert march(pace, steps) == rounds
        assert (pace[None].spent, pace[None].done) == (0, steps)
    assert impl.current_cfg().cfg_optimization  # theirs again
