"""One run of a sweep, wherever it is run: in goes a job, out come the files of its folder."""

import contextlib
import csv
import io
import json
import math
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.measure.numbers import TIMINGS, numbers
from taichi_sand.study.sweep.plan import Job

PIECE = 1 / 60
"""Simulated time between two looks at the clock [s]."""
ALONE = threading.Lock()
"""Of one run in a process at a time: stderr and the registry of effects are the process's."""


class TooLong(Exception):
    """A run took longer than it may."""


def simulate(job: Job, timeout: float | None = None) -> dict[str, bytes]:
    """Runs `job` in this process on one thread and returns its files by name: scene.toml, report.json, series.csv if asked for, and
    stderr.txt. What goes wrong is a file failed.json with a sentence in place of the report.
    """
    files = {"scene.toml": as_toml(job.scene)} if job.scene else {}
    noise = io.StringIO()
    try:
        if job.refusal:
            raise SandError(job.refusal)
        with ALONE, contextlib.redirect_stderr(noise):
            report, series = _run(job, timeout)
    except SandError as error:
        return files | {"failed.json": failure("refused", str(error))}
    except TooLong:
        return files | {"failed.json": failure("timeout", f"took longer than {timeout:g} s")}
    except Exception as error:  # a run that breaks costs one row, not the sweep
        return files | {"failed.json": failure("error", f"{type(error).__name__}: {error}")}
    files["report.json"] = json.dumps(report, indent=1, allow_nan=False, sort_keys=True).encode() + b"\n"
    if series:
        files["series.csv"] = as_csv(series)
    return files | {"stderr.txt": noise.getvalue().encode()}


def failure(status: str, sentence: str) -> bytes:
    """What a run leaves that has no report; status: refused, timeout, error or crashed."""
    return json.dumps({"status": status, "sentence": sentence}, indent=1).encode() + b"\n"


def _run(job: Job, timeout: float | None) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    from taichi_sand.measure.named import MEASURES
    from taichi_sand.run.simulation import Simulation
    from taichi_sand.scene.schema import Scene

    end = time.monotonic() + timeout if timeout else None
    with own_effects(job.own):
        sim = Simulation(Scene.from_json(job.scene), arch=job.arch, threads=1)
        series = []
        for stop in _stops(job.seconds, job.every):
            _advance(sim, stop, end)
            if job.every:
                series.append(numbers(sim.report()))
        report = {key: value for key, value in sim.report().items() if key not in TIMINGS}
        for name in job.measures:
            value = MEASURES[name](sim)
            report |= {name: value} if math.isfinite(value) else {}
        return report, series


def _stops(seconds: float, every: float | None) -> list[float]:
    """Times at which a run is looked at, its end the last [s]."""
    if not every:
        return [seconds]
    return [*(k * every for k in range(int(seconds / every - 1e-9) + 1)), seconds]


def _advance(sim: Any, until: float, end: float | None) -> None:
    """Simulates until `until` [s]; TooLong once the clock is past `end`."""

    def look(_: float) -> None:
        if end is not None and time.monotonic() > end:
            raise TooLong

    sim.advance_to(until, progress=look if end is not None else None)


def as_csv(rows: list[dict[str, Any]]) -> bytes:
    """Rows with the same names, as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def as_toml(scene: str) -> bytes:
    """A scene, from its JSON, as the file that `run` takes."""
    import tomli_w

    return tomli_w.dumps(_without_none(json.loads(scene))).encode()


def _without_none(value: Any) -> Any:
    """TOML knows no null: a key that is null is left out."""
    if isinstance(value, dict):
        return {key: _without_none(part) for key, part in value.items() if part is not None}
    return [_without_none(part) for part in value] if isinstance(value, list) else value


@contextlib.contextmanager
def own_effects(sources: dict[str, str]) -> Iterator[None]:
    """Makes effects of the user's own known here, from their source texts."""
    from taichi_sand import effects

    with tempfile.TemporaryDirectory() if sources else contextlib.nullcontext("") as folder:
        for name, text in sources.items():
            if name not in effects.own:
                file = Path(folder) / f"{name}.py"
                file.write_text(text, "utf-8")
                effects.add(file)
        yield
