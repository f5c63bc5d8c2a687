"""The window: shows a session in real time until it is closed."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.files.jsons import as_line
from taichi_sand.files.writing import Lines
from taichi_sand.play import numbers
from taichi_sand.play.files import Film
from taichi_sand.play.pace import FRAME, Pace
from taichi_sand.play.recording import Recorder
from taichi_sand.play.session import Session
from taichi_sand.play.window import hud
from taichi_sand.play.window.controls import Controls
from taichi_sand.play.window.opening import Opening
from taichi_sand.play.window.screen import Screen
from taichi_sand.play.window.telling import state_of
from taichi_sand.play.window.waiting import CancelledError
from taichi_sand.taichi_support.compiling import heard_by

MEASURE, REPORT = 0.25, 0.1
"""Time between two measurements [s], for the eye and for a report."""
TIP = 0.5
"""The mouse rests on a control for so long before that says what it does [s]."""
IDLE = 0.03
"""A paused window looks for input so often [s]."""
LISTENER = Callable[[list, int], None]


class Window:
    """A session on the screen.

    Args:
        opening: the window as it was opened, which shows the scene as it is packed until all is compiled.
        folder: where files are written.
        report: a file that gets a line of JSON a few times a second: what the window shows.
        made: arch and threads, as for Session.

    Raises:
        SandError: the scene cannot be simulated.
        CancelledError: the user did not want to wait.
    """

    def __init__(self, opening: Opening, folder: Path, report: Path | None = None, **made: Any) -> None:
        self.opening, self.name, self.folder = opening, opening.name, folder
        self.every = REPORT if report else MEASURE
        self.listener: LISTENER | None = None  # gets the actions and steps of every frame
        self.running, self.stale, self.unmeasured = True, True, True
        self.seen_at, self.hovered_at, self.tipped = (0.0, 0.0), 0.0, True
        self.film: Film | None = None
        self.failed: SandError | None = None  # what could not be written, first
        with heard_by(self._kernel):
            self.session = Session(opening.scene, **made)
        self.opening.waiting.free = lambda: self.session.making
        self.session.chapter.name = opening.name
        self.report = Lines(report) if report else None
        self.measured: dict[str, Any] = {}
        self.controls: Controls = None  # type: ignore[assignment]  # the next
        self._begin()
        self.controls = Controls(self)
        self.frame_time, self.began = FRAME, time.perf_counter()

    def _begin(self) -> None:
        """Shows the session anew."""
        self.gui, self.waiting = self.opening.gui, self.opening.waiting
        self.canvas = self.gui.img
        self.screen = Screen(self.session, self.opening.shape, self.opening.text)
        self.pace = Pace()
        self.measured, self.measured_at = {}, 0.0

    def open(self) -> None:
        """Another scene is played; a film ends with the one before."""
        told = ""
        if self.film:
            film, self.film = self.film, None
            try:
                told = f"saved {film.close().name}"
            except SandError as error:
                told = str(error)
        home, before = self.session.home, self.opening
        self.gui.close()
        del self.gui
        self.opening = Opening(home, self.name, before.width, before.text)
        self.opening.waiting.free = lambda: self.session.making
        self._begin()
        self.controls.told = told

    def wait(self, what: str) -> None:
        """Something may have to be compiled."""
        self.waiting.begin(what)

    def run(self) -> None:
        """Until the window is closed. SandError then if the report or the recording could not be written to their ends."""
        try:
            with heard_by(self._kernel):
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

    def _kernel(self, name: str) -> None:
        self.opening.waiting.kernel(name)  # another one with every window

    def tick(self) -> None:
        """One frame, and the rest of its time."""
        now = time.perf_counter()
        self.frame_time, self.began = now - self.began, now
        self.waiting.end()
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
        if steps or changed or self.stale or late or self._tip_is_due():
            self.show()
        else:
            self.gui.core.update()

    def _input(self) -> bool:
        """Answers to the mouse and the keys; whether there was anything."""
        busy, gui = False, self.gui
        kept, self.waiting.kept = self.waiting.kept, []
        for event in [*kept, *gui.get_events()]:
            if self.gui is not gui or not gui.running:  # the rest was meant for the window of another scene
                break
            busy = True
            width, height = self.screen.size
            self.controls.handle(event, event.pos[0] * width, (1 - event.pos[1]) * height)
        x, y = self._cursor()
        if (x, y) != self.seen_at:
            busy, self.seen_at = True, (x, y)
            self._hover(x, y)
        self.controls.held(x, y)
        return busy or self.session.stroke is not None or self.film is not None

    def _hover(self, x: float, y: float) -> None:
        """The mouse is over something, or over nothing."""
        zone, panel = self.controls.under(x, y), self.screen.panel
        name = zone.name if zone else ""
        if name != panel.hovered:
            panel.hovered, self.hovered_at, self.stale = name, time.perf_counter(), True
            self.tipped = not (zone and zone.tip)

    def _tip_is_due(self) -> bool:
        """Whether the mouse has rested on a control for so long that it says what it does."""
        return not self.tipped and time.perf_counter() - self.hovered_at > TIP

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
        session, controls = self.session, self.controls
        marks = {"paused": controls.paused, "filming": self.film is not None, "recording": self.listener is not None}
        self.badges = hud.badges(session, self.measured, **marks)
        told, offer = session.message or controls.told, session.offer[0] if session.offer else ""
        place = self.screen.place(x, y) if self.screen.shows(x, y) else None
        picture = self.screen.paint(self.canvas, self.badges, place, told, offer)
        zone = controls.under(x, y) if self._tip_is_due() else None
        if zone and zone.tip:
            self.screen.paint_tip(self.canvas, zone)
            self.tipped = controls.zone is None and not self.session.stroke and controls.paused
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
        self.measured["slowed"] = pace.slowed(session.speed)
        self.measured |= {"cost": pace.cost / session.sim.step, "stages": dict(pace.stages)}
        self.measured["given"] = session.sim.hand.now[None].given.to_list()

    def _tell(self, report: Lines) -> None:
        """A line of the report: what the window shows at this moment."""
        self._write(report.write, as_line(state_of(self)))

    def _write(self, write: Callable[..., None], *what: Any) -> None:
        """Writes to the report or the recording. That the disk takes no more is told, and told again at the end: the game goes on."""
        try:
            write(*what)
        except SandError as error:
            self.failed = self.failed or error
            self.controls.told = str(error)


def play(opening: Opening, *, folder: Path, record: Path | None, **made: Any) -> None:
    """Plays a scene in a window until that is closed, and records it if `record` names a file. Arguments as for Window."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        window = Window(opening, folder, **made)
    except CancelledError:
        return
    if record is None:
        window.run()
        return
    window.listener = recorder = Recorder(window.session, record)
    try:
        window.run()
    except BaseException:
        recorder.lines.close()  # steps of this frame may have been done that are not written down: no hash
        raise
    recorder.close()
