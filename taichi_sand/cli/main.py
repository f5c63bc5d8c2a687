"""The command `taichi-sand`. Exit status: 0 done, 1 the physics failed a check, 2 wrong input, 130 interrupted; see `leaving`."""

import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
import typer.core

import taichi_sand
from taichi_sand import effects
from taichi_sand.cli import check, leaving, plot, printing, study, sweep, warm
from taichi_sand.cli.export import Outputs
from taichi_sand.cli.leaving import in_one_sentence
from taichi_sand.cli.options import Arch, Effects, Overrides, Precision, SceneName, Seconds, Threads, check_seconds, progress_bar, settings
from taichi_sand.errors import PhysicsError, SandError
from taichi_sand.files import jsons, writing
from taichi_sand.files.reading import starts_with
from taichi_sand.scene import loading

if TYPE_CHECKING:
    from taichi_sand.scene.schema import Scene

app = typer.Typer(
    name="taichi-sand",
    help="A 2D granular simulator that shows what accuracy costs in time.",
    epilog="SCENE is a path or the name of a bundled scene (taichi-sand scenes).",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Prints the version.")] = False) -> None:
    if version:
        print(f"taichi-sand {taichi_sand.__version__}")
        raise typer.Exit


@app.command()
def run(
    scene: Annotated[str | None, typer.Argument(metavar="SCENE", help="Path or bundled name; not needed with --resume.")] = None,
    seconds: Seconds = None,
    as_json: Annotated[bool, typer.Option("--json", help="Prints the report as JSON, and nothing else, on stdout.")] = False,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE.gsd", help="Writes a trajectory; see --every.")] = None,
    every: Annotated[
        float | None,
        typer.Option("--every", metavar="S", help="Simulated seconds from frame to frame, and row to row; else that of [record], 0.01."),
    ] = None,
    contacts: Annotated[
        Path | None, typer.Option("--contacts", metavar="FILE", help="Writes the contacts at the end as a table, .csv or .parquet.")
    ] = None,
    series: Annotated[
        Path | None, typer.Option("--series", metavar="FILE", help="Writes the report's numbers over time, .csv or .parquet; see --every.")
    ] = None,
    fields: Annotated[
        Path | None, typer.Option("--fields", metavar="FILE", help="Writes coarse-grained fields: .vtu of the end; .pvd or .nc over time.")
    ] = None,
    save: Annotated[Path | None, typer.Option("--save", metavar="FILE", help="Writes a checkpoint at the end.")] = None,
    resume: Annotated[
        Path | None, typer.Option("--resume", metavar="FILE", help="Goes on from a checkpoint, and with the trajectory --out.")
    ] = None,
    overrides: Overrides = None,
    effect: Effects = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    precision: Precision = None,
) -> None:
    """Simulates without pictures and prints a report."""
    with in_one_sentence():
        check_seconds(seconds)
        if save is not None:
            writing.check(save, "--save")
        outputs = Outputs(out, every, contacts, series, fields)
        asked = settings(overrides, precision)
        sim = _start(scene, asked, effect, arch, threads) if resume is None else _resume(resume, scene, asked, effect, arch, threads)
        with outputs.of(sim), progress_bar(sim.scene.title or "run", printing.stage_of(sim)) as progress:
            if seconds is None:
                sim.advance_to(sim.stages.began + sim.scene.duration, progress=progress)
            else:
                sim.advance(seconds, progress=progress)
        if save is not None:
            sim.save(save)
        report = sim.report()
        if as_json:
            print(jsons.as_text(report))
        else:
            printing.print_report(sim.scene.title, report)
        for sentence in report["warnings"]:
            print(f"warning: {sentence}", file=sys.stderr)
        if report["flags"]:
            raise PhysicsError("; ".join(report["flags"]))


@app.command()
def render(
    scene: SceneName,
    out: Annotated[
        str,
        typer.Option(
            "-o", "--out", metavar="OUT", help="Ends in .mp4, .gif, .html (a page that plays), .png (last frame) or / (PNG frames)."
        ),
    ],
    seconds: Seconds = None,
    fps: Annotated[int | None, typer.Option("--fps", help="Frames in a simulated second.")] = None,
    width: Annotated[int | None, typer.Option("--width", help="Pixels; the height follows.")] = None,
    color: Annotated[
        str | None,
        typer.Option(
            "--color",
            help="kind, speed, energy, force, pressure, stress, deviator, rotation, order, temperature, moisture, saturation, "
            "'water pressure', 'water speed' or photoelastic.",
        ),
    ] = None,
    overrides: Overrides = None,
    effect: Effects = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    precision: Precision = None,
) -> None:
    """Simulates and films, without a display; SCENE may also be what `play --record` wrote."""
    with in_one_sentence():
        check_seconds(seconds)
        if _is_recording(scene):
            _film_recording(Path(scene), out, fps, width, arch, threads)
            return
        view = {"view.fps": fps, "view.width": width, "view.color": color}
        loaded = taichi_sand.load(scene, settings(overrides, precision, **view), effect or ())
        from taichi_sand.output.film import check, film

        check(out)
        sim = taichi_sand.Simulation(loaded, arch=arch, threads=threads)
        with progress_bar(loaded.title or "render") as progress:
            film(sim, out, seconds=seconds, fps=fps, progress=progress)
        if sim.flags():
            raise PhysicsError("; ".join(sim.flags()))


def _is_recording(path: str) -> bool:
    """Whether a file is what `play --record` wrote; told by how it starts."""
    return starts_with(path, b'{"taichi_sand recording"')


def _film_recording(path: Path, out: str, fps: int | None, width: int | None, arch: str, threads: int | None) -> None:
    from taichi_sand.output.film import check
    from taichi_sand.play import recording

    check(out)
    with progress_bar(path.name) as progress:
        recording.film(path, out, fps=fps or 30, width=width, arch=arch, threads=threads, progress=progress)


@app.command()
def play(
    scene: SceneName,
    folder: Annotated[Path, typer.Option("--folder", metavar="DIR", help="Where pictures, films and checkpoints are written.")] = Path(),
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="What the window shows, ten times a second, as lines of JSON.")
    ] = None,
    record: Annotated[
        Path | None, typer.Option("--record", metavar="FILE", help="Everything that is done, for `render FILE` to do again.")
    ] = None,
    width: Annotated[int | None, typer.Option("--width", min=200, max=4000, help="Of the picture, in pixels.")] = None,
    text: Annotated[int, typer.Option("--text", min=13, max=26, help="Size of the window's text, in pixels.")] = 13,
    web: Annotated[bool, typer.Option("--web", help="In a browser instead of a window; prints the address to open.")] = False,
    host: Annotated[str, typer.Option("--host", help="With --web: address to serve at; by default none but this machine.")] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="With --web: the port; 0 is any that is free.")] = 0,
    overrides: Overrides = None,
    arch: Arch = "cpu",
    threads: Threads = None,
    precision: Precision = None,
) -> None:
    """Opens a window to watch and change the simulation, and to reach into it; `h` shows the keys."""
    with in_one_sentence():
        loaded = taichi_sand.load(scene, settings(overrides, precision))
        for option, path in (("--folder", folder / "any"), ("--report", report), ("--record", record)):
            if path is not None:
                writing.check(path, option)
        if web:
            from taichi_sand.play.web import face

            made = {"arch": arch, "threads": threads}
            face.play(loaded, Path(scene).stem, folder=folder, host=host, port=port, record=record, **made)
            return
        from taichi_sand.play.window import opening

        opening.check_display()
        opened = opening.Opening(loaded, Path(scene).stem, width, text)
        opened.show()
        from taichi_sand.play.window import window  # it takes a while to import

        window.play(opened, folder=folder, record=record, report=report, arch=arch, threads=threads)


@app.command()
def scenes() -> None:
    """Lists the bundled scenes, a line each: name, title, what there is to see."""
    known = loading.bundled()
    wide = max(map(len, known), default=0)
    for name, path in known.items():
        head = tomllib.loads(path.read_text("utf-8"))
        print(f"{name:<{wide}}  {head.get('title', '')}: {head.get('about', '')}")


class EffectsHelp(typer.core.TyperCommand):
    """Lists the effects and their parameters below the options."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Imports the effects only when their help is asked for."""
        self.epilog = "\n\n".join(printing.effect_lines(effects))
        super().format_help(ctx, formatter)


@app.command("effects", cls=EffectsHelp)
def effects_(
    scene: SceneName,
    measure: Annotated[bool, typer.Option("--measure", help="Times the scene without each effect, and with each absent one.")] = False,
    seconds: Annotated[float, typer.Option("--seconds", help="Simulated seconds before it is timed.")] = 0.5,
    overrides: Overrides = None,
    effect: Effects = None,
    arch: Arch = "cpu",
    threads: Threads = 1,
    precision: Precision = None,
) -> None:
    """Shows what a scene compiles and allocates, what it leaves out, and what each effect costs."""
    with in_one_sentence():
        check_seconds(seconds)
        loaded = taichi_sand.load(scene, settings(overrides, precision), effect or ())
        from taichi_sand.study.cost import price

        sim = taichi_sand.Simulation(loaded, arch=arch, threads=threads)
        prices = price.measure(loaded, seconds, arch, threads) if measure else {}
        printing.print_effects(loaded, price.inventory(sim), price.table_bytes(sim), prices)


def _start(scene: str | None, overrides: list[str], own: list[Path] | None, arch: str, threads: int | None) -> Any:
    if scene is None:
        raise SandError("run needs a SCENE (`taichi-sand scenes` lists those bundled) or --resume FILE")
    return taichi_sand.Simulation(taichi_sand.load(scene, overrides, own or ()), arch=arch, threads=threads)


def _resume(file: Path, scene: str | None, overrides: list[str], own: list[Path] | None, arch: str, threads: int | None) -> Any:
    """A simulation from a checkpoint; another scene than the one that was saved brings its stages. Effects of the user's own are needed
    again.
    """
    wanted: Scene | None = None if scene is None else taichi_sand.load(scene, overrides, own or ())
    if wanted is None and overrides:
        raise SandError(f"--resume {file} brings its own scene, which --set and --precision cannot change")
    if wanted is None:
        for path in own or ():
            effects.add(path)
    sim = taichi_sand.Simulation.resume(file, arch=arch, threads=threads)
    if wanted is not None and wanted.to_json() not in (sim.scene.to_json(), sim.home.to_json()):
        try:
            sim.restage(wanted)
        except SandError as error:
            raise SandError(f"{file} was saved from another scene than {scene}, whose stages its grains cannot take: {error}") from None
    return sim


check.register(app)
study.register(app)
sweep.register(app)
warm.register(app)
plot.register(app)


def main() -> None:
    """Entry point of the command."""
    leaving.run(app)
