"""The folder of a sweep: a folder a run, named by its key, which is complete or not there."""

import json
import os
import shutil
from pathlib import Path
from typing import Any, Self

from taichi_sand.scene.errors import SandError
from taichi_sand.study.sweep.job import failure
from taichi_sand.study.sweep.plan import Job

RUNS, PART = "runs", ".part-"


class Store:
    """Results by key.

    Args:
        folder: of the sweep; made if it is not there.

    Raises:
        SandError: it cannot be made or written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._make()

    @classmethod
    def seen(cls, folder: Path) -> Self:
        """A store that is only looked at: nothing is made."""
        store = cls.__new__(cls)
        store.folder = folder
        return store

    def _make(self) -> None:
        folder = self.folder
        try:
            (folder / RUNS).mkdir(parents=True, exist_ok=True)
            probe = folder / RUNS / f"{PART}{os.getpid()}"
            probe.mkdir()
            probe.rmdir()
        except OSError as error:
            raise SandError(f"-o {folder}: cannot be written to: {error.strerror}") from None

    def clean(self) -> None:
        """Takes away what calls that were killed have left half-written; not while others write here."""
        for part in (self.folder / RUNS).glob(f"{PART}*"):
            shutil.rmtree(part, ignore_errors=True)

    def place(self, job: Job) -> Path:
        """Folder of a run."""
        return self.folder / RUNS / job.key

    def status(self, job: Job) -> str:
        """done, or how it failed (refused, timeout, error, crashed); "" if it has not been run."""
        place = self.place(job)
        if (place / "report.json").is_file():
            return "done"
        return str(self.failure(job).get("status", "")) if place.is_dir() else ""

    def failure(self, job: Job) -> dict[str, Any]:
        """Status and sentence of a run that failed; empty if it did not."""
        file = self.place(job) / "failed.json"
        return json.loads(file.read_text("utf-8")) if file.is_file() else {}

    def report(self, job: Job) -> dict[str, Any] | None:
        """What a run reports; None if it has no report."""
        file = self.place(job) / "report.json"
        return json.loads(file.read_text("utf-8")) if file.is_file() else None

    def put(self, job: Job, files: dict[str, bytes]) -> None:
        """Files the result of a run: written beside, then moved into place. SandError if the disk is full or the like."""
        part, place = self.folder / RUNS / f"{PART}{os.getpid()}-{job.key}", self.place(job)
        try:
            part.mkdir()
            for name, content in files.items():
                with (part / name).open("wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
            shutil.rmtree(place, ignore_errors=True)  # a failure that is tried again
            part.rename(place)
        except OSError as error:
            shutil.rmtree(part, ignore_errors=True)
            text = f"{place} could not be written: {error.strerror}; what is done is kept, the same command goes on from there"
            raise SandError(text) from None

    def fail(self, job: Job, status: str, sentence: str) -> None:
        """Files a run that left nothing of its own."""
        self.put(job, {"failed.json": failure(status, sentence)})
