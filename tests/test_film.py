"""Films: what is in them, and that they come whole or not at all."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

import taichi_sand as sand
from taichi_sand.errors import SandError
from taichi_sand.output.film import film

WIDTH, HEIGHT = 160, 120
ENDINGS = ["film.mp4", "film.gif", "film.png", "film.html", "frames/"]


@pytest.fixture(scope="module")
def sim() -> sand.Simulation:
    """Shared, because it takes seconds to compile: every film goes on where the last one ended."""
    view = {"width": WIDTH, "fps": 20, "caption": False, "color": "speed"}
    grains = [{"radius": 0.02, "count": 60, "fill": "lattice", "region": (0.1, 0.3, 0.9, 0.7)}]
    return sand.Simulation(sand.Scene(size=(1.0, 0.75), duration=0.5, grains=grains, view=view))


def content(path: Path) -> list[bytes]:
    """The file, or all files of the folder."""
    return [p.read_bytes() for p in (sorted(path.iterdir()) if path.is_dir() else [path])]


def gif_frames(path: Path) -> list[np.ndarray]:
    with Image.open(path) as file:
        frames = []
        for k in range(file.n_frames):
            file.seek(k)
            frames.append(np.asarray(file.convert("RGB")).astype(int))
    return frames


def test_mp4_has_the_frames_and_the_size(sim: sand.Simulation, tmp_path: Path) -> None:
    out, start = tmp_path / "new" / "film.mp4", sim.time
    film(sim, out)
    assert imageio_ffmpeg.count_frames_and_secs(str(out)) == (10, pytest.approx(0.5, abs=0.06))
    assert sim.time - start == pytest.approx(0.5, abs=2 * sim.step)
    frames = imageio_ffmpeg.read_frames(str(out))
    meta = next(frames)
    assert meta["size"] == (WIDTH, HEIGHT) and meta["codec"] == "h264" and "yuv420p" in meta["pix_fmt"]
    *_, last = frames
    shown = np.frombuffer(last, np.uint8).reshape(HEIGHT, WIDTH, 3).astype(int)
    assert np.abs(shown - sim.image().astype(int)).mean() < 6
    assert out.read_bytes().find(b"moov") < out.read_bytes().find(b"mdat")


def test_seconds_and_fps_are_obeyed_and_time_does_not_drift(sim: sand.Simulation, tmp_path: Path) -> None:
    start = sim.time
    film(sim, tmp_path / "film.mp4", seconds=0.4, fps=47)
    assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "film.mp4"))[0] == 19
    assert sim.time - start == pytest.approx(0.4, abs=2 * sim.step)


def test_gif_loops_and_shares_its_palette(sim: sand.Simulation, tmp_path: Path) -> None:
    film(sim, tmp_path / "film.gif", seconds=0.5)
    with Image.open(tmp_path / "film.gif") as file:
        assert file.size == (WIDTH, HEIGHT) and file.info["loop"] == 0 and file.info["duration"] == 50
    frames = gif_frames(tmp_path / "film.gif")
    assert len(frames) == 10
    assert np.abs(frames[-1] - sim.image().astype(int)).mean() < 4


def test_png_is_the_last_frame(sim: sand.Simulation, tmp_path: Path) -> None:
    start = sim.time
    film(sim, str(tmp_path / "film.png"), seconds=0.3)
    assert sim.time - start == pytest.approx(0.3, abs=2 * sim.step)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "film.png")), sim.image())


def test_folder_has_numbered_frames(sim: sand.Simulation, tmp_path: Path) -> None:
    film(sim, f"{tmp_path}/frames/", seconds=0.2)
    assert [p.name for p in sorted((tmp_path / "frames").iterdir())] == [f"frame_{k:05d}.png" for k in range(4)]
    assert np.array_equal(np.asarray(Image.open(tmp_path / "frames" / "frame_00003.png")), sim.image())


def test_odd_width_can_be_filmed(tmp_path: Path) -> None:
    sim = sand.Simulation(sand.Scene(size=(1.0, 0.75), grains=[{"positions": [(0.5, 0.5)], "radius": 0.1}], view={"width": 81, "fps": 10}))
    film(sim, tmp_path / "film.mp4", seconds=0.2)
    assert next(imageio_ffmpeg.read_frames(str(tmp_path / "film.mp4")))["size"] == (82, 60)


@pytest.mark.parametrize("name", ENDINGS)
def test_a_film_replaces_the_old_one(name: str, sim: sand.Simulation, tmp_path: Path) -> None:
    out = f"{tmp_path}/{name}"
    film(sim, out, seconds=0.1)
    old = content(Path(out))
    film(sim, out, seconds=0.2)
    assert content(Path(out)) != old
    assert os.listdir(tmp_path) == [name.rstrip("/")]


class Stop(BaseException):
    """As KeyboardInterrupt, but not caught by pytest."""


def stop_at(sim: sand.Simulation, call: int) -> Callable[..., None]:
    """An `advance` that is interrupted at its `call`-th call."""
    calls, go = iter(range(call)), sim.advance

    def advance(*arguments: object) -> None:
        if next(calls, None) is None:
            raise Stop
        go(*arguments)

    return advance


@pytest.mark.parametrize("old", [True, False])
@pytest.mark.parametrize(("name", "call"), [(name, 0) for name in ENDINGS] + [(name, 3) for name in ENDINGS if name != "film.png"])
def test_an_interruption_leaves_the_old_film_and_no_leftovers(
    name: str, call: int, old: bool, sim: sand.Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = f"{tmp_path}/{name}"
    if old:
        film(sim, out, seconds=0.1)
    before = content(Path(out)) if old else []
    monkeypatch.setattr(sim, "advance", stop_at(sim, call))
    with pytest.raises(Stop):
        film(sim, out, seconds=0.5)
    assert os.listdir(tmp_path) == ([name.rstrip("/")] if old else [])
    assert not old or content(Path(out)) == before


LONG = """
import signal, sys, taichi_sand as sand
from taichi_sand.output.film import film
scene = sand.Scene(size=(1.0, 0.75), grains=[{"positions": [(0.5, 0.5)], "radius": 0.1}], view={"width": 160})
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs are born deaf to it
film(sand.Simulation(scene), sys.argv[1], seconds=1e5)
"""


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_control_c_cleans_up(name: str, tmp_path: Path) -> None:
    """The interrupt goes to the whole group, the encoder too, as it does from a terminal."""
    process = subprocess.Popen(
        [sys.executable, "-c", LONG, str(tmp_path / name)],
        start_new_session=True,
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )
    try:
        deadline = time.monotonic() + 60
        while not any(tmp_path.glob(".film*/*")) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert any(tmp_path.glob(".film*/*"))
        time.sleep(0.3)
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(30) != 0
    finally:
        process.kill()
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("name", ["film.avi", "film", "film.mp4.txt"])
def test_other_endings_are_refused(name: str, sim: sand.Simulation, tmp_path: Path) -> None:
    start = sim.time
    with pytest.raises(SandError, match=r"a film ends in \.mp4, \.gif, \.png"):
        film(sim, tmp_path / name)
    assert sim.time == start and os.listdir(tmp_path) == []


def test_a_folder_with_other_files_is_left_alone(sim: sand.Simulation, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("x")
    for out in (f"{tmp_path}/", tmp_path):
        with pytest.raises(SandError, match=r"holds other files \(thesis\.tex\)"):
            film(sim, out)
    with pytest.raises(SandError, match="is a file"):
        film(sim, f"{tmp_path}/thesis.tex/")


def test_gif_cannot_be_faster_than_its_clock(sim: sand.Simulation, tmp_path: Path) -> None:
    with pytest.raises(SandError, match="at most 50"):
        film(sim, tmp_path / "film.gif", fps=60)
    with pytest.raises(SandError, match="at least 1"):
        film(sim, tmp_path / "film.mp4", fps=0)


@pytest.mark.parametrize("name", ENDINGS)
def test_progress_ends_at_1(name: str, sim: sand.Simulation, tmp_path: Path) -> None:
    shares: list[float] = []
    film(sim, f"{tmp_path}/{name}", seconds=0.2, progress=shares.append)
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0)


def test_no_time_is_one_frame(sim: sand.Simulation, tmp_path: Path) -> None:
    start = sim.time
    film(sim, f"{tmp_path}/frames/", seconds=0)
    assert len(os.listdir(tmp_path / "frames")) == 1 and sim.time == start
