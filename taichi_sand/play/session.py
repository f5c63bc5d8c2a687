"""A simulation that is being played with.

The only way in is `do(action)`, a list [verb, arguments…] that JSON can hold: so all can be undone, recorded and done again.
"""

import base64
import gc
import hashlib
import json
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.play import calls, knobs, transfer
from taichi_sand.play.brush import Brush
from taichi_sand.play.chapter import Chapter
from taichi_sand.play.history import History
from taichi_sand.play.rewind import Rewind
from taichi_sand.play.snapshot import Snapshot, restore, take, to_bytes
from taichi_sand.play.stroke import Stroke
from taichi_sand.play.verbs import VERBS
from taichi_sand.play.watching import Watching
from taichi_sand.run import live
from taichi_sand.run.saving import laid_out
from taichi_sand.run.simulation import Simulation
from taichi_sand.scene.schema import Scene
from taichi_sand.scene.walls import Wall
from taichi_sand.taichi_support import runtime
from taichi_sand.view.views import KIND, views_of

Key = tuple[Chapter, str, tuple[Wall, ...]]
"""What of a simulation its tables and kernels are made for: the scene that was opened, its structure, its first walls."""


FIRST_TOOL = "grab"


class Session:
    """A scene being played.

    Args:
        scene: what is played.
        arch, threads: as for Simulation.
    """

    def __init__(self, scene: Scene, *, arch: str = "cpu", threads: int | None = None) -> None:
        self.where = {"arch": arch, "threads": threads}
        self.log: list[list] | None = None  # what was done since the last `take_log`, for recordings
        self.before_action: Callable[[], None] | None = None  # is called before an action is logged
        self.doing = False  # whether an action is being done
        self.making = False  # whether a simulation is being made: what is raised then leaves all as it was
        self.counted = 0  # steps, the last time that they were
        self.history, self.rewind, self.watching = History(), Rewind(), Watching()
        self.built: dict[Key, Simulation] = {}  # what is ready to be gone on with
        self.sim: Simulation = None  # type: ignore[assignment]  # until one is made
        self.message = ""
        self.offer: tuple[str, list] | None = None  # what would help where something was refused: its name, and the action
        self.stroke: Stroke | None = None
        self.open(scene)

    def open(self, scene: Scene) -> None:
        """Starts another scene, or the same anew. SandError if it cannot be simulated, and then all is as it was."""
        before, chapter = self.moment() if self.sim else None, Chapter(scene)
        sim = self._make(scene)
        if before:
            self.history.keep(before)
        chapter.room, chapter.brush = sim.room, Brush.of(sim)
        self.built[chapter, live.structure(scene), sim.first_walls] = sim
        self._enter(chapter)
        self._listen_to(sim)
        self.opened = False  # sliders reach unphysical values
        self.physical: dict[str, float] = {}  # values that were there before they became unphysical, by key
        self.speed = 1.0
        self.rng = np.random.default_rng(scene.seed)
        self._knobs: tuple = (None, [])
        self.tool, self.stroke = FIRST_TOOL, None
        chapter.start = self.moment()

    def _enter(self, chapter: Chapter) -> None:
        """Plays this scene."""
        self.chapter, self.home, self.look, self.brush = chapter, chapter.home, chapter.look, chapter.brush
        self.rewind.forget()
        self.watching.forget()

    def drop(self) -> None:
        """Lets go of all simulations, and of Taichi's memory."""
        self.built = {}
        self.sim = None  # type: ignore[assignment]
        gc.collect()
        if not runtime.alive:
            runtime.forget()

    def do(self, action: list) -> None:
        """Does one action. What cannot be done leaves a sentence in `message`, and what would help in `offer`; both stay to the end of a
        stroke.
        """
        self._note(action)
        if action[:2] not in (["stroke", "drag"], ["stroke", "release"], ["snap"]):
            self.message, self.offer = "", None
        self.doing, before = True, self.sim.steps
        try:
            VERBS[action[0]](self, *action[1:])
        except SandError as error:
            self.message = str(error)
        finally:
            self.doing = False
            self.counted += self.sim.steps - before  # it has gone to another moment

    def _note(self, action: list) -> None:
        """Something is done, after the steps until now."""
        if self.log is not None:
            if self.before_action:
                self.before_action()
            self.log.append(action)

    def take_log(self) -> list[list]:
        """What was done since the last call."""
        done, self.log = self.log or [], []
        return done

    def advance(self, steps: int) -> None:
        """Simulates on; events that come are told."""
        before = self.sim.events
        self.sim.advance_steps(steps)
        come = [f"{name} at {time:.2f} s" for name, time in self.sim.events.items() if name not in before]
        if come:
            self.message = ", ".join(come) + ("; the simulation ends here" if self.sim.stopped else "")

    def made(self) -> int:
        """Steps simulated since the last call of this."""
        made, self.counted = self.sim.steps - self.counted, self.sim.steps
        return made

    def _listen_to(self, sim: Simulation) -> None:
        """Goes on with `sim`, and hears what is called of it."""
        self.sim, ear = sim, weakref.WeakMethod(self._heard)

        def hear(*call: Any) -> None:
            if heard := ear():
                heard(*call)

        sim.heard = hear

    def keep_built(self) -> None:
        """What was called may have changed the structure of the simulation."""
        key = self.chapter, live.structure(self.sim.scene), self.sim.first_walls
        self.built = {other: sim for other, sim in self.built.items() if sim is not self.sim} | {key: self.sim}

    def _heard(self, name: str, args: tuple, named: dict[str, Any]) -> None:
        """Something was called from outside of `do`."""
        if self.doing:
            return
        self.keep_built()
        if name in calls.CALLS:
            self._note(calls.action_of(name, args, named))

    # moments

    def moment(self, like: Snapshot | None = None) -> Snapshot:
        """All of it at this moment; it shares tables with `like`, or with the moment that was kept last, where they are the same."""
        moment = take(self.sim, like or self.history.last())
        moment.session = {"rng": self.rng.bit_generator.state, "physical": dict(self.physical)}
        moment.chapter = self.chapter
        return moment

    def go_to(self, moment: Snapshot) -> None:
        """Goes to a moment, bit for bit, of another scene too. SandError if it cannot be one, and then all is as it was."""
        chapter = moment.chapter or self.chapter
        before = self.moment() if moment.foreign else None
        sim = self._ready(chapter, moment.host.scene, moment.walls)
        try:
            restore(sim, moment)
        except BaseException:
            if not self.sim and before:
                self.go_to(before)
            raise
        if chapter is not self.chapter:
            self._enter(chapter)
        self._take(sim)
        if "rng" in moment.session:
            self.rng.bit_generator.state = moment.session["rng"]
        self.physical = dict(moment.session.get("physical", {}))
        self.stroke = None

    def digest(self) -> str:
        """Hash of where all grains are and how they move, bit by bit, and of the walls."""
        total = hashlib.sha256()
        world = self.sim.world
        count = world.count[None]
        for name in ("id", "site", "offset", "shift", "twist", "angle", "turn", "mobility"):
            total.update(np.ascontiguousarray(getattr(world.grains, name).to_numpy()[:count]).tobytes())
        total.update(json.dumps([wall.model_dump() for wall in self.sim.scene.walls]).encode())
        return total.hexdigest()[:16]

    # structures

    def _ready(self, chapter: Chapter, scene: Scene, walls: tuple[Wall, ...]) -> Simulation:
        """A simulation of the structure that `scene` wants, with tables made for these walls; its state is still to be set."""
        key = (chapter, live.structure(scene), tuple(walls))
        if key not in self.built:
            self.built[key] = self._make(laid_out(scene, walls), room=chapter.room)
        if not chapter.room:
            chapter.room, chapter.brush = self.built[key].room, Brush.of(self.built[key])
        return self.built[key]

    def _make(self, scene: Scene, room: int = 0) -> Simulation:
        """A new simulation beside those there are, or in their place once they have taken as much memory as they may: Taichi gives back
        that of single ones never. What cannot be made leaves what there was.
        """
        now = None
        if self.sim and (runtime.full() or scene.solver.precision != self.sim.scene.solver.precision):
            now = self.moment()
            self.drop()
        self.making = now is None
        try:
            return Simulation(scene, **self.where, room=room, hand=True)
        except BaseException:
            self.making = False
            if now:
                self.go_to(now)
            raise
        finally:
            self.making = False

    def become(self, scene: Scene) -> None:
        """Goes on with another solver or other effects, on the grains as they are; that can be undone."""
        walls, before = self.sim.first_walls, self.moment()
        if (self.chapter, live.structure(scene), walls) not in self.built and runtime.full():
            self.drop()
            self.go_to(before)
        if self.sim.world.sleeps:
            self.sim.renew()  # wakes everybody
        now, new = self.moment(), self._ready(self.chapter, scene, walls)
        if new is not self.sim:
            transfer.hand_over(self.sim, new, now, scene)
            self._take(new)
        else:
            self.sim.retune(scene)
        self.history.keep(before)

    def _take(self, sim: Simulation) -> None:
        """Goes on with `sim`; colours that it has not are shown no more."""
        self._listen_to(sim)
        if self.look["color"] not in views_of(sim.world):
            self.look["color"] = KIND

    # values

    def value(self, key: str) -> float:
        """Value of a knob."""
        if key == "time":
            return self.speed
        if key.startswith("tool."):
            return getattr(self.brush, key[5:])
        return self.sim.get(key)

    def unphysical(self) -> list[str]:
        """What lies beyond its declared range, in words, with the reason why that is unphysical."""
        known = {knob.key: knob for knob in self.knobs()}
        why = {key: f" ({known[key].why(value)})" if key in known else "" for key, value in self.sim.over.items()}
        return [f"{key.split('.', 1)[1]} = {value:g}{why[key]}" for key, value in self.sim.over.items()]

    def knobs(self) -> list[knobs.Knob]:
        """Everything with a slider."""
        key = (live.structure(self.sim.scene), id(self.sim))
        if self._knobs[0] != key:
            self._knobs = key, knobs.knobs_of(self.sim.scene, self.home) + self.brush.knobs(self.sim)
        return self._knobs[1]


def pack(moment: Snapshot) -> str:
    """A moment as text, for ["load", …]."""
    return base64.b64encode(to_bytes(moment)).decode()
