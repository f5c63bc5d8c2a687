"""Grains of one frame of a GSD trajectory, of ours or of HOOMD's: a grain for each particle."""

from pathlib import Path
from typing import Any

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.files.trajectory import believed

MAGIC = bytes.fromhex("df65df65df65df65")
"""What GSD files begin with."""
ROWS = {"position": 3, "velocity": 3, "orientation": 4, "diameter": 1, "body": 1, "mass": 1}


def read(path: Path, number: int | None) -> dict[str, np.ndarray]:
    """Columns of its particles, as scene.delimited names them, and z; density is mass / area where masses are told.

    Places are those of the scene that it was recorded of, by `log/shift`; else the lower left corner of the box is at 0, 0.

    Raises:
        SandError: it is no trajectory, or a damaged one; there is no such frame; it holds clumps; a number is none.
    """
    with believed(path) as file:
        last = file.nframes - 1
        if number is not None and number > last:
            raise SandError(f"{path}: frame = {number} is not there; it has frames 0 … {last}")
        frame = last if number is None else number
        count = int(_chunk(file, frame, "particles/N", 1)[0])
        found = {name: _rows(file, frame, name, width, count) for name, width in ROWS.items()}
        box = np.ravel(_chunk(file, frame, "configuration/box", 6))
        shift = _chunk(file, frame, "log/shift", 2)
        shift = box[:2] / 2 if shift is None else np.ravel(shift)
        spin = _rows(file, frame, "spin", 1, count, "log/particles/")
    columns = _columns(path, found, np.asarray(shift, float), spin)
    for name, values in columns.items():
        above = name in ("radius", "density")
        wrong = np.flatnonzero(~np.isfinite(values) | (above & (values <= 0)))
        if len(wrong):
            text = f"must be {'a number greater than 0' if above else 'a finite number'}"
            raise SandError(f"{path}: frame {frame}, particle {wrong[0]}: {name} = {values[wrong[0]]:g} {text}")
    return columns


def _chunk(file: Any, frame: int, name: str, width: int) -> Any:
    """A chunk of a frame, or of the first one; None if neither has it, ValueError if it is not so wide."""
    at = frame if file.chunk_exists(frame, name) else 0
    if not file.chunk_exists(at, name):
        if name in ("particles/N", "configuration/box"):
            raise ValueError(f"{name} is missing")
        return None
    values = np.asarray(file.read_chunk(at, name))
    if values.size % width or values.dtype.kind not in "iuf" or not values.size:
        raise ValueError(f"{name} has {values.size} numbers")
    return values


def _rows(file: Any, frame: int, name: str, width: int, count: int, group: str = "particles/") -> np.ndarray | None:
    """Numbers of each particle, (count, width) or (count,), or None: the schema's default."""
    values = _chunk(file, frame, group + name, width) if count else np.zeros((0, width))
    if values is None or (values.size != count * width and not file.chunk_exists(frame, group + name)):
        return None
    if values.size != count * width:
        raise ValueError(f"{name} has {values.size} numbers for {count} particles")
    return values.reshape((count, width) if width > 1 else (count,)).astype(float)


def _columns(path: Path, found: dict[str, np.ndarray | None], shift: np.ndarray, spin: np.ndarray | None) -> dict[str, np.ndarray]:
    place, body = found["position"], found["body"]
    if place is None:
        raise SandError(f"{path}: has no particles/position")
    if body is not None and (body >= 0).any():
        raise SandError(f"{path}: holds clumps (particles/body); only grains that are one disc can start from it")
    columns = {"x": place[:, 0] + shift[0], "y": place[:, 1] + shift[1], "z": place[:, 2]}
    diameter, velocity, turn, mass = (found[name] for name in ("diameter", "velocity", "orientation", "mass"))
    columns["radius"] = np.full(len(place), 0.5) if diameter is None else diameter / 2
    if velocity is not None:
        columns |= {"vx": velocity[:, 0], "vy": velocity[:, 1]}
    if turn is not None:
        columns["angle"] = 2 * np.arctan2(turn[:, 3], turn[:, 0])
    if spin is not None:
        columns["spin"] = spin
    if mass is not None:
        columns["density"] = mass / (np.pi * columns["radius"] ** 2)
    return columns
