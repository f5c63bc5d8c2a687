"""Reads .npz archives that anybody may have made: what they announce is looked at before any of it is read.

An archive of a few megabytes may unfold to thousands of them, an array may announce a size that is not there: neither is believed.
"""

import json
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.files.memory import available

UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    MemoryError,
)
UNREADABLE += (OverflowError, SyntaxError, tokenize.TokenError, struct.error, zipfile.BadZipFile, zlib.error)
"""What reading a file that is no archive, or a damaged one, may raise."""
MOST_HEAD = 256 * 2**20
"""Bytes of the JSON that describes the arrays: the places of some million grains."""
SHARE = 0.5
"""Of the memory that is free arrays may take so much: what they are read into takes as much again."""
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


@dataclass(frozen=True)
class Announced:
    """What an array of an archive says of itself."""

    shape: tuple[int, ...]
    kind: np.dtype
    in_columns: bool  # Fortran's order

    @property
    def bytes(self) -> int:
        """Room that it takes."""
        return math.prod(self.shape) * self.kind.itemsize


def read(file: BinaryIO, head: str, misfit: Callable[[Any, dict[str, Announced]], str]) -> tuple[Any, dict[str, np.ndarray]]:
    """The JSON in the array `head`, and all other arrays, read-only, by name.

    Args:
        file: the archive.
        head: name of the array of bytes that holds the JSON.
        misfit: what is wrong with the arrays that are announced, or "": called with the JSON before any of them is read.

    Raises:
        SandError: the arrays do not fit; the text says why, and names no file.
        UNREADABLE: the file is something else, or damaged.
    """
    with zipfile.ZipFile(file) as archive:
        infos = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        if len(infos) != len(archive.infolist()) or any(info.compress_type not in METHODS for info in infos.values()):
            raise ValueError("not as NumPy writes archives")
        if infos[head].file_size > MOST_HEAD:
            raise SandError(f"its head announces {infos[head].file_size / 2**20:.0f} MB")
        about = json.loads(take(archive, infos.pop(head)).tobytes().decode())
        announced = {name: announce(archive, info)[0] for name, info in infos.items()}
        total, free = sum(one.bytes for one in announced.values()), available()
        wrong = misfit(about, announced)
        if not wrong and total > SHARE * free:
            wrong = f"it announces {total / 2**20:.0f} MB of arrays, more than fits into the {free / 2**20:.0f} MB of memory that are free"
        if wrong:
            raise SandError(wrong)
        return about, {name: take(archive, info) for name, info in infos.items()}


def announce(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> tuple[Announced, int]:
    """What an array says of itself, and the bytes of that; ValueError if it does not say what the archive says."""
    with archive.open(info) as file:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, in_columns, kind = header(file)
        found, length = Announced(shape, kind, in_columns), file.tell()
    if kind.hasobject or any(rows < 0 for rows in shape) or found.bytes != info.file_size - length:
        raise ValueError("an array is not as large as it says")
    return found, length


def take(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """One array."""
    found, length = announce(archive, info)
    with archive.open(info) as file:
        data = file.read()
    array = np.frombuffer(data, found.kind, offset=length, count=math.prod(found.shape))
    return array.reshape(found.shape, order="F" if found.in_columns else "C")
