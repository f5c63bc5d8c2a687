"""The window: shows a session in real time until it is closed."""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import taichi as ti

from taichi_sand.errors import SandError
from taichi_sand.files.jsons import as_line
from taichi_sand.files.writing import Lines
from taichi_sand.play import numbers
from taichi_sand.play.files import Film
from taichi_sand.play.pace import FRAME, Pace
from taichi_sand.play.recording import Recorder
from taichi_sand.play.session import Session
from taichi_sand.play.window.controls import Controls
from taichi_sand.play.window.screen import Screen, picture_width
from taichi_sand.taichi_support.runtime import compiled

MEASURE, REPORT = 0.25, 0.1
"""Time between two measurements [s], for the eye and for a report."""
TRIES, PAUSE = 5, 0.3
"""How often a window is tried to be opened, and the time between [s]."""
IDLE = 0.03
"""A paused window looks for input so often [s]."""
NO_DISPLAY = "there is no display to open a window on; `taichi-sand play --web` plays in a browser, `taichi-sand render` makes films"
LISTENER = Callable[[list, int], None]


class Window:
    """A session on the screen.

    Args:
        session: what is shown.
        name: of the scene; files are called after it.
        folder: where files are written.
        width: of the picture [px]; None = one that fits a screen.
        report: a file that gets a line of JSON a few times a second: what the window shows.

    Raises:
        SandError: there is no display.
    """

    def __init__(self, session: Session, name: str, *, folder: Path, width: int | None = None, report: Path | None = None) -> None:
        self.session, self.name, self.folder, self.width = session, name, folder, width
        self.report = Lines(report) if report else None
        self.every = REPORT if report else MEASURE
        self.listener: LISTENER | None = None  # gets the actions and steps of every frame
        self.running, self.stale, self.unmeasured = True, True, True
        self.seen_at = (0.0, 0.0)
        self.film: Film | None = None
        self.failed: SandError | None = None  # what could not be written, first
        self.measured: dict[str, Any] = {}
        self.frame_time, self.began = FRAME, time.perf_counter()
        self.gui: Any = None
        self.open()
        self.controls = Controls(self)

    def open(self) -> None:
        """Opens the window in the size that suits the scene."""
        self.screen = Screen(self.session, picture_width(self.session, self.width))
        self.pace = Pace()
        self.measured, self.measured_at = {}, 0.0
        self.gui = None
        title = f"taichi_sand: {self.session.sim.scene.title or self.name}"
        for left in reversed(range(TRIES)):  # a display server whose last window was closed may be starting afresh
            try:
                self.gui = ti.GUI(title, self.screen.size, fast_gui=True)  # type: ignore[arg-type]
                break
            except RuntimeError:
                if not left:
                    raise SandError(NO_DISPLAY) from None
                time.sleep(PAUSE)
        self.gui.fps_limit = None
        self.canvas = self.gui.img

    def wait(self, text: str) -> None:
        """Says that something takes a while; not once the window is being closed, which Taichi answers with an error."""
        if text and self.gui.running:
            self.screen.message(self.canvas, text)
            self.gui.core.update()

    def run(self) -> None:
        """Until the window is closed. SandError then if the report or the recording could not be written to their ends."""
        try:
            while self.running and self.gui.running:
                self.tick()
            if self.film:
                self.film.close()
        except BaseException as error:
            if self.film:
                self.film.drop(error)
            raise
        finally:
            if self.report:
                self.report.close()
        self.gui.close()
        if self.failed:
            raise self.failed

    def tick(self) -> None:
        """One frame, and the rest of its time."""
        now = time.perf_counter()
        self.frame_time, self.began = now - self.began, now
        self.frame()
        if self.controls.paused and not self.stale:
            time.sleep(IDLE)
        else:
            time.sleep(max(0.0, FRAME - (time.perf_counter() - now)))

    def frame(self) -> None:
        """One frame: input, simulation, picture."""
        controls, session = self.controls, self.session
        changed = self._input()
        steps = self.pace.advance(session, self.frame_time, controls.due if controls.paused else None)
        controls.due = 0
        if self.listener:
            self._write(self.listener, session.take_log(), steps)
        late = self.unmeasured and time.perf_counter() - self.measured_at >= self.every
        if steps or changed or self.stale or late:
            self.show()
        else:
            self.gui.core.update()

    def _input(self) -> bool:
        """Answers to the mouse and the keys; whether there was anything."""
        width, height = self.screen.size
        busy = False
        for event in list(self.gui.get_events()):
            if not self.gui.running:
                break
            busy = True
            self.controls.handle(event, event.pos[0] * width, (1 - event.pos[1]) * height)
            width, height = self.screen.size
        x, y = self._cursor()
        busy |= (x, y) != self.seen_at
        self.seen_at = (x, y)
        self.controls.held(x, y)
        return busy or self.session.stroke is not None or self.film is not None

    def _cursor(self) -> tuple[float, float]:
        """The pixel under the mouse, y down."""
        x, y = self.gui.get_cursor_pos()
        return x * self.screen.size[0], (1 - y) * self.screen.size[1]

    def show(self) -> None:
        """Measures if it is time to, paints, shows."""
        now = time.perf_counter()
        due = now - self.measured_at >= self.every
        self.unmeasured = not due
        if due:
            self._measure(now)
        if due or self.stale:
            self.screen.paint_panel(self.canvas, self.measured)
            self.pace.stage("panel", time.perf_counter() - now)
        self.stale = False
        x, y = self._cursor()
        inside = 0 <= x < self.screen.picture[0] and self.screen.top <= y < self.screen.top + self.screen.picture[1]
        told = self.session.message or self.controls.told
        picture = self.screen.paint(self.canvas, self.measured, self.screen.place(x, y) if inside else None, told)
        shown = time.perf_counter()
        self.gui.core.update()
        for name, seconds in {**self.screen.stages, "show": time.perf_counter() - shown}.items():
            self.pace.stage(name, seconds)
        if due and self.report:
            self._tell(self.report)
        if self.film and self.film.due:
            try:
                self.film.frame(self.screen.painter.rgb(picture))
            except SandError as error:
                self.film.drop(error)
                self.film, self.controls.told = None, str(error)

    def _measure(self, now: float) -> None:
        """What the panel and the numbers over the picture say."""
        session, pace = self.session, self.pace
        self.measured = numbers.measure(session, self.measured)
        self.pace.stage("measure", time.perf_counter() - now)
        self.measured_at = now
        self.measured |= {"frames": pace.frames, "real_time": pace.factor, "paused": self.controls.paused}
        self.measured |= {"cost": pace.cost / session.sim.step, "stages": dict(pace.stages)}
        self.measured["given"] = session.sim.hand.now[None].given.to_list()

    def _tell(self, report: Lines) -> None:
        """A line of the report: what the window shows at this moment."""
        session, screen = self.session, self.screen
        state = {
            **self.measured,
            "scene": self.name,
            "solver": session.sim.scene.solver.kind,
            "effects": list(session.sim.effects),
            "values": {knob.key: session.value(knob.key) for knob in session.knobs()},
            "unphysical": session.unphysical(),
            "walls": [wall.points for wall in session.sim.scene.walls],
            "tool": session.tool,
            "kind": session.brush.kind,
            "undo": len(session.history.past),
            "look": session.look,
            "help": screen.help,
            "said": session.message or self.controls.told,
            "compiled": compiled(),
            "hash": session.digest(),
            "window": screen.size,
            "picture": [0, screen.top, *screen.picture],
            "controls": screen.panel.places(),
        }
        self._write(report.write, as_line(state))

    def _write(self, write: Callable[..., None], *what: Any) -> None:
        """Writes to the report or the recording. That the disk takes no more is told, and told again at the end: the game goes on."""
        try:
            write(*what)
        except SandError as error:
            self.failed = self.failed or error
            self.controls.told = str(error)


def check_display() -> None:
    """SandError where X11 is what windows are opened by, and there is none: before anything is compiled."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise SandError(NO_DISPLAY)


def play(session: Session, name: str, *, folder: Path, width: int | None, report: Path | None, record: Path | None) -> None:
    """Plays a session in a window until that is closed, and records it if `record` names a file. Arguments as for Window."""
    folder.mkdir(parents=True, exist_ok=True)
    window = Window(session, name, folder=folder, width=width, report=report)
    if record is None:
        window.run()
        return
    window.listener = recorder = Recorder(session, record)
    try:
        window.run()
    except BaseException:
        recorder.lines.close()  # steps of this frame may have been done that are not written down: no hash
        raise
    recorder.close()
