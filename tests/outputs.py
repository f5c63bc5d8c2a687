"""A small scene, what `run` writes of it, and the simulation that this must agree with."""

import tomllib
from pathlib import Path

from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app

SCENE = """
size = [0.25, 0.3]
edges = { left = "periodic", right = "periodic" }
[[grains]]
radius = [0.008, 0.012]
count = 30
spin = 1.0
[effects.friction]
"""


def run(folder: Path, seconds: float, **files: str) -> None:
    """Runs the scene for so long, with a row or frame every 0.05 s; the options `files` name files in the folder."""
    scene = folder / "scene.toml"
    scene.write_text(SCENE)
    options = [part for option, name in files.items() for part in (f"--{option}", str(folder / name))]
    done = CliRunner().invoke(app, ["run", str(scene), "--seconds", str(seconds), "--every", "0.05", "--threads", "1", *options])
    assert done.exit_code == 0, done.output


def simulated(seconds: float) -> sand.Simulation:
    """The same in Python."""
    sim = sand.Simulation(sand.Scene(**tomllib.loads(SCENE)), threads=1)
    sim.advance(seconds)
    return sim
