"""Trajectories: files of the format GSD, schema hoomd, that grow frame by frame while they can be read.

What is in a frame is written before the index that leads to it, so a process that is killed leaves all frames that were flushed. A
chunk is left out only where the schema has a reader take it from the first frame: it is the same there, and in a group of as many
particles or bonds; what is logged always stands in its frame.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

import numpy as np

import taichi_sand
from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.files.reading import opened, reason

ENDING = ".gsd"
SCHEMA = {"application": f"taichi-sand {taichi_sand.__version__}", "schema": "hoomd", "schema_version": [1, 4]}
"""1.4 is the last version before numbers of 64 bits; there are none here that it does not know, and older programs read it."""
STEP, MADE_OF, OF_PARTICLES = "configuration/step", "taichi_sand/scene", "log/particles/"
HEAD = 8
"""Rows of a chunk that are compared before all of it is."""
REFUSED = (OSError, RuntimeError, ValueError, KeyError, IndexError, TypeError, MemoryError, OverflowError)
"""What the library raises about files that it cannot read or write."""
Chunks = Mapping[str, np.ndarray]


def library() -> Any:
    """The module gsd.fl; SandError if the library is not installed."""
    try:
        import gsd.fl
    except ModuleNotFoundError:
        raise SandError("trajectories need the library gsd: pip install 'taichi-sand[data]'") from None
    return gsd.fl


def target(path: str | os.PathLike[str], option: str = "") -> Path:
    """Where a trajectory is written; SandError unless the name is that of one, and the library is there."""
    if not os.fspath(path).endswith(ENDING):
        raise SandError(f"{f'{option} ' if option else ''}{path}: a trajectory ends in {ENDING}")
    library()
    return writing.target_of(path, option)


class Trajectory:
    """A trajectory that is being written; `begin` and `go_on` make one. All of it raise SandError if the file cannot be written."""

    def __init__(self, path: Path, file: Any, first: dict[str, np.ndarray]) -> None:
        self.path, self.file, self.first = path, file, first
        self.last_step = step_of(file, file.nframes - 1)
        self.waiting = False  # whether frames have been written since the last flush

    @classmethod
    def begin(cls, path: Path, frame: Chunks, made_of: bytes) -> Self:
        """A new trajectory, with its first frame; an old file is replaced once that is on the disk. `made_of` tells scenes apart."""
        with writing.replacing(path) as made, library().open(str(made), "w", **SCHEMA) as file:
            put(file, {**frame, MADE_OF: np.frombuffer(made_of, np.uint8)}, {})
        return cls(path, library().open(str(path), "r+", **SCHEMA), dict(frame))

    @classmethod
    def go_on(cls, path: Path, step: int, made_of: bytes) -> Self:
        """The one that is there, without its frames after `step`.

        Raises:
            SandError: it is no trajectory, or of another scene, or begins after `step`.
        """
        with believed(path) as file:
            if not file.chunk_exists(0, MADE_OF) or file.read_chunk(0, MADE_OF).tobytes() != made_of:
                raise SandError(f"{path}: is not of this scene; another name, or none, is needed to go on from a checkpoint")
            kept = [frame for frame in range(file.nframes) if step_of(file, frame) <= step]
            if not kept:
                raise SandError(f"{path}: begins at step {step_of(file, 0)}, after the checkpoint, at {step}")
            names = file.find_matching_chunk_names("")
            first = {name: file.read_chunk(0, name) for name in names if file.chunk_exists(0, name)}
            if len(kept) < file.nframes:
                copy(file, path, kept, names)
        return cls(path, library().open(str(path), "r+", **SCHEMA), first)

    def write(self, frame: Chunks) -> None:
        """One frame more."""
        self._surely(lambda: put(self.file, frame, self.first))
        self.waiting, self.last_step = True, int(frame[STEP][0])

    def flush(self) -> None:
        """What has been written can be read, from now on whatever happens."""
        if self.waiting:
            self.waiting = False
            self._surely(self.file.flush)

    def close(self) -> None:
        """The end."""
        self._surely(self.file.close)

    def _surely(self, act: Any) -> None:
        try:
            act()
        except REFUSED as error:
            with suppress(*REFUSED):
                self.file.close()
            raise SandError(f"{self.path}: {reason(error)}; it ends with what could still be written") from None


@contextmanager
def believed(path: str | os.PathLike[str]) -> Iterator[Any]:
    """A trajectory that anybody may have made, open to be read; SandError if it is none, or turns out to be damaged in the block."""
    opened(path, "trajectory").close()
    try:
        with library().open(os.fspath(path), "r", **SCHEMA) as file:
            if file.schema != SCHEMA["schema"] or not file.nframes:
                raise ValueError("no frames of the schema hoomd")
            yield file
    except REFUSED as error:
        raise SandError(f"{path}: not a trajectory (GSD, schema hoomd), or a damaged one ({reason(error)})") from None


def step_of(file: Any, frame: int) -> int:
    """Step of a frame: 0 if it does not say."""
    return int(file.read_chunk(frame, STEP)[0]) if file.chunk_exists(frame, STEP) else 0


def put(file: Any, frame: Chunks, first: dict[str, np.ndarray]) -> None:
    """Writes a frame: of what it shares with the first only what is logged. What is logged of particles is logged in all frames or in none,
    as readers expect: what the first has not is left out, what this one has not is NaN.
    """
    if first:
        lost = [name for name in first if name.startswith(OF_PARTICLES) and name not in frame]
        frame = {name: values for name, values in frame.items() if name in first or not name.startswith(OF_PARTICLES)}
        frame |= {name: np.full(int(frame["particles/N"][0]), np.nan, np.float32) for name in lost}
    for name, values in frame.items():
        known = None if name.startswith("log/") else first.get(name)
        if known is None or not same(known, values):
            file.write_chunk(name, values)
        elif known is not values:
            first[name] = values  # the next frame may well have this very array
    file.end_frame()


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two chunks hold the same; most that do not differ in the first rows."""
    alike = one is other or (one.dtype == other.dtype and one.shape == other.shape)
    return alike and (one is other or (np.array_equal(one[:HEAD], other[:HEAD]) and np.array_equal(one, other)))


def copy(file: Any, path: Path, frames: list[int], names: list[str]) -> None:
    """Puts a trajectory of these frames in the place of `path`."""
    with writing.replacing(path) as made, library().open(str(made), "w", **SCHEMA) as shorter:
        for frame in frames:
            for name in names:
                if file.chunk_exists(frame, name):
                    shorter.write_chunk(name, file.read_chunk(frame, name))
            shorter.end_frame()
