"""Runs a plan: what has been done is not done again, what fails costs its own row, and where it runs makes no difference to the files."""

import contextlib
import dataclasses
import json
import os
import shlex
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from pathlib import Path
from typing import Any

from taichi_sand import effects as modules
from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.scene import loading
from taichi_sand.scene.schema import Scene
from taichi_sand.study.sweep import results
from taichi_sand.study.sweep.job import failure, simulate
from taichi_sand.study.sweep.local import Crew
from taichi_sand.study.sweep.plan import Asked, Job, Plan, plan
from taichi_sand.study.sweep.store import Store

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def sweep(
    scene: Scene | str | Path,
    vary: Mapping[str, str | Sequence[Any]],
    seeds: int | Sequence[int] = 1,
    *,
    seconds: float | None = None,
    every: float | None = None,
    measures: Sequence[str] = (),
    folder: str | Path | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    timeout: float | None = None,
    retry_failed: bool = False,
    arch: str = "cpu",
    effects: Sequence[str | Path] = (),
    progress: Callable[[float], None] | None = None,
) -> Any:
    """Runs a scene over all combinations of values, with several seeds each, and returns what came out.

    Args:
        scene: a Scene, a path, or the name of a bundled scene.
        vary: values by key (`"effects.friction.mu"`): a list, or a text such as `"0..1:5"`, `"log:0.001..0.1:5"`, `"md,rigid"`.
        seeds: how many seeds, from the scene's own on, or which.
        seconds: simulated time of a run [s]; the scene's duration if None.
        every: simulated time between the rows of each run's series.csv [s]; no series if None.
        measures: measurements by name (`repose_angle`), taken at the end besides the numbers of the report.
        folder: where results are kept, and found again by a later call; a temporary one if None.
        workers: processes on this machine; one a core if None.
        executor: any `concurrent.futures.Executor` (that of a Dask client: `client.get_executor()`) to run on instead.
        timeout: wall time that a run may take [s].
        retry_failed: runs that failed are done again.
        arch: backend.
        effects: Python files with effects of your own.
        progress: called with the share that is done.

    Returns:
        An xarray.Dataset with a dimension for every varied key and `seed`; the numbers of the report, NaN where a run failed.

    Raises:
        SandError: nothing can be run as asked, or results cannot be written.
    """
    results.xarray()
    asked = Asked(seconds, every, arch, own_sources(effects), tuple(measures))
    made = plan(loader(scene, effects), vary, seeds, asked)
    with tempfile.TemporaryDirectory() if folder is None else contextlib.nullcontext(folder) as place:
        store = Store(Path(place))
        with runner(workers or CORES, executor, timeout) as run:
            execute(made, store, run, retry_failed, progress)
        return results.write(made, store, command_of(scene, made, asked, [], effects))


def loader(scene: Scene | str | Path, effects: Sequence[str | Path] = (), given: Sequence[str] = ()) -> Callable[[list[str]], Scene]:
    """What makes the scene for overrides."""
    import taichi_sand

    if isinstance(scene, Scene):
        return lambda overrides: _checked(loading.changed(scene, [*given, *overrides]))
    return lambda overrides: taichi_sand.load(scene, [*given, *overrides], effects)


def _checked(scene: Scene) -> Scene:
    modules.check(scene)
    return scene


def own_sources(effects: Sequence[str | Path]) -> dict[str, str]:
    """Source text of effects in Python files, by name."""
    return {modules.add(path): Path(path).read_text("utf-8") for path in effects}


def due(made: Plan, store: Store, retry_failed: bool) -> list[Job]:
    """The jobs that have not been run."""
    again = ("", "refused", "timeout", "error", "crashed") if retry_failed else ("",)
    return [job for job in made.jobs if store.status(job) in again]


Runner = Callable[[list[Job]], Iterator[tuple[Job, dict[str, bytes]]]]
"""Runs jobs somewhere, and yields each with its files as they are done."""


def runner(workers: int, executor: Executor | None, timeout: float | None) -> contextlib.AbstractContextManager[Runner]:
    """Where runs are computed: processes on this machine, or an executor."""
    if executor is not None:
        return contextlib.nullcontext(lambda jobs: run_elsewhere(jobs, executor, timeout))
    return _local(workers, timeout)


@contextlib.contextmanager
def _local(workers: int, timeout: float | None) -> Iterator[Runner]:
    with Crew(workers, timeout) as crew:
        yield crew.run


def execute(made: Plan, store: Store, run: Runner, retry_failed: bool = False, progress: Callable[[float], None] | None = None) -> None:
    """Runs what of a plan is not in the store yet; see `sweep`."""
    left = due(made, store, retry_failed)
    for job in [job for job in left if job.refusal]:
        store.put(job, simulate(job))
    jobs = [job for job in left if not job.refusal]
    done = len(made.jobs) - len(jobs)
    for number, (job, files) in enumerate(run(jobs), 1):
        store.put(job, files)
        if progress:
            progress((done + number) / len(made.jobs))


def run_elsewhere(jobs: list[Job], executor: Executor, timeout: float | None) -> Iterator[tuple[Job, dict[str, bytes]]]:
    """Runs `jobs` on an executor; yields each with its files, as they are done. A run past its time stops by itself."""
    futures: dict[Future, Job] = {executor.submit(simulate, job, timeout): job for job in jobs}
    try:
        for future in as_completed(futures):
            job = futures.pop(future)
            try:
                yield job, future.result()
            except Exception as error:  # of the executor: a worker that died
                yield job, {"failed.json": failure("crashed", f"the executor lost it: {type(error).__name__}: {error}")}
    finally:
        for future in futures:
            future.cancel()


def command_of(scene: Scene | str | Path, made: Plan, asked: Asked, given: Sequence[str] = (), effects: Sequence[str | Path] = ()) -> str:
    """The command that runs the same: what decides the results, not where they were computed."""
    words = ["taichi-sand", "sweep", "SCENE" if isinstance(scene, Scene) else str(scene)]
    for key, values in made.vary.items():
        words += ["--vary", f"{key}={','.join(_word(value) for value in values)}"]
    words += ["--seeds", str(len(made.seeds))]
    for flag, values in (("--set", given), ("--effect", [Path(path).name for path in effects]), ("--measure", asked.measures)):
        words += [part for value in values for part in (flag, value)]
    for flag, value in (("--seconds", asked.seconds), ("--every", asked.every)):
        words += [flag, f"{value:g}"] if value is not None else []
    return shlex.join(words + (["--arch", asked.arch] if asked.arch != "cpu" else []))


def _word(value: Any) -> str:
    return value if isinstance(value, str) else str(results.as_text(value))


def write_commands(made: Plan, store: Store, file: Path, retry_failed: bool, timeout: float | None) -> int:
    """Writes a line for every run that is left, for any batch system, and what each needs beside it; returns how many.

    The lines run where this folder can be seen under the same path; the next `sweep` call takes their results in.
    """
    left = [job for job in due(made, store, retry_failed) if not job.refusal]
    folder = (store.folder / "jobs").absolute()
    more = ["--timeout", f"{timeout:g}"] if timeout else []
    for job in left:
        with writing.replacing(folder / f"{job.key}.json") as made_file:
            made_file.write_text(json.dumps(dataclasses.asdict(job)), "utf-8")
    lines = [shlex.join(["taichi-sand", "sweep", "--run", str(folder / f"{job.key}.json"), *more]) for job in left]
    with writing.replacing(file, empty=True) as made_file:
        made_file.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    return len(left)


def run_written(file: Path, timeout: float | None) -> None:
    """What a line of `write_commands` does: runs one job and files its result; nothing if that is there already."""
    try:
        data = json.loads(file.read_text("utf-8"))
        job = Job(**{**data, "measures": tuple(data["measures"])})
    except (OSError, ValueError, TypeError, KeyError):
        raise SandError(f"--run {file}: is not a job that `sweep --write-commands` wrote") from None
    store = Store(file.absolute().parents[1])
    if store.status(job) != "done":
        store.put(job, simulate(job, timeout))
