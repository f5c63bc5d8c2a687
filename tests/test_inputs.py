"""What callers give: NumPy's numbers, arrays and paths mean what Python's do, and what means nothing is refused in a sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app
from taichi_sand.play.recording import Recorder
from taichi_sand.play.session import Session
from taichi_sand.scene.schema import Grains, Solver, Wall

KEYS: dict[str, Any] = {
    "size": [0.5, 1.0],
    "gravity": [0.0, -9.75],
    "seed": 3,
    "edges": {"left": "open"},
    "solver": {"kind": "md", "tolerance": 0.0625, "precision": 64, "step": 0.5**12},
    "grains": [
        {"radius": [0.03125, 0.0625], "count": 5, "region": [0.0, 0.25, 0.5, 0.75], "fixed": True, "angle": 0.5},
        {"radius": 0.03125, "positions": [[0.25, 0.875], [0.125, 0.875]], "velocity": [0.25, 0.0]},
    ],
    "walls": [{"points": [[0.0, 0.0], [0.5, 0.25]], "closed": False, "shake": {"amplitude": [0.0, 0.125], "frequency": 2.0}}],
    "sinks": [{"region": [0.0, 0.0, 0.125, 0.125]}],
    "effects": {"friction": {"mu": 0.5}, "drag": {"linear": 0.25}},
    "view": {"width": 64, "caption": False},
}
"""Numbers that 32 bits hold exactly, so that all kinds of them are equal."""


def in_numpy(value: Any, kinds: dict[type, Any], arrays: bool) -> Any:
    """The same with NumPy's numbers; and its arrays, where a list holds numbers alone."""
    if isinstance(value, dict):
        return {key: in_numpy(part, kinds, arrays) for key, part in value.items()}
    if isinstance(value, list):
        if arrays and not isinstance(value[0], dict) and np.asarray(value).dtype != object:
            return np.asarray(value)
        return [in_numpy(part, kinds, arrays) for part in value]
    return kinds[type(value)](value) if type(value) in kinds else value


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from([np.int16, np.int32, np.int64, np.uint8]),
    st.sampled_from([np.float32, np.float64, float, np.float16]),
    st.sampled_from([np.bool_, bool]),
    st.booleans(),
)
def test_a_scene_takes_numpy(whole: Any, real: Any, switch: Any, arrays: bool) -> None:
    """Of any kind, in any key; the scene holds Python's."""
    kinds = {int: whole, float: real, bool: switch}
    made = sand.Scene(**in_numpy(KEYS, kinds, arrays))
    assert made.to_json() == sand.Scene(**KEYS).to_json()
    assert type(made.grains[0].count) is int and type(made.grains[0].fixed) is bool and type(made.seed) is int


def test_tables_alone_take_numpy_too() -> None:
    assert Grains(count=np.int64(3), radius=np.float32(0.5)).radius == (0.5, 0.5)
    assert Solver(tolerance=np.float32(0.0625)).tolerance == 0.0625
    assert Wall(points=np.eye(2), closed=np.False_).points == ((1.0, 0.0), (0.0, 1.0))


def test_a_table_made_before_is_a_table(tmp_path: Path) -> None:
    """Models and paths inside of a scene."""
    (tmp_path / "grains.csv").write_text("0.25,0.25\n")
    scene = sand.Scene(size=(1, 1), grains=[Grains(count=1, radius=0.1), {"positions_file": tmp_path / "grains.csv", "radius": 0.1}])
    assert scene.grains[1].positions == ((0.25, 0.25),)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("size", np.array([1.0])),
        ("size", np.array([[1.0, 2.0]])),
        ("size", np.array(["a", "b"])),
        ("seed", np.float64(0.5)),
        ("seed", np.array([1, 2])),
        ("gravity", np.array([np.nan, 0.0])),
        ("duration", np.complex128(1j)),
        ("title", np.int64(3)),
        ("grains", np.zeros(3)),
        ("grains", {"count": 3}),
        ("effects", ["friction"]),
        ("effects", np.zeros(2)),
        ("view", Path("x")),
        ("walls", 3),
    ],
)
def test_other_kinds_are_refused(key: str, value: Any) -> None:
    """One sentence that begins with the key."""
    with pytest.raises(sand.SandError) as caught:
        sand.Scene(**{"size": [1.0, 1.0], key: value})
    assert str(caught.value).startswith(key) and "\n" not in str(caught.value)


def test_a_name_or_a_path_is_taken_as_a_scene(scene_file: Any) -> None:
    path = scene_file("size = [0.2, 0.2]\n[[grains]]\nradius = 0.01\ncount = 3\n")
    assert sand.load(path).to_json() == sand.load(str(path)).to_json()
    for thing in (path, str(path), sand.load(path)):
        sim = sand.Simulation(thing, threads=1)
        assert sim.count == 3
        del sim


@pytest.mark.parametrize("thing", [3, None, 1.5, {"size": [1, 1]}, b"settle", np.zeros(2), ["settle"], object()])
def test_what_is_no_scene_is_refused(thing: Any) -> None:
    for make in (sand.Simulation, sand.load):
        with pytest.raises(sand.SandError) as caught:
            make(thing)
        assert "\n" not in str(caught.value)
    with pytest.raises(sand.SandError, match="there is no scene `setle`; did you mean `settle`"):
        sand.Simulation("setle")


def test_overrides_are_texts(scene_file: Any) -> None:
    path = scene_file("size = [0.2, 0.2]\n")
    assert sand.load(path, "seed=3").seed == 3
    with pytest.raises(sand.SandError, match="an override is a text KEY=VALUE"):
        sand.load(path, [("seed", 3)])  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "shake = { amplitud = [0, 1], frequency = 1.0 }",
            "walls[0].shake.amplitud is not a known key; did you mean `amplitude`? (walls[0].shake has",
        ),
        ("shake = { amplitude = [0, 1], frequency = -1.0 }", "walls[0].shake.frequency = -1 must be greater than 0 Hz"),
        ("shake = { amplitude = [0, 1] }", "walls[0].shake.frequency is missing"),
        ("shaking = 3", "walls[0].shaking is not a known key; did you mean `shake`? ([[walls]] has"),
    ],
)
def test_a_table_within_a_table_is_named(line: str, said: str, scene_file: Any) -> None:
    path = scene_file(f"size = [1, 1]\n[[walls]]\npoints = [[0, 0], [1, 1]]\n{line}\n")
    with pytest.raises(sand.SandError) as caught:
        sand.load(path)
    assert said in str(caught.value)


def test_checkpoints_and_recordings_are_no_scenes(tmp_path: Path) -> None:
    """And what they are for is said."""
    session = Session(sand.Scene(size=(0.2, 0.2), grains=[{"radius": 0.01, "count": 3}]), threads=1)
    session.sim.save(tmp_path / "state.npz")
    Recorder(session, tmp_path / "it.record").close()
    del session
    for name, hint in (("state.npz", "--resume FILE"), ("it.record", "taichi-sand render FILE")):
        done = CliRunner().invoke(app, ["run", str(tmp_path / name)])
        assert done.exit_code == 2 and hint in done.stderr and done.stderr.count("\n") == 1
    done = CliRunner().invoke(app, ["render", str(tmp_path / "state.npz"), "-o", str(tmp_path / "x.mp4")])
    assert done.exit_code == 2 and "--resume" in done.stderr
