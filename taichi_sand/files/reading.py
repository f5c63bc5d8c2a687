"""How files are read that anybody may have made: only what is a file, only as much as there is room for, without waiting."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from taichi_sand.errors import SandError

MOST_BYTES = 512 * 2**20
"""No scene, table or recording is larger; one of four million grains has some 400 MB."""


def opened(path: str | os.PathLike[str], what: str = "file", most: int | None = None) -> BinaryIO:
    """A file, open to be read; a pipe or a device is not waited for.

    Raises:
        SandError: there is none, it is a folder, a pipe or a device, may not be read, or has more than `most` bytes.
    """
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        raise SandError(f"{path}: there is no such {what}") from None
    except (OSError, ValueError) as error:
        folder = Path(os.fsdecode(path)).is_dir() if isinstance(error, OSError) else False
        raise SandError(f"{path} {f'is a folder, not a {what}' if folder else f'cannot be read: {reason(error)}'}") from None
    found = os.fstat(handle)
    wrong = ""
    if stat.S_ISDIR(found.st_mode):
        wrong = f"is a folder, not a {what}"
    elif not stat.S_ISREG(found.st_mode):
        wrong = f"is a pipe, a device or the like, not a {what}"
    elif most is not None and found.st_size > most:
        wrong = f"is too large for a {what}: {found.st_size / 2**20:.0f} MB, at most {most / 2**20:.0f}"
    if wrong:
        os.close(handle)
        raise SandError(f"{path} {wrong}")
    return os.fdopen(handle, "rb")


def reason(error: Exception) -> str:
    """Why something cannot be read, in a few words."""
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def read_bytes(path: str | os.PathLike[str], what: str = "file", most: int = MOST_BYTES) -> bytes:
    """All bytes of a file; SandError as of `opened`."""
    with opened(path, what, most) as file:
        try:
            return file.read(min(most, os.fstat(file.fileno()).st_size))
        except (OSError, MemoryError) as error:
            raise SandError(f"{path} cannot be read: {reason(error)}") from None


def read_text(path: str | os.PathLike[str], what: str = "file", most: int = MOST_BYTES) -> str:
    """The text of a UTF-8 file; SandError as of `opened`, or if it is something else."""
    data = read_bytes(path, what, most)
    if (place := data.find(b"\0")) >= 0:  # UTF-8, but in no text
        raise SandError(f"{path} is not a UTF-8 text file (byte {place} is 0x00)")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SandError(f"{path} is not a UTF-8 text file (byte {error.start} is {error.object[error.start]:#04x})") from None


def starts_with(path: str | os.PathLike[str], *heads: bytes) -> bool:
    """Whether a file begins with one of these; False for what is no file."""
    try:
        with opened(path) as file:
            return file.read(max(map(len, heads))).startswith(heads)
    except SandError:
        return False
