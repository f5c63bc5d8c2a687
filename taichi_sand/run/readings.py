"""What can be read from a simulation: its grains as arrays, its report, its picture."""

from typing import Any

import numpy as np

from taichi_sand.run.clock import Clock
from taichi_sand.run.entry import reads
from taichi_sand.solvers.bed import Bed
from taichi_sand.solvers.tolerance import TOO_SOFT, softness
from taichi_sand.world import sources
from taichi_sand.world.flags import note, sentences
from taichi_sand.world.reading import read_columns
from taichi_sand.world.tables import World

TOO_SOFT_TO_FLOW = (
    "The flow is too fast for contacts of this tolerance: its softness is {soft:.2g}, above {most:g}, and speeds may be wrong by a tenth "
    "or more. A smaller tolerance is more exact."
)


class Readings:
    """The readable side of `Simulation`."""

    scene: Any
    steps: int
    world: World
    bed: Bed
    numbers: dict[str, float]
    made: int
    removed: int
    flagged: dict[str, list[float]]
    epoch: tuple[int, float]
    step: float
    clock: Clock
    stages: Any

    def _column(self, name: str) -> np.ndarray:
        return read_columns(self.world, (name,))[name]

    @property
    @reads
    def positions(self) -> np.ndarray:
        """Centres [m], shape (n, 2), in the order in which the scene made the grains, as all that follow."""
        return self._column("position")

    @property
    @reads
    def velocities(self) -> np.ndarray:
        """[m/s], shape (n, 2)."""
        return self._column("velocity")

    @property
    @reads
    def angles(self) -> np.ndarray:
        """[rad], shape (n,); whole turns are not counted."""
        return self._column("angle")

    @property
    @reads
    def spins(self) -> np.ndarray:
        """Angular velocities [rad/s], shape (n,)."""
        return self._column("spin")

    @property
    @reads
    def radii(self) -> np.ndarray:
        """[m], shape (n,)."""
        return self._column("radius").astype(float)

    @property
    @reads
    def ids(self) -> np.ndarray:
        """Ids of the grains still there, shape (n,); the other arrays hold their rows in this order."""
        return self._column("id")

    @property
    @reads
    def count(self) -> int:
        """Grains present."""
        return int(self.world.count[None])

    @property
    @reads
    def lost(self) -> int:
        """Grains that left through open edges."""
        return self.made - self.taken - self.count

    @property
    @reads
    def taken(self) -> int:
        """Grains taken out, by sinks and by hand."""
        return self.removed + (self.world.flow.sunk[None] if self.world.flows else 0)

    @reads
    def flags(self) -> list[str]:
        """What went wrong so far, a sentence each; empty when all is well."""
        self.note_flags()
        return sentences(self.world.flags, self.flagged) + sources.late(self.scene, self.world, self.stages.flows, self.poured)

    def note_flags(self) -> None:
        """Keeps of flags when they were first raised, and at which speed: to be called before the step changes."""
        note(self.world.flags, self.flagged, self._time_of, self.numbers["speed_cap"])

    @property
    def poured(self) -> float:
        """When the sources last made what was due [s]."""
        return self._time_of(self.steps - self.steps % sources.steps_between(self.step))

    @reads
    def warnings(self) -> list[str]:
        """What the numbers cannot be trusted with, a sentence each; empty when all is well."""
        soft, most = softness(self.numbers, self.bed), TOO_SOFT[self.scene.solver.kind]
        return [TOO_SOFT_TO_FLOW.format(soft=soft, most=most)] if soft > most else []

    def _time_of(self, steps: int) -> float:
        """When so many steps had been done [s]; before the step last changed, as if it had always been the same."""
        done, then = self.epoch
        return then + (steps - done) * self.step if steps >= done else then * steps / done

    @reads
    def report(self) -> dict[str, Any]:
        """What the simulation did, how well and at what cost; the keys are those of `taichi-sand run --json`."""
        from taichi_sand.measure.report import report

        with self.clock.stage("measure"):
            return report(self)

    def image(self) -> np.ndarray:
        """The picture of this moment, (height, width, 3) uint8."""
        from taichi_sand.view.picture import image

        return image(self)
