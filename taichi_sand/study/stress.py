"""`taichi-sand stress`: hard cases that must stay numerically stable, each a set-up with gates (physics.md C).

A case is a function that builds worlds and yields gates: what was measured, and the most that it may be. It gets the [solver] table to
use, so that the same case tries both solvers at several tolerances.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from taichi_sand.study.laboratory import D, G, R, simulate
from taichi_sand.world import device

TOLERANCES = (0.05, 0.02, 0.01)
SOLVERS = ("md", "rigid")
DOWN = (0.0, -G)
UNIT = math.sqrt(G * D)
"""Speed sqrt(g d) of discs of 1 cm [m/s]."""
PILE = {"radius": R, "count": 300, "fill": "hexagonal", "region": [0.0, 0.0, 0.3, 0.2]}
"""300 discs that touch one another, on the floor of a box 0.3 m wide."""
TOP_SPEED = "top speed / possible"
EXPLOSION = 1e3
"""Measured value of a gate that could not be measured, as numbers in it are not finite."""


@dataclass(frozen=True)
class Gate:
    """A number that was measured, and the most that it may be."""

    what: str
    measured: float
    most: float

    @property
    def passed(self) -> bool:
        """Whether it is a number and within the limit."""
        return bool(np.isfinite(self.measured) and self.measured <= self.most)

    @property
    def share(self) -> float:
        """How much of the limit is used up; infinite where there must be nothing and is something."""
        if self.measured <= 0.0:
            return 0.0
        return self.measured / self.most if self.most and np.isfinite(self.measured) else math.inf


@dataclass(frozen=True)
class Case:
    """A hard case."""

    name: str
    setup: str  # one line
    run: Callable[[dict[str, Any]], Iterator[Gate]]
    quick: bool  # cheap enough for the tests


@dataclass
class Row:
    """What came out of a case with one solver and tolerance."""

    case: str
    setup: str
    solver: str
    tolerance: float
    gates: list[Gate] = field(default_factory=list)
    error: str = ""
    wall_s: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether all gates passed and nothing was raised."""
        return not self.error and bool(self.gates) and all(gate.passed for gate in self.gates)

    @property
    def tightest(self) -> Gate | None:
        """The gate that failed, or came nearest to it."""
        return max(self.gates, key=lambda gate: gate.share, default=None)

    def to_dict(self) -> dict[str, Any]:
        """For --json."""
        gates = [{**asdict(gate), "measured": number(gate.measured), "passed": gate.passed} for gate in self.gates]
        return {**asdict(self), "gates": gates, "passed": self.passed}


def number(value: float) -> float | None:
    """As JSON may have it."""
    return float(value) if np.isfinite(value) else None


CASES: dict[str, Case] = {}


def case(name: str, setup: str, quick: bool = True) -> Callable:
    """Enters a function into the table of cases."""

    def enter(run: Callable[[dict[str, Any]], Iterator[Gate]]) -> Callable:
        CASES[name] = Case(name, setup, run, quick)
        return run

    return enter


def rows(only: str, solvers: Iterable[str], tolerances: Iterable[float], quick: bool = False) -> list[tuple[Case, str, float]]:
    """All (case, solver, tolerance) to run: those cases whose name holds `only`."""
    from taichi_sand.study import hard_changes, hard_contacts, hard_piles, hard_structures, hard_walls  # noqa: F401 - they enter the cases

    chosen = [c for c in CASES.values() if only in c.name and (c.quick or not quick)]
    return [(c, solver, tolerance) for c in chosen for solver in solvers for tolerance in tolerances]


def run(one: Case, solver: str, tolerance: float, film: Path | None = None) -> Row:
    """Runs a case; what it raises fails it. With `film` there is a picture of its end in that folder."""
    row = Row(one.name, one.setup, solver, tolerance)
    start = time.perf_counter()
    try:
        for gate in one.run({"kind": solver, "tolerance": tolerance, "restitution": 0.1, "precision": 32}):
            row.gates.append(gate)
            if film:
                picture(film / f"{one.name}-{solver}-{tolerance:g}.png")
    except Exception as error:  # whatever happens, the other cases are to be run
        row.error = f"{type(error).__name__}: {error}"
    row.wall_s = time.perf_counter() - start
    return row


def run_all(asked: list[tuple[Case, str, float]], jobs: int, film: Path | None, progress: Callable[[float], None] | None) -> list[Row]:
    """Runs them in `jobs` processes; `progress` is called with the share done. A case goes through its tolerances in one process, as its
    kernels are compiled there; those that take long start first.
    """
    done: dict[int, Row] = {}
    groups: dict[tuple[str, str], list[int]] = {}
    for k in sorted(range(len(asked)), key=lambda k: asked[k][0].quick):
        groups.setdefault((asked[k][0].name, asked[k][1]), []).append(k)
    with workers(jobs) as pool:
        waiting = {}
        if pool:
            for (name, solver), those in groups.items():
                waiting[pool.submit(run_named, name, solver, [asked[k][2] for k in those], film)] = those
        for one in as_completed(waiting) if pool else groups.values():
            those = waiting[one] if pool else one
            done |= zip(those, one.result() if pool else (run(*asked[k], film) for k in those), strict=True)
            if progress:
                progress(len(done) / len(asked))
    return [done[k] for k in range(len(asked))]


@contextmanager
def workers(jobs: int) -> Iterator[ProcessPoolExecutor | None]:
    """So many processes, none for one job; they are ended, not waited for, if somebody interrupts."""
    if jobs == 1:
        yield None
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        try:
            yield pool
        except BaseException:
            for process in list(pool._processes.values()):
                process.terminate()
            pool.shutdown(cancel_futures=True)
            raise


def run_named(name: str, solver: str, tolerances: list[float], film: Path | None) -> list[Row]:
    """`run` at these tolerances, in a process of its own."""
    rows("", (), ())
    return [run(CASES[name], solver, tolerance, film) for tolerance in tolerances]


def picture(path: Path) -> None:
    """Writes what the simulation at hand looks like, once at any moment of it."""
    from taichi_sand.files import writing
    from taichi_sand.view.film import save_png

    for sim in list(device.alive):
        if pictured.get(path) != (id(sim), sim.steps):
            with writing.replacing(path) as made:
                save_png(sim.image(), made)
            pictured[path] = (id(sim), sim.steps)


pictured: dict[Path, tuple[int, int]] = {}
"""By file: the simulation, and how many steps it had done."""


class Watch:
    """Looks at a simulation while it runs, for the gates that are common to all cases (physics.md C, common gates).

    Args:
        sim: what is watched.
        drop: largest height that a grain can fall [m].
        speed: fastest motion that was put in [m/s].
    """

    def __init__(self, sim: Any, drop: float, speed: float = 0.0) -> None:
        self.sim, self.grains, self.drop = sim, sim.count, drop
        gravity = float(np.hypot(*sim.scene.gravity))
        self.fastest = 1.1 * (np.sqrt(2 * gravity * drop) + speed)
        self.first = sim.report()
        self.weight = float(self.first["mass_kg"]) * gravity * drop
        self.top_speed = self.top_energy = self.top_overlap = 0.0
        self.look(self.first)

    def look(self, report: dict[str, Any]) -> None:
        """Takes a reading."""
        self.top_speed = max(self.top_speed, report["speed_max_m_s"])
        energy = report["kinetic_energy_J"] + report["potential_energy_J"]
        self.top_energy = max(self.top_energy, energy - self.first["kinetic_energy_J"] - self.first["potential_energy_J"])
        self.top_overlap = max(self.top_overlap, report["overlap_max"])
        self.last = report

    def run(self, seconds: float, every: float = 1 / 60) -> None:
        """Simulates on, with a reading `every` so many seconds."""
        for _ in range(max(1, round(seconds / every))):
            self.sim.advance(every)
            self.look(self.sim.report())

    def bounded(self, parting: float | None = None) -> Iterator[Gate]:
        """Finite, nobody lost, no speed and no energy out of nothing.

        Grains that start in one another have to be lifted off one another: their energy may rise by what the same heap has without
        overlaps, `parting` [m g d a grain], and half an m g d a grain, which is what they have when they part at sqrt(g d).
        """
        yield from sound(self.sim, self.grains)
        yield Gate(TOP_SPEED, self.top_speed / self.fastest, 1.0)
        if parting is not None:
            unit = self.weight / self.drop * self.sim.bed.diameter
            yield Gate("energy of parting / that of the heap undone and m g d / 2 a grain", self.top_energy / unit / (parting + 0.5), 1.0)
        else:
            yield Gate("energy out of nothing / m g H", self.top_energy / self.weight if self.weight else 0.0, 1e-3)

    def resting(self, tolerance: float) -> Iterator[Gate]:
        """Overlap within the tolerance, and still."""
        unit = np.sqrt(np.hypot(*self.sim.scene.gravity) * 2 * self.sim.radii.mean())
        yield Gate("overlap p99 / tolerance", self.last["overlap_p99"] / tolerance, 1.0)
        yield Gate("rms speed / sqrt(g d)", float(np.sqrt((self.sim.velocities**2).sum(1).mean()) / unit), 1e-3)


def sound(sim: Any, count: int, beyond: float = 0.0) -> Iterator[Gate]:
    """All numbers finite, and the centres of all `count` grains in the box, or no more than `beyond` [m] outside."""
    finite = all(np.isfinite(values).all() for values in (sim.positions, sim.velocities, sim.spins))
    yield Gate("numbers that are not finite", 0.0 if finite else EXPLOSION, 0.0)
    yield Gate("grains lost", count - inside(sim, beyond), 0.0)


def at_rest(sim: Any, drop: float, seconds: float, tolerance: float) -> Iterator[Gate]:
    """Bounded for so long, and at rest after it."""
    watch = Watch(sim, drop)
    watch.run(seconds)
    yield from watch.bounded()
    yield from watch.resting(tolerance)


def inside(sim: Any, beyond: float = 0.0) -> int:
    """Grains whose centre lies in the box, or no more than `beyond` [m] outside."""
    at = sim.positions
    return int(((at >= -beyond) & (at <= np.array(sim.scene.size) + beyond)).all(1).sum())


def poured(count: int, width: float, height: float, solver: dict[str, Any], **keys: Any) -> Any:
    """`count` discs of 8 to 12 mm, loosely placed, about to fall."""
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": count, "fill": "lattice", "pitch": 1.3, "jitter": 0.2}]
    return simulate(grains, (width, height), solver, gravity=keys.pop("gravity", DOWN), mu=keys.pop("mu", 0.5), **keys)


def rms_speed(sim: Any) -> float:
    """Of all grains, over sqrt(g d) of discs of 1 cm."""
    return float(np.sqrt((sim.velocities**2).sum(1).mean())) / UNIT
