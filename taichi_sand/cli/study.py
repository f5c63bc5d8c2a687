"""The commands that measure: `cost`, `validate` and `stress`."""

import json
import os
from pathlib import Path
from typing import Annotated, Literal

import typer

import taichi_sand
from taichi_sand.cli import options, printing
from taichi_sand.cli.leaving import in_one_sentence
from taichi_sand.errors import PhysicsError, SandError
from taichi_sand.files import writing

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
ErrorName = Annotated[str, typer.Option("--error", metavar="NAME", help="The error that --target means.")]


def cost(
    scene: options.SceneName,
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Writes the table as CSV.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.png", help="Draws cost against every error.")] = None,
    target: Annotated[float | None, typer.Option("--target", help="Prints the cheapest [solver] table with an error this small.")] = None,
    error: ErrorName = "overlap_p99",
    quick: Annotated[bool, typer.Option("--quick", help="Three tolerances and short runs: about a minute for 1000 grains.")] = False,
    full: Annotated[bool, typer.Option("--full", help="Also all integrators and both precisions.")] = False,
    seconds: options.Seconds = None,
    overrides: options.Overrides = None,
    arch: options.Arch = "cpu",
    threads: options.Threads = 1,
) -> None:
    """Shows what accuracy costs in time: runs the scene over tolerances and solvers."""
    with in_one_sentence():
        from taichi_sand.study.cost.cost import study
        from taichi_sand.study.cost.errors import NAMES
        from taichi_sand.study.cost.plot import plot as draw
        from taichi_sand.study.cost.plot import pyplot
        from taichi_sand.study.cost.table import as_table, as_toml, legend, write_csv

        options.check_seconds(seconds)
        if error not in NAMES:
            raise SandError(f"--error {error}: must be one of {', '.join(NAMES)}")
        for option, file in (("--csv", csv), ("--plot", plot)):
            if file is not None:
                writing.check(file, option)
        if plot is not None:
            pyplot()
        given = overrides or []
        ladder = {"seconds": seconds, "quick": quick, "full": full}
        with options.progress_bar("cost") as progress:
            found = study(lambda more: taichi_sand.load(scene, [*given, *more]), **ladder, arch=arch, threads=threads, progress=progress)
        if csv is not None:
            write_csv(found, csv)
        if plot is not None:
            draw(found, plot)
        if target is None:
            console = printing.console(200)
            console.print(as_table(found))
            console.print(legend(found))
            return
        point = found.cheapest(error, target)
        if point is None:
            least = min((p.error(error)[1] for p in found.front(error)), default=float("nan"))
            raise PhysicsError(f"no setting tried reaches {error} <= {target:g}; the least was {least:.3g}")
        print(as_toml(point, error))


def validate(
    as_json: Annotated[bool, typer.Option("--json", help="Prints the rows as JSON, and nothing else, on stdout.")] = False,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.png", help="Draws every error over what is allowed.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Leaves out the cases that take long.")] = False,
    only: Annotated[list[str] | None, typer.Option("--only", metavar="CASE", help="Only this case, such as A5; repeatable.")] = None,
) -> None:
    """Holds both solvers against reference cases: case, source, reference, measured, error, passed. Exit status 1 if one fails."""
    with in_one_sentence():
        from taichi_sand.study.validate import validate as ladder

        if plot is not None:
            writing.check(plot, "--plot")
            ladder.pyplot()
        with options.progress_bar("validate") as progress:
            results = ladder.validate(quick, only, progress)
        if plot is not None:
            ladder.plot(results, plot)
        if as_json:
            print(json.dumps(ladder.as_json(results), indent=2, allow_nan=False))
        else:
            printing.console(180).print(ladder.as_table(results))
        failed = [f"{r.case} ({r.solver}: {r.what})" for r in results if not r.passed]
        if failed:
            raise PhysicsError(f"{len(failed)} of {len(results)} rows: {'; '.join(failed)}")


def stress(
    only: Annotated[str, typer.Option("--only", metavar="NAME", help="Cases whose name holds NAME.")] = "",
    solver: Annotated[Literal["md", "rigid"] | None, typer.Option("--solver", help="One solver; else both.")] = None,
    tolerance: Annotated[list[float] | None, typer.Option("--tolerance", help="Instead of 0.05, 0.02 and 0.01; repeatable.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Without the cases that take minutes.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Prints all gates as JSON, and nothing else, on stdout.")] = False,
    markdown: Annotated[bool, typer.Option("--markdown", help="Prints a line a case, as the documentation has it.")] = False,
    film: Annotated[
        Path | None, typer.Option("--film", metavar="DIR", help="Writes a picture of the end of each into this folder.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", min=1, help="Cases at a time, each in a process of its own; else one a core.")
    ] = None,
) -> None:
    """Runs the hard cases: a row each, exit 1 if one fails."""
    with in_one_sentence():
        from taichi_sand.study.stress import stress as hard
        from taichi_sand.study.stress.stress_table import as_markdown, as_table

        asked = hard.rows(only, [solver] if solver else hard.SOLVERS, tolerance or hard.TOLERANCES, quick)
        if not asked:
            raise SandError(f"--only {only}: no case has such a name; there are {', '.join(hard.CASES)}")
        if film is not None:
            writing.check(film / "any", "--film")
            film.mkdir(parents=True, exist_ok=True)
        with options.progress_bar("stress") as progress:
            done = hard.run_all(asked, min(jobs or CORES, len(asked)), film, progress)
        if as_json:
            print(json.dumps([row.to_dict() for row in done]))
        elif markdown:
            print(as_markdown(done))
        else:
            printing.console(160).print(as_table(done))
        failed = [row for row in done if not row.passed]
        if failed:
            raise PhysicsError(f"{len(failed)} of {len(done)} rows; the first is {failed[0].case}, {failed[0].solver}")


def register(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.command()(cost)
    app.command()(validate)
    app.command()(stress)
