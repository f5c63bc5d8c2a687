"""Water as a part of the program: bits, checkpoints, undo, what is told of it, what it looks like."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import digest, fresh_taichi

import taichi_sand as sand
from taichi_sand.measure import structure
from taichi_sand.play.session import Session
from taichi_sand.run.watering import Watering
from taichi_sand.view import picture
from taichi_sand.world import edit

SCENE = {
    "size": [0.3, 0.2],
    "grains": [{"radius": [0.0028, 0.0032], "count": 200, "region": [0.1, 0.0, 0.3, 0.2]}],
    "water": [{"region": [0.0, 0.0, 0.15, 0.15]}],
    "effects": {"water": {}, "friction": {}},
    "seed": 4,
}


def state(sim: sand.Simulation) -> tuple[str, bytes, bytes]:
    """All there is to see of grains and water, bit by bit."""
    f = sim.pausing["water"].fluid
    return digest(sim), f.place.to_numpy().tobytes(), f.velocity.to_numpy().tobytes()


@pytest.mark.parametrize("kind", ["rigid", "md"])
def test_same_bits(kind: str, tmp_path: Path) -> None:
    """Interrupted, in strides, and resumed: the same bits as in one go, water included."""
    scene = sand.Scene(**SCENE, solver={"kind": kind})
    ends = []
    for stride in (0.2, 0.013):
        fresh_taichi()
        sim = sand.Simulation(scene, threads=1)
        while sim.time < 0.199:
            sim.advance(min(stride, 0.2 - sim.time))
            if 0.1 < sim.time < 0.114:
                sim.save(tmp_path / "water.npz")
        steps = sim.steps
        ends.append(state(sim))
        sim.close()
    sim = sand.Simulation.resume(tmp_path / "water.npz", threads=1)
    sim.advance_steps(steps - sim.steps)
    ends.append(state(sim))
    assert ends[0] == ends[1] == ends[2]


def test_threads() -> None:
    """The same bits on two threads."""
    ends = []
    for threads in (1, 2):
        fresh_taichi()
        sim = sand.Simulation(sand.Scene(**SCENE), threads=threads)
        sim.advance(0.1)
        ends.append(state(sim))
        sim.close()
    assert ends[0] == ends[1]


def test_wells_and_drains() -> None:
    """What wells up is there, in the air and under water, to a marker; what drains off is gone."""
    fresh_taichi()
    wells = [
        {"region": [0.02, 0.16, 0.06, 0.18], "rate": 0.02, "until": 0.3},
        {"region": [0.2, 0.0, 0.28, 0.02], "rate": 0.03, "since": 0.1},
        {"region": [0.1, 0.0, 0.14, 0.04], "rate": -0.01},
    ]
    sim = sand.Simulation(sand.Scene(**{**SCENE, "water": [{"region": [0.0, 0.0, 0.3, 0.08]}, *wells]}), threads=1)
    start = sim.report()["water_m2"]
    sim.advance(0.5)
    now = sim.pausing["water"].fluid.now[None]
    marker = now.marker * now.width * now.height
    came = 0.02 * 0.3 + 0.03 * 0.4 - 0.01 * 0.5
    assert sim.report()["water_m2"] - start == pytest.approx(came, abs=3 * marker + 0.06 * now.step)
    assert not sim.flags()
    sim.advance(1.5)  # by then there is more than the box holds
    assert sim.report()["water_m2"] < 1.02 * 0.3 * 0.2
    assert "water that was to well up found no room" in sim.flags()[0]


def test_what_is_under_water_is_soaked() -> None:
    """With `moisture`: the grain in the water is full of it, and loses its bridges; the one on a ledge above stays as damp as it was. Under
    water, too, most are laid down to sleep within two seconds."""
    fresh_taichi()
    grains = [{"positions": [[0.05 + 0.0061 * k, 0.003] for k in range(30)] + [[0.15, 0.15]], "radius": 0.003}]
    more = {"water": {}, "moisture": {"wetness": 0.1}, "sleeping": {}}
    walls = [{"points": [[0.12, 0.147], [0.18, 0.147]]}]
    tables = {"grains": grains, "walls": walls, "effects": more, "water": [{"region": [0.0, 0.0, 0.3, 0.08]}]}
    sim = sand.Simulation(sand.Scene(**{**SCENE, **tables}), threads=1)
    sim.advance(2.5)
    place, wetness = edit.places(sim.world)[0], np.zeros(sim.world.capacity, np.float32)
    structure.moisture(sim.world, wetness)
    wetness = wetness[: sim.count]
    under = place[:, 1] < 0.08
    assert under.sum() == 30
    assert wetness[under].min() == pytest.approx(1.0, abs=1e-6) and wetness[~under] == pytest.approx(0.1, abs=1e-6)
    assert sim.report()["grains_asleep"] >= 25


def test_no_water_is_lost() -> None:
    """With `moisture`: what grains take up is gone from the water, what they let go of is there again, and what drains leaves them wet."""
    fresh_taichi()
    grains = [{"radius": [0.0028, 0.0032], "fill": "hexagonal", "region": [0.1, 0.0, 0.3, 0.06]}]
    more = {"water": {}, "moisture": {"wetness": 0.0}, "friction": {}}
    tables = {"grains": grains, "effects": more, "water": [{"region": [0.0, 0.0, 0.08, 0.18]}]}
    sim = sand.Simulation(sand.Scene(**{**SCENE, **tables}), threads=1)
    start = sim.report()
    for _ in range(4):
        sim.advance(0.3)
        now = sim.report()
        assert now["water_m2"] + now["water_held_m2"] == pytest.approx(start["water_m2"], rel=1e-6)
    assert start["water_held_m2"] == 0 and now["water_held_m2"] > 0.02 * start["water_m2"]
    held = now["water_held_m2"]
    sim.wet(0.2, 0.02, 0.03, 0.5)
    total = sim.report()["water_m2"] + sim.report()["water_held_m2"]
    assert sim.report()["water_held_m2"] > 1.1 * held
    sim.advance(0.5)
    now = sim.report()
    assert now["water_held_m2"] < 1.1 * held  # under water they have let go of it
    assert now["water_m2"] + now["water_held_m2"] == pytest.approx(total, rel=1e-6)


def test_a_bed_under_water_is_lighter() -> None:
    """The dial knows that it presses with less than two thirds of its weight, and takes longer steps."""
    tables = {"grains": [{"radius": [0.0028, 0.0032], "fill": "hexagonal", "region": [0.0, 0.0, 0.3, 0.1]}]}
    steps = []
    for depth in (0.01, 0.15):
        fresh_taichi()
        sim = sand.Simulation(sand.Scene(**{**SCENE, **tables, "water": [{"region": [0.0, 0.0, 0.3, depth]}]}), threads=1)
        sim.advance(0.6)
        steps.append(sim.step)
        lift = sim.bed.lift
        sim.close()
    assert lift == pytest.approx(0.3)  # 1000 / 2650 = 0.38, rounded down
    assert steps[1] > 1.1 * steps[0]


def test_water_by_hand() -> None:
    """The tools fill the brush with water, take it out again, and sweep it along; without the effect they say what is missing."""
    fresh_taichi()
    session = Session(sand.Scene(**SCENE), threads=1)
    start = session.sim.report()["water_m2"]
    session.brush.size = 0.03
    more = []
    for tool in ("water", "drain"):
        session.do(["choose", tool])
        session.do(["stroke", "press", 0.22, 0.16, 0.0, 0.0])
        session.do(["stroke", "release", 0.22, 0.16, 0.0, 0.0])
        more.append(session.sim.report()["water_m2"] - start)
    assert more[0] == pytest.approx(math.pi * 0.03**2, rel=0.4)  # whole cells
    assert abs(more[1]) < 0.4 * more[0]
    session.do(["choose", "wave"])
    session.do(["stroke", "press", 0.05, 0.08, 0.0, 0.0])
    session.do(["stroke", "drag", 0.06, 0.08, 0.5, 0.0])
    f = session.sim.pausing["water"].fluid
    assert f.velocity.to_numpy()[: f.now[None].markers, 0].max() == pytest.approx(0.5)
    session.advance(3)
    assert not session.message
    session.drop()
    dry: Any = Watering()
    dry.pausing, dry.runner = {}, None
    with pytest.raises(sand.SandError, match=r"no table \[effects\.water\]"):
        dry.pour_water(0.1, 0.1, 0.1)


WRONG = {
    "water[0].since needs a `rate`": {"water": [{"region": [0, 0, 0.1, 0.1], "since": 1.0}]},
    "water[0].until = 1 must be later than since = 2": {"water": [{"region": [0, 0, 0.1, 0.1], "rate": 1.0, "since": 2.0, "until": 1.0}]},
    "water[0] needs a table [effects.water]": {"effects": {}},
    "water[0].region = [0, 0, 0.4, 0.1] must lie inside the box": {"water": [{"region": [0, 0, 0.4, 0.1]}]},
    "effects.water.cell = 0: must lie in 0.1 … 100 d": {"effects": {"water": {"cell": 0.0}}},
    "effects.water: with grains, cell = 1 d must be at least 1.8 d": {"effects": {"water": {"cell": 1.0}}},
    'does not fit the integrator rk4, only "symplectic_euler"': {"solver": {"kind": "md", "integrator": "rk4"}},
    "at most 1000000 are possible": {"effects": {"water": {"cell": 2.0}}, "grains": [{"positions": [[0.1, 0.1]], "radius": 1e-5}]},
}


@pytest.mark.parametrize("sentence", WRONG)
def test_wrong_water_is_told(sentence: str) -> None:
    with pytest.raises(sand.SandError) as caught:
        sand.Simulation(sand.Scene(**{**SCENE, **WRONG[sentence]}), threads=1)
    assert sentence in str(caught.value)


def test_it_is_seen() -> None:
    """The picture is blue where water is, dark where there is none, and grains under it can be seen."""
    fresh_taichi()
    sim = sand.Simulation(sand.Scene(**SCENE, view={"width": 300, "caption": False}), threads=1)
    image = sim.image().astype(int)
    red, _, blue = (image[..., k] for k in range(3))
    assert (blue - red)[80:190, 10:90].min() > 40
    assert np.abs(blue - red)[10:40, 10:90].max() < 10
    sim.advance(0.1)
    painter = picture.painter_of(sim)
    for color, top in (("water pressure", 1000 * 9.81 * 0.15), ("water speed", 1.0)):
        painter.color = color
        painter.paint(sim.time)
        assert 0.2 * top < painter.legend.top < 2.0 * top
    painter.color = "saturation"
    painter.paint(sim.time)
    assert painter.legend.top == 1.0
