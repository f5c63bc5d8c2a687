"""What the window writes and reads: checkpoints, pictures, films."""

import base64
import contextlib
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_sand.files import writing
from taichi_sand.output.film import mp4, save_png
from taichi_sand.play.snapshot import Rows, Snapshot, to_bytes
from taichi_sand.run.host import Host
from taichi_sand.run.saving import misfit
from taichi_sand.world import checkpoint
from taichi_sand.world.search.growth import Rooms

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

FPS = 30
MOST_BEHIND = 5
"""A frame of a film is written so many times at most if the window is slow."""


def free_name(folder: Path, name: str, ending: str) -> Path:
    """The first of name_001, name_002, … that does not exist."""
    number = 1
    while (path := folder / f"{name}_{number:03d}{ending}").exists():
        number += 1
    return path


def save(session: "Session", path: Path) -> None:
    """A checkpoint of a session, which `run --resume` takes too."""
    session.sim.save(path)


def read(path: Path) -> str:
    """A checkpoint as ["load", …] takes it; SandError if it is none."""
    about, arrays = checkpoint.load(path, misfit)
    fields = {name: Rows(array.shape, [(0, len(array))] if array.ndim else [], array) for name, array in arrays.items()}
    host = Host.from_json(about["host"])
    walls = host.scene.with_walls(about["first_walls"]).walls
    return base64.b64encode(to_bytes(Snapshot(host, fields, Rooms(*about["rooms"]), walls))).decode()


def save_picture(window: Any) -> Path:
    """What the window shows, as PNG."""
    path = free_name(window.folder, window.name, ".png")
    width, height = window.screen.size
    pixels = window.canvas.reshape(height, width)
    image = np.stack([(pixels >> shift).astype(np.uint8) for shift in (16, 8, 0)], axis=-1)
    with writing.replacing(path) as made:
        save_png(image, made)
    return path


class Film:
    """A film of what goes on in the picture, in wall time. SandError, and no film, once the disk takes no more."""

    def __init__(self, path: Path) -> None:
        self.path, self.stack = path, ExitStack()
        with self.stack:
            made = self.stack.enter_context(writing.replacing(path))
            self.write = self.stack.enter_context(mp4(made, FPS))
            self.stack = self.stack.pop_all()
        self.next = time.perf_counter()

    def frame(self, image: np.ndarray) -> None:
        """The picture of this moment, (height, width, 3) uint8."""
        now = time.perf_counter()
        for _ in range(MOST_BEHIND):
            if self.next > now:
                return
            self.write(image)
            self.next += 1 / FPS
        self.next = now + 1 / FPS

    @property
    def due(self) -> bool:
        """Whether a frame is."""
        return time.perf_counter() >= self.next

    def close(self) -> Path:
        """Completes the file; SandError if that fails, or there was no frame."""
        self.stack.close()
        return self.path

    def drop(self, why: BaseException) -> None:
        """Ends it without a file, for this reason."""
        with contextlib.suppress(type(why)):
            self.stack.__exit__(type(why), why, why.__traceback__)
