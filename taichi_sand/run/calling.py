"""Functions that are called while a simulation goes on, and going on until something holds."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_sand.errors import SandError, show
from taichi_sand.run.arguments import number
from taichi_sand.scene.events import names
from taichi_sand.solvers.bed import EARTH
from taichi_sand.taichi_support.turns import turn
from taichi_sand.world import edit
from taichi_sand.world.tables import World

AT_REST, FOR = 1e-3, 0.2
"""A bed is at rest once its grains have been slower than AT_REST sqrt(g d) in the mean for so long [s]."""
NEVER = 2**31 - 1


@dataclass(eq=False)
class Call:
    """A function that is called every so often; what `Simulation.every` returns."""

    function: Callable[[Any], Any]
    interval: float  # [s]
    start: float  # [s]
    number: int = 1  # of the next call, from 1 on
    stopped: bool = False

    def stop(self) -> None:
        """It is called no more."""
        self.stopped = True

    @property
    def due(self) -> float:
        """When it is called next [s]: a multiple of the interval after the start, so that times do not drift."""
        return self.start + self.number * self.interval


@dataclass(eq=False)
class Calls:
    """All of a simulation, in the order in which they were asked for."""

    found: list[Call] = field(default_factory=list)
    calling: bool = False  # whether one is being called


class Calling:
    """The side of `Simulation` that calls back."""

    calls: Calls
    world: Any
    bed: Any
    time: float
    step: float
    owed: float
    scene: Any
    advance_to: Any
    events: dict[str, float]
    _next_event: Any

    def every(self, seconds: float, function: Callable[[Any], Any]) -> Call:
        """Calls `function` with the simulation every so many seconds of simulated time from now on, each time after the step that ends
        nearest to it. It may read and change all of it, but not advance it; what it raises ends the `advance` that it is called in, which
        leaves all whole, as an interrupt does. Checkpoints do not hold functions: after `resume` ask for them again.

        Args:
            seconds: between two calls; of those that fall on one step, one is made.
            function: what is called.

        Returns:
            A handle; its `stop()` ends the calls.

        Raises:
            SandError: that is no time above 0, or no function.
        """
        seconds = number("every", "seconds", seconds, low=0.0, open_low=True)
        if not callable(function):
            raise SandError(f"every: function = {show(function)} must be a function of the simulation")
        call = Call(function, seconds, self.time)
        self.calls.found.append(call)
        return call

    def advance_until(self, condition: str | Callable[[Any], Any], *, at_most: float, every: float = 0.01) -> bool:
        """Simulates until a condition holds.

        Args:
            condition: a function of the simulation, asked now and every so often; or "rest": grains that can move have been slower than
                1e-3 sqrt(g d) in the mean for 0.2 s, d their mean diameter (g that of the earth where there is none); or the name of an
                event of the scene, at whose step it then is.
            at_most: so long [s].
            every: how often it is asked, of simulated time [s].

        Returns:
            Whether it came to that.

        Raises:
            SandError: an argument is wrong.
        """
        at_most = number("advance_until", "at_most", at_most, low=0.0)
        if isinstance(condition, str) and condition in names(self.scene.events):
            self.advance_to(self.time + self.owed + at_most, events=[condition])
            return condition in self.events
        if condition == "rest":
            holds: Callable[[Any], Any] = Rest()
        elif callable(condition):
            holds = condition
        else:
            raise SandError(f'advance_until: condition = {show(condition)} must be "rest", an event or a function of the simulation')
        every = number("advance_until", "every", every, low=0.0, open_low=True)
        start, count = self.time + self.owed, 0
        while not holds(self):
            if count * every >= at_most:
                return False
            count += 1
            self.advance_to(start + min(count * every, at_most))
        return True

    def _check_not_calling(self) -> None:
        """SandError within a call."""
        if self.calls.calling:
            raise SandError("a function that `every` calls cannot advance the simulation: it is advancing already")

    def _steps_to_call(self) -> int:
        """Steps until the next call, or event, is due, at least 1."""
        dues = [call.due for call in self.calls.found if not call.stopped]
        dues += [self._next_event()[0]] if self.scene.events else []
        return max(1, round(min((min(dues) - self.time) / self.step, NEVER))) if dues else NEVER

    def _call_due(self) -> None:
        """Calls whatever is due at this step. A call counts as made before it is: one that raises is not made again."""
        self.calls.found[:] = [call for call in self.calls.found if not call.stopped]
        for call in self.calls.found.copy():
            if call.stopped or (call.due - self.time) / self.step > 0.5:
                continue
            call.number = max(call.number, math.floor((self.time - call.start) / call.interval + 0.5 * self.step / call.interval)) + 1
            self.calls.calling = True
            try:
                call.function(self)
            finally:
                self.calls.calling = False


def mean_speed(world: World) -> float:
    """Mean speed of the grains that can move [m/s]; 0 without any."""
    _, whole = edit.places(world)
    free = whole[:, 2] == 0
    speeds = np.hypot(*world.grains.twist.to_numpy()[: len(free), :2].T)[free]
    return float(speeds.mean()) if len(speeds) else 0.0


def slow(sim: Any) -> bool:
    """Whether the grains hardly move at this moment."""
    return mean_speed(sim.world) < AT_REST * math.sqrt((sim.bed.gravity or EARTH) * sim.bed.diameter)


class Rest:
    """Whether grains have come to rest, asked again and again."""

    def __init__(self) -> None:
        self.since: float | None = None  # they have been slow [s]

    def __call__(self, sim: Any) -> bool:
        with turn:
            self.since = (sim.time if self.since is None else self.since) if slow(sim) else None
        return self.since is not None and sim.time - self.since >= FOR - 0.5 * sim.step
