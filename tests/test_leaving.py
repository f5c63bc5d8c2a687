"""How the command ends where its output goes: a pipe that nobody reads, a full disk, a terminal that knows no Greek."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import taichi_sand as sand

SCENE = """
title = "μ → 0.5 ∑"
size = [0.2, 0.3]
[[grains]]
radius = 0.01
count = 20
"""
LIGHT = (["scenes"], ["--help"])
HEAVY = (["run", "drop.toml", "--seconds", "0.01"], ["run", "drop.toml", "--seconds", "0.01", "--json"])


def start(arguments: list[str], folder: Path, stdout: object, **environment: str) -> subprocess.Popen:
    """The command in a process of its own, in a folder with a scene."""
    (folder / "drop.toml").write_text(SCENE, "utf-8")
    paths = {"PYTHONPATH": str(Path(sand.__file__).parents[1])}
    return subprocess.Popen(
        [sys.executable, "-m", "taichi_sand", *arguments],
        cwd=folder, stdout=stdout, stderr=subprocess.PIPE, env={**os.environ, **paths, **environment},
    )  # fmt: skip


@pytest.mark.parametrize("arguments", (*LIGHT, *HEAVY), ids=" ".join)
def test_a_pipe_that_nobody_reads(arguments: list[str], tmp_path: Path) -> None:
    """As with `| head -1`: silence, and 141 or 0."""
    with start(arguments, tmp_path, subprocess.PIPE) as process:
        process.stdout.close()
        process.stdout = None
        _, said = process.communicate(timeout=120)
    assert (process.returncode, said) == (141, b"")


@pytest.mark.parametrize("arguments", [["scenes"], HEAVY[0]], ids=" ".join)
def test_stdout_on_a_full_disk(arguments: list[str], tmp_path: Path) -> None:
    """What was asked for is not there, and that is said."""
    with Path("/dev/full").open("wb") as full, start(arguments, tmp_path, full) as process:
        _, said = process.communicate(timeout=120)
    assert (process.returncode, said) == (2, b"taichi-sand: error: stdout: No space left on device\n")


@pytest.mark.parametrize("encoding", ["ascii", "cp437"])
def test_a_terminal_that_knows_no_greek(encoding: str, tmp_path: Path) -> None:
    """Nothing is lost after a run: what has no letter is written with others."""
    with start(HEAVY[0], tmp_path, subprocess.PIPE, PYTHONIOENCODING=encoding, PYTHONUTF8="0") as process:
        told, said = process.communicate(timeout=120)
    text = told.decode(encoding)
    assert (process.returncode, said) == (0, b"")
    assert "-> 0.5 ?" in text.replace("→", "->").replace("∑", "?") and "fastest grain" in text
    with start(["run", "μ.toml"], tmp_path, subprocess.PIPE, PYTHONIOENCODING=encoding) as process:
        _, said = process.communicate(timeout=120)
    assert process.returncode == 2 and b".toml: there is no such file" in said
