"""`taichi-sand stress`: hard cases that must stay numerically stable, each a set-up with gates (physics.md C).

A case is a function that builds worlds and yields gates: what was measured, and the most that it may be. It gets the [solver] table to
use, so that the same case tries both solvers at several tolerances.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from taichi_sand.study.laboratory import D, G, R, simulate
from taichi_sand.world import device

TOLERANCES = (0.05, 0.02, 0.01)
SOLVERS = ("md", "rigid")
DOWN = (0.0, -G)
UNIT = math.sqrt(G * D)
"""Speed sqrt(g d) of discs of 1 cm [m/s]."""
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
        shares = [gate.measured / gate.most if gate.most else gate.measured * np.inf if gate.measured else 0.0 for gate in self.gates]
        return self.gates[int(np.argmax(np.nan_to_num(shares, nan=np.inf)))] if self.gates else None

    def to_dict(self) -> dict[str, Any]:
        """For --json."""
        return {**asdict(self), "gates": [{**asdict(gate), "passed": gate.passed} for gate in self.gates], "passed": self.passed}


CASES: dict[str, Case] = {}


def case(name: str, setup: str, quick: bool = True) -> Callable:
    """Enters a function into the table of cases."""

    def enter(run: Callable[[dict[str, Any]], Iterator[Gate]]) -> Callable:
        CASES[name] = Case(name, setup, run, quick)
        return run

    return enter


def rows(only: str, solvers: Iterable[str], tolerances: Iterable[float], quick: bool = False) -> list[tuple[Case, str, float]]:
    """All (case, solver, tolerance) to run: those cases whose name holds `only`."""
    from taichi_sand.study import hard_changes, hard_contacts, hard_piles  # noqa: F401 - they enter the cases

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


def picture(path: Path) -> None:
    """Writes what the simulation at hand looks like, once at any moment of it."""
    from PIL import Image

    for sim in list(device.alive):
        if pictured.get(path) != (id(sim), sim.steps):
            Image.fromarray(sim.image()).save(path)
            pictured[path] = (id(sim), sim.steps)


pictured: dict[Path, tuple[int, int]] = {}
"""By file: the simulation, and how many steps it had done."""


def as_table(done: list[Row]) -> Table:
    """For the terminal: of every row the gate that failed, or came nearest to it."""
    table = Table("case", "set-up", "solver", "tolerance", "gate", "measured", "at most", "verdict", header_style="bold", box=None)
    for row in done:
        gate = row.tightest
        cells = (gate.what, f"{gate.measured:.3g}", f"{gate.most:.3g}") if gate and not row.error else (row.error or "no gate", "", "")
        verdict = "passed" if row.passed else "failed"
        table.add_row(row.case, row.setup, row.solver, f"{row.tolerance:g}", *cells, verdict, style="" if row.passed else "#E5534B")
    return table


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

    def bounded(self, parting: bool = False) -> Iterator[Gate]:
        """Finite, nobody lost, no speed and no energy out of nothing; of grains that start in one another (`parting`) the energy may
        rise, as they have to be lifted off one another: by no more than their weight times d.
        """
        finite = all(np.isfinite(values).all() for values in (self.sim.positions, self.sim.velocities, self.sim.spins))
        yield Gate("numbers that are not finite", 0.0 if finite else EXPLOSION, 0.0)
        yield Gate("grains lost", self.grains - inside(self.sim), 0.0)
        yield Gate("top speed / possible", self.top_speed / self.fastest, 1.0)
        if parting:
            yield Gate("energy of parting / m g d a grain", self.top_energy / (self.weight / self.drop * self.sim.bed.diameter), 1.0)
        else:
            yield Gate("energy out of nothing / m g H", self.top_energy / self.weight if self.weight else 0.0, 1e-3)

    def resting(self, tolerance: float) -> Iterator[Gate]:
        """Overlap within the tolerance, and still."""
        unit = np.sqrt(np.hypot(*self.sim.scene.gravity) * 2 * self.sim.radii.mean())
        yield Gate("overlap p99 / tolerance", self.last["overlap_p99"] / tolerance, 1.0)
        yield Gate("rms speed / sqrt(g d)", float(np.sqrt((self.sim.velocities**2).sum(1).mean()) / unit), 1e-3)


def inside(sim: Any) -> int:
    """Grains whose centre lies in the box."""
    at = sim.positions
    return int(((at >= 0) & (at <= np.array(sim.scene.size))).all(1).sum())


def poured(count: int, width: float, height: float, solver: dict[str, Any], **keys: Any) -> Any:
    """`count` discs of 8 to 12 mm, loosely placed, about to fall."""
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": count, "fill": "lattice", "pitch": 1.3, "jitter": 0.2}]
    return simulate(grains, (width, height), solver, gravity=keys.pop("gravity", DOWN), mu=keys.pop("mu", 0.5), **keys)


def rms_speed(sim: Any) -> float:
    """Of all grains, over sqrt(g d) of discs of 1 cm."""
    return float(np.sqrt((sim.velocities**2).sum(1).mean())) / UNIT
