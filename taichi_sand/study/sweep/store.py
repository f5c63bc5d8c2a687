"""The folder of a sweep: a folder a run, named by its key, which is complete or not there."""

import json
from pathlib import Path
from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.study.sweep.plan import Job

RUNS = "runs"


class Store:
    """Results by key, in a folder that is made when the first one comes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

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
        """Files the result of a run. SandError if the disk is full or the like; what is done before is kept."""
        try:
            with writing.replacing(self.place(job), folder=True, empty=True) as made:
                made.mkdir()
                for name, content in files.items():
                    (made / name).write_bytes(content)
        except SandError as error:
            raise SandError(f"{error}; what is done is kept, the same command goes on from there") from None
