"""Whatever is written: a full disk, a kill or a dead encoder leaves the old file or a complete new one, and no litter."""

import json
import os
import resource
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app
from taichi_sand.files import writing
from taichi_sand.output import film as films
from taichi_sand.play import files as played
from taichi_sand.play import recording
from taichi_sand.play.session import Session
from taichi_sand.study.cost import plot, table
from taichi_sand.world import checkpoint

SMALL = 64 * 1024
"""The room on the disk of these tests [bytes]."""
FILMS = ("film.mp4", "film.gif", "film.png", "frames/")
COMMANDS = {name: ("render", "-o", name) for name in FILMS} | {"state.npz": ("run", "--save", "state.npz")}
SCENE = """
size = [0.2, 0.3]
duration = 0.3
[[grains]]
radius = 0.01
count = 20
"""


@contextmanager
def disk_of(room: int) -> Iterator[None]:
    """No file may grow beyond `room` bytes, in this process and those that it starts: what a full disk or a quota does."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.fixture(scope="module")
def session() -> Session:
    """Shared, as it takes seconds to compile."""
    return Session(sand.Scene(size=(0.4, 0.3), grains=[{"radius": 0.01, "count": 60}], view={"width": 320}), threads=1)


random = np.random.default_rng(0)


def noise(_: object) -> np.ndarray:
    """A picture of 230 kB that nothing makes smaller."""
    return random.integers(0, 256, (240, 320, 3), np.uint8)


def long_csv(_: object) -> str:
    """A table of 300 kB."""
    return "0.123456,\n" * 30_000


def record(session: Session, path: Path) -> None:
    """A recording that grows until the disk is full."""
    recorder = recording.Recorder(session, path)
    while recorder.lines.length < 3 * SMALL:
        recorder([["look", "color", "kind" * 200]], 0)


def save_figure(path: Path) -> None:
    """A plot of noise."""
    figure = plot.pyplot().figure(figsize=(8, 8))
    figure.figimage(noise(None))
    figure.figimage(noise(None), 300, 300)
    plot.save(figure, path)


def write_film(session: Session, path: Path) -> None:
    """As key `v` of the window does."""
    film = played.Film(path)
    try:
        for _ in range(10):
            film.next = time.perf_counter()
            film.frame(noise(None))
        film.close()
    except BaseException as error:
        film.drop(error)
        raise


KINDS: dict[str, Callable[[Session, str], object]] = {
    **{name: lambda session, out: films.film(session.sim, out, seconds=0.1) for name in FILMS},
    "state.npz": lambda session, out: session.sim.save(out, more="".join(map(chr, np.random.default_rng(1).integers(32, 1000, 200_000)))),
    "quick.npz": lambda session, out: checkpoint.save(out, {}, {"field": Random()}),
    "table.csv": lambda session, out: table.write_csv(None, Path(out)),
    "plot.png": lambda session, out: save_figure(Path(out)),
    "window.mp4": lambda session, out: write_film(session, Path(out)),
}


class Random:
    """A field of 400 kB that nothing makes smaller."""

    def to_numpy(self) -> np.ndarray:
        return np.random.default_rng(2).integers(0, 2**31, 100_000, np.int32)


def content(path: Path) -> dict[str, bytes]:
    """All files in a folder and below, hidden ones too."""
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


@pytest.mark.parametrize("old", [True, False], ids=["old", "new"])
@pytest.mark.parametrize("name", KINDS)
def test_a_full_disk(name: str, old: bool, session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence; what was there is, and nothing else."""
    monkeypatch.setattr(films, "image", noise)
    monkeypatch.setattr(table, "as_csv", long_csv)
    path = tmp_path / "folder" / name
    if old:
        path.parent.mkdir()
        if name.endswith("/"):
            path.mkdir()
        (path / "frame_00000.png" if name.endswith("/") else path).write_bytes(b"what was there")
    before = content(tmp_path)
    with disk_of(SMALL), pytest.raises(sand.SandError) as caught:
        KINDS[name](session, f"{tmp_path}/folder/{name}")
    assert "cannot be written" in str(caught.value) and name.strip("/") in str(caught.value) and "\n" not in str(caught.value)
    assert content(tmp_path) == before
    assert os.listdir(tmp_path) == (["folder"] if old else [])


def test_a_full_disk_ends_a_recording_with_a_whole_line(session: Session, tmp_path: Path) -> None:
    """It is there from its first line on, and can be done again as far as it goes. One whose first line does not fit leaves the old one."""
    path, room = tmp_path / "it.record", 2 * SMALL  # the first line holds two moments of a session that has been played
    path.write_bytes(b"old")
    with disk_of(room), pytest.raises(sand.SandError, match=r"it\.record: .*; it ends with what could still be written"):
        record(session, path)
    lines = recording.read(path).lines
    assert lines and path.read_bytes().endswith(b"\n") and room - 1200 < path.stat().st_size <= room
    path.write_bytes(b"old")
    with disk_of(5000), pytest.raises(sand.SandError, match="cannot be written"):
        record(session, path)
    assert content(tmp_path) == {"it.record": b"old"}


def test_a_recording_that_cannot_begin_leaves_the_session_as_it_was(session: Session, tmp_path: Path) -> None:
    """What can be undone and gone back to still can, and it is played on."""
    session.log = session.before_action = None
    session.do(["mark"])
    session.do(["rewinding", True])
    undo, moments = len(session.history.past), session.rewind.times()
    with disk_of(1000), pytest.raises(sand.SandError, match="cannot be written"):
        recording.Recorder(session, tmp_path / "it.record")
    assert (len(session.history.past), session.rewind.times()) == (undo, moments) and undo and moments
    session.advance(3)
    session.do(["undo"])
    assert session.log is None and content(tmp_path) == {}


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("room", [0, 1000])
def test_a_full_disk_is_told_before_anything_is_simulated(name: str, room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sand, "Simulation", None, raising=False)
    monkeypatch.chdir(tmp_path)
    Path("drop.toml").write_text(SCENE)
    verb, option, out = COMMANDS[name]
    with disk_of(room):
        done = CliRunner().invoke(app, [verb, "drop.toml", option, f"new/folder/{out}"])
    assert done.exit_code == 2 and "cannot be written: File too large" in done.stderr and done.stderr.count("\n") == 1
    assert os.listdir(tmp_path) == ["drop.toml"]


@pytest.mark.parametrize("name", COMMANDS)
def test_the_command_on_a_full_disk(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ends with 2: the encoder's death is no success."""
    monkeypatch.setattr(films, "image", noise)
    monkeypatch.setattr(checkpoint, "read_field", lambda field: {"": Random().to_numpy()})
    monkeypatch.chdir(tmp_path)
    Path("drop.toml").write_text(SCENE)
    verb, option, out = COMMANDS[name]
    with disk_of(SMALL):
        done = CliRunner().invoke(app, [verb, "drop.toml", option, out, "--seconds", "0.1", "--threads", "1"])
    assert done.exit_code == 2 and done.stderr.startswith("taichi-sand: error: ") and done.stderr.count("\n") == 1, done.output
    assert os.listdir(tmp_path) == ["drop.toml"]


WRONG = {
    'run drop.toml --save ""': "not the name of a file",
    "run drop.toml --save folder": "--save folder cannot be written: it is a folder, not a file",
    "run drop.toml --save /dev/null": "--save /dev/null cannot be written: it is a device",
    "run drop.toml --save drop.toml/x.npz": "drop.toml is a file, not a folder",
    "run drop.toml --save /proc/x.npz": "/proc/x.npz: cannot be written",
    "play drop.toml --report folder": "--report folder cannot be written: it is a folder",
    "play drop.toml --record folder": "--record folder cannot be written: it is a folder",
    "play drop.toml --record /proc/x": "/proc/x: cannot be written",
    "play drop.toml --folder drop.toml": "is a file, not a folder",
    "render drop.toml -o /proc/x.mp4": "/proc/x.mp4: cannot be written",
    'render drop.toml -o ""': "needs the name of a file",
    "cost drop.toml --csv folder": "--csv folder cannot be written: it is a folder",
    "cost drop.toml --plot /proc/x.png": "/proc/x.png: cannot be written",
    "validate --plot folder": "--plot folder cannot be written: it is a folder",
    "stress --film drop.toml": "is a file, not a folder",
}


@pytest.mark.parametrize("line", WRONG)
def test_what_cannot_be_written_is_refused_at_once(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.setattr(sand, "Simulation", None, raising=False)
    Path("drop.toml").write_text(SCENE)
    Path("folder").mkdir()
    done = CliRunner().invoke(app, [part.strip('"') for part in line.split()])
    assert done.exit_code == 2 and WRONG[line] in done.stderr and done.stderr.count("\n") == 1, (done.output, done.exception)
    assert sorted(os.listdir(tmp_path)) == ["drop.toml", "folder"] and not os.listdir("folder")


def test_write_protected_files_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state.npz"
    path.write_bytes(b"old")
    path.chmod(0o444)
    monkeypatch.setattr(os, "access", lambda *_, **__: False)  # root may write anywhere
    with pytest.raises(sand.SandError, match="write-protected"), writing.replacing(path):
        pass
    assert content(tmp_path) == {"state.npz": b"old"}


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_permissions_follow_the_umask(mask: int, session: Session, tmp_path: Path) -> None:
    before = os.umask(mask)
    try:
        session.sim.save(tmp_path / "state.npz")
        recording.Recorder(session, tmp_path / "it.record").close()
        for name in ("film.png", "frames/", "film.mp4"):
            films.film(session.sim, f"{tmp_path}/{name}", seconds=0)
    finally:
        os.umask(before)
    for path in tmp_path.rglob("*"):
        assert stat.S_IMODE(path.stat().st_mode) == (0o777 if path.is_dir() else 0o666) & ~mask, path


def test_links_are_followed(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "here").symlink_to(tmp_path / "disk" / "there")
    with writing.replacing(tmp_path / "here") as made:
        made.write_text("x")
    assert (tmp_path / "here").is_symlink() and (tmp_path / "disk" / "there").read_text() == "x"


ENCODERS = {
    "fails": ("exit 3", "failed with status 3"),
    "is killed": ("kill -9 $$", "was stopped by signal 9"),
    "makes nothing": ("cat >/dev/null; exit 0", "cannot be written"),
    "makes nonsense": ('cat >/dev/null; for last; do :; done; echo nonsense >"$last"', "cannot be written"),
    "complains": ("echo No space left on device >&2; exit 1", "No space left on device"),
}


@pytest.mark.parametrize("how", ENCODERS)
@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_dead_encoder(name: str, how: str, session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its exit status is looked at, and what it made."""
    encoder = tmp_path / "encoder"
    encoder.write_text(f"#!/bin/sh\n{ENCODERS[how][0]}\n")
    encoder.chmod(0o755)
    folder = tmp_path / "films"
    folder.mkdir()
    (folder / name).write_bytes(b"old")
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(encoder))
    with pytest.raises(sand.SandError) as caught:
        films.film(session.sim, folder / name, seconds=0.1)
    assert "\n" not in str(caught.value) and (name == "film.gif" or ENCODERS[how][1] in str(caught.value))
    assert content(folder) == {name: b"old"}


def test_what_a_kill_left_is_cleared_away_and_what_others_write_is_not(tmp_path: Path) -> None:
    left = tmp_path / ".film.mp4.abcd.part"
    left.mkdir()
    (tmp_path / ".film.mp4.notes").write_text("not ours")
    with writing.replacing(tmp_path / "film.mp4") as outer:
        assert not left.exists()
        with writing.replacing(tmp_path / "film.mp4") as inner:  # another process at the same time
            inner.write_text("inner")
        outer.write_text("outer")
    assert (tmp_path / "film.mp4").read_text() == "outer"
    assert sorted(os.listdir(tmp_path)) == [".film.mp4.notes", "film.mp4"]


def test_a_folder_moved_aside_when_it_was_killed_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a system cannot exchange two folders in one step."""
    (tmp_path / ".frames.abcd.part" / "old").mkdir(parents=True)
    (tmp_path / ".frames.abcd.part" / "old" / "frame_00000.png").write_text("old")
    writing.check(tmp_path / "frames", folder=True)
    assert content(tmp_path) == {"frames/frame_00000.png": b"old"}
    monkeypatch.setattr(writing, "exchange", lambda *_: False)
    with writing.replacing(tmp_path / "frames", folder=True) as made:
        made.mkdir()
        (made / "frame_00000.png").write_text("new")
    assert content(tmp_path) == {"frames/frame_00000.png": b"new"}


WRITER = """
import sys, time
import numpy as np
import taichi_sand as sand
from taichi_sand.play.recording import Recorder
from taichi_sand.play.session import Session
from taichi_sand.output.film import film

session = Session(sand.Scene(size=(0.4, 0.3), grains=[{"radius": 0.01, "count": 60}], view={"width": 160}), threads=1)
sim, path, kind = session.sim, sys.argv[1], sys.argv[2]

def record():
    recorder = Recorder(session, path)
    for _ in range(20):
        session.advance(3)
        recorder([], 3)
    recorder.close()

print("ready", flush=True)
while True:
    {"render": lambda: film(sim, path, seconds=0.2), "run": lambda: sim.save(path), "record": record}[kind]()
"""


def whole(path: Path) -> bool:
    """Whether a file can be read to its end as what it is."""
    if path.suffix == ".npz":
        return len(checkpoint.load(path)[1]) > 10
    if path.suffix == ".record":
        lines = recording.read(path).lines
        return all(isinstance(line, dict | list) for line in lines)
    if path.suffix == ".gif":
        with Image.open(path) as film:
            return getattr(film, "n_frames", 1) == 6
    if path.suffix == ".mp4":
        return imageio_ffmpeg.count_frames_and_secs(str(path))[0] == 6
    return len(list(path.iterdir())) == 6 and all(file.read_bytes().endswith(b"IEND\xaeB`\x82") for file in path.iterdir())


def killed(kind: str, target: str, folder: Path, times: int) -> None:
    """Kills a process that writes over and over, at random moments: what is there is whole, and the next write clears up."""
    path = folder / target.rstrip("/")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    for _ in range(times):
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, f"{folder}/{target}", kind], stdout=subprocess.PIPE, env=environment
        ) as process:
            assert process.stdout is not None and process.stdout.readline() == b"ready\n"
            time.sleep(random.uniform(0.0, 0.6))
            process.kill()
        assert not path.exists() or whole(path), f"{target} is not whole"
        assert len(os.listdir(folder)) <= 3, "more and more is left"
    time.sleep(0.5)  # an encoder that was left alone ends by itself
    writing.check(path, folder=target.endswith("/"))
    assert os.listdir(folder) in ([], [path.name])


@pytest.mark.parametrize(("kind", "target"), [("render", "film.mp4"), ("record", "it.record")])
def test_killed_while_writing(kind: str, target: str, tmp_path: Path) -> None:
    """Once, as a process takes seconds to start; twenty times in the slow one."""
    killed(kind, target, tmp_path, 1)


TARGETS = {"film.mp4": "render", "film.gif": "render", "frames/": "render", "state.npz": "run", "it.record": "record"}


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_killed_twenty_times(target: str, tmp_path: Path) -> None:
    killed(TARGETS[target], target, tmp_path, 20)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGHUP, 129)])
def test_signals_end_the_command_without_litter(number: int, status: int, tmp_path: Path) -> None:
    """Only the command gets it, as from a job scheduler; its encoder ends with it."""
    (tmp_path / "drop.toml").write_text(SCENE)
    command = [sys.executable, "-m", "taichi_sand", "render", "drop.toml", "-o", "out/film.mp4", "--seconds", "1e6", "--threads", "1"]
    environment = {**os.environ, "PYTHONPATH": str(Path(sand.__file__).parents[1])}
    heard = "signal.signal(signal.SIGINT, signal.default_int_handler); signal.signal(signal.SIGHUP, signal.SIG_DFL)"
    prepare = f"import signal, os, sys; {heard}; os.execv(sys.executable, sys.argv[1:])"  # background jobs, and nohup, are deaf to one
    with subprocess.Popen(
        [sys.executable, "-c", prepare, *command], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        deadline = time.monotonic() + 60
        while not any(tmp_path.glob("out/.film*/film.mp4")) and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(number)
        try:
            assert process.wait(30) == status
        finally:
            process.kill()  # or its end would be waited for
        assert process.stderr is not None
        assert process.stderr.read() == f"taichi-sand: {'interrupted' if number == signal.SIGINT else 'terminated'}\n"
    assert os.listdir(tmp_path) == ["drop.toml"]


def test_the_window_goes_on_when_its_report_cannot(tmp_path: Path) -> None:
    """Lines are cut off whole, and nothing is written after them."""
    lines = writing.Lines(tmp_path / "report.jsonl")
    with disk_of(100), pytest.raises(sand.SandError, match=r"report\.jsonl: File too large"):
        for k in range(100):
            lines.write(json.dumps({"k": k}))
    lines.write("{}")
    text = (tmp_path / "report.jsonl").read_text()
    assert [json.loads(line)["k"] for line in text.splitlines()] == list(range(len(text.splitlines()))) and text.endswith("}\n")
