"""What keys, buttons and the hand do, of whatever face: each becomes an action of the session, or something that the face does."""

from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.play import files
from taichi_sand.play.keys import BY_KEY
from taichi_sand.play.knobs import Knob
from taichi_sand.play.session import Session
from taichi_sand.scene import loading
from taichi_sand.view.views import views_of

WHEEL = 1.15
"""The brush grows by this factor a notch."""
SMOOTH = 0.35
"""Share of the newest frame in the velocity of the hand."""
SPEEDS = (0.05, 4.0)
Place = tuple[float, float]


class Commands:
    """What the user does. The `face` has a `name` and a `folder` for files, the `frame_time` [s], and can `wait(text)` and `open()`
    for another scene; `stale` is set where it must be shown anew. Places are in metres.
    """

    def __init__(self, face: Any, session: Session) -> None:
        self.face, self.session = face, session
        self.paused = False
        self.due = 0  # steps to do although it is paused
        self.last: Place = (0.0, 0.0)  # where the hand was
        self.motion: Place = (0.0, 0.0)  # and how it moved
        self.told = ""  # what there is to say besides the session's message

    def key(self, name: str) -> None:
        """What a key does; nothing if it does nothing."""
        if name in BY_KEY:
            self.call(BY_KEY[name].call, *BY_KEY[name].arguments)

    def call(self, name: str, *arguments: Any) -> None:
        """Does what a key or button says; what cannot be done is told."""
        self.told = ""
        try:
            getattr(self, name)(*arguments)
        except (SandError, OSError) as error:
            self.tell(error)

    def tell(self, error: Exception) -> None:
        """Tells what cannot be done."""
        self.told = str(error)

    def do(self, *action: Any) -> None:
        """An action of the session."""
        self.told = ""
        if action[0] in ("solver", "effect", "open", "undo", "redo", "reset", "load"):
            self.face.wait("compiling …" if action[0] in ("solver", "effect", "open") else "")
        self.session.do(list(action))
        self.face.stale = True

    # the hand

    def press(self, place: Place, other: bool) -> None:
        """A button goes down at a place; `other`: the right one."""
        if self.session.stroke is None:
            self.motion, self.last = (0.0, 0.0), place
            self.do("stroke", "press", *place, 0.0, 0.0, other)

    def drag(self, place: Place) -> None:
        """Once a frame while a button is down, even if the hand stands still."""
        if self.session.stroke is not None:
            self.session.do(["stroke", "drag", *place, *self._motion(place)])
            self.last = place

    def release(self, place: Place) -> None:
        """The button comes up."""
        if self.session.stroke is not None:
            self.do("stroke", "release", *place, *self._motion(place))

    def let_go(self) -> None:
        """The button comes up where the hand was last."""
        self.release(self.last)

    def _motion(self, place: Place) -> Place:
        """Velocity of the hand in simulated time [m/s], smoothed over some frames: a mouse reports in jerks."""
        time = max(self.face.frame_time * self.session.speed, 1e-3)
        x, y = ((now - before) / time for now, before in zip(place, self.last, strict=True))
        self.motion = (self.motion[0] + SMOOTH * (x - self.motion[0]), self.motion[1] + SMOOTH * (y - self.motion[1]))
        return self.motion

    # sliders

    def take(self, knob: Knob) -> None:
        """A slider is taken hold of; what it changes can be undone."""
        if not knob.key.startswith("tool."):
            self.do("mark")

    def slide(self, knob: Knob, share: float) -> None:
        """A slider is moved to this place, 0 .. 1."""
        value = knob.value(share, self.session.opened)
        if value != self.session.value(knob.key):
            self.do("set", knob.key, value)

    def grow(self, notches: int) -> None:
        """The wheel makes the brush larger."""
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
        self.face.stale = True

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

    # files

    def save(self) -> None:
        """A checkpoint to go back to, or to go on from with `run --resume`."""
        path = self.face.folder / f"{self.face.name}.npz"
        files.save(self.session, path)
        self.told = f"saved {path.name}"

    def load(self) -> None:
        """Back to what was saved."""
        path = self.face.folder / f"{self.face.name}.npz"
        data = files.read(path)
        self.do("load", data)
        self.told = self.told or f"loaded {path.name}"

    def other_scene(self, step: int) -> None:
        """The next scene of those bundled, or the one before."""
        names = list(loading.bundled())
        number = names.index(self.face.name) + step if self.face.name in names else 0
        self.scene(names[number % len(names)])

    def scene(self, name: str) -> None:
        """A bundled scene."""
        self.do("open", loading.load(name).to_json())
        self.face.name = name
        self.face.open()
