"""Events of a scene as they come while it is simulated: what has come, what the next ones wait for, and what each changes.

When one comes follows from the scene and this record alone, at the step nearest to its time: a run that is interrupted, saved or undone has
the same stages.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

from pydantic import ValidationError

from taichi_sand.errors import SandError, show
from taichi_sand.run import live
from taichi_sand.run.calling import FOR, slow
from taichi_sand.run.entry import changes
from taichi_sand.run.overlaps import with_walls
from taichi_sand.scene.events import After, Event, all_walls, live_changes, names, staged, waiting
from taichi_sand.scene.moving import corners, motion, moves
from taichi_sand.scene.nearby import images, segments
from taichi_sand.scene.schema import Scene
from taichi_sand.taichi_support.turns import turn
from taichi_sand.world.sources import Flow
from taichi_sand.world.walls.build import structure_fits
from taichi_sand.world.walls.motion import hours

LOOK = 0.01
"""Time between two looks at whether grains are at rest, while an event waits for that [s]."""


@dataclass(frozen=True)
class Stages:
    """What has come of the events of a scene."""

    began: float  # time that those of events count from [s]
    times: tuple[float | None, ...]  # when each came [s]; None: it has not
    flows: tuple[Flow, ...]  # of each source
    looks: int = 0  # at whether grains are at rest, since the beginning
    slow: float | None = None  # since when they have been, as those found [s]

    @classmethod
    def of(cls, scene: Scene, began: float = 0.0) -> Self:
        """Those of a scene that begins at this time [s]."""
        idle = waiting(scene)
        flows = tuple(Flow(None if source.name in idle else began, 0) for source in scene.sources)
        return cls(began, (None,) * len(scene.events), flows)

    def to_json(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return asdict(self) | {"flows": [list(flow) for flow in self.flows]}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """What `to_json` gave; KeyError or TypeError if it is something else."""
        return cls(**{**data, "times": tuple(data["times"]), "flows": tuple(Flow(*flow) for flow in data["flows"])})


def laid_walls(scene: Scene) -> tuple[Any, ...]:
    """The walls that tables are made for: those of `scene`, and what events will make of them."""
    return all_walls(scene.walls, scene.events)


def check_live_keys(scene: Scene) -> None:
    """SandError unless events may set what they set of live numbers, one after the other."""
    now = scene
    for number, event in enumerate(scene.events):
        for key, value in live_changes(event).items():
            try:
                now = live.written(now, key, value)
            except SandError as error:
                text = str(error).removeprefix(f"{scene.source}: ")
                raise scene.error(f"events[{number}].set", f"{show(key)} = {show(value)}: {text}") from None


class Staged:
    """The side of `Simulation` that sees to events."""

    scene: Scene
    stages: Stages
    world: Any
    bed: Any
    time: float
    step: float
    home: Scene
    set: Any
    set_walls: Any
    retune: Any
    _discs: Any

    @changes
    def restage(self, scene: Scene) -> None:
        """Goes on with the walls, the live numbers and the events of another scene, on the grains as they are. Times of its events count
        from now; a wall that moves as one does that there is goes on with it.

        Raises:
            SandError: it differs in more than what may change, or a wall would cut a grain; then nothing has changed.
        """
        live.check_live(self.scene, scene)
        check_live_keys(scene)
        self._check_fit(scene)
        self.retune(scene.model_copy(update={"walls": self.scene.walls}))
        laid = laid_walls(scene)
        if not structure_fits(self.world, scene.model_copy(update={"walls": laid})):
            self.set_walls(laid)
        self.set_walls(scene.walls)
        made = [int(self.world.flow.made[index]) for index in range(len(scene.sources))]
        stages = Stages.of(scene, self.time)
        flows = tuple(flow._replace(before=count) for flow, count in zip(stages.flows, made, strict=True))
        self.scene = self.home = scene
        self.stages = replace(stages, flows=flows)

    def _check_fit(self, scene: Scene) -> None:
        """SandError if a wall of `scene` would lie deeper in a grain than the tolerance allows, and than one does already."""
        left = {number: motion(wall) for number, wall in enumerate(self.scene.walls) if moves(wall)}
        times, lines = self._hours(), []
        for wall in scene.walls:
            same = next((number for number, other in left.items() if other == motion(wall)), None)
            lines.append(corners(wall, 0.0 if same is None else times[same]))
            left.pop(-1 if same is None else same, None)
        discs = self._discs()
        allowed = max(with_walls(self, discs)[0], scene.solver.tolerance * self.bed.diameter) * (1 + 1e-5)
        overlap, grain = with_walls(self, discs, images(segments(lines), scene.size, scene.periodic))
        if overlap > allowed:
            raise scene.error("walls", f"one would lie {overlap:.3g} m deep in grain {grain}; {allowed:.3g} m is allowed")

    @property
    def events(self) -> dict[str, float]:
        """When each of the scene's events that have come came [s], by name, in the order in which they stand."""
        called = zip(names(self.scene.events), self.stages.times, strict=True)
        return {name: time for name, time in called if time is not None}

    @property
    def stopped(self) -> bool:
        """Whether an event has ended the simulation: nothing more is simulated then."""
        return any(event.stop and time is not None for event, time in zip(self.scene.events, self.stages.times, strict=True))

    def _time_of_event(self, number: int) -> float:
        """When an event that has not come comes, or is looked at next, as far as is known [s]."""
        event, stages = self.scene.events[number], self.stages
        if isinstance(event.at, After):
            before = stages.times[names(self.scene.events).index(event.at.after)]
            return math.inf if before is None else before + event.at.seconds
        if event.at == "rest":
            return math.inf if None in stages.times[:number] else stages.began + (stages.looks + 1) * LOOK
        return stages.began + float(event.at)

    def _next_event(self) -> tuple[float, int]:
        """Time [s] and number of the next one; infinite without any."""
        left = [number for number, time in enumerate(self.stages.times) if time is None]
        return min(((self._time_of_event(number), number) for number in left), default=(math.inf, -1))

    def _stage(self) -> None:
        """Whatever is due at this step comes."""
        while not self.stopped:
            due, number = self._next_event()
            if not (due - self.time) / self.step <= 0.5:
                return
            with turn:
                if self.scene.events[number].at != "rest" or self._rests():
                    self._come(number)

    def _rests(self) -> bool:
        """A look at whether the grains are at rest, and have been."""
        now = self.time
        since = (now if self.stages.slow is None else self.stages.slow) if slow(self) else None
        looks = max(self.stages.looks + 1, math.floor((now - self.stages.began + 0.5 * self.step) / LOOK))
        self.stages = replace(self.stages, looks=looks, slow=since)
        return since is not None and now - since >= FOR - 0.5 * self.step

    def _come(self, number: int) -> None:
        """This event comes."""
        event, times = self.scene.events[number], list(self.stages.times)
        times[number] = self.time
        self.stages = replace(self.stages, times=tuple(times), slow=None, flows=self._flows_after(event))
        try:
            walls = staged(self.scene.walls, event, self._hours())
            if walls != self.scene.walls:
                self.set_walls(walls)
            for key, value in live_changes(event).items():
                self.set(key, value)
        except (SandError, ValidationError) as error:
            raise SandError(f"{names(self.scene.events)[number]} comes at {self.time:.4g} s, but cannot be had: {error}") from None

    def _flows_after(self, event: Event) -> tuple[Flow, ...]:
        """How sources make grains from an event on; those that still wait for room when one ends are not made."""
        flows = list(self.stages.flows)
        for index, source in enumerate(self.scene.sources):
            if source.name and source.name in (*event.start_sources, *event.end_sources):
                flows[index] = Flow(self.time if source.name in event.start_sources else None, int(self.world.flow.made[index]))
        return tuple(flows)

    def _hours(self) -> list[float]:
        """What the clock of each wall shows [s]; 0 of those that stand still."""
        times = iter(hours(self.world.movers).tolist() if self.world.moves else ())
        return [next(times) if moves(wall) else 0.0 for wall in self.scene.walls]
