"""What keys, buttons and the hand do, of whatever face: each becomes an action of the session, or something that the face does."""

from itertools import pairwise
from typing import Any

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.play import files, wall_tools
from taichi_sand.play.actions import LARGEST
from taichi_sand.play.keys import BY_KEY
from taichi_sand.play.knobs import Knob
from taichi_sand.play.session import Session
from taichi_sand.scene import loading
from taichi_sand.scene.schema import Scene
from taichi_sand.view.views import views_of

WHEEL = 1.15
"""The brush grows by this factor a notch."""
SMOOTH = 0.35
"""Share of the newest frame in the velocity of the hand."""
SPEEDS = (0.05, 4.0)
SLOW = ("solver", "effect", "open", "undo", "redo", "reset", "load", "back")
"""Actions that may have something compiled."""
STRAIGHT, MOST_PLACES = 0.002, 64
"""The way of the hand between two frames is followed by straight parts that are nowhere farther off than this share of the box, and a tool
with a brush works at so many places of it at most."""
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
        self.way: list[Place] = []  # where it has passed since
        self.motion: Place = (0.0, 0.0)  # and how it moved
        self.opening = ""  # name of the scene that is being opened
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
        self.told, chapter = "", self.session.chapter
        if action[0] in SLOW:
            self.face.wait(self.opening if action[0] == "open" else str(action[1]) if action[0] in ("solver", "effect") else action[0])
        self.session.do(list(action))
        self.face.stale = True
        if self.session.chapter is not chapter:
            name = self.opening if action[0] == "open" else self.session.chapter.name
            self.session.chapter.name = self.face.name = name or self.face.name
            self.face.open()

    # the hand

    def press(self, place: Place, other: bool) -> None:
        """A button goes down at a place; `other`: the right one."""
        if self.session.stroke is None:
            self.motion, self.last, self.way = (0.0, 0.0), place, []
            self.do("stroke", "press", *place, 0.0, 0.0, other)

    def passes(self, place: Place) -> None:
        """The hand passes a place between two frames, while a button is down."""
        if self.session.stroke is not None and self.session.stroke.tool.follows:
            self.way.append(place)

    def drag(self, place: Place) -> None:
        """Once a frame while a button is down, even if the hand stands still."""
        if self.session.stroke is not None:
            motion = self._motion(place)
            for passed in (*self._passed(place), place):
                self.session.do(["stroke", "drag", *passed, *motion])
            self.last, self.way = place, []

    def release(self, place: Place) -> None:
        """The button comes up."""
        if self.session.stroke is not None:
            motion = self._motion(place)
            for passed in self._passed(place):
                self.session.do(["stroke", "drag", *passed, *motion])
            self.way = []
            self.do("stroke", "release", *place, *motion)

    def _passed(self, place: Place) -> list[Place]:
        """The corners of the way of the hand since the last frame; where the tool has a brush, with places between them, so that none is
        left out however slow the frames are.
        """
        tool = self.session.stroke.tool if self.session.stroke else None
        if tool is None or not tool.follows:
            return []
        corners = wall_tools.straightened(np.array([self.last, *self.way, place]), STRAIGHT * min(self.session.sim.scene.size))
        places = [corners[0]]
        for start, end in pairwise(corners):
            far = np.hypot(*(end - start)) / self.session.brush.size if tool.uses else 0.0
            parts = max(1, min(MOST_PLACES, int(far) + 1))
            places += [start + (end - start) * part / parts for part in range(1, parts + 1)]
        return [(float(x), float(y)) for x, y in places[1:-1]]

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

    def type_in(self, knob: Knob, value: float) -> None:
        """A value for a slider is typed; SandError if it is none that it may have."""
        if not abs(value) <= LARGEST:
            raise SandError(f"{value:g} is no value for {knob.label}")
        bounded = knob.bounded(value, self.session.opened)
        self.take(knob)
        self.do("set", knob.key, value)
        if bounded != value:
            low, high = knob.limits()
            self.told = f"{knob.label} lies in {low:g} … {high:g} {knob.unit}".rstrip()

    def restore(self, knob: Knob) -> None:
        """A slider goes back to what the scene says."""
        self.take(knob)
        self.do("default", knob.key)

    def help_out(self) -> None:
        """Does what was offered when something was refused."""
        if self.session.offer:
            self.do(*self.session.offer[1])

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

    def rewinding(self) -> None:
        """Keeps moments to go back to, or no more."""
        self.do("rewinding", not self.session.rewind.on)

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
        self.start(loading.load(name), name)

    def start(self, scene: Scene, name: str) -> None:
        """Another scene, under this name."""
        self.opening = name
        self.do("open", scene.to_json())
