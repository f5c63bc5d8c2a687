"""What the window writes and reads: checkpoints, pictures, films."""

import base64
import json
import math
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from taichi_sand.play.snapshot import Rows, Snapshot, to_bytes
from taichi_sand.scene.schema import Scene
from taichi_sand.solvers.bed import Bed
from taichi_sand.view.film import mp4, put_in_place, scratch_beside
from taichi_sand.world import checkpoint

if TYPE_CHECKING:
    from taichi_sand.play.session import Session
    from taichi_sand.play.window import Window

FPS = 30
MOST_BEHIND = 5
"""A frame of a film is written so many times at most if the window is slow."""


def as_line(thing: Any) -> str:
    """One line of JSON; null for a number that is none."""
    return json.dumps(_finite(thing), separators=(",", ":"), allow_nan=False)


def _finite(thing: Any) -> Any:
    if isinstance(thing, dict):
        return {key: _finite(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [_finite(value) for value in thing]
    return None if isinstance(thing, float) and not math.isfinite(thing) else thing


def free_name(folder: Path, name: str, ending: str) -> Path:
    """The first of name_001, name_002, … that does not exist."""
    number = 1
    while (path := folder / f"{name}_{number:03d}{ending}").exists():
        number += 1
    return path


def save(session: "Session", path: Path) -> None:
    """A checkpoint of a session, which `run --resume` takes too."""
    session.sim.save(path, over=session.over)


def read(path: Path) -> str:
    """A checkpoint as ["load", …] takes it; SandError if it is none."""
    about, arrays = checkpoint.load(path)
    host = {name: about[name] for name in ("made", "removed", "numbers")}
    host |= {"scene": Scene.from_json(about["scene"]), "bed": Bed(**about["bed"]), "epoch": tuple(about["epoch"])}
    host["steps"] = int(arrays[".0.pace:done"])
    fields = {name: Rows(array.shape, [(0, len(array))] if array.ndim else [], array) for name, array in arrays.items()}
    return base64.b64encode(to_bytes(Snapshot(host, fields, {"over": about["over"]}))).decode()


def save_picture(window: "Window") -> Path:
    """What the window shows, as PNG."""
    path = free_name(window.folder, window.name, ".png")
    width, height = window.screen.size
    pixels = window.canvas.reshape(height, width)
    image = np.stack([(pixels >> shift).astype(np.uint8) for shift in (16, 8, 0)], axis=-1)
    with scratch_beside(path) as scratch:
        Image.fromarray(image).save(scratch / path.name, optimize=True)
        put_in_place(scratch / path.name, path, scratch)
    return path


class Film:
    """A film of what goes on in the picture, in wall time."""

    def __init__(self, path: Path) -> None:
        self.path, self.stack = path, ExitStack()
        self.scratch = self.stack.enter_context(scratch_beside(path))
        self.write = None
        self.next = time.perf_counter()

    def frame(self, image: np.ndarray) -> None:
        """The picture of this moment, (height, width, 3) uint8."""
        if self.write is None:
            self.encoder = ExitStack()
            self.write = self.encoder.enter_context(mp4(self.scratch / self.path.name, FPS))
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
        """Completes the file."""
        with self.stack:
            if self.write is not None:
                self.encoder.close()
                put_in_place(self.scratch / self.path.name, self.path, self.scratch)
        return self.path
