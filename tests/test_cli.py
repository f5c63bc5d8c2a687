"""The command on good input: what it prints, writes and exits with."""

import errno
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

import taichi_sand as sand
from taichi_sand.cli import options
from taichi_sand.cli.main import app
from taichi_sand.cli.printing import GROUPS

SCENE = """
title = "Drop"
size = [0.2, 0.3]
duration = 0.04
[[grains]]
radius = [0.008, 0.012]
count = 20
[effects.friction]
[view]
width = 100
"""
REPORT = """time_s steps grains grains_lost pairs contacts tolerance overlap_mean overlap_p99 overlap_max flow_softness
kinetic_energy_J potential_energy_J momentum_Ns angular_momentum_Nms packing_fraction coordination bed_height_m
floor_force_N wall_force_N speed_max_m_s step_s wall_time_s
compile_time_s real_time_factor ns_per_grain_step stages_s solver effects arch threads precision warnings flags""".split()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a small scene in it."""
    (tmp_path / "drop.toml").write_text(SCENE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def command(*arguments: str, status: int = 0) -> Result:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == status, (result.output, result.exception)
    return result


def as_json(*arguments: str) -> dict:
    return json.loads(command("run", "drop.toml", "--json", *arguments).stdout)


def test_json_is_the_report_alone(folder: Path) -> None:
    report = as_json()
    assert set(REPORT) <= set(report)
    assert report["time_s"] == pytest.approx(0.04, abs=0.5 * report["step_s"])
    assert report["grains"] == 20
    assert report["flags"] == []


def test_json_alone_in_a_process_of_its_own(folder: Path) -> None:
    """Nothing that Taichi prints when it starts may stand in front."""
    environment = {key: value for key, value in os.environ.items() if key != "ENABLE_TAICHI_HEADER_PRINT"}
    environment["PYTHONPATH"] = str(Path(sand.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-m", "taichi_sand", "run", "drop.toml", "--json", "--seconds", "0.01"],
        capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["grains"] == 20
    assert done.stderr == ""


def test_the_table_puts_asked_next_to_measured(folder: Path) -> None:
    text = command("run", "drop.toml").stdout
    assert re.search(r"tolerance asked +0\.02 +d *\n.*\n +overlap, mean", text), text
    report = as_json()
    shown = {key: label for keys in GROUPS.values() for key, (label, _) in keys.items() if key in report}
    assert {"tolerance", "overlap_mean", "overlap_p99", "wall_time_s"} <= set(shown) <= {*REPORT, "depth"}
    for label in shown.values():
        assert label in text


def test_flags_of_the_command_reach_the_scene(folder: Path) -> None:
    report = as_json("--set", "solver.kind=md", "--precision", "64", "--threads", "1", "--seconds", "0.01", "--set", "grains.0.count=3")
    assert (report["solver"], report["precision"], report["threads"], report["grains"]) == ("md", 64, 1, 3)
    assert report["time_s"] == pytest.approx(0.01, rel=0.05)


def test_a_resumed_run_equals_an_uninterrupted_one(folder: Path) -> None:
    command("run", "drop.toml", "--seconds", "0.02", "--save", "half.npz")
    command("run", "--resume", "half.npz", "--save", "resumed.npz")  # the rest of the duration
    command("run", "drop.toml", "--save", "whole.npz")
    resumed, whole = (dict(np.load(name, allow_pickle=False)) for name in ("resumed.npz", "whole.npz"))
    assert resumed.keys() == whole.keys()
    for name, value in whole.items():
        assert np.array_equal(value, resumed[name], equal_nan=value.dtype.kind == "f"), name


def test_resume_goes_with_the_scene_that_was_saved(folder: Path) -> None:
    command("run", "drop.toml", "--seconds", "0.01", "--set", "seed=3", "--save", "a.npz")
    result = command("run", "drop.toml", "--resume", "a.npz", status=2)
    assert "a.npz was saved from another scene than drop.toml" in result.stderr


@pytest.mark.parametrize("out", ["drop.png", "new/drop.mp4", "drop.gif", "frames/"])
def test_render(folder: Path, out: str) -> None:
    result = command("render", "drop.toml", "-o", out, "--fps", "25", "--width", "120", "--color", "speed")
    assert result.output == ""
    path = folder / out
    pictures = sorted(path.glob("*.png")) if path.is_dir() else [path]
    assert pictures and all(picture.stat().st_size > 100 for picture in pictures)
    if out.endswith((".png", "/")):
        assert Image.open(pictures[-1]).size == (120, 180)


class Quick:
    """Stands in for a simulation where only what the command makes of it matters."""

    said = ("3 grains were lost.",)
    stages = SimpleNamespace(began=0.0)

    def __init__(self, scene: object, **_: object) -> None:
        self.scene, self.time = scene, 0.0

    def advance(self, seconds: float, progress: object = None) -> None:
        self.time += seconds

    def advance_to(self, time: float, progress: object = None) -> None:
        self.time = time

    def flags(self) -> list[str]:
        return list(self.said)

    def report(self) -> dict:
        return {"flags": self.flags(), "warnings": []}


class Interrupted(Quick):
    """A user presses Ctrl-C while it runs."""

    def advance(self, seconds: float, progress: object = None) -> None:
        raise KeyboardInterrupt

    advance_to = advance


def test_what_the_physics_flags_is_said_and_exits_with_1(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sand, "Simulation", Quick, raising=False)
    result = command("run", "drop.toml", "--json", "--seconds", "0.01", status=1)
    assert json.loads(result.stdout)["flags"] == ["3 grains were lost."]
    assert result.stderr == "taichi-sand: failed: 3 grains were lost.\n"


def test_an_interrupted_run_leaves_quietly(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sand, "Simulation", Interrupted, raising=False)
    for arguments in (("run", "drop.toml", "--save", "a.npz"), ("render", "drop.toml", "-o", "drop.png")):
        assert command(*arguments, status=130).stderr == "taichi-sand: interrupted\n"
    assert [path.name for path in folder.iterdir()] == ["drop.toml"]


def test_without_a_terminal_progress_is_a_line_now_and_then(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line within 30 s, the next in the next 30 s, with the time left at the pace so far; none of short work, none of the end."""
    now = 1000.0
    monkeypatch.setattr(options.time, "monotonic", lambda: now)
    with options.progress_bar("render", lambda: " · fill") as tell:
        for second in range(0, 81, 10):
            now = 1000.0 + second
            tell(second / 80)
    lines = ["render · fill: 38%, some 50 s to go", "render · fill: 75%, some 20 s to go"]
    assert capsys.readouterr().err.splitlines() == lines


def test_progress_that_nobody_can_be_told_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The log is on a full disk, or its reader has gone."""

    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(options, "TOLD_EVERY", 0.0)
    monkeypatch.setattr(sys, "stderr", Full())
    with options.progress_bar("render") as tell:
        tell(0.5)


def test_scenes_lists_a_line_each() -> None:
    lines = command("scenes").stdout.splitlines()
    assert len(lines) >= 9
    assert any(re.fullmatch(r"hourglass +Hourglass: .*\.", line) for line in lines)


def test_help_and_version() -> None:
    for arguments in (["--help"], ["run", "--help"], ["render", "--help"], ["scenes", "--help"]):
        assert "Usage" in command(*arguments).stdout
    assert re.fullmatch(r"taichi-sand \d+\.\d+\.\d+\n", command("--version").stdout)
