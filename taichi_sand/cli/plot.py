"""The command `plot`: pictures of what `run` has written."""

from pathlib import Path
from typing import Annotated

import typer

from taichi_sand.cli.leaving import in_one_sentence
from taichi_sand.errors import SandError
from taichi_sand.files import writing

ENDINGS = (".png", ".svg", ".pdf")


def plot(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE…", help="Written by `run`: series, contacts (.csv, .parquet), .gsd, fields (.nc, .vtu)."),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Ends in .png, .svg or .pdf.")] = Path("plot.png"),
    show: Annotated[
        list[str] | None, typer.Option("--show", metavar="NAME", help="Number of a series or profile, instead of the usual; repeatable.")
    ] = None,
) -> None:
    """Draws what `run` wrote: series over time, force distribution P(f), fabric of the contacts, profiles over height."""
    with in_one_sentence():
        if out.suffix not in ENDINGS:
            raise SandError(f"--out {out}: a plot ends in {', '.join(ENDINGS)}")
        writing.check(out, "--out")
        from taichi_sand.study.cost.plot import pyplot
        from taichi_sand.study.plots import draw, written

        pyplot()  # SandError without matplotlib
        count = draw.plot([written.read(file) for file in files], out, show or ())
        print(f"{count} panels in {out}")


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command()(plot)
