"""The main loop: search, march, until the time asked for; and the state of a simulation, to read and to keep."""

import math
from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np

from taichi_sand import effects as effect_modules
from taichi_sand import live, marching
from taichi_sand.clock import Clock
from taichi_sand.keeping import Keeping
from taichi_sand.readings import Readings
from taichi_sand.scene import loading
from taichi_sand.scene.errors import SandError, show
from taichi_sand.scene.packing import pack
from taichi_sand.scene.schema import Scene
from taichi_sand.solvers import choose
from taichi_sand.solvers.bed import DENSE, EARTH, REST, Bed, bed_of, depth_of
from taichi_sand.solvers.tolerance import follows_tolerance
from taichi_sand.tuning import Tuning
from taichi_sand.world import census, device, fields, sources
from taichi_sand.world import hand as hands
from taichi_sand.world.build import check_periodic, fill, make_world
from taichi_sand.world.rest import wake
from taichi_sand.world.wall_scene import check_speeds, fastest_wall, set_patience, shortest_shake, wall_loads

LEAST_ROOM = 1000
"""Room for grains that a user adds by hand."""
WALL_ROOM = (4096, 65536)
"""Room for entries of walls (a grain's width of wall has some five), without and with a hand that may draw them."""
LOOK, GROWTH = 0.25 / math.sqrt(0.01 / EARTH), 1.2
"""Simulated time between two looks at the pile, in sqrt(d / g), 0.25 s for grains of 1 cm; and by how much it must have grown in depth for
stiffness and step to follow."""


MOST_STEPS = 2**31 - 1
"""That a simulation counts."""


class Simulation(Tuning, Keeping, Readings):
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
        self.clock = Clock()
        scene = loading.scene_of(scene)
        with self.clock.stage("compile"):
            self.scene, self.arch, self.threads, self.room = scene, arch, threads, room
            self.first_walls = scene.walls  # those that tables have been made for
            device.start(self, arch, threads, scene.solver.precision)
            self.over = {}
            effects = effect_modules.check(scene)
            grains = pack(scene)
            planned = sources.foreseen(scene, grains)
            check_periodic(scene, planned, effect_modules.reach(effects), self.arch != "cpu")
            if hand and not room:
                self.room = max(LEAST_ROOM, len(grains) // 2)
            fields.lend(self, lambda: self._lay(planned, hand), keep=not device.on_gpu())
            fill(self.world, grains)
            self.made, self.removed = len(grains.radius), 0
            self.steps, self.epoch, self.owed = 0, (0, 0.0), 0.0
            self._start_steps()

    def _lay(self, grains: Any, hand: bool) -> None:
        """World, solver and effects, as structure; the grains come after."""
        scene, kind = self.scene, self.scene.solver.kind
        columns = {name: effect_modules.columns(name, values, kind) for name, values in self.effects.items()}
        turns = effect_modules.turns(self.effects) or bool(np.any(grains.spin))
        solver = choose(kind)
        extra = solver.MEMORY + sum(columns.values())
        rooms, structure = (self.room + sources.room_for(scene), WALL_ROOM[hand]), effect_modules.structure(self.effects, grains)
        self.world = fields.same(make_world(scene, grains, extra, turns, self.arch != "cpu", *rooms, **structure))
        drive = max([fastest_wall(scene)] + [math.hypot(*source.velocity) for source in scene.sources])
        bed = bed_of(grains, scene.gravity, scene.size, drive, shortest_shake(scene))
        self.bed = replace(bed, **effect_modules.bed(self.effects, self.world), **wall_loads(scene, grains))
        self.sizes = np.array([form.size for form in grains.forms] or [1.0])  # by kind: radius of a disc of the same area / radius
        memory = list(self.world.pairs.memory[-extra:]) if extra else []
        own = [memory.pop(0) for _ in range(solver.MEMORY)]
        built = []
        for name, values in self.effects.items():
            built.append(fields.same(effect_modules.build(name, values, [memory.pop(0) for _ in range(columns[name])], kind)))
        self.hand = fields.same(hands.allocate(self.world.real)) if hand else None
        if self.hand:
            built.append(self.hand)
        self.numbers = solver.numbers(scene, self.bed)
        check_speeds(scene, self.numbers["speed_cap"])
        self.solver = fields.same(solver.build(scene, self.numbers, effect_modules.live(self.effects), own, tuple(built), self.world))
        self.pausing = [effect for effect in built if hasattr(effect, "between")]
        """Effects that act between launches."""

    def _start_steps(self) -> None:
        pace = self.world.pace
        pace[None].spent = 1
        self._set_pace()
        marching.compile_steps(self.world, self.solver)
        self._march(0)
        if self.world.layout == "cells" and not census.all_listed(self.world):
            raise SandError(f"--arch {self.arch}: its driver leaves out parts of the search for contacts; take --arch cpu", "arch")
        census.places(self.world)  # only compiles, as the next
        census.strained(self.world, 0.0, 0.0)
        census.contact_speeds(self.world)
        self._follow(self.numbers)

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
        start, due = self.time, self.owed + seconds
        while True:
            rest = due - (self.time - start)
            if self.steps + rest / self.step > MOST_STEPS:  # the step may change on the way
                raise SandError(f"advance({seconds:g}): more than {MOST_STEPS} steps of {self.step:.3g} s cannot be counted")
            left = round(rest / self.step)
            if left <= 0:
                break
            self.advance_steps(min(left, self._steps_to_look(), max(1, round(1 / (30 * self.step))) if progress else left))
            if progress:
                done = self.time - start
                progress(1.0 if due - done < 0.5 * self.step else done / due)
        self.owed = rest

    def advance_steps(self, count: int) -> None:
        """Simulates `count` steps, with the pauses in which effects act."""
        if self.hand and self.world.sleeps and self.hand.now[None].work:
            wake(self.world)
            marching.renew(self.world, self.solver)
        end = self.steps + count
        while self.steps < end:
            pauses = self._pauses()
            part = min([end - self.steps, self._steps_to_look()] + [every - self.steps % every for _, every in pauses])
            with self.clock.stage("march"):
                self._march(part)
            done, self.steps = self.steps, self.world.pace[None].done
            self.clock.count(self.count, self.steps - done, self.step)
            for act, every in pauses:
                if self.steps % every == 0:
                    with self.clock.stage("effects"):
                        act(self.world, self.solver)
            with self.clock.stage("look"):
                if self.world.pace[None].hasty:
                    self._hasten()
                elif self._steps_to_look() == self._look_every():
                    self._look()

    def _pauses(self) -> list[tuple[Callable[[Any, Any], None], int]]:
        """What acts between launches, and after how many steps each."""
        pauses = [(effect.between, max(1, math.floor(effect.interval / self.step))) for effect in self.pausing]
        if self.scene.sources:
            pauses.append((self._pour, sources.steps_between(self.step)))
        return pauses

    def _pour(self, world: Any, solver: Any) -> None:
        """The sources make the grains that are due."""
        made = sources.pour(self.scene, world, self.made, self.time)
        if made:
            self.made += made
            self.renew()

    def _look_every(self) -> int:
        return max(1, math.floor(LOOK * self.bed.moment / self.step))

    def _steps_to_look(self) -> int:
        """Steps until the next look at the depth, counted from when the step last changed."""
        return self._look_every() - (self.steps - self.epoch[0]) % self._look_every()

    def _look(self) -> None:
        """Stiffness and step follow the depth of a pile that has grown, what the contacts of one at rest show, how fast grains are, and
        how fast they flow.
        """
        if not self.count or self._sleepy():
            return
        if self.bed.gravity:
            self.bed = self._deeper(self.bed)
        unit = math.sqrt(self.bed.gravity * self.bed.diameter)
        share, deep, fastest = census.strained(self.world, self.scene.solver.tolerance * self.bed.diameter, REST * unit)
        if self.bed.gravity and follows_tolerance(self.scene.solver):
            self.bed = self.bed.seen(share, deep)
        self.bed = self.bed.moving(fastest, census.flow(self.world, DENSE) if share > 0.01 else 0.0)
        self._keep_up()

    def _hasten(self) -> None:
        """Stiffness and step follow a grain that is faster than they are made for."""
        *_, fastest = census.strained(self.world, 0.0, 0.0)
        self.bed = self.bed.outrun(fastest)
        self._keep_up()

    def _keep_up(self) -> None:
        """Stiffness and step are those for the bed as it is."""
        self.world.pace[None].hasty = 0
        if choose(self.scene.solver.kind).numbers(self.scene, self.bed) != self.numbers:
            self._adopt(self.scene, self.bed, self.over)

    def _deeper(self, bed: Bed) -> Bed:
        """The bed as deep as it is now, if it has grown."""
        numbers, whole = census.places(self.world)
        free = whole[:, 2] == 0
        if free.any():
            radius = numbers[:, 2] * self.sizes[whole[:, 1]]
            depth, load = depth_of(numbers[free, :2], radius[free], 1 / numbers[free, 3], self.scene.gravity)
            if depth > GROWTH * bed.depth or load > GROWTH * bed.load:
                return replace(bed, depth=max(depth, bed.depth), load=max(load, bed.load))
        return bed

    def _sleepy(self) -> bool:
        """Whether this look can be left out: with few awake a pile grows more slowly, with nobody not at all."""
        if not self.world.sleeps:
            return False
        awake = self.world.naps.state[None].awake
        number = (self.steps - self.epoch[0]) // self._look_every()
        return not awake or number % max(1, math.floor((GROWTH - 1) * self.count / awake)) != 0

    def renew(self) -> None:
        """Searches anew, after grains or walls have been changed by hand; what contacts that are gone carried is forgotten."""
        with self.clock.stage("march"):
            wake(self.world)
            self._search_anew()

    def _search_anew(self) -> None:
        self.world.pace[None].spent = 1
        self._march(0)
        marching.renew(self.world, self.solver)

    def _adopt(self, scene: Scene, bed: Bed, over: dict[str, float]) -> None:
        """Goes on with this scene, of the same structure, and these numbers beyond its ranges: what the kernels read follows."""
        bed = replace(bed, **effect_modules.bed(effect_modules.check(scene), self.world))
        numbers = choose(scene.solver.kind).numbers(scene, bed)
        check_speeds(scene, numbers["speed_cap"])
        self.epoch = (self.steps, self.time)
        before = self.numbers
        self.scene, self.bed, self.numbers, self.over = scene, bed, numbers, over
        self.world.box[None].gravity = scene.gravity
        constants = self.solver.constants
        for name, value in live.kernel_numbers(scene, over, numbers).items():
            if name in constants.keys:
                setattr(constants[None], name, value)
        self._set_pace()
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
        self.world.pace[None].watch = min((max(1, math.floor(e.interval / self.step)) for e in marching.watchers(self.solver)), default=0)
        set_patience(self.world, self.scene, self.numbers["speed_cap"])

    def _march(self, count: int) -> None:
        marching.march(self.world, self.solver, self.steps, self.steps + count)


def stretch(seconds: Any) -> float:
    """`seconds` as a number of seconds, 0 or more; SandError if it is something else."""
    number = isinstance(seconds, int | float | np.integer | np.floating) and not isinstance(seconds, bool)
    if not number or not 0 <= seconds < math.inf:
        raise SandError(f"advance({show(seconds)}): must be a number of seconds, 0 or more")
    return float(seconds)
