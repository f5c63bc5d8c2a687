"""The clock of a simulation: what its stages took, compiling apart, and what has been done in that time."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from taichi_sand.taichi_support import compiling


@dataclass
class Clock:
    """Times [s] since the simulation was made or resumed; a stage within another counts as itself alone."""

    wall: float = 0.0  # in all stages
    compile: float = 0.0  # making the simulation, and kernels that a stage was the first to call
    stages: dict[str, float] = field(default_factory=dict)
    simulated: float = 0.0  # time that has been simulated
    grain_steps: int = 0  # steps of all grains
    within: list[list[float]] = field(default_factory=list)  # of each stage that is open: what others within it took, and compiled

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to stage `name`, but for what it compiles; all of it, if that is "compile", counts as compiling."""
        start, before = time.perf_counter(), compiling.seconds()
        self.within.append([0.0, 0.0])
        try:
            yield
        finally:
            spent, compiled = time.perf_counter() - start, compiling.seconds() - before
            inner = self.within.pop()
            if self.within:
                self.within[-1][0] += spent
                self.within[-1][1] += compiled
            own, compiled = spent - inner[0], compiled - inner[1]
            if name == "compile":
                self.compile += own
            else:
                self.compile += compiled
                self.wall += own - compiled
                self.stages[name] = self.stages.get(name, 0.0) + own - compiled

    def count(self, grains: int, steps: int, step: float) -> None:
        """So many grains have gone so many steps of `step` [s]."""
        self.simulated += steps * step
        self.grain_steps += grains * steps
