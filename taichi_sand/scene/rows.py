"""Grains listed one by one in a CSV file beside the scene."""

import csv
import io
import math
from pathlib import Path

from taichi_sand.errors import SandError, show
from taichi_sand.files.reading import read_text

COLUMNS = ("x", "y", "radius", "vx", "vy", "angle", "spin")
LENGTHS = (2, 3, 5, 6, 7)
"""How many of the columns a row may have: velocities come in pairs."""


def read_rows(path: Path) -> list[list[float]]:
    """Reads rows of x, y[, radius[, vx, vy[, angle[, spin]]]] in SI units; a first line with these names may stand above them.

    Raises:
        SandError: the file is missing, not text, empty, or a line of it is wrong.
    """
    lines = csv.reader(io.StringIO(read_text(path), newline=""))
    rows: list[list[float]] = []
    length = 0  # columns, 0 = not known yet
    try:
        for line in lines:
            cells = [cell.strip() for cell in line]
            if not any(cells):
                continue
            if not length and not any(map(_is_number, cells)):
                _check_header(path, cells, lines.line_num)
            else:
                rows.append(_numbers(path, cells, lines.line_num, length))
            length = len(cells)
    except csv.Error as error:
        raise SandError(f"{path}: line {lines.line_num}: {error}") from None
    if not rows:
        raise SandError(f"{path}: holds no grains (its columns are {', '.join(COLUMNS)}, of which x and y must be there)")
    return rows


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _check_header(path: Path, cells: list[str], line: int) -> None:
    if tuple(cells) != COLUMNS[: len(cells)] or len(cells) not in LENGTHS:
        raise SandError(f"{path}: line {line}: the columns are {show(cells)}, but must be x, y[, radius[, vx, vy[, angle[, spin]]]]")


def _numbers(path: Path, cells: list[str], line: int, length: int) -> list[float]:
    if len(cells) not in LENGTHS or length not in (0, len(cells)):
        wanted = length or "2, 3, 5, 6 or 7"
        raise SandError(f"{path}: line {line}: has {len(cells)} columns instead of {wanted} ({', '.join(COLUMNS)})")
    row = []
    for name, cell in zip(COLUMNS, cells, strict=False):
        value = float(cell) if _is_number(cell) else math.nan
        if not math.isfinite(value) or (name == "radius" and value <= 0):
            wanted = "a number greater than 0" if name == "radius" else "a finite number"
            raise SandError(f"{path}: line {line}: {name} = {show(cell)} must be {wanted}")
        row.append(value)
    return row
