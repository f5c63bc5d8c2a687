"""The command `check`: scenes held to what they say they must show."""

import json
from typing import Annotated

import typer

import taichi_sand
from taichi_sand.cli import printing
from taichi_sand.cli.leaving import in_one_sentence
from taichi_sand.cli.options import Arch, Overrides, Threads, progress_bar
from taichi_sand.errors import PhysicsError
from taichi_sand.scene import loading

SceneNames = Annotated[
    list[str] | None, typer.Argument(metavar="SCENE", help="Paths or bundled names; all bundled scenes with checks if none is given.")
]


def check(
    scenes: SceneNames = None,
    as_json: Annotated[bool, typer.Option("--json", help="Prints the rows as JSON, and nothing else, on stdout.")] = False,
    overrides: Overrides = None,
    arch: Arch = "cpu",
    threads: Threads = None,
) -> None:
    """Simulates scenes and holds them to their tables `checks`: a row each, exit status 1 if one fails."""
    with in_one_sentence():
        loaded = [(name, taichi_sand.load(name, overrides or ())) for name in scenes or loading.bundled()]
        asked = [(name, scene) for name, scene in loaded if scenes or scene.checks]
        from rich.table import Table

        from taichi_sand.study.check import check as study

        rows = []
        for name, scene in asked:
            with progress_bar(name) as progress:
                rows += study.check(name, scene, arch, threads, progress)
        if as_json:
            print(json.dumps([row.to_dict() for row in rows], indent=2, allow_nan=False))
        else:
            table = Table("scene", "observable", "at", "found", "must be", "", box=None)
            for row in rows:
                verdict = "[green]passed[/]" if row.passed else "[bold red]FAILED[/]"
                table.add_row(row.scene, row.observable, f"{row.at:.4g} s", f"{row.value:.4g}", row.limits, verdict)
            printing.console(140).print(table)
        failed = [f"{row.scene}: {row.observable} = {row.value:.4g}" for row in rows if not row.passed]
        if failed:
            raise PhysicsError(f"{len(failed)} of {len(rows)} checks: {'; '.join(failed)}")


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command()(check)
