"""Records a simulation while it goes on: frames of a trajectory, at exact times. What is simulated does not change by a bit."""

import hashlib
import json
import weakref
from collections.abc import Callable
from contextlib import suppress
from os import PathLike
from typing import Any

from taichi_sand.errors import SandError, show
from taichi_sand.files.trajectory import Trajectory, target
from taichi_sand.measure.frame import Frames
from taichi_sand.run import live
from taichi_sand.run.calling import Call, Calls
from taichi_sand.run.entry import changes
from taichi_sand.scene.kinds import HUGE
from taichi_sand.scene.record import LEAST
from taichi_sand.scene.schema import Scene


class Recorder:
    """Writes frames of a simulation at multiples of `every` [s] of its time, each at the nearest step; `stop` ends it."""

    def __init__(self, sim: Any, frames: Frames, trajectory: Trajectory, every: float) -> None:
        self.frames, self.trajectory = frames, trajectory
        self.sim = weakref.ref(sim)
        self.ending = weakref.finalize(sim, _quietly, trajectory)
        self.call = Call(self.write, every, 0.0, round(sim.time / every))
        if round((self.call.due - sim.time) / sim.step) == 0:
            self.write(sim)
        while round((self.call.due - sim.time) / sim.step) <= 0:
            self.call.number += 1

    def write(self, sim: Any) -> None:
        """Writes a frame, unless that has been done at this step."""
        if self.trajectory.last_step < sim.steps:
            with sim.clock.stage("record"):
                self.surely(sim, lambda: self.trajectory.write(self.frames.of(sim)))

    def surely(self, sim: Any, act: Callable[[], None]) -> None:
        """Does what may fail; then nothing more is written."""
        try:
            act()
        except SandError:
            self.end(sim)
            raise

    def end(self, sim: Any) -> None:
        """Writes no more."""
        self.call.stop()
        if self in sim.recorders:
            sim.recorders.remove(self)

    def stop(self) -> None:
        """Ends the recording; the file is complete. SandError if the disk is full."""
        sim = self.sim()
        if sim is not None and self in sim.recorders:
            self.end(sim)
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
    calls: Calls

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
        self.calls.found.append(recorder.call)
        return recorder

    def flush_recorders(self) -> None:
        """What has been recorded can be read."""
        for recorder in list(self.recorders):
            recorder.surely(self, recorder.trajectory.flush)


def made_of(scene: Any) -> bytes:
    """A mark that scenes have in common that differ only in what may change while they are simulated."""
    table = json.loads(scene.to_json())
    kept = {name: value for name, value in table.items() if name not in live.FREE}
    text = json.dumps([kept, scene.solver.kind, scene.solver.precision], sort_keys=True)
    return hashlib.sha256(text.encode()).digest()
