"""Live numbers: set and read by their keys, checked like a scene, kept, and always those that the kernels read."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from helpers import G, R, fresh_taichi

import taichi_sand as sand
from taichi_sand.play import snapshot
from taichi_sand.run import live
from taichi_sand.run.host import Host

EFFECTS = {"friction": {"mu": 0.4}, "drag": {}}
KEYS = {
    "gravity": [0.5, -5.0],
    "gravity.0": 0.25,
    "solver.tolerance": 0.03,
    "solver.restitution": 0.4,
    "solver.step": 1e-5,
    "effects.friction.mu": 0.7,
    "effects.drag.wind_x": 2.0,
}
SOURCE = {"radius": R, "rate": 300.0, "region": [0.0, 0.3, 0.12, 0.4], "velocity": [0.0, -2.0]}


def scene_of(kind: str, **keys: object) -> sand.Scene:
    grains = [{"radius": [0.8 * R, R], "count": 30, "fill": "lattice", "pitch": 1.2}]
    table = {"size": [0.12, 0.4], "gravity": (0.0, -G), "solver": {"kind": kind}, "grains": grains, "sources": [SOURCE], "duration": 1.0}
    return sand.Scene(**{**table, "effects": EFFECTS, **keys})


@pytest.fixture(scope="module", params=["md", "rigid"])
def made(request: pytest.FixtureRequest) -> tuple[sand.Simulation, snapshot.Snapshot]:
    """A simulation, and its start."""
    fresh_taichi()
    sim = sand.Simulation(scene_of(request.param), threads=1)
    return sim, snapshot.take(sim)


@pytest.fixture
def sim(made: tuple) -> sand.Simulation:
    """At its start."""
    snapshot.restore(*made)
    return made[0]


def kernels_read(sim: sand.Simulation) -> dict[str, float]:
    """The numbers in the fields of solver and effects."""
    return {name: getattr(sim.solver.constants[None], name) for name in sim.solver.constants.keys}


def test_every_key_and_none_other(sim: sand.Simulation, tmp_path: Path) -> None:
    """Each can be read and set, arrives in the kernels, in the report where it stands there, in checkpoints and in undo."""
    start = snapshot.take(sim)
    before = kernels_read(sim)
    for key, value in KEYS.items():
        sim.set(key, value)
        assert sim.get(key) == (tuple(value) if isinstance(value, list) else value)
        if key.startswith("effects."):
            assert kernels_read(sim)[key.removeprefix("effects.").replace(".", "_")] == pytest.approx(value, rel=1e-6)
        sim.advance_steps(20)
    assert sim.step == 1e-5 and kernels_read(sim)["step"] == pytest.approx(1e-5) and sim.world.pace[None].step == pytest.approx(1e-5)
    assert sim.world.box[None].gravity.to_list() == pytest.approx([0.25, -5.0])
    assert sim.report()["tolerance"] == 0.03 and sim.report()["step_s"] == 1e-5
    set_all = (kernels_read(sim), Host.of(sim).to_json())
    sim.save(tmp_path / "set.npz")
    snapshot.restore(sim, start)
    assert kernels_read(sim) == before and sim.get("effects.friction.mu") == 0.4
    again = sand.Simulation.resume(tmp_path / "set.npz", threads=1)
    assert (kernels_read(again), Host.of(again).to_json()) == set_all
    assert all(key.startswith("solver.") for key in live.keys(again.scene) if again.get(key) is None)
    for wrong in (
        "mu",
        "friction_mu",
        "effects.friction",
        "effects.friction.model",
        "solver.kind",
        "solver.precision",
        "size",
        3,
        ["gravity"],
    ):
        for refused in (lambda wrong=wrong: again.get(wrong), lambda wrong=wrong: again.set(wrong, 1.0)):
            with pytest.raises(sand.SandError, match=r"what can: gravity, .*solver\.tolerance, .*effects\.friction\.mu"):
                refused()


def test_checked_like_a_scene(sim: sand.Simulation) -> None:
    """What a scene may not have is refused, and changes nothing; NumPy's numbers are numbers."""
    before = (kernels_read(sim), Host.of(sim).to_json())
    wrong = {"solver.tolerance": 0.5, "effects.friction.mu": -0.1, "solver.restitution": 1.1, "gravity": [1.0], "gravity.1": "down"}
    wrong |= {"effects.drag.density": "5", "solver.step": 0.05, "effects.drag.wind_x": math.nan}
    for key, value in wrong.items():
        with pytest.raises(sand.SandError, match=key.removesuffix(".1").replace(".", r"\.")):
            sim.set(key, value)
    for key, value in {"effects.friction.mu": math.inf, "solver.tolerance": 0.5, "solver.restitution": -1.0}.items():
        with pytest.raises(sand.SandError):
            sim.set(key, value, unphysical=True)
    assert (kernels_read(sim), Host.of(sim).to_json()) == before
    sim.set("effects.friction.mu", np.float32(0.5))
    sim.set("gravity", np.array([0.0, -1.0]))
    assert sim.get("effects.friction.mu") == 0.5 and sim.get("gravity") == (0.0, -1.0)
    sim.set("solver.step", 1e-5)
    sim.set("solver.step", None)
    assert sim.get("solver.step") is None and sim.step != 1e-5


def test_retune_changes_what_it_says_and_no_more(sim: sand.Simulation) -> None:
    """Another mu in the scene is another mu in the kernels; another structure is refused."""
    friction = {**sim.scene.effects, "friction": {"mu": 0.9}}
    sim.retune(sim.scene.model_copy(update={"effects": friction}))
    assert kernels_read(sim)["friction_mu"] == pytest.approx(0.9) and sim.effects["friction"]["mu"] == 0.9
    before, kind = Host.of(sim).to_json(), sim.scene.solver.kind
    others = [
        scene_of("md" if kind == "rigid" else "rigid"),
        scene_of(kind, effects={"friction": {}}),
        scene_of(kind, effects={**EFFECTS, "sleeping": {}}),
        scene_of(kind, size=[0.13, 0.4]),
        scene_of(kind, solver={"kind": kind, "precision": 64}),
        scene_of(kind, grains=[]),
    ]
    for other in others:
        with pytest.raises(sand.SandError, match="make a new Simulation"):
            sim.retune(other)
    assert Host.of(sim).to_json() == before


def test_beyond_the_physical_range(sim: sand.Simulation, tmp_path: Path) -> None:
    """Where asked for; kept over retunes and looks at a pile that grows, over checkpoints and undo, and forgotten when set again."""
    tall, kind = sim, sim.scene.solver.kind
    tall.set("effects.friction.mu", -0.1, unphysical=True)
    tall.set("solver.restitution", 1.02, unphysical=True)
    name = "damping" if kind == "md" else "restitution"
    wild, depth = kernels_read(tall)[name], tall.bed.depth
    assert wild < 0 if kind == "md" else wild == pytest.approx(1.02)
    while tall.bed.depth == depth and tall.time < 2.0:
        tall.advance(0.1)
    assert tall.bed.depth > depth
    moment = snapshot.take(tall)
    tall.retune(tall.scene.model_copy(update={"gravity": (0.0, -2 * G)}))

    def check(one: sand.Simulation) -> None:
        values = kernels_read(one)
        assert one.get("effects.friction.mu") == -0.1 and values["friction_mu"] == pytest.approx(-0.1)
        assert one.get("solver.restitution") == 1.02 and (values[name] < 0 if kind == "md" else values[name] == pytest.approx(1.02))

    check(tall)
    assert tall.scene.effects["friction"]["mu"] == 0.0 and tall.scene.solver.restitution == 1.0  # the nearest that a scene may have
    snapshot.restore(tall, snapshot.from_bytes(snapshot.to_bytes(moment)))
    check(tall)
    tall.save(tmp_path / "wild.npz")
    tall.set("effects.friction.mu", 0.3)
    tall.retune(tall.scene.model_copy(update={"solver": tall.scene.solver.model_copy(update={"restitution": 0.5})}))
    assert tall.over == {} and kernels_read(tall)["friction_mu"] == pytest.approx(0.3)
    check(sand.Simulation.resume(tmp_path / "wild.npz", threads=1))


def test_one_record_holds_all_that_changes(sim: sand.Simulation) -> None:
    """A simulation keeps nothing on the host besides it but what was made once, so that nothing can be forgotten by undo or checkpoints."""
    once = {key: value for key, value in vars(sim).items() if key not in {field.name for field in dataclasses.fields(Host)}}
    sim.set("effects.friction.mu", 0.1)
    sim.set("gravity", [0.0, -1.0])
    sim.advance(0.3)
    assert Host.of(sim).steps > 0
    changed = {key for key, value in vars(sim).items() if key in once and once[key] is not value} | (vars(sim).keys() - once.keys())
    assert changed - {field.name for field in dataclasses.fields(Host)} <= {"clock", "pace"}, changed
