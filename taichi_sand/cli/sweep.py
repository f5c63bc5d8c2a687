"""The commands that run a scene many times: `sweep` and `calibrate`."""

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from taichi_sand.cli import options
from taichi_sand.cli.leaving import in_one_sentence
from taichi_sand.errors import PhysicsError, SandError
from taichi_sand.files import writing

Vary = Annotated[
    list[str],
    typer.Option("--vary", metavar="KEY=SPEC", help="0.1,0.2,0.5 or 0..1:5 or log:0.001..0.1:5 or words (md,rigid); repeatable."),
]
Folder = Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Where results are kept, and found again.")]
Measure = Annotated[
    list[str] | None, typer.Option("--measure", metavar="NAME", help="A number of the report, or repose_angle; repeatable.")
]
Workers = Annotated[int | None, typer.Option("--workers", min=1, help="Processes on this machine; one a core.")]
Scheduler = Annotated[str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster to run on instead.")]
Timeout = Annotated[float | None, typer.Option("--timeout", min=0.1, help="Wall time that a run may take, in seconds.")]
Every = Annotated[float | None, typer.Option("--every", min=1e-4, help="Simulated seconds between the rows of each run's series.csv.")]


def sweep(
    scene: Annotated[str | None, typer.Argument(metavar="SCENE", help="Path of a scene file, or name of a bundled scene.")] = None,
    vary: Vary = [],  # noqa: B006  typer copies it
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="Runs of every combination, each with a seed of its own.")] = 1,
    out: Folder = Path("sweep"),
    seconds: options.Seconds = None,
    every: Every = None,
    measure: Measure = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.png", help="Draws the first --measure: lines, or a map.")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    write_commands: Annotated[
        Path | None, typer.Option("--write-commands", metavar="FILE", help="Runs nothing: writes a line a run, for a batch system.")
    ] = None,
    grainlearning: Annotated[
        Path | None, typer.Option("--grainlearning", metavar="DIR", help="Writes the series in the files that GrainLearning reads.")
    ] = None,
    timeout: Timeout = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Does runs again that failed.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Says what would be run, and runs nothing.")] = False,
    one: Annotated[Path | None, typer.Option("--run", metavar="JOB", help="Runs one job that --write-commands wrote.")] = None,
    overrides: options.Overrides = None,
    effect: options.Effects = None,
    arch: options.Arch = "cpu",
) -> None:
    """Runs a scene over values of its keys and over seeds; what is done is not done again."""
    with in_one_sentence():
        from taichi_sand.study.sweep import engine, results
        from taichi_sand.study.sweep import grainlearning as files
        from taichi_sand.study.sweep.plot import plot as draw
        from taichi_sand.study.sweep.store import Store

        if one is not None:
            engine.run_written(one, timeout)
            return
        options.check_seconds(seconds)
        results.xarray()
        for file, option in ((plot, "--plot"), (write_commands, "--write-commands")):
            if file is not None:
                writing.check(file, option)
        for folder, option in ((out, "--out"), (grainlearning, "--grainlearning")):
            if folder is not None and not dry_run:
                writing.check(folder, option, folder=True)
        made, asked = _plan(scene, vary, seeds, seconds, every, measure, overrides, effect, arch)
        store = Store(out)
        left = engine.due(made, store, retry_failed)
        if dry_run:
            kinds = len({job.structure for job in left})
            print(f"{len(made.jobs)} runs, {len(made.jobs) - len(left)} done, {len(left)} to do in {kinds} structures")
            return
        if write_commands is not None:
            count = engine.write_commands(made, store, write_commands, retry_failed, timeout)
            print(f"{count} lines in {write_commands}; the same command without --write-commands takes their results in")
            return
        with cluster(scheduler) as executor, options.progress_bar("sweep") as progress:
            with engine.runner(workers or engine.CORES, executor, timeout) as run:
                engine.execute(made, store, run, retry_failed, progress)
        found = results.write(made, store, engine.command_of(scene or "", made, asked, overrides or (), effect or ()))
        if plot is not None:
            draw(found, _first(measure), plot)
        if grainlearning is not None:
            print(f"{files.export(made, store, grainlearning)} runs in {grainlearning}")
        _tell(made, store, out)


def calibrate(
    scene: options.SceneName,
    vary: Vary,
    measure: Annotated[str, typer.Option("--measure", metavar="NAME", help="A number of the report, or repose_angle.")],
    target: Annotated[float, typer.Option("--target", help="What was measured elsewhere.")],
    within: Annotated[float, typer.Option("--within", min=0.0, help="How far off the mean may be.")],
    out: Folder = Path("calibration"),
    most: Annotated[int, typer.Option("--runs", min=8, help="Most runs.")] = 24,
    seconds: options.Seconds = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    timeout: Timeout = None,
    overrides: options.Overrides = None,
    effect: options.Effects = None,
    arch: options.Arch = "cpu",
) -> None:
    """Finds the value of a key at which the scene measures --target, and says how sure it is; SPEC gives the range, as 0.1..0.8:2."""
    with in_one_sentence():
        from taichi_sand.measure.named import MEASURES
        from taichi_sand.study.sweep import calibrate as search
        from taichi_sand.study.sweep import engine
        from taichi_sand.study.sweep.plan import Asked
        from taichi_sand.study.sweep.specs import parse
        from taichi_sand.study.sweep.store import Store

        options.check_seconds(seconds)
        search.optuna()
        writing.check(out, "--out", folder=True)
        ranges = search.ranges_of(dict(map(parse, vary)), {text.partition("=")[0]: "=log:" in text for text in vary})
        named = (measure,) if measure in MEASURES else ()
        asked = Asked(seconds, None, arch, engine.own_sources(effect or ()), named)
        load, store = engine.loader(scene, effect or (), overrides or ()), Store(out)
        many = workers or engine.CORES
        with cluster(scheduler) as executor, options.progress_bar("calibrate") as progress:
            with engine.runner(many, executor, timeout) as run:
                aim = (measure, target, within, asked, store, run)
                found = search.calibrate(load, ranges, *aim, most=most, abreast=many, progress=progress)
        for key, value in found.values.items():
            print(f"{key} = {value:.4g}" + (f" ± {found.errors[key]:.2g}" if found.errors[key] == found.errors[key] else ""))
        sure = "95 % sure to lie within" if found.sure else "not yet sure to lie within"
        print(f"{measure} = {found.measured:.4g} ± {found.error:.2g} there ({sure} {target:g} ± {within:g});", end=" ")
        print(f"a single run scatters by {found.spread:.2g}; {len(found.trials)} runs")
        if not found.sure:
            raise PhysicsError(f"{measure} is known to ± {1.96 * found.error:.2g} only after {len(found.trials)} runs: give more --runs")


def _plan(
    scene: str | None, vary: list[str], seeds: int, seconds: float | None, every: float | None, measure: list[str] | None,
    overrides: list[str] | None, effect: list[Path] | None, arch: str,
) -> tuple[Any, Any]:  # fmt: skip
    from taichi_sand.measure.named import MEASURES
    from taichi_sand.study.sweep import engine
    from taichi_sand.study.sweep.plan import Asked, plan
    from taichi_sand.study.sweep.specs import parse

    if scene is None:
        raise SandError("sweep needs a SCENE (`taichi-sand scenes` lists those bundled)")
    varied = [parse(text) for text in vary]
    if twice := [key for index, (key, _) in enumerate(varied) if key in dict(varied[:index])]:
        raise SandError(f"--vary {twice[0]} is given twice")
    named = tuple(name for name in measure or () if name in MEASURES)
    asked = Asked(seconds, every, arch, engine.own_sources(effect or ()), named)
    return plan(engine.loader(scene, effect or (), overrides or ()), dict(varied), seeds, asked), asked


def _first(measure: list[str] | None) -> str:
    if not measure:
        raise SandError("--plot needs --measure NAME: what is to be drawn")
    return measure[0]


def _tell(made: Any, store: Any, out: Path) -> None:
    """What came out, and what failed."""
    from taichi_sand.study.sweep.results import failed

    lost = failed(made, store)
    print(f"{len(made.jobs)} runs: {len(made.jobs) - len(lost)} done, {len(lost)} failed; {out / 'sweep.csv'}, {out / 'sweep.nc'}")
    for job, status in lost[:5]:
        values = ", ".join(f"{key} = {value}" for key, value in job.values.items())
        print(f"  {values}: {status}: {store.failure(job).get('sentence', '')}")
    if lost:
        raise PhysicsError(f"{len(lost)} of {len(made.jobs)} runs; --retry-failed does them again")


@contextmanager
def cluster(address: str | None) -> Iterator[Executor | None]:
    """The executor of a Dask cluster; None without an address."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise SandError("--scheduler needs Dask: pip install 'taichi-sand[cluster]'") from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise SandError(f"--scheduler {address}: no Dask scheduler answers there: {error}") from None
    with client:
        yield client.get_executor()


def register(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.command()(sweep)
    app.command()(calibrate)
