"""Tables as files: contacts and series of numbers, as CSV or Parquet, told by the ending of the name."""

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.measure.contacts import contacts
from taichi_sand.measure.numbers import numbers
from taichi_sand.world.search.images import nearest

if TYPE_CHECKING:
    from taichi_sand.run.simulation import Simulation

ENDINGS = (".csv", ".parquet")
Columns = dict[str, np.ndarray]


def check(path: Path, option: str) -> None:
    """SandError unless a table can be written there, and its library is installed."""
    if path.suffix not in ENDINGS:
        raise SandError(f"{option} {path}: a table ends in {' or '.join(ENDINGS)}")
    if path.suffix == ".parquet":
        parquet(option)
    writing.check(path, option)


def parquet(option: str = "Parquet") -> Any:
    """The library that writes Parquet; SandError if it is not installed."""
    try:
        import pyarrow.parquet
    except ModuleNotFoundError:
        raise SandError(f"{option} needs pyarrow to write .parquet: pip install 'taichi-sand[data]'; .csv needs nothing") from None
    return pyarrow


def write(path: Path, columns: Columns) -> None:
    """Writes columns of the same length; SandError if the file cannot be written."""
    with writing.replacing(path) as made:
        if path.suffix == ".parquet":
            library = parquet()
            library.parquet.write_table(library.table(columns), made)
        else:
            made.write_text(
                as_csv(list(columns)) + "".join(map(as_csv, zip(*(column.tolist() for column in columns.values()), strict=True)))
            )


def as_csv(cells: Any) -> str:
    """A line of CSV; numbers with all digits that tell them apart."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()


def of_contacts(sim: "Simulation") -> Columns:
    """The contacts of this moment, a row each, by the names of the field, SI: see `Simulation.contacts` for what they mean.

    `pos1` and `pos2` are the centres of the two grains, of a wall the point that is touched; over a periodic edge on the side where the
    contact is. `force_normal` pushes if it is above 0; both forces are those on the second along the normal, and along the normal turned by
    90 degrees. `history` is the stretch of the tangential spring [m], `bridge` whether there is a liquid bridge.
    """
    found, ids, place = contacts(sim), sim.ids, sim.positions
    point, wall = found["point"], found["id2"] < 0
    one = _beside(place[np.searchsorted(ids, found["id1"])], point, sim)
    other = point.copy()
    other[~wall] = _beside(place[np.searchsorted(ids, found["id2"][~wall])], point[~wall], sim)
    columns = {"time": np.full(len(found), sim.time), "id1": found["id1"], "id2": found["id2"]}
    for name, values in (("pos1", one), ("pos2", other), ("contact_point", point), ("normal", found["normal"])):
        columns |= {f"{name}_x": values[:, 0], f"{name}_y": values[:, 1]}
    columns |= {"force_normal": found["force_n"], "force_tangential": found["force_t"]}
    columns |= {name: found[name] for name in ("overlap", "history", "bridge")}
    return {name: np.ascontiguousarray(column) for name, column in columns.items()}


def _beside(place: np.ndarray, point: np.ndarray, sim: "Simulation") -> np.ndarray:
    """The images of places (n, 2) in a periodic box that are nearest to points (n, 2) [m]."""
    way = place - point
    return place - (way - nearest(way, sim.world, sim.scene.size))


class Series:
    """The numbers of reports, a row a moment: a CSV file grows row by row, a Parquet file is written at the end."""

    last_only = False

    def __init__(self, path: Path) -> None:
        self.path, self.rows, self.lines, self.names = path, [], None, []
        self.done = -1  # step of the last row

    def note(self, sim: "Simulation") -> None:
        """A row of this moment, unless there is one. SandError if it cannot be written."""
        if sim.steps == self.done:
            return
        self.done, row = sim.steps, numbers(sim.report())
        if self.path.suffix == ".parquet":
            self.rows.append(row)
            return
        if self.lines is None:
            self.names = list(row)
            self.lines = writing.Lines(self.path, as_csv(self.names).rstrip("\n"))
        self.lines.write(as_csv([row.get(name, "") for name in self.names]).rstrip("\n"))

    def close(self) -> None:
        """The end; SandError if it cannot be written."""
        if self.lines is not None:
            self.lines.close()
        elif self.rows:
            names = dict.fromkeys(name for row in self.rows for name in row)
            write(self.path, {name: np.array([row.get(name, np.nan) for row in self.rows]) for name in names})
