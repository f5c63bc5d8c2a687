"""What `run` writes beside its report and checkpoint: all of it is looked at before anything is simulated."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.files import trajectory, writing
from taichi_sand.scene.record import LEAST


class Outputs:
    """The files that were asked for. SandError if one cannot be written, or a library for it is missing.

    Args:
        out: a trajectory.
        every: seconds from frame to frame, and from row to row; that of the scene's [record] if None.
        contacts: a table of the contacts at the end.
        series: a table of the numbers of the report over time.
        fields: coarse-grained fields, of the end (.vtu) or over time.
    """

    def __init__(self, out: Path | None, every: float | None, contacts: Path | None, series: Path | None, fields: Path | None) -> None:
        self.out, self.every, self.contacts, self.series, self.fields = out, every, contacts, series, fields
        if every is not None and not LEAST <= every < float("inf"):
            raise SandError(f"--every {every:g} must be a number of seconds, at least {LEAST:g}")
        if out is not None:
            writing.check(trajectory.target(out, "--out"), "--out")
        if contacts is not None or series is not None:
            from taichi_sand.output import tables

            for path, option in ((contacts, "--contacts"), (series, "--series")):
                if path is not None:
                    tables.check(path, option)
        if fields is not None:
            from taichi_sand.output import grids

            grids.check(fields, "--fields")

    @contextmanager
    def of(self, sim: Any) -> Iterator[None]:
        """Writes them while `sim` is advanced in the block; trajectory and series keep what there is when that is interrupted."""
        out, every = self.out or sim.scene.record.trajectory, self.every or sim.scene.record.every
        recorder = None if out is None else sim.record(out, every)
        try:
            with self._noted(self._series(), sim, every), self._noted(self._fields(sim), sim, every):
                yield
        finally:
            if recorder is not None:
                recorder.stop()
        if self.contacts is not None:
            from taichi_sand.output import tables

            tables.write(self.contacts, tables.of_contacts(sim))

    def _series(self) -> Any:
        from taichi_sand.output import tables

        return None if self.series is None else tables.Series(self.series)

    def _fields(self, sim: Any) -> Any:
        from taichi_sand.output import grids

        return None if self.fields is None else grids.Fields(self.fields, sim)

    @contextmanager
    def _noted(self, book: Any, sim: Any, every: float) -> Iterator[None]:
        """`book` notes the moment now, every so often, and at the end."""
        if book is None:
            yield
            return
        if not book.last_only:
            book.note(sim)
            sim.every(every, book.note)
        try:
            yield
            book.note(sim)
        finally:
            book.close()
