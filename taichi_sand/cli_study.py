"""The commands that measure: `cost` and `validate`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

import taichi_sand
from taichi_sand import cli
from taichi_sand.scene.errors import PhysicsError, SandError

ErrorName = Annotated[str, typer.Option("--error", metavar="NAME", help="The error that --target means.")]


def cost(
    scene: cli.SceneName,
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Writes the table as CSV.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.png", help="Draws cost against every error.")] = None,
    target: Annotated[float | None, typer.Option("--target", help="Prints the cheapest [solver] table with an error this small.")] = None,
    error: ErrorName = "overlap_p99",
    quick: Annotated[bool, typer.Option("--quick", help="Three tolerances and short runs: about a minute for 1000 grains.")] = False,
    full: Annotated[bool, typer.Option("--full", help="Also all integrators and both precisions.")] = False,
    seconds: cli.Seconds = None,
    overrides: cli.Overrides = None,
    arch: cli.Arch = "cpu",
    threads: cli.Threads = 1,
) -> None:
    """Shows what accuracy costs in time: runs the scene over tolerances and solvers."""
    with cli.in_one_sentence():
        from taichi_sand.study.cost import study
        from taichi_sand.study.errors import NAMES
        from taichi_sand.study.plot import plot as draw
        from taichi_sand.study.plot import pyplot
        from taichi_sand.study.table import as_table, as_toml, legend, write_csv

        cli._check_seconds(seconds)
        if error not in NAMES:
            raise SandError(f"--error {error}: must be one of {', '.join(NAMES)}")
        for file in filter(None, (csv, plot)):
            cli.check_writable(file)
        if plot is not None:
            pyplot()
        given = overrides or []
        ladder = {"seconds": seconds, "quick": quick, "full": full}
        with cli.progress_bar("cost") as progress:
            found = study(lambda more: taichi_sand.load(scene, [*given, *more]), **ladder, arch=arch, threads=threads, progress=progress)
        if csv is not None:
            write_csv(found, csv)
        if plot is not None:
            draw(found, plot)
        if target is None:
            console = Console(highlight=False, width=None if Console().is_terminal else 200)
            console.print(as_table(found))
            console.print(legend(found))
            return
        point = found.cheapest(error, target)
        if point is None:
            least = min((p.error(error)[1] for p in found.front(error)), default=float("nan"))
            raise PhysicsError(f"no setting tried reaches {error} <= {target:g}; the least was {least:.3g}")
        print(as_toml(point, error))


def register(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.command()(cost)
