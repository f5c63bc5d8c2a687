"""Checkpoints: every field of a simulation in one .npz file, without pickle, checked when it is read."""

import hashlib
import json
import struct
import tokenize
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from taichi_sand.files import writing
from taichi_sand.scene.errors import SandError

FORMAT = 7


UNREADABLE = (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, NotImplementedError, RuntimeError, MemoryError)
UNREADABLE += (OverflowError, SyntaxError, tokenize.TokenError, struct.error, zipfile.BadZipFile, zipfile.zlib.error)
"""What reading a file that is no checkpoint, or a damaged one, may raise."""


def fields_of(thing: Any, name: str) -> dict[str, Any]:
    """All Taichi fields within nested dataclasses, named tuples and tuples, by path."""
    if hasattr(thing, "to_numpy"):
        return {name: thing}
    if hasattr(thing, "_fields"):
        parts = zip(thing._fields, thing, strict=True)
    elif isinstance(thing, tuple | list):
        parts = enumerate(thing)
    elif hasattr(thing, "__dataclass_fields__"):
        parts = ((key, getattr(thing, key)) for key in thing.__dataclass_fields__)
    else:
        return {}
    return {key: field for part, value in parts for key, field in fields_of(value, f"{name}.{part}").items()}


def read_field(field: Any) -> dict[str, np.ndarray]:
    """Arrays of a field; a struct has one a member."""
    values = field.to_numpy()
    return {f":{key}": value for key, value in values.items()} if isinstance(values, dict) else {"": values}


def digest(arrays: dict[str, np.ndarray]) -> str:
    """Checksum over names, types, shapes and bytes."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def save(path: str | Path, about: dict[str, Any], fields: dict[str, Any]) -> None:
    """Writes `fields` and `about` (JSON) to `path`: completely, or not at all; SandError if it cannot be written."""
    arrays = {name + part: array for name, field in fields.items() for part, array in read_field(field).items()}
    header = json.dumps({"format": FORMAT, "about": about, "sha256": digest(arrays)})
    with writing.replacing(path, whole_archive) as made, made.open("wb") as file:
        np.savez_compressed(file, header=np.frombuffer(header.encode(), np.uint8), **arrays)


def whole_archive(path: Path) -> str:
    """What is wrong with an .npz file that was just written, or ""."""
    try:
        with zipfile.ZipFile(path) as file:
            return "" if "header.npy" in file.namelist() else "it lacks its header"
    except zipfile.BadZipFile as error:
        return str(error)


def load(path: str | Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What `save` wrote: about, and the arrays. SandError if the file is damaged, foreign or of another version."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(arrays.pop("header").tobytes().decode())
        version, about, checksum = header["format"], header["about"], header["sha256"]
    except FileNotFoundError:
        raise SandError(f"{path}: there is no such checkpoint") from None
    except UNREADABLE as error:
        raise SandError(f"{path}: not a checkpoint of taichi-sand, or a damaged one ({type(error).__name__})") from None
    if version != FORMAT:
        age = "a newer" if isinstance(version, int) and version > FORMAT else "another"
        raise SandError(f"{path}: a checkpoint of format {version}, written by {age} taichi-sand; this one reads format {FORMAT}")
    if checksum != digest(arrays):
        raise SandError(f"{path}: the checkpoint is damaged: its checksum does not match")
    return about, arrays


def restore(fields: dict[str, Any], arrays: dict[str, np.ndarray], path: str | Path) -> None:
    """Puts the arrays of a checkpoint back into the fields they came from."""
    for name, field in fields.items():
        parts = read_field(field)
        stored = {part: arrays.get(name + part) for part in parts}
        if any(stored[p] is None or stored[p].shape != parts[p].shape or stored[p].dtype != parts[p].dtype for p in parts):
            raise SandError(f"{path}: the checkpoint lacks a fitting `{name}`; it was written by another version of taichi-sand")
        field.from_numpy(stored[""] if "" in stored else {part[1:]: array for part, array in stored.items()})
