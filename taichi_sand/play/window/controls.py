"""From the mouse and the keys to actions."""

from typing import Any

import taichi as ti

from taichi_sand.errors import SandError
from taichi_sand.play import files
from taichi_sand.play.keys import BY_KEY
from taichi_sand.play.window.panel import Zone
from taichi_sand.scene import loading
from taichi_sand.view.views import views_of

WHEEL = 1.15
"""The brush grows by this factor a notch."""
SCROLL = 40
"""The panel moves by so many pixels a notch."""
SMOOTH = 0.35
"""Share of the newest frame in the velocity of the hand."""
SPEEDS = (0.05, 4.0)


class Controls:
    """What the user does, of one window."""

    def __init__(self, window: Any) -> None:
        self.window, self.session = window, window.session
        self.paused = False
        self.due = 0  # steps to do although it is paused
        self.zone: Zone | None = None  # the slider that is being dragged
        self.other = False  # the right button
        self.last = (0.0, 0.0)  # where the hand was
        self.motion = (0.0, 0.0)  # and how it moved
        self.told = ""  # what there is to say besides the session's message

    def handle(self, event: Any, x: float, y: float) -> None:
        """One event of the window, the mouse at the pixel (x, y), y down."""
        if event.key in (ti.GUI.LMB, ti.GUI.RMB):
            if event.type == ti.GUI.PRESS:
                self._press(x, y, event.key == ti.GUI.RMB)
            else:
                self._release(x, y)
        elif event.key == ti.GUI.WHEEL:
            self._wheel(x, 1 if event.delta[1] > 0 else -1)
        elif event.key == ti.GUI.EXIT:
            self.quit()
        elif event.type == ti.GUI.PRESS and event.key in BY_KEY:
            key = BY_KEY[event.key]
            self.call(key.call, *key.arguments)

    def call(self, name: str, *arguments: Any) -> None:
        """Does what a key or button says; what cannot be done is told."""
        self.told = ""
        try:
            getattr(self, name)(*arguments)
        except (SandError, OSError) as error:
            if not self.window.gui:  # there is nowhere to tell it
                raise
            self.told = str(error)

    def do(self, *action: Any) -> None:
        """An action of the session."""
        self.told = ""
        if action[0] in ("solver", "effect", "open", "undo", "redo", "reset", "load"):
            self.window.wait("compiling …" if action[0] in ("solver", "effect", "open") else "")
        self.session.do(list(action))
        self.window.stale = True

    # mouse

    def _press(self, x: float, y: float, other: bool) -> None:
        zone = self.window.screen.panel.under(x, y)
        if zone is not None:
            if zone.knob:
                self.zone = zone
                if not zone.knob.key.startswith("tool."):
                    self.do("mark")
                self._slide(x)
            elif zone.action:
                self.do(*zone.action)
            else:
                self.call(*zone.call)
        elif x < self.window.screen.picture[0] and self.session.stroke is None:
            self.motion = (0.0, 0.0)
            place = self.last = self.window.screen.place(x, y)
            self.do("stroke", "press", *place, 0.0, 0.0, other)

    def _release(self, x: float, y: float) -> None:
        if self.zone is not None:
            self._slide(x)
            self.zone = None
        elif self.session.stroke is not None:
            place = self.window.screen.place(x, y)
            self.do("stroke", "release", *place, *self._motion(place))

    def held(self, x: float, y: float) -> None:
        """Once a frame: what goes on while a button is held."""
        if self.zone is not None:
            self._slide(x)
        elif self.session.stroke is not None:
            place = self.window.screen.place(x, y)
            self.session.do(["stroke", "drag", *place, *self._motion(place)])
            self.last = place

    def _motion(self, place: tuple[float, float]) -> tuple[float, float]:
        """Velocity of the hand in simulated time [m/s], smoothed over some frames: a mouse reports in jerks."""
        time = max(self.window.frame_time * self.session.speed, 1e-3)
        new = ((now - before) / time for now, before in zip(place, self.last, strict=True))
        self.motion = tuple(old + SMOOTH * (value - old) for old, value in zip(self.motion, new, strict=True))
        return self.motion

    def _slide(self, x: float) -> None:
        knob = self.zone.knob
        if all(other.key != knob.key for other in self.session.knobs()):
            self.zone = None  # its effect has been undone under the hand
            return
        value = knob.value(self.zone.share(x), self.session.opened)
        if value != self.session.value(knob.key):
            self.do("set", knob.key, value)

    def _wheel(self, x: float, notches: int) -> None:
        if x >= self.window.screen.picture[0]:
            self.window.screen.panel.scroll(-SCROLL * notches)
            self.window.stale = True
        else:
            self.do("set", "tool.size", self.session.brush.size * WHEEL**notches)

    # keys

    def choose(self, tool: str) -> None:
        """Another tool."""
        self.do("choose", tool)

    def next_kind(self) -> None:
        """Another kind of grain for create and pour."""
        self.do("kind", 1)

    def pause(self) -> None:
        """Stops time, or lets it go on."""
        self.paused = not self.paused
        self.window.stale = True

    def single_step(self) -> None:
        """One step of the solver."""
        self.paused, self.due = True, 1

    def single_frame(self) -> None:
        """A sixtieth of a second."""
        self.paused, self.due = True, max(1, round(1 / 60 / self.session.sim.step))

    def reset(self) -> None:
        """Back to the start."""
        self.do("reset")

    def faster(self, factor: float) -> None:
        """Time runs so many times as fast."""
        self.do("set", "time", min(SPEEDS[1], max(SPEEDS[0], self.session.speed * factor)))

    def undo(self) -> None:
        """Takes the last stroke back."""
        self.do("undo")

    def redo(self) -> None:
        """Does it again."""
        self.do("redo")

    def other_solver(self) -> None:
        """md instead of rigid, or the other way round."""
        self.do("solver", "md" if self.session.sim.scene.solver.kind == "rigid" else "rigid")

    def open_ranges(self) -> None:
        """Sliders reach unphysical values, or no more."""
        self.do("opened", not self.session.opened)

    def switch(self, name: str) -> None:
        """Switches a part of the picture on or off."""
        self.do("look", name, not self.session.look[name])

    def next_view(self) -> None:
        """Other colours."""
        names = views_of(self.session.sim.world)
        self.do("look", "color", names[(names.index(self.session.look["color"]) + 1) % len(names)])

    def help(self) -> None:
        """Shows the keys, or hides them."""
        self.window.screen.help = not self.window.screen.help
        self.window.stale = True

    def quit(self) -> None:
        """Closes the window."""
        self.window.running = False

    # files

    def save(self) -> None:
        """A checkpoint to go back to, or to go on from with `run --resume`."""
        path = self.window.folder / f"{self.window.name}.npz"
        files.save(self.session, path)
        self.told = f"saved {path.name}"

    def load(self) -> None:
        """Back to what was saved."""
        path = self.window.folder / f"{self.window.name}.npz"
        data = files.read(path)
        self.do("load", data)
        self.told = self.told or f"loaded {path.name}"

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

    def other_scene(self, step: int) -> None:
        """The next scene of those bundled, or the one before."""
        names = list(loading.bundled())
        number = names.index(self.window.name) + step if self.window.name in names else 0
        name = names[number % len(names)]
        self.do("open", loading.load(name).to_json())
        self.window.name = name
        self.window.open()
