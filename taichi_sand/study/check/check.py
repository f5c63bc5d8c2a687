"""Simulates scenes and holds them to their [[checks]]."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand.errors import SandError, show, suggest
from taichi_sand.measure.named import MEASURES
from taichi_sand.run.simulation import Simulation
from taichi_sand.scene.expected import Check
from taichi_sand.scene.schema import Scene
from taichi_sand.study.sweep.job import numbers

LOOKS = 100
"""Moments at which a number is looked at that is followed over a time."""


@dataclass(frozen=True)
class Row:
    """One check, and what was found."""

    scene: str
    observable: str
    at: float  # [s]
    value: float  # NaN: there was nothing to measure, or the event that it waits for has not come
    low: float
    high: float

    @property
    def passed(self) -> bool:
        """Whether the value lies within its range."""
        return self.low <= self.value <= self.high

    @property
    def limits(self) -> str:
        """Its range, in words."""
        if math.isinf(self.low):
            return f"at most {self.high:.4g}"
        return f"at least {self.low:.4g}" if math.isinf(self.high) else f"{self.low:.4g} … {self.high:.4g}"

    def to_dict(self) -> dict[str, Any]:
        """For JSON, which knows no NaN: null."""
        found = {**vars(self), "passed": self.passed}
        return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in found.items()}


def when(scene: Scene, check: Check) -> float:
    """The time at which a check is due at the latest [s]."""
    return float(scene.duration if isinstance(check.at, str) else check.at)


def moments(sim: Simulation, told: Callable[[float], None] | None) -> Iterator[tuple[Check, bool]]:
    """Simulates on, and yields each check of the scene when it is due, at a time or at the step of an event, and whether that came: once an
    event has ended the simulation, no later time does.
    """
    scene = sim.scene
    left = {one.at for one in scene.checks if isinstance(one.at, str)} - {"end"}
    for stop in sorted({when(scene, one) for one in scene.checks}):
        while True:
            sim.advance_to(stop, progress=told, events=left)
            come = left & sim.events.keys()
            yield from ((one, True) for one in scene.checks if one.at in come)
            left -= come
            if not come:
                break
        there = sim.time > stop - sim.step
        yield from ((one, there or one.at == "end") for one in scene.checks if when(scene, one) == stop and one.at in (stop, "end"))
    yield from ((one, False) for one in scene.checks if one.at in left)


class Followed:
    """The values of the number of a check over the last while of a simulation, at LOOKS moments of it."""

    def __init__(self, sim: Simulation, check: Check) -> None:
        self.check, self.found = check, deque[tuple[float, float]](maxlen=LOOKS + 1)
        self.call = sim.every(check.over / LOOKS, self.look)

    def look(self, sim: Simulation) -> None:
        """Notes what it is now, unless that is long before it is asked for."""
        if isinstance(self.check.at, str) or sim.time > self.check.at - 1.1 * self.check.over:
            self.found.append((sim.time, observed(sim, self.check.observable)))

    def value(self, sim: Simulation) -> float:
        """What is asked for of those values; NaN without any, or where there was nothing to measure."""
        self.call.stop()
        self.look(sim)
        values = [value for time, value in self.found if time > sim.time - 1.01 * self.check.over]
        return float({"mean": np.mean, "least": np.min, "most": np.max}[self.check.take](values or [math.nan]))


def observed(sim: Simulation, observable: str) -> float:
    """As `observe`; NaN if there is no such number now, such as of a wall that has gone."""
    return MEASURES[observable](sim) if observable in MEASURES else numbers(sim.report()).get(observable, math.nan)


def observe(sim: Simulation, observable: str) -> float:
    """A measurement, or a number of the report; SandError if there is none of that name."""
    if observable in MEASURES:
        return MEASURES[observable](sim)
    found = numbers(sim.report())
    if observable not in found:
        known = [*MEASURES, *found]
        raise sim.scene.error("checks", f"observable = {show(observable)} is no number of this scene{suggest(observable, known)}")
    return found[observable]


def check(
    name: str, scene: Scene, arch: str = "cpu", threads: int | None = None, progress: Callable[[float], None] | None = None
) -> list[Row]:
    """Simulates `scene` as far as its checks ask for, and returns a row each, in the order of time.

    Args:
        name: what rows call the scene.
        scene: with [[checks]].
        arch: backend.
        threads: CPU threads; all there are if None.
        progress: called with the share that is done.

    Raises:
        SandError: the scene has no checks, or one that asks for a number that there is not.
    """
    if not scene.checks:
        raise SandError(f"{name} has no [[checks]]: it says nothing of what it must show")
    with Simulation(scene, arch=arch, threads=threads) as sim:
        for wanted in scene.checks:
            observe(sim, wanted.observable)
        rows, end = [], max(when(scene, wanted) for wanted in scene.checks)
        followed = {id(wanted): Followed(sim, wanted) for wanted in scene.checks if wanted.over}
        told = None if progress is None else lambda _: progress(min(1.0, sim.time / end))
        for wanted, came in moments(sim, told):
            low = -math.inf if wanted.low is None else wanted.low
            high = math.inf if wanted.high is None else wanted.high
            value = math.nan
            if came:
                value = followed[id(wanted)].value(sim) if wanted.over else observed(sim, wanted.observable)
            rows.append(Row(name, wanted.observable, sim.time, value, low, high))
        return rows
