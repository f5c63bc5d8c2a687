"""Trajectories: what gsd reads back is the simulation, at the times asked for, whatever happens on the way."""

import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gsd.fl
import gsd.hoomd
import numpy as np
import pytest
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app
from taichi_sand.files.trajectory import STEP, Trajectory
from taichi_sand.measure.frame import mean_radius
from tests.helpers import digest
from tests.test_writing import disk_of

EVERY = 0.02
DISCS = {
    "size": (0.25, 0.3),
    "duration": 0.2,
    "edges": {"left": "periodic", "right": "periodic"},
    "grains": [
        {"radius": (0.008, 0.012), "count": 16, "velocity": (0.5, 0.0), "spin": 3.0},
        {"radius": 0.01, "positions": [(0.1, 0.02)], "density": 1000.0, "fixed": True},
    ],
    "effects": {"friction": {}},
}
FLOW = {
    "size": (0.2, 0.3),
    "duration": 0.4,
    "grains": [{"shape": "triangle", "radius": (0.005, 0.007), "count": 4, "angle": "random", "region": (0.0, 0.0, 0.2, 0.1)}],
    "sources": [
        {"radius": (0.005, 0.008), "rate": 60, "region": (0.02, 0.2, 0.1, 0.3), "velocity": (0.0, -1.0)},
        {"shape": "triangle", "radius": 0.006, "rate": 30, "region": (0.1, 0.2, 0.18, 0.3), "velocity": (0.0, -1.0)},
    ],
    "sinks": [{"region": (0.0, 0.0, 0.2, 0.05)}],
    "walls": [{"points": [(0.02, 0.16), (0.1, 0.11), (0.18, 0.16)]}],
    "effects": {"friction": {}},
}
Frames = list[Any]


def read(path: Path) -> Frames:
    with gsd.hoomd.open(path) as trajectory:
        return list(trajectory)


def recorded(table: dict, path: Path) -> tuple[Any, Frames]:
    """A simulation of a scene to its end, and its frames."""
    sim = sand.Simulation(sand.Scene(**table), threads=1)
    recorder = sim.record(path, every=EVERY)
    sim.advance_to(sim.scene.duration)
    recorder.stop()
    return sim, read(path)


def place(frame: Any) -> np.ndarray:
    """Positions in the scene (n, 2)."""
    return frame.particles.position[:, :2] + frame.log["shift"]


@pytest.fixture(scope="module")
def discs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Frames, Path]:
    path = tmp_path_factory.mktemp("discs") / "run.gsd"
    return *recorded(DISCS, path), path


def test_frames_are_the_states_of_an_undisturbed_run(discs: tuple[Any, Frames, Path]) -> None:
    """At the steps nearest to the times asked for, and not a bit of the simulation changes."""
    sim, frames, _ = discs
    alone = sand.Simulation(sand.Scene(**DISCS), threads=1)
    assert len(frames) == 11
    for k, frame in enumerate(frames):
        alone.advance_to(k * EVERY)
        assert frame.configuration.step == alone.steps
        assert abs(frame.log["time"][0] - k * EVERY) <= 0.5 * alone.step * (1 + 1e-9)
        assert np.array_equal(frame.log["particles/id"], alone.ids)
        across = np.abs(place(frame) - alone.positions) % 0.25
        assert np.minimum(across[:, 0], 0.25 - across[:, 0]).max() < 2e-8 and across[:, 1].max() < 2e-8
        assert np.array_equal(frame.particles.velocity[:, :2], alone.velocities.astype(np.float32))
        assert np.array_equal(frame.log["particles/spin"], alone.spins.astype(np.float32))
        check_bonds(frame, alone)
        turned = 2 * np.arctan2(frame.particles.orientation[:, 3], frame.particles.orientation[:, 0])
        assert np.abs(np.exp(1j * turned) - np.exp(1j * alone.angles)).max() < 1e-6
    assert digest(alone) == digest(sim) and max(frame.bonds.N for frame in frames) > 3


def check_bonds(frame: Any, sim: Any) -> None:
    """Bonds are the contacts of grains, between the discs that touch; forces on particles are theirs and those of walls."""
    found, p = sim.contacts(), frame.particles
    inner, ids = found[found["id2"] >= 0], frame.log["particles/id"]
    assert frame.bonds.types == ["contact", "bridge"] and frame.bonds.N == len(inner) and not frame.bonds.typeid.any()
    one, two = frame.bonds.group.T
    assert np.array_equal(ids[one], inner["id1"]) and np.array_equal(ids[two], inner["id2"])
    for name in ("force_n", "force_t", "overlap"):
        assert np.array_equal(frame.log[f"bonds/{name}"], inner[name].astype(np.float32))
    way = (p.position[two] - p.position[one])[:, :2]
    way -= np.array(sim.scene.size) * sim.scene.periodic * np.round(way / np.array(sim.scene.size))
    touching = (p.diameter[one] + p.diameter[two]) / 2 - inner["overlap"]
    assert np.linalg.norm(way, axis=1) == pytest.approx(touching, abs=1e-6)
    push = found["force_n"][:, None] * found["normal"] + found["force_t"][:, None] * found["normal"][:, ::-1] * [-1, 1]
    net = np.zeros((sim.made, 2))
    np.add.at(net, found["id1"], -push)
    np.add.at(net, inner["id2"], push[found["id2"] >= 0])
    forces = np.zeros((sim.made, 2))
    np.add.at(forces, ids, frame.log["particles/force"][:, :2].astype(float))
    assert np.abs(forces - net).max(initial=0) <= 1e-5 * np.abs(push).max(initial=0)


def test_a_frame_says_what_the_grains_are(discs: tuple[Any, Frames, Path]) -> None:
    sim, frames, _ = discs
    for frame in frames:
        p, box = frame.particles, frame.configuration
        assert box.dimensions == 2 and box.box == pytest.approx([0.25, 0.3, 0, 0, 0, 0])
        assert (np.abs(p.position[:, 0]) <= 0.125).all() and (p.position[:, 0] < np.float32(0.125)).all()
        assert p.N == 17 and p.types == ["grains[0]", "grains[1]"] and list(p.typeid) == [0] * 16 + [1]
        assert p.type_shapes[1] == {"type": "Sphere", "diameter": 0.02}
        assert np.array_equal(p.diameter, (2 * sim.radii).astype(np.float32))
        density = np.where(p.typeid == 0, 2650.0, 1000.0)
        assert p.mass == pytest.approx(density * np.pi * sim.radii**2, rel=1e-6)
        assert p.moment_inertia[:, 2] == pytest.approx(0.5 * p.mass * sim.radii**2, rel=1e-6)
        assert (p.body == -1).all()
    report = sim.report()
    for name in ("kinetic_energy_J", "potential_energy_J"):
        assert frames[-1].log[name][0] == pytest.approx(report[name], rel=1e-6)


def test_types_of_distributed_sizes() -> None:
    """Their shape is that of the mean: of a log-normal law, median exp(sigma² / 2)."""
    law = {"distribution": "lognormal", "median": 0.004, "sigma": 0.2}
    table = sand.Scene(size=(1, 1), grains=[{"radius": law, "count": 5}]).grains[0]
    assert mean_radius(table) == pytest.approx(0.004 * math.exp(0.02), rel=2e-3)


def test_a_resumed_run_goes_on_with_it(discs: tuple[Any, Frames, Path], tmp_path: Path) -> None:
    """The frames after the checkpoint are written again, and the file has those of a run that was never interrupted."""
    path, saved = tmp_path / "run.gsd", tmp_path / "saved.npz"
    sim = sand.Simulation(sand.Scene(**DISCS), threads=1)
    sim.record(path, every=EVERY)
    sim.advance(0.085)
    sim.save(saved)
    sim.advance(0.05)
    assert len(read(path)) == 7  # before it is closed
    del sim
    again = sand.Simulation.resume(saved, threads=1)
    again.record(path, every=EVERY)
    assert len(read(path)) == 5
    again.advance_to(0.2)
    again.close()
    same(read(path), discs[1])


def same(one: Frames, other: Frames) -> None:
    """Whether two trajectories hold the same."""
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert a.configuration.step == b.configuration.step and a.log.keys() == b.log.keys()
        assert all(np.array_equal(a.log[name], b.log[name]) for name in a.log)
        for name, values in vars(a.particles).items():
            assert np.array_equal(values, getattr(b.particles, name)), name
        assert a.bonds.N == b.bonds.N and np.array_equal(a.bonds.group, b.bonds.group)


@pytest.fixture(scope="module")
def flow(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Frames, Path]:
    path = tmp_path_factory.mktemp("flow") / "run.gsd"
    return *recorded(FLOW, path), path


def test_clumps_are_their_discs(flow: tuple[Any, Frames, Path]) -> None:
    """Mass, momentum, kinetic energy and angular momentum of the particles are those of the grains; discs of a clump touch as built."""
    sim, frames, _ = flow
    p, report = frames[-1].particles, sim.report()
    ids, count = np.unique(frames[-1].log["particles/id"], return_counts=True)
    assert np.array_equal(ids, sim.ids) and set(count) == {1, 3}
    assert np.array_equal(p.body, np.repeat(np.where(count == 3, ids, -1), count))
    v, spin = p.velocity[:, :2].astype(float), frames[-1].log["particles/spin"].astype(float)
    assert p.mass.sum() == pytest.approx(report["mass_kg"], rel=1e-6)
    assert p.mass @ v == pytest.approx(report["momentum_Ns"], rel=1e-4, abs=1e-6)
    inertia = p.moment_inertia[:, 2]
    assert 0.5 * (p.mass @ (v**2).sum(axis=1) + inertia @ spin**2) == pytest.approx(report["kinetic_energy_J"], rel=1e-5)
    x = place(frames[-1])
    turning = (p.mass * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + inertia * spin).sum()
    assert turning == pytest.approx(report["angular_momentum_Nms"], rel=1e-4)
    for body in ids[count == 3]:
        corners = x[p.body == body]
        apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        assert apart == pytest.approx(p.diameter[p.body == body], rel=1e-5)


def test_grains_come_and_go(flow: tuple[Any, Frames, Path]) -> None:
    """Every chunk stands in every frame of another number: gsd would else take it from the first."""
    _, frames, path = flow
    alone = sand.Simulation(sand.Scene(**FLOW), threads=1)
    numbers = []
    for k, frame in enumerate(frames):
        alone.advance_to(k * EVERY)
        ids, first = np.unique(frame.log["particles/id"], return_index=True)
        numbers.append(frame.particles.N)
        assert np.array_equal(ids, alone.ids)
        check_bonds(frame, alone)
        single = frame.particles.body[first] < 0
        assert np.array_equal(frame.particles.diameter[first][single], (2 * alone.radii[single]).astype(np.float32))
        assert np.abs(place(frame)[first][single] - alone.positions[single]).max(initial=0.0) < 2e-8
        assert np.abs(centres(frame) - alone.positions).max() < 2e-7
    assert max(frame.bonds.N for frame in frames) > 3
    assert max(numbers) > numbers[0] and frames[-1].log["particles/id"][0] > 0
    with gsd.fl.open(str(path), "r") as file:
        names = {name for name in file.find_matching_chunk_names("particles/") if "types" not in name and "shapes" not in name}
        for k, number in enumerate(numbers):
            assert number == numbers[0] or all(file.chunk_exists(k, name) for name in names), k


def centres(frame: Any) -> np.ndarray:
    """Centres of mass of grains (n, 2), in the order of their ids."""
    _, owner = np.unique(frame.log["particles/id"], return_inverse=True)
    mass, x = frame.particles.mass.astype(float), place(frame)
    return np.stack([np.bincount(owner, mass * x[:, k]) / np.bincount(owner, mass) for k in (0, 1)], axis=1)


def test_freud_opens_it(discs: tuple[Any, Frames, Path]) -> None:
    """Its neighbours are those that a search of all pairs finds."""
    freud = pytest.importorskip("freud", reason="freud is the field's tool to read trajectories; the extra `test` has it")
    frame, reach = discs[1][-1], 0.025
    box = freud.box.Box.from_box(frame.configuration.box)
    assert box.is2D
    pairs = freud.locality.AABBQuery(box, frame.particles.position).query(frame.particles.position, {"r_max": reach, "exclude_ii": True})
    found = {(int(i), int(j)) for i, j in pairs.toNeighborList()[:]}
    way = frame.particles.position[:, None] - frame.particles.position[None]
    way -= np.array([0.25, 0.3, 1.0]) * np.round(way / np.array([0.25, 0.3, 1.0]))
    near = np.linalg.norm(way, axis=-1) < reach
    assert found == {(int(i), int(j)) for i, j in np.argwhere(near) if i != j} and len(found) > 4


BAD = {
    "run.xyz": "run.xyz: a trajectory ends in .gsd",
    "folder.gsd": "it is a folder, not a file",
    "pipe.gsd": "it is a device, a pipe or the like, not a file",
    "text/run.gsd": "is a file, not a folder",
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_written(discs: tuple[Any, Frames, Path], tmp_path: Path, name: str) -> None:
    (tmp_path / "folder.gsd").mkdir()
    os.mkfifo(tmp_path / "pipe.gsd")
    (tmp_path / "text").write_text("")
    with pytest.raises(sand.SandError, match=BAD[name]):
        discs[0].record(tmp_path / name, every=0.1)
    scene = tmp_path / "scene.toml"
    scene.write_text("size = [0.1, 0.1]\n")
    done = CliRunner().invoke(app, ["run", str(scene), "--out", str(tmp_path / name)])
    assert done.exit_code == 2 and BAD[name] in done.output and "--out" in done.output


@pytest.mark.parametrize("every", [0, -1.0, float("nan"), float("inf"), "0.1", True, None])
def test_times_that_are_none(discs: tuple[Any, Frames, Path], tmp_path: Path, every: Any) -> None:
    with pytest.raises(sand.SandError, match="must be a number of seconds"):
        discs[0].record(tmp_path / "run.gsd", every=every)
    assert not list(tmp_path.iterdir())


def test_a_trajectory_of_something_else_is_kept(discs: tuple[Any, Frames, Path], tmp_path: Path) -> None:
    """A simulation that is under way does not put its own in the place of another."""
    sim, path = discs[0], tmp_path / "run.gsd"
    other = {**DISCS, "seed": 1}
    later = discs[2].read_bytes()
    for content, sentence in ((b"no trajectory", "not a trajectory"), (b"", "not a trajectory"), (later[:300], "not a trajectory")):
        path.write_bytes(content)
        with pytest.raises(sand.SandError, match=sentence):
            sim.record(path, every=0.1)
        assert path.read_bytes() == content
    path.unlink()
    recorded(other, path)
    content = path.read_bytes()
    with pytest.raises(sand.SandError, match="is not of this scene"):
        sim.record(path, every=0.1)
    assert path.read_bytes() == content


def test_any_byte_of_a_trajectory_may_be_wrong(discs: tuple[Any, Frames, Path], tmp_path: Path) -> None:
    """Going on with a damaged one works, or is refused in a sentence."""
    sim, path, rng = discs[0], tmp_path / "run.gsd", np.random.default_rng(3)
    whole = np.frombuffer(discs[2].read_bytes(), np.uint8)
    for _ in range(60):
        damaged = whole.copy()
        damaged[rng.integers(0, len(whole), 4)] = rng.integers(0, 256, 4)
        path.write_bytes(damaged.tobytes())
        try:
            sim.record(path, every=0.1).stop()
        except sand.SandError as error:
            assert str(path) in str(error)


def test_a_full_disk(tmp_path: Path) -> None:
    """One sentence; the simulation goes on, and what was written can be read."""
    path = tmp_path / "run.gsd"
    sim = sand.Simulation(sand.Scene(**DISCS), threads=1)
    sim.record(path, every=1e-3)
    room = os.path.getsize(path) + 20_000
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        with disk_of(room), pytest.raises(sand.SandError, match=r"run\.gsd: .*ends with what could still be written"):
            for _ in range(40):
                sim.advance(0.005)
    finally:
        signal.signal(signal.SIGXFSZ, handler)
    assert not sim.recorders
    sim.advance(0.005)
    assert 1 <= len(read(path)) < 200


def test_what_effects_have_grains_carry_may_come_and_go(tmp_path: Path) -> None:
    """gsd takes what a frame does not log from the first frame, and breaks where that has not got it either."""
    frames = [{STEP: np.array([k], np.uint64), "particles/N": np.array([2 + k], np.uint32)} for k in range(3)]
    frames[0]["log/particles/wetness"] = frames[1]["log/particles/wetness"] = frames[1]["log/particles/heat"] = np.ones(2, np.float32)
    trajectory = Trajectory.begin(tmp_path / "run.gsd", frames[0], b"scene")
    for frame in frames[1:]:
        trajectory.write(frame)
    trajectory.close()
    found = [frame.log for frame in read(tmp_path / "run.gsd")]
    assert [list(log) for log in found] == 3 * [["particles/wetness"]]
    assert np.isnan(found[2]["particles/wetness"]).tolist() == [True] * 4


def test_without_the_library(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A sentence that names the extra, before anything is simulated."""
    monkeypatch.setitem(sys.modules, "gsd.fl", None)
    monkeypatch.setitem(sys.modules, "gsd", None)
    done = CliRunner().invoke(app, ["run", "settle", "--out", str(tmp_path / "run.gsd")])
    assert done.exit_code == 2 and "pip install 'taichi-sand[data]'" in done.output


SCENE = """
size = [0.25, 0.3]
duration = 0.1
edges = { left = "periodic", right = "periodic" }
[[grains]]
radius = 0.01
count = 12
spin = 1.0
[effects.friction]
[record]
every = 0.025
trajectory = "own.gsd"
"""


def test_scenes_say_what_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """[record] is what `run` writes; --out and --every go before it."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    mine = ("--out", "mine.gsd", "--every", "0.05")
    for arguments in (("scene.toml",), ("scene.toml", *mine, "--save", "end.npz"), ("--resume", "end.npz", "--seconds", "0.1", *mine)):
        assert CliRunner().invoke(app, ["run", *arguments]).exit_code == 0
    assert len(read(Path("own.gsd"))) == 5
    assert [round(float(frame.log["time"][0]), 2) for frame in read(Path("mine.gsd"))] == [0.0, 0.05, 0.1, 0.15, 0.2]


@pytest.mark.parametrize("name", ["../run.gsd", "/run.gsd", "a\\b.gsd", ".gsd", "run.txt", ""])
def test_scenes_write_to_no_other_folder(name: str) -> None:
    """Nor to what is not called a trajectory: a scene may come from anybody."""
    with pytest.raises(sand.SandError, match=r"record\.trajectory = .* must be the name of a file that ends in \.gsd, without a folder"):
        sand.Scene(size=(1, 1), record={"trajectory": name})


KILLED = """
import sys, taichi_sand as sand
sim = sand.Simulation(sand.Scene(**eval(sys.argv[1])), threads=1)
sim.record(sys.argv[2], every=1e-3)
for _ in range(10**6):
    sim.advance(0.002)
    print(sim.steps, flush=True)
"""


@pytest.fixture
def killed(tmp_path: Path) -> Iterator[tuple[Path, int]]:
    """A trajectory whose process was killed while it was writing, and the step up to which `advance` had come back."""
    path = tmp_path / "run.gsd"
    process = subprocess.Popen([sys.executable, "-c", KILLED, repr(DISCS), path], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(100)]
    finally:
        process.kill()
        process.wait()
    yield path, int(lines[-1])


def test_a_killed_run_leaves_what_it_had_written(killed: tuple[Path, int]) -> None:
    frames = read(killed[0])
    steps = [int(frame.configuration.step) for frame in frames]
    assert steps == list(range(len(steps))) and steps[-1] >= killed[1] > 20  # frames are asked for more often than there are steps
