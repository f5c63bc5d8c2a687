"""Checkpoints: a resumed run equals an uninterrupted one, bit for bit; a file that cannot be used is refused in a sentence."""

import os
import struct
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from helpers import digest, simulate

import taichi_sand as sand
from taichi_sand.world import checkpoint

LOOSE = {"radius": [0.008, 0.012], "density": 1000.0, "count": 150, "fill": "lattice", "pitch": 1.3, "jitter": 0.1}
KEYS = {"gravity": (0.0, -9.81), "mu": 0.5, "seed": 2, "edges": {"right": "open"}}
STEPS = {"rigid": (301, 400), "md": (2001, 3000)}


def make(kind: str):
    """A heap that loses grains through its open side."""
    return simulate([LOOSE], (0.4, 0.6), {"kind": kind, "precision": 32}, **KEYS)


@pytest.mark.parametrize("kind", STEPS)
def test_resumed_equals_uninterrupted(kind: str, tmp_path: Path) -> None:
    """Saved in the middle of a list build's life, with stretched springs, carried impulses and grains lost."""
    first, second = STEPS[kind]
    sim = make(kind)
    sim.advance_steps(first)
    sim.save(tmp_path / "half.npz")
    sim.advance_steps(second)
    expected, lost, time = digest(sim), sim.lost, sim.time
    del sim
    resumed = sand.Simulation.resume(tmp_path / "half.npz", threads=1)
    assert resumed.steps == first
    resumed.advance_steps(second)
    assert (digest(resumed), resumed.lost, resumed.time) == (expected, lost, time)
    report = resumed.report()
    assert report["steps"] == first + second and report["grains"] + report["grains_lost"] == 150


def test_saving_changes_nothing(tmp_path: Path) -> None:
    """Reports, pictures of the state and checkpoints only look."""
    digests = []
    for look in (False, True):
        sim = make("rigid")
        for _ in range(4):
            sim.advance_steps(60)
            if look:
                sim.save(tmp_path / "look.npz")
                sim.report()
                assert np.isfinite(sim.positions).all()
        digests.append(digest(sim))
        del sim
    assert digests[0] == digests[1]


def test_interrupted_save_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """design.md 7: either the old file or a complete new one."""
    path = tmp_path / "state.npz"
    sim = make("rigid")
    sim.save(path)
    old = path.read_bytes()

    def full_disk(file, **_: object) -> None:
        file.write(b"half of it")
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "savez_compressed", full_disk)
    monkeypatch.setattr(np, "savez", full_disk)
    sim.advance_steps(10)
    with pytest.raises((OSError, sand.SandError)):
        sim.save(path)
    assert path.read_bytes() == old and [file.name for file in tmp_path.iterdir()] == ["state.npz"]


def damage(data: bytes, how: str) -> bytes:
    """A checkpoint with something wrong."""
    middle = len(data) // 2
    end = middle + 64  # longer than a header within the file, of which not every byte counts
    return {
        "cut": data[:middle],
        "flipped": data[:middle] + bytes(byte ^ 0xFF for byte in data[middle:end]) + data[end:],
        "empty": b"",
        "text": b"not a checkpoint\n" * 10,
    }[how]


@pytest.mark.parametrize("how", ["cut", "flipped", "empty", "text", "missing"])
def test_wrong_checkpoint_is_refused(how: str, tmp_path: Path) -> None:
    """One sentence that names the file."""
    path = tmp_path / "state.npz"
    if how != "missing":
        sim = make("rigid")
        sim.save(path)
        path.write_bytes(damage(path.read_bytes(), how))
        del sim
    with pytest.raises(sand.SandError) as caught:
        sand.Simulation.resume(path, threads=1)
    assert "state.npz" in str(caught.value) and "\n" not in str(caught.value)


def test_file_of_a_newer_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It says so, and names both formats."""
    monkeypatch.setattr(checkpoint, "FORMAT", checkpoint.FORMAT + 1)
    checkpoint.save(tmp_path / "state.npz", {}, {})
    monkeypatch.undo()
    with pytest.raises(sand.SandError, match=f"format {checkpoint.FORMAT + 1}, written by a newer taichi-sand"):
        checkpoint.load(tmp_path / "state.npz")


def test_foreign_archives_are_refused(tmp_path: Path) -> None:
    """Other files that NumPy reads."""
    np.save(tmp_path / "array.npy", np.arange(3))
    np.savez(tmp_path / "other.npz", header=np.arange(3), x=np.zeros(2))
    for name in ("array.npy", "other.npz"):
        with pytest.raises(sand.SandError, match=name):
            checkpoint.load(tmp_path / name)


def test_an_array_whose_description_breaks_off_is_refused(tmp_path: Path) -> None:
    """Found by fuzzing: NumPy reads it as Python, and says what Python does."""
    array = b"\x93NUMPY\x01\x00" + struct.pack("<H", 20) + b"{'descr': '|u1', (  "
    with zipfile.ZipFile(tmp_path / "state.npz", "w") as file:
        file.writestr("header.npy", array)
    with pytest.raises(sand.SandError, match=r"not a checkpoint .*TokenError"):
        checkpoint.load(tmp_path / "state.npz")


SAVER = """
import sys
import numpy as np
from taichi_sand.world import checkpoint

class Field:
    def __init__(self, k):
        self.k = k
    def to_numpy(self):
        return np.random.default_rng(self.k).integers(0, 9, 200_000).astype(np.int32)

k = 0
while True:
    checkpoint.save(sys.argv[1], {"k": k}, {"field": Field(k)})
    print(k, flush=True)
    k += 1
"""


def test_killed_while_saving(tmp_path: Path) -> None:
    """Killed at any moment of a save, a process leaves the file of the last save that ended, or of one it was about to end, whole."""
    path, random = tmp_path / "state.npz", np.random.default_rng(1)
    for _ in range(8):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        with subprocess.Popen([sys.executable, "-c", SAVER, str(path)], stdout=subprocess.PIPE, env=environment) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(random.uniform(0, 0.06))
            process.kill()
            saved = [0, *map(int, process.stdout.read().split())]
        about, arrays = checkpoint.load(path)
        assert about["k"] in (saved[-1], saved[-1] + 1)
        assert (arrays["field"] == np.random.default_rng(about["k"]).integers(0, 9, 200_000)).all()
