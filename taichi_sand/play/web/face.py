"""Plays a session in a browser: inputs of the page become commands, states go to the server."""

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from taichi_sand.files.jsons import finite
from taichi_sand.play import numbers
from taichi_sand.play.pace import FRAME, Pace
from taichi_sand.play.recording import Recorder
from taichi_sand.play.session import Session
from taichi_sand.play.web import described
from taichi_sand.play.web.keeping import Film, Keeping
from taichi_sand.play.web.sending import frame, live_page
from taichi_sand.play.web.server import Server
from taichi_sand.scene.schema import Scene
from taichi_sand.view.planes import Planes, message
from taichi_sand.view.views import KIND, PHOTOELASTIC

MEASURE = 0.25
"""Time between two measurements [s]."""
DRAWN = ("rotation",)
"""Views whose numbers a page has anyway."""


class Browser(Keeping):
    """A session in a browser. Arguments as for Window."""

    def __init__(self, session: Session, name: str, server: Server, folder: Path) -> None:
        super().__init__(self, session)
        self.server, self.name, self.folder = server, name, folder
        session.chapter.name = name
        self.stale, self.frame_time, self.began = True, FRAME, time.perf_counter()
        self.recorder: Recorder | None = None
        self.own = False  # whether the page started the recorder
        self.movie: Film | None = None
        self.described = ""
        server.publish("scenes", json.dumps({"scenes": described.scenes()}))
        self.number = 0  # of rosters so far
        self.open()

    def open(self) -> None:
        """Another scene; a film ends with the one before."""
        if self.movie:
            self.film()
        self.pace, self.measured, self.measured_at = Pace(), {}, 0.0
        self.before: dict[str, Any] = {}  # what was measured before
        self.watched: dict[str, Any] = {}
        self.planes: Planes | None = None
        self.roster: Any = None

    def wait(self, text: str) -> None:
        """Says that something may take a while."""
        self.server.publish("state", json.dumps({"wait": f"{text} …"}))

    def run(self) -> None:
        """Until it is interrupted."""
        try:
            while True:
                now = time.perf_counter()
                self.frame_time, self.began = now - self.began, now
                self.tick()
                time.sleep(max(0.0, FRAME - (time.perf_counter() - now)))
        finally:
            if self.movie:
                self.movie.close()

    def tick(self) -> None:
        """One frame: inputs, simulation, what is told of it."""
        session = self.session
        self._inputs()
        steps = self.pace.advance(session, self.frame_time, self.due if self.paused else None)
        self.due = 0
        if self.recorder:
            self._record(steps)
        if steps or self.stale or session.stroke:
            self._publish_frame()
        if self.stale or time.perf_counter() - self.measured_at >= MEASURE:
            self._publish_state()
        if self.movie:
            self._shoot()
        self.stale = False

    # what comes in

    def _inputs(self) -> None:
        while not self.server.inputs.empty():
            verb, *given = self.server.inputs.get()
            getattr(self, f"_on_{verb}")(*given)
        if self.session.stroke is not None and self.server.place is not None:
            self.drag(self.server.place)

    def _on_press(self, x: float, y: float, other: bool) -> None:
        self.press((float(x), float(y)), other)

    def _on_move(self, x: float, y: float) -> None:
        self.passes((float(x), float(y)))

    def _on_release(self, x: float, y: float) -> None:
        self.release((float(x), float(y)))

    def _on_cancel(self) -> None:
        self.let_go()

    _on_gone = _on_cancel

    def _on_key(self, name: str) -> None:
        self.key(name)

    def _on_do(self, action: list) -> None:
        self.do(*action)

    def _on_take(self, key: str) -> None:
        if (knob := self._knob(key)) is not None:
            self.take(knob)

    def _on_slide(self, key: str, share: float) -> None:
        if (knob := self._knob(key)) is not None:
            self.slide(knob, share)

    def _on_value(self, key: str, value: float) -> None:
        if (knob := self._knob(key)) is not None:
            self.type_in(knob, value)

    def _on_default(self, key: str) -> None:
        if (knob := self._knob(key)) is not None:
            self.restore(knob)

    def _knob(self, key: str) -> Any:
        return next((knob for knob in self.session.knobs() if knob.key == key), None)

    def _on_grow(self, notches: int) -> None:
        self.grow(max(-10, min(10, notches)))

    def _on_help_out(self) -> None:
        self.help_out()

    def _on_inspect(self, grain: int) -> None:
        """The grain with this id; below 0: none."""
        self.session.watching.grain = grain if grain >= 0 else None
        self.watched, self.stale = {}, True

    def _on_rule(self, *line: float) -> None:
        x0, y0, x1, y1 = map(float, line)
        self.session.watching.line = x0, y0, x1, y1
        self.watched, self.stale = {}, True

    def _on_unrule(self) -> None:
        self.session.watching.line = None
        self.watched, self.stale = {}, True

    def _on_plot(self, name: str, on: bool) -> None:
        self.session.watching.plot(name, on)
        self.watched, self.stale = {}, True

    def _on_scene(self, name: str) -> None:
        self.call("scene", name)

    # what keys do here

    def quit(self) -> None:
        """A page is closed by its own button."""
        self.told = "close the page; Ctrl-C in the terminal ends the program"

    def help(self) -> None:
        """Is the page's own affair."""

    fit = help

    # what goes out

    def _publish_frame(self) -> None:
        session = self.session
        sim, look = session.sim, session.look
        if self.planes is None or self.planes.sim is not sim or self.planes.world is not sim.world:
            self.planes = Planes(sim)
        color = look["color"]
        views = () if look["chains"] or color in (KIND, PHOTOELASTIC, *DRAWN) else (color,)
        start = time.perf_counter()
        state = self.planes.state(views, chains=bool(look["chains"] or look["forces"]))
        if state.roster is not self.roster:
            self.roster, self.number = state.roster, self.number + 1
            self.server.publish("roster", message({"kind": "roster", "roster": self.number}, state.roster.planes()))
        self.server.publish("frame", frame(session, state, self.number))
        self.pace.stage("show", time.perf_counter() - start)

    def _publish_state(self) -> None:
        now = time.perf_counter()
        if now - self.measured_at >= MEASURE:
            self.before, self.measured = self.measured, numbers.measure(self.session, self.measured)
            self.measured_at, self.watched = now, {}
        self.watched = self.watched or self.session.watching.look(self.session, self.measured, self.before)
        pace = self.pace
        self.measured |= {"frames": pace.frames, "real_time": pace.factor, "paused": self.paused, "cost": pace.cost / self.session.sim.step}
        self.measured["stages"] = dict(pace.stages)
        panel = json.dumps(finite({"panel": described.panel(self.session)}))
        if panel != self.described:
            self.described = panel
            self.server.publish("panel", panel)
        state = described.state(self.session, self.measured, self.session.message or self.told)
        state |= {"filming": self.movie is not None, "recording": self.recorder is not None, "name": self.name}
        state |= {"serving_s": self.server.seconds, "watched": self.watched, "plots": sorted(self.session.watching.plots)}
        self.server.publish("state", json.dumps(finite({"state": state})))


def play(scene: Scene, name: str, *, folder: Path, host: str, port: int, record: Path | None, arch: str, threads: int | None) -> None:
    """Serves the page and plays until Ctrl-C or SIGTERM; the address is printed. Arguments as for Session and Server.

    Raises:
        SandError: the library websockets is not there, the address cannot be had, or the recording could not be written to its end.
    """
    folder.mkdir(parents=True, exist_ok=True)
    server = Server(live_page(), host, port)
    try:
        print(f"open {server.url}", flush=True)
        server.publish("state", json.dumps({"wait": f"making {scene.title or name} ready …"}))
        browser = Browser(Session(scene, arch=arch, threads=threads), name, server, folder)
        if record is not None:
            browser.recorder = Recorder(browser.session, record)
        try:
            browser.run()
        finally:
            if browser.recorder is not None:
                browser.recorder.lines.close()
    finally:
        server.close()
        if os.name == "posix":
            sys.stdout.flush()
