"""Columns of numbers that grains carry along for effects: heat, water. They follow a grain through every sort.

The last slot, which is always empty, holds what a grain starts with.
"""

from collections import namedtuple
from collections.abc import Mapping
from typing import Any

import taichi as ti

from taichi_sand.taichi_support import field_pool


def allocate_carried(real: Any, capacity: int, starts: Mapping[str, float]) -> Any:
    """A named tuple of columns, shape (capacity,), filled with what a grain starts with."""
    columns = {name: field_pool.scalars(real, capacity) for name in starts}
    for name, column in columns.items():
        column.fill(starts[name])
    return namedtuple("Carried", columns)(**columns)


@ti.func
def start_anew(w: ti.template(), i):
    """A new grain in slot i."""
    for column in ti.static(w.carried):
        column[i] = column[w.capacity - 1]


@ti.func
def move_along(w: ti.template(), source, i):
    """What the grain of slot `source` carries goes to slot i."""
    for column in ti.static(w.carried):
        column[i] = column[source]


@ti.func
def sort_along(w: ti.template(), count):
    """Moves what the grains 0 .. count-1 carry to where the sort has put them."""
    for column in ti.static(w.carried):
        ti.loop_config(serialize=w.layout == "one")
        for i in range(count):
            w.grid.number[i][0] = column[w.grid.source[i]]
        ti.loop_config(serialize=w.layout == "one")
        for i in range(count):
            column[i] = w.grid.number[i][0]
