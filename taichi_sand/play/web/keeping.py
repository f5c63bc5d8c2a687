"""Files of a session in a browser: checkpoints, pictures, films, recordings and scenes go to the page, and some come from it."""

import io
import json
import tempfile
import time
import tomllib
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from PIL import Image

from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.output.html import html
from taichi_sand.play import files
from taichi_sand.play.commands import Commands
from taichi_sand.play.recording import Recorder
from taichi_sand.play.window.screen import Screen
from taichi_sand.play.window.shape import Shape
from taichi_sand.scene.schema import Scene
from taichi_sand.view.planes import message

FILM_FPS = 30
TEXT_ENDINGS = (".toml",)


class Film:
    """A page of what is played, in wall time."""

    def __init__(self, path: Path) -> None:
        self.path, self.stack, self.start, self.count = path, ExitStack(), time.perf_counter(), 0
        with self.stack:
            self.write = self.stack.enter_context(html(self.stack.enter_context(writing.replacing(path)), FILM_FPS))
            self.stack = self.stack.pop_all()

    def frame(self, sim: Any) -> None:
        """This moment, if one is due."""
        now = time.perf_counter() - self.start
        if now >= self.count / FILM_FPS:
            self.write(sim, now)
            self.count = int(now * FILM_FPS) + 1

    def close(self) -> Path:
        """Completes the file."""
        self.stack.close()
        return self.path

    def drop(self, why: BaseException) -> None:
        """Ends it without a file, for this reason."""
        with suppress(type(why)):
            self.stack.__exit__(type(why), why, why.__traceback__)


class Keeping(Commands):
    """The part of a session in a browser that is about files."""

    server: Any
    stale: bool
    folder: Path
    name: str
    recorder: Recorder | None
    own: bool
    movie: Film | None
    open: Callable[[], None]  # shows what is played now

    def _on_file(self, name: str, data: bytes) -> None:
        self.call("take_file", Path(name).suffix.lower(), data)

    def _on_scene_file(self) -> None:
        data = tomli_w.dumps(json.loads(self.session.sim.scene.to_json())).encode()
        self._send(f"{self.name}.toml", data)

    def _on_record(self) -> None:
        self.call("record")

    def save(self) -> None:
        """A checkpoint, in the folder and for the page."""
        super().save()
        self._send_file(self.folder / f"{self.name}.npz")

    def picture(self) -> None:
        """A picture, as the window makes it."""
        scene = self.session.sim.scene
        screen = Screen(self.session, Shape.of(scene.size, scene.view.width))
        memory, path = io.BytesIO(), files.free_name(self.folder, self.name, ".png")
        Image.fromarray(screen.film_frame()).save(memory, "PNG", optimize=True)
        with writing.replacing(path) as made:
            made.write_bytes(memory.getvalue())
        self._send_file(path)

    def film(self) -> None:
        """Starts a film, a page that plays, or ends it."""
        if self.movie is None:
            self.movie = Film(files.free_name(self.folder, self.name, ".html"))
            self.told = "filming"
        else:
            movie, self.movie = self.movie, None
            self._send_file(movie.close())

    def record(self) -> None:
        """Starts a recording, or ends the one that the page started."""
        self.let_go()
        if self.recorder is None:
            self.recorder, self.own = Recorder(self.session, files.free_name(self.folder, self.name, ".record")), True
            self.told = "recording; what was done before can be undone no more"
        elif not self.own:
            raise SandError("what is played is recorded already, by --record")
        else:
            recorder, self.recorder, self.session.log = self.recorder, None, None
            recorder.close()
            self._send_file(recorder.lines.path)

    def take_file(self, ending: str, data: bytes) -> None:
        """A file of the page: a checkpoint, or a scene that names no other files."""
        if data.startswith(b"PK\x03\x04"):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "checkpoint.npz"
                path.write_bytes(data)
                self.do("load", files.read(path))
        elif ending in TEXT_ENDINGS:
            try:
                scene = Scene.from_json(json.dumps(tomllib.loads(data.decode())))
            except (ValueError, RecursionError, TypeError) as error:
                raise SandError(f"this is no scene file: {str(error)[:200]}") from None
            self.start(scene, "scene")
        else:
            raise SandError("a checkpoint (.npz) or a scene file (.toml) can be loaded")

    def _send_file(self, path: Path) -> None:
        self.told = f"saved {path.name}"
        self._send(path.name, path.read_bytes())

    def _send(self, name: str, data: bytes) -> None:
        """A file for the driver to keep."""
        self.server.mail(message({"kind": "file", "name": name}, [("data", np.frombuffer(data, np.uint8))]))
        self.stale = True

    def _record(self, steps: int) -> None:
        assert self.recorder
        try:
            self.recorder(self.session.take_log(), steps)
        except SandError as error:
            self.recorder, self.session.log, self.told = None, None, str(error)

    def _shoot(self) -> None:
        assert self.movie
        try:
            self.movie.frame(self.session.sim)
        except SandError as error:
            self.movie.drop(error)
            self.movie, self.told = None, str(error)
