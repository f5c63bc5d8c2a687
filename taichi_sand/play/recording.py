"""Session recordings: a snapshot, everything that was done and how far it ran in between, and a hash of the state every second.

One line of JSON each, so that a recording is whole up to the moment at which a program was stopped: it doubles as a bug report.
[actions, steps, wall time] is a frame, {"hash": …} what the state must be there.
"""

import base64
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from taichi_sand.errors import PhysicsError, SandError
from taichi_sand.files import writing
from taichi_sand.files.jsons import as_line
from taichi_sand.files.reading import read_bytes
from taichi_sand.files.writing import Lines
from taichi_sand.output.film import WRITERS, Progress, destination
from taichi_sand.play.actions import is_action
from taichi_sand.play.chapter import Chapter
from taichi_sand.play.session import FIRST_TOOL, Session, pack
from taichi_sand.play.snapshot import Snapshot, from_bytes
from taichi_sand.play.window.screen import Screen
from taichi_sand.play.window.shape import Shape
from taichi_sand.scene.schema import Scene
from taichi_sand.view import palette
from taichi_sand.view.camera import picture_height
from taichi_sand.world.checkpoint import believing

FORMAT, TITLE = 2, "taichi_sand recording"
EVERY = 1.0
"""Wall time between two hashes [s]."""
LEAST_WIDTH = 2
"""Of a picture within another [px]."""
MOST_STEPS, LONGEST = 1_000_000, 86400.0
"""Steps of a frame, and seconds that are played, are no more."""


class Recorder:
    """Writes down what is done to a session; to be called once a frame. SandError once the disk takes no more: what is there is whole.

    It may begin while a session is played. What was done before is not in it, and can be undone no more; a reset goes where it would.
    """

    def __init__(self, session: Session, path: Path) -> None:
        self.session, self.written = session, 0  # steps of this frame that are
        head = {TITLE: FORMAT, "scene": session.home.to_json(), "start": pack(session.moment())}
        if session.history.past or session.sim.steps:
            head["reset"] = pack(session.chapter.start)
        first = [[actions, 0, 0.0]] if (actions := manner(session)) else []
        self.lines = Lines(path, as_line(head), *map(as_line, first))  # if it cannot be written the session is as it was
        session.history.forget()
        session.rewind.switch(False)
        session.log, session.before_action = [], self.note
        session.made()
        self.started = self.hashed = time.perf_counter()

    def __call__(self, actions: list, steps: int) -> None:
        """A frame: these actions, then so many steps."""
        self._frame(actions, steps - self.written)
        self.written = 0
        self.session.made()
        self.session.take_log()
        if time.perf_counter() - self.hashed >= EVERY:
            self.hash()
            self.hashed = time.perf_counter()

    def note(self) -> None:
        """What was done in this frame so far, if there were steps: something else comes next."""
        steps = self.session.made()
        if steps:
            self._frame(self.session.take_log(), steps)
            self.written += steps

    def _frame(self, actions: list, steps: int) -> None:
        if actions or steps:
            self._line([actions, steps, round(time.perf_counter() - self.started, 4)])

    def hash(self) -> None:
        """The state as it is now."""
        self._line({"hash": self.session.digest()})

    def close(self) -> None:
        """The end."""
        self._frame(self.session.take_log(), self.session.made())
        self.session.log = self.session.before_action = None
        self.hash()
        self.lines.close()

    def _line(self, thing: Any) -> None:
        self.lines.write(as_line(thing))


def manner(session: Session) -> list[list]:
    """Actions by which a session that has just opened the same scene gets the tool, brush and look of this one."""
    brush, look = session.brush, Chapter(session.home).look
    tables = session.sim.scene.grains
    first = next((number for number, table in enumerate(tables) if not table.fixed), 0)
    found: list[list] = [["opened", True]] if session.opened else []
    if session.tool != FIRST_TOOL:
        found.append(["choose", session.tool])
    if brush.kind != first:
        found.append(["kind", (brush.kind - first) % len(tables)])
    found += [["set", f"tool.{name}", getattr(brush, name)] for name, value in brush.first.items() if getattr(brush, name) != value]
    return found + [["look", name, value] for name, value in session.look.items() if value != look[name]]


class Recorded(NamedTuple):
    """A recording."""

    start: Snapshot
    scene: Scene  # that was opened
    lines: list  # [actions, steps, wall time] or {"hash": …}
    reset: Snapshot | None  # where a reset goes to, if not to the start


def read(path: Path) -> Recorded:
    """A recording. A last line that was cut off as it was written is left out.

    Raises:
        SandError: the file is damaged, or no recording.
    """
    text = read_bytes(path, "recording")
    with believing(path, "recording"):
        head, *rest = (json.loads(line) for line in text.decode().split("\n")[:-1])
        if (version := head[TITLE]) != FORMAT:
            raise SandError(f"a recording of format {version}, of another taichi-sand; this one reads format {FORMAT}")
        start, scene = from_bytes(base64.b64decode(head["start"])), Scene.from_json(head["scene"])
        reset = from_bytes(base64.b64decode(head["reset"])) if "reset" in head else None
    last = 0.0
    for number, line in enumerate(rest, 2):
        if not (is_frame(line, last) or (isinstance(line, dict) and isinstance(line.get("hash"), str))):
            raise SandError(f"{path}: line {number} of the recording is damaged")
        last = line[2] if isinstance(line, list) else last
    return Recorded(start, scene, rest, reset)


def is_frame(line: Any, last: float) -> bool:
    """Whether a line says what was done, how many steps were simulated then, and when, not before `last` [s]."""
    if not (isinstance(line, list) and [type(part) for part in line] in ([list, int, float], [list, int, int])):
        return False
    actions, steps, wall = line
    return all(map(is_action, actions)) and 0 <= steps <= MOST_STEPS and last <= wall <= LONGEST


def replay(recorded: Recorded, path: Path, arch: str, threads: int | None) -> Iterator[tuple[Session, float]]:
    """Does again what a recording holds; the session after every frame, and the wall time of the frame [s].

    Raises:
        PhysicsError: the state is not what it was when it was recorded.
    """
    with believing(path, "recording"):
        session = Session(recorded.scene, arch=arch, threads=threads)
        session.go_to(recorded.reset or recorded.start)
        session.chapter.start = session.moment()
        if recorded.reset:
            session.go_to(recorded.start)
    for number, line in enumerate(recorded.lines, 2):
        if isinstance(line, dict):
            if line["hash"] != session.digest():
                raise PhysicsError(f"{path}: in line {number} the state is not what was recorded")
            continue
        actions, steps, wall = line
        with believing(f"{path}: line {number}", "recording"):
            for action in actions:
                session.do(action)
        session.advance(steps)
        yield session, wall


def film(path: Path, out: str, *, fps: int, width: int | None, arch: str, threads: int | None, progress: Progress | None = None) -> None:
    """Films a recording, in the wall time in which it was played."""
    target, ending = destination(out)
    if ending == ".png":
        raise SandError(f"{out}: a recording becomes a film, .mp4 or .gif, a page .html, or a folder of frames")
    recorded = read(path)
    total = max((line[2] for line in recorded.lines if isinstance(line, list)), default=0.0)
    with writing.replacing(target, folder=ending == "/") as made, WRITERS[ending](made, fps) as write:
        pictures, shown = Pictures(width), 0
        for session, wall in replay(recorded, path, arch, threads):
            while shown / fps <= wall:
                if ending == ".html":
                    write(session.sim, shown / fps)
                    shown = max(shown, int(wall * fps)) + 1  # a page needs no copies
                    continue
                write(pictures.of(session))
                shown += 1
            if progress and total:
                progress(min(1.0, wall / total))


class Pictures:
    """Pictures of one size of a session, whatever scene it plays: that of the first, in which those of others are shown whole.

    `width`: of the pictures [px]; that of the scene if None.
    """

    def __init__(self, width: int | None) -> None:
        self.width, self.size = width, (0, 0)
        self.screen: Screen | None = None

    def of(self, session: Session) -> np.ndarray:
        """This moment, (height, width, 3) uint8."""
        if self.screen is None or self.screen.chapter is not session.chapter:
            self.screen = self._screen(session)
        picture, (width, height) = self.screen.film_frame(), self.size
        if picture.shape[:2] == (height, width):
            return picture
        whole = np.empty((height, width, 3), np.uint8)
        whole[:] = palette.rgb(palette.GROUND)
        top, left = (height - picture.shape[0]) // 2, (width - picture.shape[1]) // 2
        whole[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
        return whole

    def _screen(self, session: Session) -> Screen:
        """What paints the scene that is played, as large as fits."""
        view, (wide, high) = session.sim.scene.view, session.sim.scene.size
        if not self.size[0]:
            screen = Screen(session, Shape.of(session.sim.scene.size, self.width or view.width))
            self.size = screen.picture
            return screen
        width = max(LEAST_WIDTH, min(self.size[0], int(self.size[1] * wide / high)))
        while width > LEAST_WIDTH and picture_height((wide, high), width) > self.size[1]:
            width -= 1
        return Screen(session, Shape.of((wide, high), width))
