"""What a hard case is made of: a set-up and gates (physics.md C).

A case is a function that builds worlds and yields gates: what was measured, and the most that it may be. It gets the [solver] table to
use, so that the same case tries both solvers at several tolerances.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand.study.laboratory import D, G, R, simulate

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


CASES: dict[str, Case] = {}


def case(name: str, setup: str, quick: bool = True) -> Callable:
    """Enters a function into the table of cases."""

    def enter(run: Callable[[dict[str, Any]], Iterator[Gate]]) -> Callable:
        CASES[name] = Case(name, setup, run, quick)
        return run

    return enter


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
