"""The layout of large worlds: a sweep in strips of columns, the two sweeps of a rigid step as one pass."""

from typing import Any

import numpy as np
import pytest
from helpers import digest, fresh_taichi

import taichi_sand as sand
from taichi_sand.run import stepping
from taichi_sand.world import build
from taichi_sand.world.sweep import sweeps_join

LOOSE = {"radius": [0.008, 0.012], "density": 1000.0, "count": 400, "fill": "lattice", "pitch": 1.3, "jitter": 0.1}
SIDE = 0.6
SCENES: dict[str, dict[str, Any]] = {
    "plain": {},
    "boulder": {"grains": [LOOSE, {"positions": [[0.3, 0.9, 0.1]], "density": 1000.0}], "edges": {}},
    "lid": {"walls": [{"points": [[0.0, 0.9], [SIDE, 0.9]], "velocity": [0.0, -1.0], "force": 20.0, "mass": 2.0}]},
    "wall": {"walls": [{"points": [[0.0, 0.02], [SIDE, 0.02]], "shake": {"amplitude": [0.0, 0.001], "frequency": 10.0}}]},
}


def settling(case: str, layout: str, monkeypatch: pytest.MonkeyPatch, threads: int = 1) -> sand.Simulation:
    """400 loose discs above the floor, to the rigid solver."""
    fresh_taichi()
    monkeypatch.setattr(build, "layout_of", lambda gpu, grains: layout)
    keys = {"grains": [LOOSE], "edges": {"left": "periodic", "right": "periodic"}, **SCENES[case]}
    scene = sand.Scene(size=[SIDE, 1.2], solver={"kind": "rigid", "restitution": 0.1}, effects={"friction": {"mu": 0.5}}, **keys)
    sim = sand.Simulation(scene, threads=threads)
    assert sim.world.layout == layout and sweeps_join(sim.world) == (layout == "strips" and case == "plain")
    return sim


@pytest.mark.parametrize("case", list(SCENES))
def test_a_step_without_impacts_does_the_same(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that are known to have no impacts leave out what answers them: as if none were left out, to what a compiler may round
    otherwise; and to the same bits on two threads.
    """
    launched, step = [], stepping.step_alone
    monkeypatch.setattr(stepping, "step_alone", lambda world, solver, impacts: (launched.append(impacts), step(world, solver, impacts)))
    places, ends = {}, {}
    for threads, calms in ((1, False), (1, True), (2, True)):
        monkeypatch.setattr(stepping, "may_be_calm", lambda world, solver, calms=calms: calms)
        sim = settling(case, "strips", monkeypatch, threads)
        launched.clear()
        sim.advance(0.3)  # many have touched
        places[calms] = sim.positions
        sim.advance(0.7)
        assert (np.mean(launched) < 1.0) == calms and sim.flags() == []
        ends[threads, calms] = digest(sim)
        del sim
    assert np.abs(places[True] - places[False]).max() < 1e-4 * 0.02
    assert ends[1, True] == ends[2, True]


def test_rests_as_in_one_block(monkeypatch: pytest.MonkeyPatch) -> None:
    """The order of the contacts is another, the bed the same: its weight on the floor, overlaps, packing, and it is still."""
    found = []
    for layout in ("one", "strips"):
        sim = settling("plain", layout, monkeypatch)
        sim.advance(2.0)
        found.append(sim.report())
        weight = 9.81 * found[-1]["mass_kg"]
        assert found[-1]["kinetic_energy_J"] < 1e-4 * weight * 0.01
        assert found[-1]["floor_force_N"] == pytest.approx(weight, rel=0.01)
        del sim
    one, strips = found
    assert strips["overlap_p99"] < 0.02 and strips["grains"] == 400
    for key, share in (("overlap_mean", 0.3), ("packing_fraction", 0.02), ("contacts", 0.05)):
        assert strips[key] == pytest.approx(one[key], rel=share), key
