"""The one place where files are written.

What is written is made in a hidden folder beside its target, looked at, and moved into place in one step: whatever happens on the way, a
full disk or a kill, there is the old file or a complete new one. The hidden folder goes with the block that it was made for; what a kill
leaves of it, the next write of the same target clears away.
"""

import ctypes
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from taichi_sand.errors import SandError

try:
    import fcntl
except ModuleNotFoundError:  # Windows
    fcntl = None

PROBE = 4096
"""Bytes that are written to find out whether a disk takes any."""
LEFT = 86400.0
"""Where the system has no locks, a hidden folder is taken to be left over after this time [s]."""
AT_FDCWD, RENAME_EXCHANGE = -100, 2
Look = Callable[[Path], str]
"""What looks at a file that was made: returns what is wrong with it, or ""."""


def target_of(path: str | os.PathLike[str], option: str = "", *, folder: bool = False) -> Path:
    """The absolute path of what is to be written, links followed; `option` (`--save`) is named in errors.

    Raises:
        SandError: the path is empty, or what stands there, or on the way there, is something else than it should be.
    """
    text = os.fspath(path)
    head = f"{option} " if option else ""
    if text in ("", ".") or "\0" in text:
        raise SandError(f"{head}{text!r}: this is not the name of a file to write")
    target = Path(os.path.realpath(text))
    above = target.parent
    while not os.path.lexists(above) and above != above.parent:
        above = above.parent
    if not above.is_dir():
        raise SandError(f"{head}{text} cannot be written: {above} is a file, not a folder")
    if folder:
        if os.path.lexists(target) and not target.is_dir():
            raise SandError(f"{head}{text} cannot be written: it is a file, not a folder")
    elif target.is_dir():
        raise SandError(f"{head}{text} cannot be written: it is a folder, not a file")
    elif os.path.lexists(target) and not target.is_file():
        raise SandError(f"{head}{text} cannot be written: it is a device, a pipe or the like, not a file")
    if os.path.lexists(target) and not os.access(target, os.W_OK):
        raise SandError(f"{head}{text} cannot be written: it is write-protected")
    return target


def check(path: str | os.PathLike[str], option: str = "", *, folder: bool = False) -> None:
    """Refuses what cannot be written before the work that would fill it: tries out whether its folder takes a file.

    Raises:
        SandError: see `target_of`; or folder or disk take nothing.
    """
    with scratch_beside(target_of(path, option, folder=folder)):
        pass


@contextmanager
def replacing(path: str | os.PathLike[str], look: Look | None = None, *, folder: bool = False, empty: bool = False) -> Iterator[Path]:
    """A hidden path, to be filled in the block; what is there at its end takes the place of `path`. Permissions follow the umask.

    Args:
        path: the file, or the folder, that is written.
        look: looks at what was made before it goes into place.
        folder: whether it is a folder of files.
        empty: whether a file may be empty.

    Raises:
        SandError: it cannot be written, or is not what it should be; what stood there still does.
    """
    target = target_of(path, folder=folder)
    with scratch_beside(target) as scratch:
        made = scratch / target.name
        yield made
        files = sorted(made.iterdir()) if folder else [made]
        wrong = "it was not made" if not all(map(Path.is_file, files)) else look(made) if look else ""
        wrong = wrong or ("it is empty" if not empty and not all(file.stat().st_size for file in files) else "")
        if wrong:
            raise SandError(f"{target}: cannot be written: {wrong}")
        for file in files:
            settle(file)
        put_in_place(made, target, scratch)
        with suppress(OSError):  # not all systems can for the names in a folder
            settle(target.parent)


def settle(path: Path) -> None:
    """Waits until the disk has a file: what it cannot take after all is said here."""
    handle = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def put_in_place(made: Path, target: Path, scratch: Path) -> None:
    """Moves a finished file or folder to where it belongs; a folder that stood there goes with the scratch folder."""
    if not target.is_dir():
        os.replace(made, target)
        return
    if exchange(made, target):
        return
    old = scratch / "old"
    os.rename(target, old)
    try:
        os.rename(made, target)
    except BaseException:
        os.rename(old, target)
        raise


def exchange(one: Path, other: Path) -> bool:
    """Exchanges two folders in one step, so that there is one at any time; False where the system cannot."""
    try:
        swap = ctypes.CDLL(None).renameat2
    except (OSError, AttributeError, TypeError):
        return False
    return swap(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0


@contextmanager
def scratch_beside(target: Path) -> Iterator[Path]:
    """A hidden folder beside `target`, gone afterwards whatever happens, and with it folders above that were made for nothing.

    Raises:
        SandError: it cannot be made, or takes no bytes; or the disk refuses what is written in the block.
    """
    missing = [folder for folder in target.parents if not folder.exists()]
    scratch: Path | None = None
    handle = -1
    try:
        with in_words(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            clear_left(target)
            scratch, handle = locked_folder(target)
            probe(scratch / "probe")
            yield scratch
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)
        if handle >= 0:
            os.close(handle)
        with suppress(OSError):  # those that something lies in stay
            for folder in missing:
                folder.rmdir()


@contextmanager
def in_words(target: Path) -> Iterator[None]:
    """What a disk refuses, as a sentence about `target`. Errors about other files are not touched."""
    try:
        yield
    except OSError as error:
        name = error.filename
        ours = name is None or Path(os.fsdecode(name)).is_relative_to(target.parent) or target.is_relative_to(os.fsdecode(name))
        if not ours or error.errno is None:
            raise
        raise SandError(f"{target}: cannot be written: {error.strerror}") from None


def probe(path: Path) -> None:
    """Writes a few bytes to the disk, and takes them away again."""
    with path.open("wb") as file:
        file.write(b"\xa5" * PROBE)
        file.flush()
        os.fsync(file.fileno())
    path.unlink()


def hidden_name(target: Path) -> str:
    """How the hidden folders of a target begin; a name may have 255 bytes."""
    return f".{target.name[:48]}."


def locked_folder(target: Path) -> tuple[Path, int]:
    """A new hidden folder beside `target`, and a handle that is open, and locked, while somebody works there."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=hidden_name(target), suffix=".part", dir=target.parent))
        if fcntl is None:
            return folder, -1
        handle = os.open(folder, os.O_RDONLY)
        if lock(handle) and folder.exists():
            return folder, handle
        os.close(handle)  # somebody took it for a left one before it was locked


def lock(handle: int) -> bool:
    """Locks what a handle is open on; False if somebody else holds it. Some file systems have no locks: there nobody does."""
    assert fcntl
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def clear_left(target: Path) -> None:
    """Takes away what killed processes have left of earlier writes of `target`."""
    for entry in target.parent.iterdir():
        if entry.name.startswith(hidden_name(target)) and entry.name.endswith(".part") and is_left(entry):
            if (entry / "old").is_dir() and not os.path.lexists(target):  # killed between the two steps of `put_in_place`
                os.rename(entry / "old", target)
            shutil.rmtree(entry, ignore_errors=True)


def is_left(folder: Path) -> bool:
    """Whether nobody works in a hidden folder any more. Where there are no locks that is believed after a day."""
    try:
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or fcntl is None:
            return stat.S_ISDIR(found.st_mode) and time.time() - found.st_mtime > LEFT
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # gone
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return time.time() - found.st_mtime > LEFT
    finally:
        os.close(handle)
    return True


class Lines:
    """A file that grows line by line: there from its first line on, and whole up to its last one whatever happens.

    Args:
        path: where it is written; an old file there is replaced once the first lines are on the disk.
        first: the lines that it begins with.

    Raises:
        SandError: it cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], *first: str) -> None:
        self.path = target_of(path)
        with replacing(self.path, empty=True) as made:
            made.write_text("".join(f"{line}\n" for line in first), "utf-8")
        self.handle = os.open(self.path, os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0))
        self.length = os.fstat(self.handle).st_size

    def write(self, line: str) -> None:
        """One line more. SandError if the disk refuses it; the file then ends with the line before, and is closed."""
        if self.handle < 0:
            return
        left = memoryview(f"{line}\n".encode())
        length = self.length + len(left)
        try:
            while left:
                left = left[os.write(self.handle, left) :]
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self.handle, self.length)
            self.close()
            raise SandError(f"{self.path}: {error.strerror}; it ends with what could still be written") from None
        self.length = length

    def close(self) -> None:
        """The end."""
        if self.handle >= 0:
            os.close(self.handle)
        self.handle = -1
