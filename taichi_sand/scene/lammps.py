"""LAMMPS data files of `atom_style sphere` (docs.lammps.org/read_data.html): atoms with a diameter and a density, and their velocities.

`diameter` is of the disc; `density` is taken as it is, as mass / area [kg/m2], which is what LAMMPS means by it for discs in two
dimensions (`fix nve/sphere disc`). Images of a periodic box are left out.
"""

import re
from pathlib import Path

import numpy as np

from taichi_sand.errors import SandError, show

ATOM = ("id", "type", "diameter", "density", "x", "y", "z")
VELOCITY = ("id", "vx", "vy", "vz", "wx", "wy", "spin")
SECTIONS = re.compile(
    r"^\s*(Atoms|Velocities|Masses|Pair Coeffs|PairIJ Coeffs|Bonds|Bond Coeffs|Ellipsoids|Lines|Bodies|Atom Type Labels)\b"
)
HEADER = re.compile(r"^\s*(\d+)\s+atoms\s*(#.*)?$", re.MULTILINE)


def is_data(text: str) -> bool:
    """Whether a text is LAMMPS data: it says how many atoms there are, and has a section of them."""
    return HEADER.search(text[:20_000]) is not None and re.search(r"^\s*Atoms\b", text, re.MULTILINE) is not None


def read(path: Path, text: str) -> dict[str, np.ndarray]:
    """Columns of its atoms in the order of their ids, as scene.delimited names them, and z.

    Raises:
        SandError: a line is wrong, the style is another, or there are not as many atoms as it says.
    """
    atoms: dict[int, dict[str, float]] = {}
    section = ""
    for number, raw in enumerate(text.splitlines(), 1):
        if number == 1:  # LAMMPS skips it
            continue
        content, _, comment = raw.partition("#")
        head = SECTIONS.match(content)
        if head:
            section = head[1]
            style = comment.split()[0] if comment.split() else "sphere"
            if section == "Atoms" and style != "sphere":
                raise SandError(f"{path}: line {number}: atom_style {style} has no diameters; only sphere can be read")
        elif content.strip() and section in ("Atoms", "Velocities"):
            _take(path, number, content.split(), atoms, section)
    told = HEADER.search(text)
    if told and int(told[1]) != len(atoms):
        raise SandError(f"{path}: says that it has {told[1]} atoms, but lists {len(atoms)}")
    columns = {}
    for name in ("x", "y", "z", "density", "diameter", "vx", "vy", "spin"):
        if any(name in atom for atom in atoms.values()):
            columns[name] = np.array([atoms[key].get(name, 0.0) for key in sorted(atoms)])
    if "diameter" in columns:
        columns["radius"] = columns.pop("diameter") / 2
    return columns


def _take(path: Path, number: int, cells: list[str], atoms: dict[int, dict[str, float]], section: str) -> None:
    """Puts one line of a section to its atom."""
    names = ATOM if section == "Atoms" else VELOCITY
    many = (len(ATOM), len(ATOM) + 3) if section == "Atoms" else (len(VELOCITY),)
    if len(cells) not in many:
        wanted = " or ".join(map(str, many))
        raise SandError(
            f"{path}: line {number}: has {len(cells)} columns instead of {wanted} ({', '.join(names)}): not of atom_style sphere"
        )
    values = {name: _number(path, number, name, cell) for name, cell in zip(names, cells, strict=False)}
    key = int(values.pop("id"))
    if section == "Velocities" and key not in atoms:
        raise SandError(f"{path}: line {number}: id = {key} is of no atom above")
    if section == "Atoms" and key in atoms:
        raise SandError(f"{path}: line {number}: id = {key} is there twice")
    atoms.setdefault(key, {}).update(values)


def _number(path: Path, line: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    above = name in ("diameter", "density")
    if not np.isfinite(value) or (above and value <= 0) or (name == "id" and value != int(value)):
        wanted = "a number greater than 0" if above else "a whole number" if name == "id" else "a finite number"
        raise SandError(f"{path}: line {line}: {name} = {show(cell)} must be {wanted}")
    return float(value)
