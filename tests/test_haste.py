"""Reading kernels faster than Taichi does: its error messages still say where, and functions are theirs."""

import inspect

import pytest
import taichi as ti
from helpers import fresh_taichi

from taichi_sand.taichi_support import runtime, tracing


@ti.func
def doubled(x):
    return 2 * x


@ti.func
def wrong(x):
    return x + nowhere  # noqa: F821


@ti.kernel
def right() -> ti.i32:
    return doubled(doubled(3))


@ti.kernel
def fails() -> ti.i32:
    return wrong(
        3,
    )


def test_errors_name_line_and_source() -> None:
    """Of the place that is wrong, and of the one that called it."""
    fresh_taichi()
    user = pytest.MonkeyPatch()
    runtime.start(user, "cpu", 1, 32)
    assert right() == 12
    assert tracing.lines_of(doubled) == inspect.getsourcelines(inspect.unwrap(doubled))
    with pytest.raises(ti.TaichiCompilationError) as failure:
        fails()
    lines, first = inspect.getsourcelines(inspect.unwrap(wrong))
    for text in (
        f'test_haste.py", line {first + 2}, in wrong:\n{lines[2].rstrip()}\n',
        "in fails:\n    return wrong(\n",
        'Name "nowhere" is not defined',
    ):
        assert text in str(failure.value), str(failure.value)
