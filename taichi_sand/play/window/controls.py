"""From the mouse and the keys of the window to commands."""

import time
from typing import Any

import taichi as ti

from taichi_sand.play import files
from taichi_sand.play.commands import Commands
from taichi_sand.play.window.panel import SCROLL
from taichi_sand.play.window.parts import Zone

SCROLLED = 40
"""The panel moves by so many pixels a notch."""
DOUBLE = 0.35
"""Two clicks within this time are a double click [s]."""
NUMBER = "0123456789+-.,e"
"""Keys that make a number."""
ASK = "quit? esc or enter: yes, any other key: no"


class Controls(Commands):
    """What the user does, of one window."""

    def __init__(self, window: Any) -> None:
        super().__init__(window, window.session)
        self.window = window
        self.zone: Zone | None = None  # what is held by the mouse
        self.panning: tuple[float, float] | None = None  # where the mouse was, while the picture is moved
        self.clicked = ("", 0.0)  # what was pressed last, and when
        self.asking = False  # whether to quit

    def handle(self, event: Any, x: float, y: float) -> None:
        """One event of the window, the mouse at the pixel (x, y), y down."""
        if event.key in (ti.GUI.LMB, ti.GUI.RMB):
            if event.type == ti.GUI.PRESS:
                self._press(x, y, event.key == ti.GUI.RMB)
            else:
                self._release(x, y)
        elif event.key == ti.GUI.MMB:
            self.panning = (x, y) if event.type == ti.GUI.PRESS and self.window.screen.shows(x, y) else None
        elif event.key == ti.GUI.MOVE:
            self._move(x, y)
        elif event.key == ti.GUI.WHEEL:
            self._wheel(x, y, 1 if event.delta[1] > 0 else -1, "Shift" in event.modifier)
        elif event.key == ti.GUI.EXIT:
            self.window.running = False
        elif event.type == ti.GUI.PRESS:
            self._key(event.key)

    def tell(self, error: Exception) -> None:
        """As of any face; what a window that is no more cannot tell is raised."""
        if not self.window.gui:
            raise error
        super().tell(error)

    # mouse

    def under(self, x: float, y: float) -> Zone | None:
        """What of the panel, or of what is offered over the picture, lies at a pixel."""
        screen = self.window.screen
        return screen.panel.under(x, y) or next((zone for zone in screen.zones if zone.holds(x, y)), None)

    def _press(self, x: float, y: float, other: bool) -> None:
        self._keep_typed()
        self.asking = False
        zone, panel = self.under(x, y), self.window.screen.panel
        if zone is None:
            if self.window.screen.shows(x, y):
                self.press(self.window.screen.place(x, y), other)
            return
        self.zone, panel.pressed, self.window.stale = zone, zone.name, True
        now, (name, before) = time.perf_counter(), self.clicked
        self.clicked = (zone.name, now)
        if zone.knob and name == zone.name and now - before < DOUBLE:
            self.zone, self.clicked = None, ("", 0.0)
            self.restore(zone.knob)
        elif zone.knob:
            self.take(zone.knob)
            self._slide(x)
        elif zone.name == SCROLL:
            panel.scroll_to(y)
        elif zone.action:
            self.do(*zone.action)
        else:
            self.call(*zone.call)

    def _release(self, x: float, y: float) -> None:
        if self.zone is not None:
            if self.zone.knob:
                self._slide(x)
            self.zone, self.window.screen.panel.pressed, self.window.stale = None, "", True
        elif self.session.stroke is not None:
            self.release(self.window.screen.place(x, y))

    def _move(self, x: float, y: float) -> None:
        """The mouse passes a pixel."""
        if self.panning is not None:
            self.window.screen.pan(x - self.panning[0], y - self.panning[1])
            self.panning, self.window.stale = (x, y), True
        elif self.zone is None:
            self.passes(self.window.screen.place(x, y))

    def held(self, x: float, y: float) -> None:
        """Once a frame: what goes on while a button is held."""
        if self.zone is not None:
            if self.zone.knob:
                self._slide(x)
            elif self.zone.name == SCROLL:
                self.window.screen.panel.scroll_to(y)
                self.window.stale = True
        elif self.session.stroke is not None:
            self.drag(self.window.screen.place(x, y))

    def _slide(self, x: float) -> None:
        zone = self.zone
        assert zone and zone.knob
        if all(other.key != zone.knob.key for other in self.session.knobs()):
            self.zone = None  # its effect has been undone under the hand
            return
        self.slide(zone.knob, zone.share(x))

    def _wheel(self, x: float, y: float, notches: int, shift: bool) -> None:
        screen = self.window.screen
        if x >= screen.wide:
            screen.panel.scroll(-SCROLLED * notches)
        elif shift:
            self.grow(notches)
        else:
            screen.zoom(notches, x, y)
        self.window.stale = True

    # keys

    def _key(self, name: str) -> None:
        """A key goes to the number that is being typed, to the question whether to quit, or does what it does."""
        asked, self.asking = self.asking, False
        if self.window.screen.panel.typed is not None:
            self._type(name)
        elif asked:
            self.window.running = name not in ("Escape", "Return")
            self.told = ""
        else:
            self.key(name)
        self.window.stale = True

    def edit(self, knob: Any) -> None:
        """A value for a slider is to be typed."""
        self.window.screen.panel.typed = (knob.key, "")
        self.told = f"{knob.label}: type a value, enter takes it"

    def _type(self, name: str) -> None:
        panel = self.window.screen.panel
        key, text = panel.typed
        if name in ("Return", "KP_Enter"):
            self._keep_typed()
        elif name == "Escape":
            panel.typed, self.told = None, ""
        elif name == "BackSpace":
            panel.typed = (key, text[:-1])
        elif name in NUMBER:
            panel.typed = (key, text + name)

    def _keep_typed(self) -> None:
        """What was typed becomes the value, if it is a number."""
        panel = self.window.screen.panel
        if panel.typed is None:
            return
        (key, text), panel.typed, self.told = panel.typed, None, ""
        knob = next((knob for knob in self.session.knobs() if knob.key == key), None)
        try:
            value = float(text.replace(",", ".")) if text else None
        except ValueError:
            self.told = f"{text} is no number"
            return
        if knob is not None and value is not None:
            self.call("type_in", knob, value)

    def fit(self) -> None:
        """Shows all of the box."""
        self.window.screen.look(self.window.screen.home)

    def help(self) -> None:
        """Shows the keys, or hides them."""
        self.window.screen.help = not self.window.screen.help
        self.window.stale = True

    def quit(self) -> None:
        """Closes what is open; with nothing open, asks whether to close the window."""
        if self.window.screen.help:
            self.help()
        else:
            self.asking, self.told = True, ASK

    # files

    def picture(self) -> None:
        """Saves what the window shows."""
        self.told = f"saved {files.save_picture(self.window).name}"

    def film(self) -> None:
        """Starts a film, or ends it."""
        if self.window.film is None:
            self.window.film = files.Film(files.free_name(self.window.folder, self.window.name, ".mp4"))
            self.told = "filming"
        else:
            film, self.window.film = self.window.film, None
            self.told = f"saved {film.close().name}"
