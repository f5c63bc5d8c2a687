"""The main loop: list build, march, until the time asked for; and the state of a simulation, to read and to keep."""

import math
import time
from collections.abc import Callable, Collection
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np

from taichi_sand import effects as effect_modules
from taichi_sand.errors import SandError
from taichi_sand.run import live, stepping
from taichi_sand.run.arguments import steps_of, stretch
from taichi_sand.run.calling import Calling, Calls
from taichi_sand.run.clock import Clock
from taichi_sand.run.entry import changes, running
from taichi_sand.run.events import Staged, Stages, check_live_keys, laid_walls
from taichi_sand.run.growing import Growing
from taichi_sand.run.instrument import Instrument
from taichi_sand.run.looking import Looking
from taichi_sand.run.pausing import Pausing
from taichi_sand.run.readings import Readings
from taichi_sand.run.recording import Recorded, Recorder
from taichi_sand.run.saving import Keeping
from taichi_sand.run.steering import Steering
from taichi_sand.run.tuning import Tuning
from taichi_sand.run.watering import Watering
from taichi_sand.scene import loading
from taichi_sand.scene.packing import pack
from taichi_sand.scene.schema import Scene
from taichi_sand.solvers import choose
from taichi_sand.solvers.bed import Bed, bed_of
from taichi_sand.taichi_support import field_pool, runtime
from taichi_sand.taichi_support.turns import turn
from taichi_sand.world import edit, sources
from taichi_sand.world.build import check_periodic, fill, make_world
from taichi_sand.world.extras import hand as hands
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.search.growth import NO_ROOMS
from taichi_sand.world.sleep.fall_asleep import wake
from taichi_sand.world.tables import MOST_STEPS, World, steps_within
from taichi_sand.world.walls.build import change_walls, check_speeds, fastest_wall, set_patience, shortest_shake, wall_loads

LEAST_ROOM = 1000
"""Room for grains that a user adds by hand."""
WALL_ROOM = (4096, 65536)
"""Room for entries of walls (a grain's width of wall has some five), without and with a hand that may draw them."""


class Simulation(Instrument, Growing, Tuning, Watering, Steering, Staged, Calling, Looking, Pausing, Keeping, Recorded, Readings):
    """A scene in motion.

    Args:
        scene: what to simulate: a scene, or the name or path of one.
        arch: cpu, cuda, vulkan, metal or gpu (the best there is).
        threads: CPU threads; all there are if None. Results do not depend on it.
        room: how many grains more than those of the scene there may be, for what adds some while it runs.
        hand: whether somebody may reach into it, by `hand`; unless `room` is given there is then room for half as many grains more.

    Raises:
        SandError: the scene cannot be simulated as it asks, or the backend is not there.
    """

    def __init__(
        self, scene: Scene | str | PathLike[str], *, arch: str = "cpu", threads: int | None = None, room: int = 0, hand: bool = False
    ) -> None:
        self.clock, self.calls = Clock(), Calls()
        scene = loading.scene_of(scene)
        self.cadence = stepping.Cadence()
        self.runner: int | None = None  # thread that is advancing it
        self.recorders: list[Recorder] = []
        with turn, self.clock.stage("compile"):
            self.scene, self.home, self.arch, self.room = scene, scene, arch, room
            self.first_walls, self.stages = laid_walls(scene), Stages.of(scene)  # walls that tables have been made for
            self.program = runtime.start(self, arch, threads, scene.solver.precision)
            self.threads = runtime.threads()
            self.over = {}
            effects = effect_modules.check(scene)
            check_live_keys(scene)
            grains = pack(scene)
            planned = self.planned = sources.foreseen(scene, grains)
            self.rooms = NO_ROOMS  # least of its tables
            check_periodic(scene, planned, effect_modules.reach(effects), self.arch != "cpu")
            if hand and not room:
                self.room = max(LEAST_ROOM, len(grains) // 2)
            self.returning = field_pool.borrow(self, lambda: self._lay(planned, hand), keep=not runtime.on_gpu())
            turn.pause()
            fill(self.world, grains)
            if self.first_walls != scene.walls:
                change_walls(self.world, scene.model_copy(update={"walls": self.first_walls}), scene)
            self.made, self.removed = len(grains.radius), 0
            self.steps, self.epoch, self.owed, self.flagged = 0, (0, 0.0), 0.0, {}
            self._start_steps()

    def _lay(self, grains: Any, hand: bool) -> None:
        """World, solver and effects, as structure; the grains come after."""
        scene, kind = self.scene.model_copy(update={"walls": self.first_walls}), self.scene.solver.kind
        columns = {name: effect_modules.columns(name, values, kind) for name, values in self.effects.items()}
        turns = effect_modules.turns(self.effects) or bool(np.any(grains.spin))
        solver = choose(kind)
        extra = solver.MEMORY + sum(columns.values())
        rooms, structure = (self.room + sources.room_for(scene), WALL_ROOM[hand]), effect_modules.structure(self.effects, grains)
        made = make_world(scene, grains, extra, turns, self.arch != "cpu", *rooms, **structure, rooms=self.rooms)
        self._world = field_pool.same(made)
        drive = max([fastest_wall(scene)] + [math.hypot(*source.velocity) for source in scene.sources])
        bed = bed_of(grains, scene.gravity, scene.size, drive, shortest_shake(scene))
        self.bed = replace(bed, **effect_modules.bed(self.effects, self.world), **wall_loads(scene, grains))
        self.sizes = np.array([form.size for form in grains.forms] or [1.0])  # by kind: radius of a disc of the same area / radius
        memory = list(self.world.pairs.memory[-extra:]) if extra else []
        own = [memory.pop(0) for _ in range(solver.MEMORY)]
        built = []
        for name, values in self.effects.items():
            followed = [memory.pop(0) for _ in range(columns[name])]
            followed += field_pool.same(effect_modules.tables(name, values, scene, grains, self.world))
            built.append(field_pool.same(effect_modules.build(name, values, followed, kind)))
        self.hand = field_pool.same(hands.allocate(self.world.real)) if hand else None
        if self.hand:
            built.append(self.hand)
        self.numbers = solver.numbers(scene, self.bed)
        if self.rooms == NO_ROOMS:  # tables that grow keep their numbers
            check_speeds(scene, self.numbers["speed_cap"])
        self.mix()
        self.solver = field_pool.same(solver.build(scene, self.numbers, effect_modules.live(self.effects), own, tuple(built), self.world))
        self.pausing = {name: effect for name, effect in zip(self.effects, built, strict=False) if offers(effect, "on_pause")}
        """Effects that act between launches."""

    def _start_steps(self) -> None:
        pace = self.world.pace
        pace[None].spent = 1
        self._set_pace()
        stepping.compile_steps(self.world, self.solver)
        turn.pause()
        self._march(0)
        self._begin_pauses()
        turn.pause()
        if self.world.layout == "cells" and not edit.all_listed(self.world):
            raise SandError(f"--arch {self.arch}: its driver leaves out parts of the search for contacts; take --arch cpu", "arch")
        edit.places(self.world)  # only compiles, as the next
        edit.strained(self.world, 0.0, 0.0)
        edit.contact_speeds(self.world)
        self._follow(self.numbers)

    @property
    def world(self) -> World:
        """Its state, in fields; SandError if that is no more."""
        if self._world is None:
            raise SandError("this simulation has been closed")
        runtime.check(self.program)
        return self._world

    @property
    def effects(self) -> dict[str, dict[str, Any]]:
        """Complete tables of the effects that are on, as the scene has them now."""
        return effect_modules.check(self.scene)

    @property
    def step(self) -> float:
        """Time step [s]."""
        return self.numbers["step"]

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.epoch[1] + (self.steps - self.epoch[0]) * self.step

    def advance(self, seconds: float, progress: Callable[[float], None] | None = None) -> None:
        """Simulates until `seconds` later, to the nearest step; what is left over, at most half a step, is kept for the next call: many
        short strides end where a long one does. `progress` is called with the share done.

        Raises:
            SandError: `seconds` is no number of seconds, or makes more steps than a simulation can count.
        """
        seconds = stretch(seconds)
        with running(self):
            self._advance(seconds, progress)

    def advance_to(self, time: float, progress: Callable[[float], None] | None = None, *, events: Collection[str] = ()) -> None:
        """Simulates until `time` [s], to the nearest step, or until one of these events of the scene, by name, has come; not at all if that
        is past. For the rest see `advance`.
        """
        seconds = max(0.0, stretch(time) - self.time - self.owed)
        with running(self):
            self._advance(seconds, progress, events)

    def _advance(self, seconds: float, progress: Callable[[float], None] | None, events: Collection[str] = ()) -> None:
        start, due = self.time, self.owed + seconds
        while True:
            rest = due - (self.time - start)
            if self.steps + rest / self.step > MOST_STEPS:  # the step may change on the way
                raise SandError(f"advance({seconds:g}): more than {MOST_STEPS} steps of {self.step:.3g} s cannot be counted")
            left = round(rest / self.step)
            over = self.stopped or any(name in self.events for name in events)
            if left <= 0 or over:
                break
            stride = max(1, round(1 / (30 * self.step))) if progress else left
            self.advance_steps(min(left, self._steps_to_look(), self._steps_to_call(), stride))
            if progress:
                done = self.time - start
                progress(1.0 if due - done < 0.5 * self.step else done / due)
        self.owed = 0.0 if over else rest

    def advance_steps(self, count: int) -> None:
        """Simulates `count` steps, with the pauses in which effects act.

        It can be interrupted (Ctrl-C) after every launch, of a tenth of a second or so; what was simulated until then is whole, and goes on
        to the same bits.
        """
        count = steps_of(count)
        self._check_not_calling()
        with running(self):
            end = self.steps + count
            if self.hand and self.world.sleeps:
                with turn:
                    if self.hand.now[None].work:
                        wake(self.world)
                        self.fit_tables()
                        stepping.renew(self.world, self.solver)
            self._stage()
            while self.steps < end and not self.stopped:
                with turn:
                    self._advance_to(end)
                self._stage()
                self._call_due()

    def _advance_to(self, end: int) -> None:
        """A launch of steps, up to step `end`, and the pauses that are due then."""
        pauses = self._pauses()
        fit = self.cadence.steps(stepping.awake(self.world))
        due = min((at - self.steps for _, at in pauses), default=MOST_STEPS)
        part = min(end - self.steps, fit, self._steps_to_look(), self._steps_to_call(), due)
        before, start = self.steps, time.perf_counter()
        with self.clock.stage("march"):
            self._march(part)
        self.steps = int(self.world.pace[None].done)
        self.clock.count(self.count, self.steps - before, self.step)
        self.cadence.took(self.steps - before, time.perf_counter() - start)
        for act, at in pauses:
            if self.steps == at:
                with self.clock.stage("effects"):
                    act(self.world, self.solver)
        with self.clock.stage("look"):
            if self.world.pace[None].hasty:
                self._hasten()
            elif self._steps_to_look() == self._look_every():
                self._look()

    def _pour(self, world: Any, solver: Any) -> None:
        """The sources make the grains that are due."""
        made = sources.pour(self.scene, world, self.stages.flows, self.made, self.time)
        if made:
            self.made += made
            self.renew()

    @changes
    def renew(self) -> None:
        """Builds the neighbour list anew, after grains or walls were changed by hand; what contacts that are gone carried is forgotten."""
        with self.clock.stage("march"):
            wake(self.world)
            self._search_anew()

    def _search_anew(self) -> None:
        self.world.pace[None].spent = 1
        self._march(0)
        stepping.renew(self.world, self.solver)

    def _adopt(self, scene: Scene, bed: Bed, over: dict[str, float]) -> None:
        """Goes on with this scene, of the same structure, and these numbers beyond its ranges: what the kernels read follows."""
        bed = replace(bed, **effect_modules.bed(effect_modules.check(scene), self.world))
        numbers = choose(scene.solver.kind).numbers(scene, bed)
        check_speeds(scene, numbers["speed_cap"])
        self.note_flags()
        self.epoch = (self.steps, self.time)
        before = self.numbers
        self.scene, self.bed, self.numbers, self.over = scene, bed, numbers, over
        self.world.box[None].gravity = scene.gravity
        constants = self.solver.constants
        for name, value in live.kernel_numbers(scene, over, numbers).items():
            if name in constants.keys:
                setattr(constants[None], name, value)
        self._set_pace()
        self.mix()
        self._keep_due(before["step"])
        with self.clock.stage("march"):
            self._search_anew()
        self._follow(before)

    def _follow(self, before: dict[str, float]) -> None:
        """Contacts go on from the numbers `before` with those there are."""
        solver = choose(self.scene.solver.kind)
        if hasattr(solver, "follow"):
            solver.follow(self.world, self.solver, before, self.numbers)

    def _set_pace(self) -> None:
        for name in ("step", "speed_cap", "alert", "deep", "growth", "settling", "spare"):
            setattr(self.world.pace[None], name, self.numbers.get(name, 0.0))
        self.world.pace[None].on_step = min((steps_within(e.interval, self.step) for e in stepping.step_effects(self.solver)), default=0)
        set_patience(self.world, self.scene)

    def _march(self, count: int) -> None:
        self.fit_tables()
        stepping.march(self, self.steps, self.steps + count)
