"""What accuracy costs in time: one scene over a ladder of tolerances, solvers, integrators and precisions.

Every setting runs REPEATS times, each time with another seed of the scene, and the settings take turns, so that neither a lucky bed nor
a busy moment of the machine decides; medians stand with the range of the runs. Cost is the CPU time that one thread spends stepping, a
simulated second, without compiling or measuring: the wall time on an otherwise idle machine. On several threads, or a GPU, it is wall time.

The trajectory error needs a truth: the same solver at the finest tolerance of the ladder, 16 times finer in time, in 64 bits. It is
trusted until it and its like at 8 times are HORIZON_SPREAD d apart (RMS over the grains); after that, chaos decides who is where.
"""

import math
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

import taichi_sand as sand
from taichi_sand.errors import SandError
from taichi_sand.scene.packing import pack
from taichi_sand.solvers import choose
from taichi_sand.solvers.bed import bed_of
from taichi_sand.study.cost import errors
from taichi_sand.study.laboratory import fresh_taichi

REPEATS = 3
LADDER = (0.1, 0.05, 0.02, 0.01, 0.005)
QUICK_LADDER = (0.1, 0.03, 0.01)
QUICK_SECONDS = 1.5
LATE = 0.75
"""Overlaps and forces are those after this share of the run."""
NOTES = 16
"""Times a run is looked at."""
FINER = (16, 8)
"""Steps of the reference, and of its like that tells how far it can be trusted, in one of the finest tolerance."""
HORIZON_SPREAD = 0.01
HORIZON_STEPS = 12
REFERENCE_WORK = {True: 1.5e8, False: 2e9}
"""Most grain-steps of the references of a kind of solver, quick or not: they bound the horizon."""

Make = Callable[[Sequence[str]], Any]
"""From overrides `KEY=VALUE` to a scene."""


@dataclass(frozen=True)
class Setting:
    """A way to solve the scene."""

    kind: str
    tolerance: float
    integrator: str = ""  # md only
    precision: int = 32

    @property
    def table(self) -> dict[str, str]:
        """Keys of [solver], values as in TOML."""
        keys = {"kind": f'"{self.kind}"', "tolerance": f"{self.tolerance:g}"}
        if self.integrator and self.integrator != "symplectic_euler":
            keys["integrator"] = f'"{self.integrator}"'
        if self.precision != 32:
            keys["precision"] = str(self.precision)
        return keys

    @property
    def overrides(self) -> list[str]:
        """As for `--set`."""
        return [f"solver.{key}={value}" for key, value in self.table.items()]

    @property
    def family(self) -> str:
        """All but the tolerance, in words."""
        integrator = self.integrator.removeprefix("symplectic_euler").replace("_", " ")
        return " ".join(filter(None, [self.kind, integrator, "" if self.precision == 32 else "64 bit"]))


@dataclass
class Point:
    """A setting and what came of it: three numbers each, lowest, median and highest of the runs; NaN where one has no meaning."""

    setting: Setting
    costs: list[float] = field(default_factory=list)
    runs: list[dict[str, float]] = field(default_factory=list)
    failure: str = ""

    @property
    def cost(self) -> tuple[float, float, float]:
        """[s/s]"""
        return spread(self.costs)

    def error(self, name: str) -> tuple[float, float, float]:
        """Error `name` of errors.NAMES."""
        return spread([run[name] for run in self.runs])


@dataclass
class Study:
    """All points, and up to when trajectories were compared."""

    title: str
    seconds: float
    points: list[Point]
    horizon: dict[str, float]  # by kind of solver [s]

    def front(self, name: str) -> list[Point]:
        """Points that no other one beats in both cost and error `name`, cheapest first."""
        good = [p for p in self.points if not p.failure and math.isfinite(p.error(name)[1])]
        good.sort(key=lambda p: (p.cost[1], p.error(name)[1]))
        best, front = math.inf, []
        for point in good:
            if point.error(name)[1] < best:
                best = point.error(name)[1]
                front.append(point)
        return front

    def cheapest(self, name: str, target: float) -> Point | None:
        """The cheapest point whose median error `name` is at most `target`."""
        return next((point for point in self.front(name) if point.error(name)[1] <= target), None)


def spread(values: Sequence[float]) -> tuple[float, float, float]:
    """Lowest, median and highest of those that are numbers."""
    known = [v for v in values if not math.isnan(v)]
    return (min(known), statistics.median(known), max(known)) if known else (math.nan, math.nan, math.nan)


def settings_of(scene: Any, ladder: Sequence[float], full: bool) -> list[Setting]:
    """Settings to try: both solvers, the precision of the scene; with `full` all integrators and both precisions."""
    solver = scene.solver
    integrators = ("symplectic_euler", "velocity_verlet", "rk4") if full else (solver.integrator,)
    precisions = (32, 64) if full else (solver.precision,)
    kinds = [("rigid", "")] + [("md", name) for name in integrators]
    return [Setting(kind, x, name, bits) for bits, (kind, name), x in product(precisions, kinds, ladder)]


def stopwatch(arch: str, threads: int | None) -> Callable[[], float]:
    """Clock [s]: CPU time of one thread, wall time of several."""
    return time.process_time if arch == "cpu" and threads == 1 else time.perf_counter


class Runner:
    """Runs a scene under many settings."""

    def __init__(self, make: Make, seconds: float, arch: str, threads: int | None) -> None:
        self.make, self.seconds, self.arch, self.threads = make, seconds, arch, threads
        self.seed = make([]).seed
        self.truth: dict[tuple[str, int], np.ndarray] = {}  # places at the horizon, by kind of solver and repeat
        self.horizon: dict[str, float] = {}  # [s]

    def simulation(self, setting: Setting, repeat: int, more: Sequence[str] = ()) -> Any:
        """A simulation of the scene under `setting`."""
        scene = self.make([*setting.overrides, f"seed={self.seed + repeat}", *more])
        fresh_taichi()
        return sand.Simulation(scene, arch=self.arch, threads=self.threads)

    def trust(self, finest: Setting, repeats: int, work: float) -> None:
        """Runs the references of a kind of solver for at most `work` grain-steps, and finds out how far they can be trusted."""
        step, count, diameter = self.plan(finest)
        cost = max(count, 1) / step * (FINER[0] * repeats + FINER[1])  # of a simulated second
        times = np.linspace(0, min(self.seconds, work / cost), HORIZON_STEPS + 1)[1:]
        tracks = {}
        for repeat, finer in [*product(range(repeats), FINER[:1]), (0, FINER[1])]:
            sim = self.simulation(finest, repeat, [f"solver.step={step / finer}"])
            tracks[repeat, finer] = [places(sim, moment) for moment in times]
            del sim
        last = 0
        for k in range(HORIZON_STEPS):
            if errors.apart(tracks[0, FINER[0]][k], tracks[0, FINER[1]][k], diameter) > HORIZON_SPREAD:
                break
            last = k
        self.horizon[finest.kind] = float(times[last])
        for repeat in range(repeats):
            self.truth[finest.kind, repeat] = tracks[repeat, FINER[0]][last]

    def plan(self, setting: Setting) -> tuple[float, int, float]:
        """Step [s], number of grains and their mean diameter [m] that a setting means."""
        scene = self.make(setting.overrides)
        grains = pack(scene)
        bed = bed_of(grains, scene.gravity, scene.size)
        return choose(setting.kind).numbers(scene, bed)["step"], len(grains.radius), bed.diameter

    def run(self, setting: Setting, repeat: int, more: Sequence[str] = ()) -> tuple[float, dict[str, float], list[str]]:
        """Cost [s/s], errors and flags of one run; `more` overrides than those of the setting."""
        sim = self.simulation(setting, repeat, more)
        clock = stopwatch(self.arch, self.threads)
        diary, spent, done = errors.begin(sim), 0.0, 0
        stops = [(self.seconds * (k + 1) / NOTES, True) for k in range(NOTES)]
        horizon = self.horizon.get(setting.kind)
        if horizon is not None:
            stops = sorted([*stops, (horizon, False)])
        distance = math.nan
        for moment, noted in stops:
            start, steps = clock(), sim.steps
            sim.advance_to(moment)
            spent, done = spent + clock() - start, done + sim.steps - steps
            if noted:
                errors.note(sim, diary, moment > LATE * self.seconds)
            elif (setting.kind, repeat) in self.truth:
                distance = errors.apart(places(sim, moment), self.truth[setting.kind, repeat], sim.bed.diameter)
        conservative = sim.scene.solver.restitution == 1 and not sim.effects
        found = {**errors.close(sim, diary, conservative), "trajectory": distance}
        return spent / (done * sim.step), found, sim.flags()


def places(sim: Any, moment: float) -> np.ndarray:
    """Centres of the grains at time `moment` [s], shape (n, 2): where they are after the last step before it, and on from there."""
    sim.advance_to(moment)
    return sim.positions + (moment - sim.time) * sim.velocities


def relate(points: list[Point]) -> None:
    """Turns heights, packings and speeds of flows into errors: against the finest runs of the same kind of solver, seed by seed."""
    for name in ("height", "packing", "flow"):
        finest: dict[str, list[float]] = {}
        for point in sorted(points, key=lambda p: (-p.setting.tolerance, p.setting.precision)):
            if not point.failure:
                finest[point.setting.kind] = [run[name] for run in point.runs]
        for point in points:
            truth = finest.get(point.setting.kind, [])
            ends = truth is not None and point.runs and [run[name] for run in point.runs] == truth
            for run, true in zip(point.runs, truth, strict=False):
                run[name] = math.nan if ends or not true else abs(run[name] / true - 1)


def study(
    make: Make,
    *,
    seconds: float | None = None,
    full: bool = False,
    quick: bool = False,
    arch: str = "cpu",
    threads: int | None = 1,
    progress: Callable[[float], None] | None = None,
) -> Study:
    """Runs the whole ladder.

    Args:
        make: from overrides to the scene.
        seconds: simulated time of a run [s]; the scene's duration, with `quick` at most QUICK_SECONDS, if None.
        full: also all integrators of molecular dynamics, and both precisions.
        quick: three tolerances, short references, of the first seed alone.
        arch, threads: as of Simulation.
        progress: called with the share done.
    """
    scene = make([])
    if seconds is None:
        seconds = min(float(scene.duration), QUICK_SECONDS) if quick else float(scene.duration)
    if seconds <= 0:
        raise SandError(f"--seconds {seconds:g} must be more than 0: cost is counted by the simulated second")
    runner = Runner(make, seconds, arch, threads)
    ladder = QUICK_LADDER if quick else LADDER
    settings = settings_of(scene, ladder, full)
    points = [Point(setting) for setting in settings]
    jobs = list(all_jobs(runner, points, ladder, quick))
    for k, job in enumerate(jobs):
        job()
        if progress:
            progress((k + 1) / len(jobs))
    relate(points)
    return Study(scene.title, seconds, points, runner.horizon)


def all_jobs(runner: Runner, points: list[Point], ladder: Sequence[float], quick: bool) -> Iterator[Callable[[], None]]:
    """What there is to do, in turns: first the references, then every setting once, twice, three times."""
    for kind in dict.fromkeys(point.setting.kind for point in points):
        given = (Setting(kind, min(ladder), "", 64), 1 if quick else REPEATS, REFERENCE_WORK[quick])
        yield lambda given=given: attempt([], runner.trust, *given)  # without a reference all but trajectories can be judged
    for repeat, point in product(range(REPEATS), points):
        yield lambda point=point, repeat=repeat: once(runner, point, repeat)


def attempt(points: list[Point], work: Callable[..., Any], *given: Any) -> Any:
    """Does `work`; what cannot be simulated at all marks `points` as failed."""
    try:
        return work(*given)
    except SandError as error:
        for point in points:
            point.failure = str(error)
        return None


def once(runner: Runner, point: Point, repeat: int) -> None:
    """One run of a point that has not failed."""
    if point.failure:
        return
    done = attempt([point], runner.run, point.setting, repeat)
    if done is not None:
        cost, found, flags = done
        point.costs.append(cost)
        point.runs.append(found)
        point.failure = "; ".join(flags)
