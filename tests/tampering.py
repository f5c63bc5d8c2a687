"""Files broken at random, for `fuzz`: scene files, CSV files, checkpoints and recordings with any byte or value changed, and their hashes
made right again; and how long, and with how much memory, each may be looked at.
"""

import base64
import contextlib
import gc
import io
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli import main
from taichi_sand.errors import PhysicsError, SandError
from taichi_sand.play import recording
from taichi_sand.play.session import Session
from taichi_sand.study.laboratory import fresh_taichi
from taichi_sand.taichi_support import compiling
from taichi_sand.world import checkpoint

MOST_SECONDS, MOST_WAITING = 2.0, 20.0
"""Of a processor, compiling apart, and of waiting: other processes may hold it up."""
MOST_MEMORY = 500 * 2**20  # bytes more than before
MOST_STEPS = 200
"""Of a recording: one may ask for a million, as a scene may for a long duration."""
Arrays = dict[str, np.ndarray]

SAMPLE = b"""title = "x"
size = [0.2, 0.2]
gravity = [0.0, -9.81]
edges = { left = "open", right = "wall" }
[solver]
kind = "md"
tolerance = 0.05
[[grains]]
positions_file = "grains.csv"
density = 2650.0
[[walls]]
points = [[0.0, 0.1], [0.05, 0.08]]
[effects.friction]
mu = 0.5
"""
ROWS = b"x,y,radius,vx,vy\n0.05,0.15,0.005,0,0\n0.10,0.15,0.004,0.1,-0.2\n"
WORDS = [
    *(b"nan", b"inf", b"-1", b"1e308", b"1e-320", b"true", b'"', b"[", b"]", b"=", b"\n", b"\x00", b"\xff", b"0x", b"[[walls]]", b","),
    b"9" * 400,
]
ODD = [
    None,
    True,
    -1,
    0,
    0.5,
    2,
    2**31,
    10**12,
    10**400,
    -1e-300,
    1e300,
    float("nan"),
    float("inf"),
    "",
    "x",
    "nan",
    [],
    [[]],
    {},
    {"x": 1},
]
"""What may stand anywhere in a JSON that somebody has tampered with."""
WHOLE = [-(2**31), -2, -1, 0, 1, 2, 63, 64, 2**20, 2**30, 2**31 - 1]
REAL = [float("nan"), float("inf"), -1e30, -1.0, 0.0, 1e-30, 1.0, 1e9, 1e30]


@contextlib.contextmanager
def within_limits() -> Iterator[None]:
    """AssertionError if the block takes too long, or too much memory (where the system tells that). What hypothesis keeps of a thousand
    examples is put out of reach of the collector: going through it is no cost of what is tried.
    """
    gc.freeze()
    peak, here = Path("/proc/self/clear_refs"), Path("/proc/self/status")
    before = 0
    if here.exists():
        peak.write_text("5")  # the peak is counted from here
        before = peak_memory(here)
    wall, cpu, compiled = time.perf_counter(), time.process_time(), compiling.seconds()
    try:
        yield
    finally:
        gc.unfreeze()
    whole, cpu = time.perf_counter() - wall, time.process_time() - cpu
    wall = whole - (compiling.seconds() - compiled)
    cpu *= wall / whole  # compiling has taken its share of both
    assert cpu <= MOST_SECONDS and wall <= MOST_WAITING, f"it took {wall:.1f} s, {cpu:.1f} s of a processor"
    if before:
        more = peak_memory(here) - before
        assert more <= MOST_MEMORY, f"it took {more / 2**20:.0f} MB"


def peak_memory(status: Path) -> int:
    """Most memory that this process has had [bytes]."""
    return next(1024 * int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("VmHWM"))


@st.composite
def broken(draw: Callable, text: bytes) -> bytes:
    """The text with some bytes cut out, doubled, or replaced by what often breaks a reader; or bytes of no sense."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 12)))
        middle = draw(st.one_of(st.sampled_from(WORDS), st.binary(max_size=4), st.just(2 * text[start:end])))
        text = text[:start] + middle + text[end:]
    return text


def odd(draw: Callable, thing: Any) -> Any:
    """A JSON with one value in it, on any level, replaced by another; texts that hold a JSON too."""
    if isinstance(thing, str) and thing[:1] in "{[" and thing:
        return json.dumps(odd(draw, json.loads(thing)))
    if not isinstance(thing, dict | list) or not thing or draw(st.integers(0, 7)) == 0:
        return draw(st.sampled_from(ODD))
    key = draw(st.sampled_from(sorted(thing) if isinstance(thing, dict) else range(len(thing))))
    changed = thing.copy()
    if draw(st.integers(0, 15)) == 0:
        del changed[key]
    else:
        changed[key] = odd(draw, thing[key])
    return changed


@st.composite
def tampered(draw: Callable, good: Arrays, head: str) -> Arrays:
    """The arrays of an archive with some numbers changed, or a shape or type, or something in the JSON `head`."""
    arrays = dict(good)
    for _ in range(draw(st.integers(1, 2))):
        name = draw(st.one_of(st.just(head), st.sampled_from(sorted(arrays))))
        values = arrays.get(name)
        if values is None:
            continue
        if name == head:
            text = json.dumps(odd(draw, json.loads(values.tobytes()))).encode() if values is good[head] else values.tobytes()
            arrays[name] = np.frombuffer(text, np.uint8)
        elif draw(st.integers(0, 9)) == 0:
            del arrays[name]
            arrays |= draw(st.sampled_from([{}, {name: values[..., None]}, {name: values.astype("f8")}, {name[1:]: values}]))
        elif values.size:
            arrays[name] = values.copy()
            place = draw(st.integers(0, values.size - 1))
            whole = values.dtype.kind == "i"
            arrays[name].flat[place] = draw(
                st.one_of(st.sampled_from(WHOLE if whole else REAL), st.integers(-3, 99) if whole else st.floats(-2, 2))
            )
    return arrays


def to_archive(arrays: Arrays) -> bytes:
    """An .npz of arrays."""
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def with_hash(arrays: Arrays) -> Arrays:
    """The arrays of a checkpoint, with the hash that they have now."""
    header = json.loads(arrays["header"].tobytes()) if "header" in arrays else None
    if not isinstance(header, dict):
        return arrays
    rest = {name: values for name, values in arrays.items() if name != "header"}
    text = json.dumps(header | {"sha256": checkpoint.digest(rest)})
    return rest | {"header": np.frombuffer(text.encode(), np.uint8)}


def arrays_of(data: bytes) -> Arrays:
    """The arrays of an .npz that is ours."""
    with np.load(io.BytesIO(data)) as file:
        return {name: file[name] for name in file.files}


@st.composite
def retold(draw: Callable, lines: list[str]) -> list[str]:
    """The lines of a recording, with something changed in what it starts from, or in what was done."""
    number = draw(st.one_of(st.just(0), st.integers(0, len(lines) - 1)))
    line = json.loads(lines[number])
    if number == 0 and draw(st.booleans()):
        changed = draw(tampered(arrays_of(base64.b64decode(line["start"])), "head"))
        line["start"] = base64.b64encode(to_archive(changed)).decode()
    else:
        line = odd(draw, line)
    return [*lines[:number], json.dumps(line), *lines[number + 1 :]]


def run_command(arguments: list[str]) -> None:
    """Runs the command; AssertionError unless it ends in time with a result, or with exit status 1 or 2 and a sentence."""
    fresh_taichi()
    with within_limits():
        done = CliRunner().invoke(main.app, arguments)
    assert done.exit_code in (0, 1, 2), f"{arguments}: {done.exit_code} {done.exception!r}"
    assert done.exception is None or isinstance(done.exception, SystemExit), f"{arguments}: {done.exception!r}"


def check_files(folder: Path, toml: bytes, rows: bytes) -> None:
    """A scene file and the CSV file beside it, run for no time."""
    (folder / "scene.toml").write_bytes(toml)
    (folder / "grains.csv").write_bytes(rows)
    run_command(["run", str(folder / "scene.toml"), "--seconds", "0", "--json", "--threads", "1"])


def check_checkpoint(folder: Path, data: bytes, seconds: float = 0.0) -> None:
    """A checkpoint that is damaged, or none."""
    (folder / "state.npz").write_bytes(data)
    run_command(["run", "--resume", str(folder / "state.npz"), "--seconds", str(seconds), "--json", "--threads", "1"])


def check_recording(folder: Path, text: bytes) -> None:
    """A recording that is damaged, or none: refused, or done again as far as it goes."""
    path = folder / "it.record"
    path.write_bytes(text)
    fresh_taichi()
    with within_limits():
        try:
            recorded = recording.read(path)
            assume(sum(line[1] for line in recorded[2] if isinstance(line, list)) <= MOST_STEPS)
            for _ in recording.replay(recorded, path, "cpu", 1):
                pass
        except (SandError, PhysicsError) as error:
            assert "\n" not in str(error) and str(path) in str(error), str(error)


def sample_scene() -> sand.Scene:
    """Some of each: a wall that turns, one that stands, grains of two sizes that touch."""
    walls = [{"points": [[0.02, 0.02], [0.05, 0.02]], "spin": 1.0}, {"points": [[0.05, 0.06], [0.09, 0.06]]}]
    grains = [{"radius": [0.003, 0.005], "count": 20}]
    return sand.Scene(size=[0.1, 0.1], grains=grains, walls=walls, effects={"friction": {}})


def checkpoint_bytes(folder: Path) -> bytes:
    """A small checkpoint as it should be."""
    fresh_taichi()
    sim = sand.Simulation(sample_scene(), arch="cpu", threads=1, hand=True)
    sim.advance(0.1)
    sim.save(folder / "good.npz")
    return (folder / "good.npz").read_bytes()


def recorded_lines(folder: Path) -> list[str]:
    """A short recording as it should be."""
    fresh_taichi()
    session = Session(sample_scene(), threads=1)
    recorder = recording.Recorder(session, folder / "good.record")
    for action in (
        *(["set", "gravity.0", 2.0], ["choose", "stir"], ["stroke", "press", 0.05, 0.05, 0.0, 0.0, False]),
        *(["stroke", "release", 0.06, 0.05, 1.0, 0.0], ["undo"], ["look", "grid", True], ["opened", True], ["kind", 1], ["mark"]),
    ):
        session.do(action)
        session.advance(5)
        recorder([action], 5)
    recorder.close()
    return (folder / "good.record").read_text().splitlines()
