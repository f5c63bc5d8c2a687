"""[[events]]: stages of an experiment, when they come and what they change."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import D, G, R, digest
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app
from taichi_sand.errors import SandError
from taichi_sand.play.session import Session
from taichi_sand.study.check.check import check
from taichi_sand.view.picture import facts

KINDS = ("md", "rigid")
BOX: dict[str, Any] = {
    "size": [0.4, 0.4],
    "duration": 2.0,
    "grains": [{"radius": [0.008, 0.01], "count": 24, "region": [0.0, 0.0, 0.15, 0.3]}],
    "walls": [
        {"points": [[0.15, 0.0], [0.15, 0.4]], "name": "gate"},
        {"points": [[0.3, 0.2], [0.4, 0.2]], "name": "lid"},
    ],
    "sources": [{"name": "tap", "radius": 0.009, "rate": 40.0, "region": [0.2, 0.25, 0.3, 0.39]}],
    "effects": {"friction": {"mu": 0.4}},
}
"""Grains that fall beside a gate; a lid that stands still; a source that waits."""
STAGES: list[dict[str, Any]] = [
    {"name": "settled", "at": "rest"},
    {"name": "opened", "at": {"after": "settled", "seconds": 0.1}, "remove_walls": ["gate"], "start_sources": ["tap"]},
    {"at": {"after": "opened", "seconds": 0.1}, "set": {"walls.lid.velocity": [0.0, -0.5], "effects.friction.mu": 0.3}},
    {
        "name": "held",
        "at": {"after": "opened", "seconds": 0.2},
        "set": {"walls": {"lid": {"velocity": [0.0, 0.0]}}},
        "end_sources": ["tap"],
    },
    {"name": "calm", "at": "rest", "stop": True},
]


def scene(*events: dict[str, Any], **keys: Any) -> sand.Scene:
    """The box with these events."""
    return sand.Scene(**BOX | keys, events=list(events))


def staged(kind: str) -> sand.Scene:
    """With all the stages, in this solver."""
    return scene(*STAGES, solver={"kind": kind})


@pytest.mark.parametrize("kind", KINDS)
def test_stages_come_in_their_order_and_change_what_they_say(kind: str) -> None:
    """Rest is what `advance_until` calls so; the others come at their steps: a lid runs for 0.1 s, a source makes 40 grains a second."""
    plain = sand.Simulation(scene(solver={"kind": kind}, sources=[{**BOX["sources"][0], "until": 0.0}]), threads=1)
    assert plain.advance_until("rest", at_most=3.0)
    rest = plain.time
    sim = sand.Simulation(staged(kind), threads=1)
    sim.advance(5.0)
    came, step = sim.events, 2 * sim.step
    assert list(came) == ["settled", "opened", "events[2]", "held", "calm"]
    assert came["settled"] == pytest.approx(rest, abs=0.01)
    for name, before, seconds in (("opened", "settled", 0.1), ("events[2]", "opened", 0.1), ("held", "opened", 0.2)):
        assert came[name] == pytest.approx(came[before] + seconds, abs=step)
    assert sim.stopped and sim.time == came["calm"] < 5.0
    assert sim.wall_points[0][:, 1] == pytest.approx(0.2 - 0.5 * 0.1, abs=0.5 * step)  # the gate is gone: this is the lid
    assert abs(sim.made - 24 - 40 * 0.2) <= 1 and sim.count == sim.made
    assert sim.get("effects.friction.mu") == 0.3
    assert sim.positions[:, 0].max() > 0.3  # they have run out
    report = sim.report()
    assert report["events"] == came and report["grains_waiting"] == 0 and not report["flags"]
    assert "calm at" in " ".join(facts(sim))
    sim.advance(1.0)
    sim.advance_steps(10)
    assert sim.time == came["calm"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_bits_in_any_strides_and_resumed_in_any_stage(kind: str, tmp_path: Path) -> None:
    """Saved while grains fall, while they are waited for, between the stages and during them, on 2 threads."""
    whole = sand.Simulation(staged(kind), threads=1)
    whole.advance(1.5)
    came, whole_digest = whole.events, digest(whole)
    whole.close()
    sim = sand.Simulation(staged(kind), threads=2)
    before: set[int] = set()
    for number in range(75):
        if number % 5 == 2:
            sim.save(tmp_path / "half.npz")
            sim.close()
            sim = sand.Simulation.resume(tmp_path / "half.npz", threads=2)
            before.add(len(sim.events))
        sim.advance(0.02)
    found, shown = sim.events, digest(sim)
    sim.close()
    assert {0, 1, 2, 4} <= before and found == came
    assert shown == whole_digest


def test_undone_events_come_again(tmp_path: Path) -> None:
    session = Session(staged("rigid"), threads=1)
    session.advance(round(0.3 / session.sim.step))
    session.do(["mark"])
    start, marked = dict(session.sim.events), session.digest()
    session.advance(round(1.5 / session.sim.step))
    assert "opened" in session.sim.events and "at" in session.message
    end, shown = dict(session.sim.events), session.digest()
    session.do(["undo"])
    assert session.sim.events == start and session.digest() == marked
    session.advance(round(1.5 / session.sim.step))
    assert session.sim.events == end and session.digest() == shown
    session.do(["solver", "md"])
    assert session.message == "" and session.sim.events == end and session.sim.scene.solver.kind == "md"
    session.do(["reset"])
    assert session.sim.events == {} and len(session.sim.scene.walls) == 2


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_shelf_held_falls_when_it_goes(kind: str) -> None:
    """Galileo: by g t²/2 since the event; and gravity that an event turns off leaves it as fast as it was."""
    events = [{"at": 0.1, "remove_walls": ["shelf"]}, {"at": 0.2, "set": {"gravity": [0.0, 0.0]}}]
    shelf = {"points": [[0.0, 0.6], [0.1, 0.6]], "name": "shelf"}
    grains = [{"positions": [[0.05, 0.6 + R]], "radius": R}]
    sim = sand.Simulation(sand.Scene(size=[0.1, 1.0], grains=grains, walls=[shelf], events=events, solver={"kind": kind}), threads=1)
    sim.advance(0.1)
    assert sim.positions[0, 1] == pytest.approx(0.6 + R, abs=0.02 * D)
    sim.advance(0.2)
    held, freed = sim.events.values()
    seconds = freed - held
    fallen = G * seconds**2 / 2 + G * seconds * (sim.time - freed)
    assert seconds == pytest.approx(0.1, abs=sim.step)
    assert 0.6 + R - sim.positions[0, 1] == pytest.approx(fallen, abs=0.02 * D + G * seconds * sim.step / 2)
    assert sim.velocities[0, 1] == pytest.approx(-G * seconds, rel=1e-3)


def test_walls_go_on_from_where_they_are() -> None:
    """Whatever an event makes of a motion, no wall jumps; what it does not change goes on: translated, turned, shaken."""
    walls = [
        {"points": [[0.1, 0.1], [0.2, 0.1]], "name": "arm", "spin": 1.0, "pivot": [0.1, 0.1]},
        {"points": [[0.3, 0.1], [0.4, 0.1]], "name": "table", "shake": {"amplitude": [0.0, 0.01], "frequency": 2.0}},
        {"points": [[0.5, 0.1], [0.6, 0.1], [0.6, 0.2]], "closed": True, "name": "block", "velocity": [0.1, 0.1]},
        {"points": [[0.7, 0.1], [0.8, 0.1]], "velocity": [0.0, 0.2]},
    ]
    events = [
        {"at": 0.5, "set": {"walls.arm.spin": -2.0, "walls.block.spin": 3.0, "walls.table.shake.frequency": 1.0}},
        {"at": 0.8, "set": {"walls.arm.spin": 0.0, "walls.block.velocity": [0.0, 0.0], "walls.block.spin": 0.0}},
    ]
    keys = {"gravity": [0.0, 0.0], "solver": {"step": 1e-3}}
    sim = sand.Simulation(sand.Scene(size=[1.0, 1.0], walls=walls, events=events, **keys), threads=1)
    at, last = {}, sim.wall_points
    for number in range(1, 101):
        sim.advance_to(0.01 * number)
        now = sim.wall_points
        for one, other in zip(now, last, strict=True):
            assert np.hypot(*(one - other).T).max() < 0.01 * 0.75  # [m] at most 0.75 m/s
        at[number], last = now, now
    tip = at[100][0][1] - at[100][0][0]
    assert np.arctan2(tip[1], tip[0]) == pytest.approx(0.5 * 1.0 - 0.3 * 2.0, abs=0.01)
    assert at[100][0][0] == pytest.approx([0.1, 0.1], abs=1e-6)
    assert at[100][2].mean(0) - at[80][2].mean(0) == pytest.approx([0.0, 0.0], abs=1e-6)
    assert at[80][2][:3].mean(0) == pytest.approx(np.array([0.5, 0.1, 0.6, 0.1, 0.6, 0.2]).reshape(3, 2).mean(0) + 0.08, abs=1e-3)
    assert at[100][3][:, 1] == pytest.approx(0.1 + 0.2, abs=1e-3)
    assert at[100][1][0, 1] - at[75][1][0, 1] == pytest.approx(-0.01, abs=1e-4)  # 1 Hz from 0.5 s on: from its crest to the middle


def test_a_floor_that_sets_out_or_stops_keeps_its_load() -> None:
    """What a wall bears is remembered where its motion or surface changes: forces of that step, and impulses of the next."""
    events = [
        {"name": "sinks", "at": 0.8, "set": {"walls.floor.velocity": [0.0, -0.002]}},
        {"name": "rubs", "at": 0.9, "set": {"walls.floor.friction": 0.2}},
        {"name": "stops", "at": 1.0, "set": {"walls.floor.velocity": [0.0, 0.0]}},
    ]
    walls = [{"points": [[0.0, 0.02], [0.1, 0.02]], "name": "floor", "friction": 0.5}]
    grains = [{"radius": 0.005, "count": 30, "region": [0.0, 0.02, 0.1, 0.1]}]
    sim = sand.Simulation(sand.Scene(size=[0.1, 0.2], grains=grains, walls=walls, events=events, effects={"friction": {}}), threads=1)
    for event in events:
        sim.advance_to(event["at"] - 1.5 * sim.step)
        before = sim.wall_forces()["force"][0, 1]
        assert sim.advance_until(event["name"], at_most=0.1)
        assert before < -10.0 and sim.wall_forces()["force"][0, 1] == pytest.approx(before, rel=0.05)
        sim.advance_steps(3)
        assert sim.wall_forces()["force"][0, 1] == pytest.approx(before, rel=0.1)
    assert sim.wall_forces()["name"][0] == "floor"


NAMED = {"walls": [{"points": [[0.5, 0.0], [0.5, 1.0]], "name": "gate"}], "effects": {"friction": {}}}
WRONG: dict[str, tuple[list[dict[str, Any]], str]] = {
    "no time": ([{"name": "a"}], "events[0].at is missing"),
    "a word": ([{"at": "soon"}], 'events[0].at = "soon" must be a time in seconds, "rest", or { after'),
    "the past": ([{"at": -1.0}], "events[0].at = -1 must be a time"),
    "after nothing": ([{"at": {"after": "a"}}], 'after = "a" must be the name of an event that stands before it (there are: none)'),
    "after a later one": ([{"at": {"after": "late"}}, {"at": 1.0, "name": "late"}], "that stands before it"),
    "no order": ([{"at": 2.0}, {"at": 1.0}], "events[1].at = 1 must be at least 2 s"),
    "a name twice": ([{"at": 1.0, "name": "a"}, {"at": 2.0, "name": "a"}], 'events[1].name = "a" is the name of two events'),
    "no wall": ([{"at": 1.0, "remove_walls": ["gat"]}], "did you mean `gate`? (those with a name: gate)"),
    "a wall that is gone": (
        [{"at": 1.0, "name": "x", "remove_walls": ["gate"]}, {"at": 2.0, "set": {"walls.gate.spin": 1.0}}],
        'events[1].set names the wall "gate", which x has removed',
    ),
    "gone and changed": ([{"at": 1.0, "remove_walls": ["gate"], "set": {"walls.gate.spin": 1.0}}], "it is one or the other"),
    "no key of a wall": ([{"at": 1.0, "set": {"walls.gate.spni": 1.0}}], "did you mean `spin`?"),
    "a place": ([{"at": 1.0, "set": {"walls.gate.points": []}}], "cannot be set"),
    "no vector": ([{"at": 1.0, "set": {"walls.gate.velocity": 3}}], "of walls.gate, velocity = 3 must be: [vx, vy]"),
    "half a motion": ([{"at": 1.0, "set": {"walls.gate.force": 3.0}}], "force needs a `velocity`"),
    "no live key": ([{"at": 1.0, "set": {"size": [1, 1]}}], 'events[0].set: "size" = [1, 1] cannot be set'),
    "an effect that is off": ([{"at": 1.0, "set": {"effects.rolling.mu": 0.1}}], "without a table [effects.rolling]"),
    "no source": ([{"at": 1.0, "start_sources": ["tap"]}], 'names "tap", which no [[sources]] table has'),
    "an unknown key": ([{"at": 1.0, "stpo": True}], "events[0].stpo is not a known key; did you mean `stop`?"),
    "a reserved name": ([{"at": 1.0, "name": "end"}], 'events[0].name = "end"'),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_events(case: str) -> None:
    events, said = WRONG[case]
    with pytest.raises(SandError) as error:
        sand.Scene(size=[1.0, 1.0], events=events, **NAMED)
    assert said in str(error.value) and "\n" not in str(error.value)


SOURCES = [{"name": "tap", "radius": 0.01, "rate": 1.0, "region": [0.0, 0.0, 0.4, 0.4]}]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ([{"at": 1.0, "start_sources": ["tap"]}, {"at": 2.0, "start_sources": ["tap"]}], "which runs already"),
        ([{"at": 1.0, "end_sources": ["tap"]}, {"at": 2.0, "end_sources": ["tap"]}], "which makes nothing then anyway"),
        ([{"at": 1.0, "start_sources": ["tap"], "end_sources": ["tap"]}], "both name"),
    ],
)
def test_wrong_sources(keys: list[dict[str, Any]], said: str) -> None:
    with pytest.raises(SandError, match=said):
        sand.Scene(size=[1.0, 1.0], events=keys, sources=SOURCES)
    with pytest.raises(SandError, match="which has an `until`"):
        sand.Scene(size=[1.0, 1.0], events=[{"at": 1.0, "start_sources": ["tap"]}], sources=[{**SOURCES[0], "until": 3.0}])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"effects.friction.model": "viscous"}, 'events[0].set: "effects.friction.model" = "viscous": "effects.friction.model" cannot be'),
        ({"effects.friction.mu": -1.0}, 'events[0].set: "effects.friction.mu" = -1: effects.friction.mu'),
        ({"solver.tolerance": "small"}, 'events[0].set: "solver.tolerance" = "small": solver.tolerance'),
        ({"gravity": 9.81}, 'events[0].set: "gravity" = 9.81: gravity'),
        ({"walls.gate.velocity": [1000.0, 0.0]}, "walls.gate: moves at up to 1e+03 m/s"),
    ],
)
def test_wrong_values_are_told_before_anything_is_simulated(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SandError) as error:
        sand.Simulation(sand.Scene(size=[1.0, 1.0], events=[{"at": 5.0, "set": changes}], solver={"step": 1e-3}, **NAMED), threads=1)
    assert said in str(error.value)


def test_checks_at_events() -> None:
    """At the step of the event; one that does not come is no pass."""
    events = [{"name": "early", "at": 0.05}, {"name": "late", "at": 5.0}]
    checks = [{"observable": "momentum_Ns_y", "low": -1e9, "high": 1e9, "at": at} for at in ("late", "end", "early", 0.02)]
    grains = [{"positions": [[0.5, 0.5]], "radius": 0.1}]
    made = sand.Scene(size=[1.0, 1.0], duration=0.1, solver={"step": 1e-3}, events=events, checks=checks, grains=grains)
    rows = check("fall", made, threads=1)
    assert [row.at for row in rows] == pytest.approx([0.02, 0.05, 0.1, 0.1], abs=2e-3)
    assert [row.passed for row in rows] == [True, True, True, False]
    weight = 2650.0 * np.pi * 0.1**2 * G
    assert [row.value for row in rows[:3]] == pytest.approx([-weight * 0.02, -weight * 0.05, -weight * 0.1], rel=0.05)


def command(*words: str, status: int = 0) -> Any:
    """The command, with the exit status that it must have."""
    done = CliRunner().invoke(app, [*words, "--threads", "1"])
    assert done.exit_code == status, done.output
    return done


def as_toml(made: sand.Scene, path: Path) -> str:
    """A scene as a file."""
    import tomli_w

    path.write_text(tomli_w.dumps(json.loads(made.to_json())))
    return str(path)


def test_another_scene_takes_over_with_its_stages(tmp_path: Path) -> None:
    """A bed that has settled once is opened in a second run, whose times count from there; the same scene goes on where it was."""
    keys = {"solver": {"kind": "rigid"}, "sources": []}
    fill = as_toml(scene({"at": "rest", "name": "settled", "stop": True}, **keys), tmp_path / "fill.toml")
    bed = str(tmp_path / "bed.npz")
    command("run", fill, "--save", bed)
    again = json.loads(command("run", fill, "--resume", bed, "--json").stdout)
    then = again["time_s"]
    assert again["events"] == {"settled": then}
    opened = as_toml(scene({"at": 0.1, "name": "opened", "remove_walls": ["gate"]}, duration=0.5, **keys), tmp_path / "open.toml")
    report = json.loads(command("run", opened, "--resume", bed, "--json").stdout)
    assert report["events"] == {"opened": pytest.approx(then + 0.1, abs=0.005)}
    assert report["time_s"] == pytest.approx(then + 0.5, abs=0.005)
    assert report["kinetic_energy_J"] > 100 * again["kinetic_energy_J"]
    cut = [{**BOX["walls"][0], "points": [[0.075, 0.0], [0.075, 0.4]]}]
    said = command("run", as_toml(scene(walls=cut, **keys), tmp_path / "cut.toml"), "--resume", bed, status=2).stderr
    assert "bed.npz was saved from another scene" in said and "deep in grain" in said and said.count("\n") == 1
    other = as_toml(scene(grains=[{**BOX["grains"][0], "count": 3}], **keys), tmp_path / "other.toml")
    assert "grains: cannot change" in command("run", other, "--resume", bed, status=2).stderr
