"""Records a simulation while it goes on: frames of a trajectory, at exact times. What is simulated does not change by a bit."""

import hashlib
import json
import weakref
from contextlib import suppress
from os import PathLike
from typing import Any

from taichi_sand.errors import SandError, show
from taichi_sand.files.trajectory import Trajectory, target
from taichi_sand.measure.frame import Frames
from taichi_sand.run import live
from taichi_sand.run.clock import Clock
from taichi_sand.run.entry import changes
from taichi_sand.scene.kinds import HUGE
from taichi_sand.scene.record import LEAST
from taichi_sand.scene.schema import Scene

MOST = 2**31
"""Steps, more than a simulation counts."""


class Recorder:
    """Writes frames of a simulation at multiples of `every` [s] of its time, each at the nearest step; `stop` ends it."""

    def __init__(self, sim: Any, frames: Frames, trajectory: Trajectory, every: float) -> None:
        self.frames, self.trajectory, self.every, self.next = frames, trajectory, every, round(sim.time / every)
        self.sim = weakref.ref(sim)
        self.ending = weakref.finalize(sim, _quietly, trajectory)
        if self.steps_left(sim) < 0:
            self.next += 1
        self.look(sim)

    def steps_left(self, sim: Any) -> int:
        """Steps until the next frame; below 0 = it is past."""
        return round((self.next * self.every - sim.time) / sim.step)

    def look(self, sim: Any) -> None:
        """Writes the frame that is due, if one is and has not been written."""
        if self.steps_left(sim) <= 0:
            if self.trajectory.last_step < sim.steps:
                self.trajectory.write(self.frames.of(sim))
            while self.steps_left(sim) <= 0:  # of several within a step the first is written
                self.next += 1

    def stop(self) -> None:
        """Ends the recording; the file is complete. SandError if the disk is full."""
        sim = self.sim()
        if sim is not None and self in sim.recorders:
            sim.recorders.remove(self)
            self.trajectory.close()


def _quietly(trajectory: Trajectory) -> None:
    """Closes the file of a simulation that is gone."""
    with suppress(SandError):
        trajectory.close()


class Recorded:
    """The side of `Simulation` that writes trajectories."""

    recorders: list[Recorder]
    scene: Scene
    steps: int
    step: float
    time: float
    clock: Clock

    @changes
    def record(self, path: str | PathLike[str], every: float) -> Recorder:
        """Writes a trajectory (GSD) from now on: a frame of this moment, and at each multiple of `every` [s] one, at the nearest step.
        Needs the extra `data`. The file can be read at any time, and after a kill up to its last flush; it is complete after the returned
        recorder's `stop()`, or `close()`, or the end of the simulation. What a frame holds is told in measure/frame.py.

        A simulation that is past its start, such as one that was resumed, goes on with the trajectory that is there: frames later than
        now go. At the start an old file is replaced.

        Raises:
            SandError: `every` is no time, the file cannot be written, the library is missing, or another scene's trajectory is in the way.
        """
        number = isinstance(every, int | float) and not isinstance(every, bool)
        if not number or not LEAST <= every <= HUGE:
            raise SandError(f"every = {show(every)} must be a number of seconds, at least {LEAST:g}")
        place, mark, frames = target(path), made_of(self.scene), Frames(self)
        if any(one.trajectory.path == place for one in self.recorders):
            raise SandError(f"{place}: is being recorded already")
        if self.steps and place.exists():
            trajectory = Trajectory.go_on(place, self.steps, mark)
        else:
            trajectory = Trajectory.begin(place, frames.of(self), mark)
        recorder = Recorder(self, frames, trajectory, float(every))
        self.recorders.append(recorder)
        return recorder

    def _steps_to_record(self) -> int:
        """Steps until the next frame of any recorder."""
        return min((recorder.steps_left(self) for recorder in self.recorders), default=MOST)

    def _look_at_recorders(self) -> None:
        """Writes the frames that are due; a recorder that cannot write is none any more."""
        if self.recorders:
            with self.clock.stage("record"):
                for recorder in list(self.recorders):
                    self._surely(recorder, recorder.look, self)

    def flush_recorders(self) -> None:
        """What has been recorded can be read."""
        for recorder in list(self.recorders):
            self._surely(recorder, recorder.trajectory.flush)

    def _surely(self, recorder: Recorder, act: Any, *arguments: Any) -> None:
        try:
            act(*arguments)
        except SandError:
            self.recorders.remove(recorder)
            raise


def made_of(scene: Any) -> bytes:
    """A mark that scenes have in common that differ only in what may change while they are simulated."""
    table = json.loads(scene.to_json())
    kept = {name: value for name, value in table.items() if name not in live.FREE}
    text = json.dumps([kept, scene.solver.kind, scene.solver.precision], sort_keys=True)
    return hashlib.sha256(text.encode()).digest()
