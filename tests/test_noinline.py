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

from taichi_sand.taichi_support import field_pool, runtime
from taichi_sand.taichi_support.noinline import noinline


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
