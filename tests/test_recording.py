"""Recordings as files: whole up to where they were cut off, and refused in a sentence if they are damaged."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import taichi_sand as sand
from taichi_sand.play import recording
from taichi_sand.play.actions import is_action
from taichi_sand.play.calls import CALLS
from taichi_sand.play.session import Session


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Three frames, of which the second changes gravity; and the hash at the end."""
    path = tmp_path_factory.mktemp("recording") / "it.record"
    grains = [{"radius": 0.01, "count": 20, "fill": "lattice"}]
    session = Session(sand.Scene(size=[0.2, 0.3], grains=grains, effects={"friction": {}}), threads=1)
    recorder = recording.Recorder(session, path)
    for actions in ([], [["set", "gravity.0", 2.0]], []):
        for action in actions:
            session.do(action)
        session.advance(20)
        recorder(actions, 20)
    recorder.close()
    return path.read_bytes()


def steps_of(path: Path) -> int:
    """Steps that a recording, done again, has done."""
    *_, (session, _) = recording.replay(recording.read(path), path, "cpu", 2)
    return session.sim.steps


def test_done_again(recorded: bytes, tmp_path: Path) -> None:
    path = tmp_path / "it.record"
    path.write_bytes(recorded)
    assert steps_of(path) == 60


def test_begun_in_the_middle(tmp_path: Path) -> None:
    """Tool, brush, ranges and look are those of then, a number goes back to what the scene says, a reset to where the scene began."""
    grains = [{"radius": 0.01, "count": 20, "fill": "lattice"}, {"radius": [0.006, 0.009], "count": 3, "region": [0, 0.2, 0.2, 0.3]}]
    session, path = Session(sand.Scene(size=[0.2, 0.3], grains=grains, effects={"friction": {}}), threads=1), tmp_path / "it.record"
    for action in (["set", "gravity.0", 2.0], ["choose", "pour"], ["kind", 1], ["set", "tool.size", 0.04], ["opened", True], ["mark"]):
        session.do(action)
    session.do(["look", "color", "speed"])
    session.advance(30)
    recorder = recording.Recorder(session, path)
    session.do(["undo"])
    assert session.message == "there is nothing to undo"
    before = session.sim.count
    for phase in ("press", "drag", "release"):
        session.do(["stroke", phase, 0.1, 0.25, 0.0, 0.0])
        session.advance(10)
        recorder(session.take_log(), 10)
    assert session.sim.count > before
    for action in (["default", "gravity.0"], ["set", "solver.restitution", 1.2]):
        session.do(action)
        session.advance(10)
        recorder(session.take_log(), 10)
    recorder.hash()
    session.do(["reset"])
    session.advance(10)
    recorder(session.take_log(), 10)
    assert session.sim.steps == 10 and session.sim.scene.gravity == (0.0, -9.81)
    recorder.close()
    *_, (again, _) = recording.replay(recording.read(path), path, "cpu", 1)
    assert again.digest() == session.digest() and again.look == session.look and again.brush == session.brush


def test_a_page_of_it(recorded: bytes, tmp_path: Path) -> None:
    """A film of a recording may be a page; its clock is that of the wall."""
    path, out = tmp_path / "it.record", tmp_path / "it.html"
    path.write_bytes(recorded)
    recording.film(path, str(out), fps=30, width=None, arch="cpu", threads=1)
    tail = json.loads(re.search(r'id="tail">(.*?)</script>', out.read_text("utf-8"))[1])
    assert tail["report"]["grains"] == 20 and len(tail["series"]["at"]) >= 1 and tail["report"]["steps"] == 60


def test_cut_off_as_it_was_written(recorded: bytes, tmp_path: Path) -> None:
    """As by kill -9: all but the line that was being written."""
    path = tmp_path / "it.record"
    lines = recorded.split(b"\n")
    path.write_bytes(b"\n".join(lines[:4])[:-5])
    assert steps_of(path) == 40
    path.write_bytes(recorded[:-8])
    assert steps_of(path) == 60


def test_another_state(recorded: bytes, tmp_path: Path) -> None:
    """What was done is not what is written down."""
    path = tmp_path / "it.record"
    path.write_bytes(recorded.replace(b"[[], 20, ", b"[[], 21, ", 1).replace(b"[[],20,", b"[[],21,", 1))
    with pytest.raises(sand.PhysicsError, match="the state is not what was recorded"):
        steps_of(path)


@pytest.mark.parametrize("how", ["half a head", "another version", "unknown action", "no action", "no frame", "bytes", "empty"])
def test_damaged(recorded: bytes, how: str, tmp_path: Path) -> None:
    """One sentence that names the file."""
    head, *rest = recorded.split(b"\n")
    path = tmp_path / "it.record"
    damaged = {
        "half a head": head[: len(head) // 2] + b"\n",
        "another version": b"\n".join([head.replace(b": 2", b": 3", 1).replace(b":2", b":3", 1), *rest]),
        "unknown action": b"\n".join([head, *rest]).replace(b'"set"', b'"sit"'),
        "no action": b"\n".join([head, b"[[[[]]], 1, 2.0]", *rest]),
        "no frame": b"\n".join([head, b"[1, 2]", *rest]),
        "bytes": b"\xff\xfe" + recorded,
        "empty": b"",
    }[how]
    assert damaged != recorded
    path.write_bytes(damaged)
    with pytest.raises(sand.SandError, match=r"it\.record") as caught:
        recording.read(path)
    assert "\n" not in str(caught.value)
    assert ("format 3" in str(caught.value)) == (how == "another version")


def test_a_scene_that_cannot_be_simulated_is_told(recorded: bytes, tmp_path: Path) -> None:
    """With the name of the recording that holds it."""
    head, rest = recorded.split(b"\n", 1)
    told = json.loads(head)
    told["scene"] = json.dumps({**json.loads(told["scene"]), "effects": {"fraction": {}}})
    path = tmp_path / "it.record"
    path.write_bytes(json.dumps(told).encode() + b"\n" + rest)
    with pytest.raises(sand.SandError, match=r"it\.record: effects\.fraction: there is no such effect; did you mean `friction`\?"):
        steps_of(path)


def test_calls_from_python_are_done_again(tmp_path: Path) -> None:
    """What a script does to the simulation of a session, out of `every` too, and takes back: to the same bits. What is refused is not
    written down.
    """
    path = tmp_path / "it.record"
    grains = [{"radius": 0.01, "count": 20, "fill": "lattice", "region": [0.0, 0.0, 0.2, 0.2]}]
    session = Session(sand.Scene(size=[0.2, 0.3], grains=grains, effects={"friction": {}, "push": {}}), threads=1)
    recorder, sim = recording.Recorder(session, path), session.sim
    sim.advance(0.02)
    ids = sim.add(np.array([[0.05, 0.28]]), radius=0.01, velocities=(0.0, -1.0))
    sim.push(ids, force=(0.5, 0.0), torque=np.float32(1e-3))
    late = sim.every(0.02, lambda sim: sim.count > 22 or sim.add([[0.15, 0.28]], radius=np.float32(0.01), velocities=[0.0, -1.0]))
    session.advance(100)
    late.stop()
    session.do(["mark"])
    sim.set("gravity", (1.0, -9.81))
    sim.set_walls([{"points": [[0.0, 0.22], [0.05, 0.24]]}])
    sim.advance(0.02)
    session.do(["undo"])
    assert session.sim.scene.gravity == (0.0, -9.81)
    session.sim.remove([0])
    session.sim.set_state([1], velocities=(0.0, 2.0))
    with pytest.raises(sand.SandError):
        session.sim.remove([0])
    session.sim.advance_steps(50)
    recorder.close()
    verbs = [
        action[1] if action[0] == "call" else action[0] for line in recording.read(path)[2] if isinstance(line, list) for action in line[0]
    ]
    assert verbs == ["add", "push", "add", "add", "mark", "set", "set_walls", "undo", "remove", "set_state"]
    end = session.digest(), session.sim.steps, session.sim.ids.tolist()
    del sim
    session.drop()  # Taichi has one number of threads at a time
    *_, (again, _) = recording.replay(recording.read(path), path, "cpu", 2)
    assert (again.digest(), again.sim.steps, again.sim.ids.tolist()) == end


@pytest.mark.parametrize(
    "given", [["sit", {}], ["add", []], ["add", {"size": 1}], ["add", {}], ["retune", {"scene": 1}], [[], {}], ["set"]]
)
def test_calls_that_are_none(given: list) -> None:
    assert not is_action(["call", *given]) and is_action(["call", "renew", {}])


def test_every_call_that_changes_a_simulation_is_known() -> None:
    """Those that steer it, water too; not the one that only writes down what it does."""
    steering = {"add", "remove", "set_state", "push", "set", "retune", "restage", "set_walls", "wet", "renew"}
    assert set(CALLS) >= steering | {"pour_water", "drain_water", "push_water"} and not {"record", "advance", "report"} & set(CALLS)
