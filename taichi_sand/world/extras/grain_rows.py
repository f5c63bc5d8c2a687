"""Rows of grains: what a row is made of, and all that lays one down or moves it to another slot.

Besides the columns of every simulation there are those that effects ask for, which grains carry along: heat, water. Of these the last
slot, which is always empty, holds what a grain starts with.
"""

from collections import namedtuple
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
import taichi as ti

from taichi_sand.taichi_support import field_pool


class Column(NamedTuple):
    """How a column of the grain table is kept."""

    width: int = 1  # numbers in it: 1 = a scalar, else a vector
    whole: bool = False  # i32
    lasts: bool = True  # goes with its grain from slot to slot
    rests: bool = True  # and is the same for a grain that sleeps; of the others a sleeper has zeros
    clumps: bool = False  # only there with clumps


class Grains(NamedTuple):
    """One row a grain, shape (capacity,). A column that is added here follows its grain: all that moves rows is below."""

    site: Annotated[Any, Column(2, whole=True)]  # lattice site at the last list build
    offset: Annotated[Any, Column(2)]  # place within the site at the last list build, from its centre [m]
    shift: Annotated[Any, Column(2, lasts=False)]  # moved since the last list build [m]
    start_velocity: Annotated[Any, Column(2, rests=False)]  # velocity at the last list build, with which it foresaw a straight flight [m/s]
    twist: Annotated[Any, Column(4, rests=False)]  # motion: velocity x, y [m/s], spin [rad/s], 0: one instruction moves it
    mobility: Annotated[Any, Column(4, rests=False)]  # 1/mass, 1/mass [1/kg], 1/moment of inertia [1/(kg m2)], 0; zeros = fixed
    wrench: Annotated[Any, Column(4, rests=False)]  # contact force x, y and torque of this step [N, N, N m] (md), or the contact impulses
    #                                                 to start the next step with [N s, N s, N m s] (rigid), 0
    radius: Annotated[Any, Column()]  # of the disc, or of the circle about its centre of mass that holds a grain of several discs [m]
    angle: Annotated[Any, Column()]  # at the last list build [rad], in -pi..pi
    turn: Annotated[Any, Column(lasts=False)]  # turned since the last list build [rad]
    id: Annotated[Any, Column(whole=True)]  # index of the grain in the order in which they were made; < 0 = the next list build drops it
    kind: Annotated[Any, Column(whole=True)]  # which [[grains]] table made it, or after them which of the [[sources]]
    heading: Annotated[Any, Column(2, lasts=False, clumps=True)]  # cosine and sine of angle + turn
    start_spin: Annotated[Any, Column(lasts=False, clumps=True)]  # spin at the last list build [rad/s]


COLUMNS: dict[str, Column] = {name: hint.__metadata__[0] for name, hint in get_type_hints(Grains, include_extras=True).items()}
"""The columns of `Grains`."""


class Part(NamedTuple):
    """A number of a row."""

    column: int  # of `Grains`
    component: int  # of a vector, -1 = the column is a scalar
    place: int  # in a row of the scratch


def parts_of(whole: bool, rests: bool) -> tuple[Part, ...]:
    """The whole numbers of a row, or the others, that go with a grain; with `rests` only those that a sleeper has."""
    parts: list[Part] = []
    for index, column in enumerate(COLUMNS.values()):
        if column.lasts and column.whole == whole and (column.rests or not rests):
            for component in range(column.width) if column.width > 1 else (-1,):
                parts.append(Part(index, component, len(parts)))
    return tuple(parts)


WHOLE, NUMBERS = parts_of(True, False), parts_of(False, False)
"""What goes with a grain."""
CELL = len(WHOLE)
"""Where the scratch of whole numbers keeps the cell of a grain that is being sorted."""
WHOLE_AT_REST, NUMBERS_AT_REST = parts_of(True, True), parts_of(False, True)
"""And with one that sleeps, or did until now."""
CLEARED = tuple(k for k, column in enumerate(COLUMNS.values()) if not column.clumps and not (column.lasts and column.rests))
"""Columns that are zero for a grain at rest right after a list build."""


def allocate_grains(real: Any, rows: int, clumps: bool) -> Grains:
    """Empty grain table of `rows` rows."""
    made = []
    for column in COLUMNS.values():
        kind = ti.i32 if column.whole else real
        if column.clumps and not clumps:
            made.append(None)
        else:
            made.append(field_pool.vectors(column.width, kind, rows) if column.width > 1 else field_pool.scalars(kind, rows))
    return Grains(*made)


def allocate_carried(real: Any, capacity: int, starts: Mapping[str, float]) -> Any:
    """A named tuple of columns, shape (capacity,), filled with what a grain starts with."""
    columns = {name: field_pool.scalars(real, capacity) for name in starts}
    for name, column in columns.items():
        column.fill(starts[name])
    return namedtuple("Carried", columns)(**columns)


def new_rows(grains: Mapping[str, np.ndarray], first_id: int, spacing: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of the table, by name, for new grains with the ids first_id, first_id + 1, …; what is not among them is zero.

    Args:
        grains: position, velocity (n, 2), angle, spin, radius, mass, inertia, kind, and of those that are held in place fixed (n,); SI.
        first_id: an id that was never given before, and all above it.
        spacing: of the lattice sites (2,) [m].
    """
    count = len(grains["radius"])
    site, zero = np.floor(grains["position"] / spacing), np.zeros(count)
    moves = np.ones((count, 1)) if "fixed" not in grains else ~grains["fixed"][:, None]
    return {
        "site": site,
        "offset": grains["position"] - (site + 0.5) * spacing,
        "start_velocity": grains["velocity"],
        "twist": np.column_stack([grains["velocity"], grains["spin"], zero]) * moves,
        "mobility": np.column_stack([1 / grains["mass"], 1 / grains["mass"], 1 / grains["inertia"], zero]) * moves,
        "radius": grains["radius"],
        "angle": grains["angle"],
        "id": first_id + np.arange(count),
        "kind": grains["kind"],
    }


def beside(rows: Mapping[str, np.ndarray], whole: bool) -> np.ndarray:
    """The columns of whole numbers, or the others, side by side as a row has them, shape (n, number of parts); zeros if not in `rows`."""
    count = len(rows["id"])
    kept = {name: column for name, column in COLUMNS.items() if column.lasts and column.whole == whole}
    return np.column_stack([rows.get(name, np.zeros((count, column.width))) for name, column in kept.items()])


@ti.func
def store_row(w: ti.template(), whole: ti.template(), numbers: ti.template(), i, row):
    """Lays these parts of slot i aside, in a row of the scratch."""
    for part in ti.static(whole):
        column = ti.static(w.grains[part.column])
        if ti.static(part.component < 0):
            w.grid.scratch.whole[row][part.place] = column[i]
        else:
            w.grid.scratch.whole[row][part.place] = column[i][part.component]
    for part in ti.static(numbers):
        column = ti.static(w.grains[part.column])
        if ti.static(part.component < 0):
            w.grid.scratch.number[row][part.place] = column[i]
        else:
            w.grid.scratch.number[row][part.place] = column[i][part.component]


@ti.func
def load_row(w: ti.template(), whole: ti.template(), numbers: ti.template(), row, i):
    """Takes what `store_row` has laid aside into slot i."""
    for part in ti.static(whole):
        write_part(w, part, i, w.grid.scratch.whole[row][part.place])
    for part in ti.static(numbers):
        write_part(w, part, i, w.grid.scratch.number[row][part.place])


@ti.func
def put_row(w: ti.template(), whole: ti.template(), numbers: ti.template(), k, i):
    """Takes row k of two arrays, as `beside` makes them, into slot i, which was empty."""
    clear_motion(w, i)
    for part in ti.static(WHOLE):
        write_part(w, part, i, whole[k, part.place])
    for part in ti.static(NUMBERS):
        write_part(w, part, i, numbers[k, part.place])
    for column in ti.static(w.carried):
        column[i] = column[w.capacity - 1]


@ti.func
def write_part(w: ti.template(), part: ti.template(), i, value):
    """Gives the row in slot i this number."""
    column = ti.static(w.grains[part.column])
    if ti.static(part.component < 0):
        column[i] = value
    else:
        column[i][part.component] = value


@ti.func
def clear_motion(w: ti.template(), i):
    """The grain in slot i rests, and is held there."""
    for index in ti.static(CLEARED):
        column = ti.static(w.grains[index])
        column[i] = ti.zero(column[i])


@ti.func
def copy_at_rest(w: ti.template(), j, i):
    """The grain at rest in slot j goes to slot i, with what it carries."""
    for part in ti.static(WHOLE_AT_REST + NUMBERS_AT_REST):
        column = ti.static(w.grains[part.column])
        if ti.static(part.component < 0):
            column[i] = column[j]
        else:
            column[i][part.component] = column[j][part.component]
    clear_motion(w, i)
    for column in ti.static(w.carried):
        column[i] = column[j]


@ti.func
def sort_carried(w: ti.template(), count):
    """Moves what the grains 0 .. count-1 carry to where the sort has put them."""
    for column in ti.static(w.carried):
        ti.loop_config(serialize=w.layout == "one")
        for i in range(count):
            w.grid.scratch.number[i][0] = column[w.grid.source[i]]
        ti.loop_config(serialize=w.layout == "one")
        for i in range(count):
            column[i] = w.grid.scratch.number[i][0]


@ti.func
def move_carried(w: ti.template(), first, end, slot: ti.template()):
    """Moves what the grains first .. end-1 carry to their new slots, on one thread."""
    for column in ti.static(w.carried):
        for j in range(first, end):
            w.grid.scratch.number[j][0] = column[j]
        for j in range(first, end):
            column[slot[j]] = w.grid.scratch.number[j][0]
