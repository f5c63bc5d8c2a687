"""Tables of grains as text: CSV with a header in any order, bare columns, and yade's text (x y z r)."""

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from taichi_sand.errors import SandError, show, suggest

COLUMNS = ("x", "y", "radius", "vx", "vy", "angle", "spin", "density")
"""Of a grain [m, m, m, m/s, m/s, rad, rad/s, kg/m2]; bare columns stand in this order."""
BARE = (2, 3, 5, 6, 7, 8)
"""How many bare columns there may be; four are yade's: x, y, z, radius."""
YADE = ("x", "y", "z", "radius")
ALIASES = {
    **dict.fromkeys(("x", "posx", "px", "position_x", "pos_x", "x_position", "coordinate_x", "points_0", "position_0"), "x"),
    **dict.fromkeys(("y", "posy", "py", "position_y", "pos_y", "y_position", "coordinate_y", "points_1", "position_1"), "y"),
    **dict.fromkeys(("z", "posz", "pz", "position_z", "pos_z", "z_position", "coordinate_z", "points_2", "position_2"), "z"),
    **dict.fromkeys(("radius", "r", "rad", "radii", "particle_radius"), "radius"),
    **dict.fromkeys(("diameter", "d", "diam", "dia"), "diameter"),
    **dict.fromkeys(("vx", "velx", "v_x", "vel_x", "velocity_x", "x_velocity", "velocity_0"), "vx"),
    **dict.fromkeys(("vy", "vely", "v_y", "vel_y", "velocity_y", "y_velocity", "velocity_1"), "vy"),
    **dict.fromkeys(("angle", "theta", "phi", "orientation", "rotation"), "angle"),
    **dict.fromkeys(("spin", "omega", "wz", "omegaz", "omega_z", "angular_velocity", "angular_velocity_z", "angvel_z"), "spin"),
    **dict.fromkeys(("density", "rho"), "density"),
}
"""What columns are called, in small letters, and with _ for what stands between words."""
LEFT_OUT = (
    "",
    "id",
    "index",
    "number",
    "particle",
    "particle_identifier",
    "type",
    "typeid",
    "particle_type",
    "kind",
    "vz",
    "v_z",
    "velocity_z",
    "velocity_2",
)
LEFT_OUT += ("matid", "material", "mask")
"""Columns that grains here have no use for."""
ABOVE_ZERO = ("radius", "diameter", "density")
MARKS = "#%!"
"""What a comment begins with."""
HEAD = "x, y[, radius[, vx, vy[, angle[, spin[, density]]]]]"


class Line(NamedTuple):
    """A line of a file that is no comment."""

    number: int  # from 1 on
    cells: list[str]


def read_table(path: Path, text: str) -> dict[str, np.ndarray]:
    """Columns of a table, by the names of COLUMNS, z if there is one.

    Raises:
        SandError: a line is wrong; the text names it, its column and value.
    """
    lines, comments = _split(text)
    if not lines:
        return {}
    names, first = _named(path, lines, comments)
    rows = []
    for line in lines[first:]:
        if len(line.cells) != len(names):
            expected = ", ".join(name for name in names if name)
            raise SandError(f"{path}: line {line.number}: has {len(line.cells)} columns instead of {len(names)} ({expected})")
        rows.append([_number(path, line, name, cell) for name, cell in zip(names, line.cells, strict=True) if name])
    kept = [name for name in names if name]
    columns = dict(zip(kept, np.array(rows, float).reshape(-1, len(kept)).T, strict=True))
    if "diameter" in columns:
        columns["radius"] = columns.pop("diameter") / 2
    return columns


def _split(text: str) -> tuple[list[Line], list[str]]:
    """Lines in cells, and the comments above the first."""
    lines: list[Line] = []
    comments: list[str] = []
    cut, decimal = None, False
    for number, raw in enumerate(text.splitlines(), 1):
        content = re.split(f"[{MARKS}]|//", raw, maxsplit=1)[0].strip("\r\n ")
        if not content.strip():
            if not lines and raw.strip():
                comments.append(raw.strip().lstrip(MARKS + "/ \t"))
            continue
        if not lines:
            cut = next((mark for mark in ";\t," if mark in content), None)
        cells = [cell.strip().strip("\"'").strip() for cell in content.split(cut)]
        if any(cells):
            lines.append(Line(number, cells))
    if all(line.cells[-1] == "" for line in lines):  # a comma at the end of each line
        lines = [Line(line.number, line.cells[:-1]) for line in lines]
    decimal = cut in (";", "\t") and not any("." in cell for line in lines[1:] for cell in line.cells)
    if decimal:
        lines = [Line(line.number, [re.sub(r"(?<=\d),(?=\d)", ".", cell) for cell in line.cells]) for line in lines]
    return lines, comments


def plain(name: str) -> str:
    """What a column is called, without its unit: `Position.X [m]` is position_x."""
    bare = re.sub(r"[\[(].*?[\])]", "", name.strip().lower())
    return re.sub(r"[\s.:\-]+", "_", bare.strip()).strip("_")


def _named(path: Path, lines: list[Line], comments: list[str]) -> tuple[list[str], int]:
    """The names of the columns, "" of those left out, and the first line with numbers."""
    cells = lines[0].cells
    if not any(map(_is_number, cells)):
        return _header(path, lines[0].number, cells), 1
    for comment in comments:
        told = re.match(r"format\s+(\S+)", comment)
        words = told[1].split("_") if told else re.split(r"[\s,;]+", comment.strip())
        known = [plain(word) for word in words]
        if len(words) == len(cells) and {"x", "y"} <= {ALIASES.get(word) for word in known}:
            return _header(path, lines[0].number - 1, words), 0
    if len(cells) == len(YADE):
        return list(YADE), 0
    if len(cells) not in BARE:
        raise SandError(
            f"{path}: line {lines[0].number}: has {len(cells)} columns instead of 2, 3, 5, 6, 7 or 8 ({HEAD}), and no names above them"
        )
    return list(COLUMNS[: len(cells)]), 0


def _header(path: Path, number: int, cells: list[str]) -> list[str]:
    """The columns that a header names."""
    names = []
    where = f"{path}: line {number}: the columns are {show(cells)}, but must be {HEAD}, in any order"
    for cell in cells:
        name = plain(cell)
        if name not in ALIASES and name not in LEFT_OUT:
            raise SandError(f"{where}: {show(cell)} is none of them{suggest(name, list(ALIASES))}")
        names.append(ALIASES.get(name, ""))
    twice = next((name for name in names if name and names.count(name) > 1), None)
    if twice or {"radius", "diameter"} <= set(names):
        raise SandError(f"{where}: {twice or 'the radius'} is there twice")
    missing = [name for name in ("x", "y") if name not in names]
    if missing or ("vx" in names) != ("vy" in names):
        raise SandError(f"{where}: {missing[0] if missing else 'vx or vy'} is missing")
    return names


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(path: Path, line: Line, name: str, cell: str) -> float:
    value = float(cell) if _is_number(cell) else math.nan
    if not math.isfinite(value) or (name in ABOVE_ZERO and value <= 0):
        wanted = "a number greater than 0" if name in ABOVE_ZERO else "a finite number"
        raise SandError(f"{path}: line {line.number}: {name} = {show(cell)} must be {wanted}")
    return value
