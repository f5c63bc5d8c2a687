"""What `run` writes beside its report and checkpoint: all of it is looked at before anything is simulated."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.files import trajectory, writing
from taichi_sand.scene.record import LEAST


class Outputs:
    """The files that were asked for. SandError if one cannot be written, or a library for it is missing."""

    def __init__(self, out: Path | None, every: float | None) -> None:
        self.out, self.every = out, every
        if every is not None and not LEAST <= every < float("inf"):
            raise SandError(f"--every {every:g} must be a number of seconds, at least {LEAST:g}")
        if out is not None:
            writing.check(trajectory.target(out, "--out"), "--out")

    @contextmanager
    def of(self, sim: Any) -> Iterator[None]:
        """Writes them while `sim` is advanced in the block; what there is when that is interrupted stays."""
        record = sim.scene.record
        every, out = self.every or record.every, self.out or record.trajectory
        recorder = None if out is None else sim.record(out, every)
        try:
            yield
        finally:
            if recorder is not None:
                recorder.stop()
