"""The command `warm`: compiles ahead what scenes need."""

import time
from typing import Annotated

import typer

import taichi_sand
from taichi_sand.cli.check import SceneNames
from taichi_sand.cli.leaving import in_one_sentence
from taichi_sand.cli.options import Arch, Overrides, Precision, Threads, progress_bar, settings
from taichi_sand.scene import loading
from taichi_sand.scene.schema import Scene


def warm(
    scenes: SceneNames = None,
    window: Annotated[bool, typer.Option("--play", help="Also what the window needs: it has more room, for what is done by hand.")] = False,
    overrides: Overrides = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    precision: Precision = None,
) -> None:
    """Compiles scenes ahead, all bundled ones if none is given: `run`, `render` and `play` then find their kernels in Taichi's cache."""
    with in_one_sentence():
        given = settings(overrides, precision)
        loaded = [taichi_sand.load(name, given) for name in scenes or loading.bundled()]
        start = time.perf_counter()
        with progress_bar("warm") as progress:
            for number, scene in enumerate(loaded):
                touch(scene, window, arch, threads)
                progress((number + 1) / len(loaded))
        many = "s" * (len(loaded) != 1)
        print(f"{len(loaded)} scene{many}: {time.perf_counter() - start:.0f} s")


def touch(scene: Scene, window: bool, arch: str, threads: int | None) -> None:
    """Does once what is done with `scene`: a step, a report, a picture."""
    from taichi_sand.play.session import Session
    from taichi_sand.run.simulation import Simulation
    from taichi_sand.view.picture import image

    with Simulation(scene, arch=arch, threads=threads) as sim:
        sim.advance_steps(1)
        sim.report()
        sim.image()
    if window:
        session = Session(scene, arch=arch, threads=threads)
        session.advance(1)
        image(session.sim)


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command()(warm)
