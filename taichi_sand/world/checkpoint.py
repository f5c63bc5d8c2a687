"""Checkpoints: every field of a simulation in one .npz file, without pickle, checked when it is read."""

import hashlib
import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.files import archive, writing
from taichi_sand.files.archive import Announced
from taichi_sand.files.reading import opened
from taichi_sand.world.search.cell_list import Scratch

FORMAT = 10
Misfit = Callable[[Any, dict[str, Announced]], str]


def fields_of(thing: Any, name: str, scratch: bool = False) -> dict[str, Any]:
    """All Taichi fields within nested dataclasses, named tuples and tuples, by path; those that hold nothing for long only as `scratch`."""
    if isinstance(thing, Scratch) and not scratch:
        return {}
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
    return {key: field for part, value in parts for key, field in fields_of(value, f"{name}.{part}", scratch).items()}


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
        np.savez_compressed(file, **{"header": np.frombuffer(header.encode(), np.uint8), **arrays})  # type: ignore[arg-type]


def whole_archive(path: Path) -> str:
    """What is wrong with an .npz file that was just written, or ""."""
    try:
        with zipfile.ZipFile(path) as file:
            return "" if "header.npy" in file.namelist() else "it lacks its header"
    except zipfile.BadZipFile as error:
        return str(error)


def load(path: str | PathLike[str], misfit: Misfit = lambda about, announced: "") -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What `save` wrote: about, and the arrays, read-only.

    Args:
        path: the file; anybody may have made it.
        misfit: what is wrong with the arrays that are announced, or "": called with what they are about before any of them is read.

    Raises:
        SandError: the file is damaged, foreign or of another version, or its arrays are not what they should be.
    """

    def wrong_with(header: Any, announced: dict[str, Announced]) -> str:
        version = header["format"]
        if version != FORMAT:
            age = "a newer" if isinstance(version, int) and version > FORMAT else "another"
            return f"a checkpoint of format {version}, written by {age} taichi-sand; this one reads format {FORMAT}"
        return misfit(header["about"], announced)

    with opened(path, "checkpoint") as file, believing(path, "checkpoint"):
        header, arrays = archive.read(file, "header", wrong_with)
        if header["sha256"] != digest(arrays):
            raise SandError("the checkpoint is damaged: its checksum does not match")
        return header["about"], arrays


@contextmanager
def believing(path: str | PathLike[str], what: str) -> Iterator[None]:
    """Around the reading of what `path` says: what is wrong with it becomes one sentence that names it."""
    try:
        yield
    except SandError as error:
        raise SandError(f"{path}: {error}") from None
    except archive.UNREADABLE as error:
        raise SandError(f"{path}: not a {what} of taichi-sand, or a damaged one ({type(error).__name__})") from None


def tables_of(fields: dict[str, Any]) -> dict[str, np.ndarray]:
    """The arrays of fields, members of structs apart, by name."""
    return {name + part: values for name, field in fields.items() for part, values in read_field(field).items()}


def check_shapes(tables: dict[str, np.ndarray], stored: Mapping[str, Any]) -> None:
    """SandError unless every table has one of its shape and type in what was stored."""
    for name, values in tables.items():
        one = stored.get(name)
        if one is None or one.shape != values.shape or one.dtype != values.dtype:
            raise SandError(f"it lacks a fitting `{name}`; it comes from another scene or another version of taichi-sand")


def restore(fields: dict[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Puts arrays, which have been checked, back into the fields they came from."""
    for name, field in fields.items():
        parts = {part: arrays[name + part] for part in read_field(field)}
        field.from_numpy(parts[""] if "" in parts else {part[1:]: array for part, array in parts.items()})
