"""Grains listed one by one in a file beside the scene: CSV, yade's text, LAMMPS data, or a frame of a GSD trajectory.

What is read is told by what stands in the file, not by its name. Whatever it is becomes columns of COLUMNS, SI units.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from taichi_sand.errors import SandError, show
from taichi_sand.files.reading import read_text, starts_with
from taichi_sand.scene import lammps, snapshot
from taichi_sand.scene.delimited import COLUMNS, read_table

LENGTHS = (2, 3, 5, 6, 7, 8)
"""How many of the columns a row of `positions` may have: velocities come in pairs."""
FLAT = 1.0
"""Grains whose z differ by more than so many of their largest radius are not in one layer."""
Columns = dict[str, np.ndarray]


class Rows(NamedTuple):
    """Rows of `positions`, and whether their radii are those of the key `radius`."""

    rows: list[list[float]]
    radius_taken: bool


def read_rows(path: Path, frame: int | None = None, radius: Any = None) -> Rows:
    """The grains of a file, as rows of `positions`.

    Args:
        path: the file; anybody may have made it.
        frame: of a trajectory; the last if None.
        radius: of the grains, where the file has none.

    Raises:
        SandError: the file is missing, something else, or holds no grains; or a line of it is wrong.
    """
    trajectory = starts_with(path, snapshot.MAGIC)
    if frame is not None and not trajectory:
        raise SandError(f"{path}: has no frames: `frame` belongs to a trajectory (GSD)")
    if trajectory:
        columns = snapshot.read(path, frame)
    else:
        text = read_text(path)
        columns = lammps.read(path, text) if lammps.is_data(text) else read_table(path, text)
    if not len(columns.get("x", ())):
        raise SandError(f"{path}: holds no grains (its columns are {', '.join(COLUMNS)}, of which x and y must be there)")
    _check_flat(path, columns, radius)
    return _rows(path, columns, radius)


def _check_flat(path: Path, columns: Columns, radius: Any) -> None:
    """SandError unless the grains lie in one layer: what else has z."""
    z = columns.pop("z", None)
    size = columns.get("radius", radius if isinstance(radius, int | float) else None)
    if z is not None and size is not None and np.ptp(z) > FLAT * np.max(size):
        raise SandError(f"{path}: z runs from {z.min():g} to {z.max():g}: grains here lie in one layer")


def _rows(path: Path, columns: Mapping[str, np.ndarray], radius: Any) -> Rows:
    """Rows as `positions` has them; columns in between that are not there are 0, but for a radius."""
    last = max(k for k, name in enumerate(COLUMNS) if name in columns)
    width = next(length for length in LENGTHS if length > last)
    count = len(columns["x"])
    filled = {name: columns.get(name, np.zeros(count)) for name in COLUMNS[:width]}
    taken = width > 2 and "radius" not in columns
    if taken:
        if not isinstance(radius, int | float) or isinstance(radius, bool):
            raise SandError(f"{path}: has no column radius, so the key `radius` must be one number, not {show(radius)}")
        filled["radius"] = np.full(count, float(radius))
    return Rows(np.column_stack([filled[name] for name in COLUMNS[:width]]).tolist(), taken)
