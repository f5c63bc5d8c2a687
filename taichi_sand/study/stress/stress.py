"""`taichi-sand stress`: hard cases that must stay numerically stable, each with both solvers at several tolerances (physics.md C)."""

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from taichi_sand.study.stress import (  # noqa: F401 - they enter the cases
    hard_changes,
    hard_contacts,
    hard_piles,
    hard_structures,
    hard_walls,
    hard_water,
)
from taichi_sand.study.stress.gates import CASES, Case, Gate
from taichi_sand.taichi_support import runtime

TOLERANCES = (0.05, 0.02, 0.01)
SOLVERS = ("md", "rigid")


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


def rows(only: str, solvers: Iterable[str], tolerances: Iterable[float], quick: bool = False) -> list[tuple[Case, str, float]]:
    """All (case, solver, tolerance) to run: those cases whose name holds `only`."""
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
        parts: Any = as_completed(waiting) if pool else groups.values()
        for part in parts:
            those = waiting[part] if pool else part
            done |= zip(those, part.result() if pool else (run(asked[k][0], asked[k][1], asked[k][2], film) for k in those), strict=True)
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
    return [run(CASES[name], solver, tolerance, film) for tolerance in tolerances]


def picture(path: Path) -> None:
    """Writes what the simulation at hand looks like, once at any moment of it."""
    from taichi_sand.files import writing
    from taichi_sand.output.film import save_png

    for sim in list(runtime.alive):
        if pictured.get(path) != (id(sim), sim.steps):
            with writing.replacing(path) as made:
                save_png(sim.image(), made)
            pictured[path] = (id(sim), sim.steps)


pictured: dict[Path, tuple[int, int]] = {}
"""By file: the simulation, and how many steps it had done."""
