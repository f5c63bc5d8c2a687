"""Walls that hold a pressure: what they press with is that times the length that grains can load, which follows the walls beside them."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import OPEN, D, Disc, G, M, R, simulate

import taichi_sand as sand
from taichi_sand.scene.loaded import loaded_length

KINDS = ("rigid", "md")
P = 400.0  # [N/m]


def lid(**keys: Any) -> dict[str, Any]:
    """A lid over the whole box, 1 m wide, and what is asked of it."""
    return {"points": [[0.0, 0.5], [1.0, 0.5]], "velocity": [0.0, -0.1], "pressure": P, **keys}


SIDE = {"points": [[0.2, 0.0], [0.2, 0.8]]}
GOING = {"points": [[0.9, 0.1], [0.9, 0.9]], "velocity": [-0.05, 0.0]}


@pytest.mark.parametrize(
    ("walls", "keys", "length"),
    [
        ([lid()], {}, 1.0),
        ([lid(points=[[-1.0, 0.5], [3.0, 0.5]])], {}, 1.0),  # the edges end it
        ([lid(points=[[0.1, 0.5], [0.4, 0.5]])], {}, 0.3),  # its own ends
        ([lid(), SIDE], {}, 0.8),
        ([lid(), SIDE, GOING], {}, 0.6),  # 2 s later
        ([lid(), {**SIDE, "points": [[0.2, 0.51], [0.2, 0.8]]}], {}, 1.0),  # one that it is not beside
        ([lid(), {**SIDE, "points": [[0.0, 0.3], [0.4, 0.7]]}], {}, 0.8),  # aslant
        ([lid(points=[[-1.0, 0.5], [3.0, 0.5]])], {"edges": {"left": "periodic", "right": "periodic"}}, 1.0),
        ([lid(points=[[0.0, 0.5], [0.5, 0.6], [1.0, 0.5]]), SIDE], {}, 0.8),  # seen along its course
        ([lid(velocity=[0.1, -0.1], points=[[0.3, 0.3], [0.6, 0.6]])], {}, 0.3 * math.sqrt(2)),
    ],
)
def test_the_length_that_can_be_loaded(walls: list, keys: dict, length: float) -> None:
    """From side to side between what stands beside it, or to its own ends."""
    scene = sand.Scene(size=[1.0, 1.0], walls=walls, **keys)
    times = [2.0] * len(walls)
    assert loaded_length(scene, scene.walls[0], times) == pytest.approx(length)


@pytest.mark.parametrize("kind", KINDS)
def test_the_force_follows_the_length(kind: str) -> None:
    """Discs that lie apart from one another under a lid, between two walls that close in: the floor bears their weight and p L(t)."""
    speed, gap, count = 0.2, 0.5, 6
    discs = [Disc(0.3 + (k - 0.5 * (count - 1)) * 2 * D, 0.1 + R) for k in range(count)]
    sides = [{"points": [[x, 0.0], [x, 0.3]], "velocity": [v, 0.0]} for x, v in ((0.3 - gap / 2, speed / 2), (0.3 + gap / 2, -speed / 2))]
    lid = {"points": [[-0.1, 0.1 + D], [0.7, 0.1 + D]], "velocity": [0.0, -0.5], "pressure": P, "name": "lid"}
    floor = {"points": [[-0.1, 0.1], [0.7, 0.1]], "name": "floor"}
    solver = {"kind": kind, "tolerance": 0.005}
    sim = simulate(discs, (0.6, 0.4), solver, gravity=(0.0, -G), walls=[lid, floor, *sides], edges=OPEN, mu=0.0)
    sim.advance(0.3)
    for _ in range(4):
        sim.advance(0.1)
        report = sim.report()
        assert -report["wall_forces_N"]["floor"][1] == pytest.approx(P * (gap - speed * sim.time) + count * M * G, rel=2e-3)
        assert report["wall_pressures_N_m"]["lid"] == pytest.approx(P, rel=2e-3)
    assert sim.flags() == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_cell_holds_its_pressures(kind: str) -> None:
    """Four walls around loose grains come to rest where each bears its own pressure, within 1 %, and so they do with others later."""
    middle, out, far = 0.15, 0.07, 0.14
    places = {"top": (0.0, 1.0), "base": (0.0, -1.0), "west": (-1.0, 0.0), "east": (1.0, 0.0)}
    walls = []
    for name, (x, y) in places.items():
        along = np.array([y, x])
        at = middle + out * np.array([x, y])
        line = [(at - far * along).tolist(), (at + far * along).tolist()]
        walls.append({"name": name + "_wall", "points": line, "velocity": [-0.2 * x, -0.2 * y], "pressure": P})
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": 40, "region": [0.085, 0.085, 0.215, 0.215]}]
    sim = simulate(grains, (0.3, 0.3), {"kind": kind}, walls=list(walls), mu=0.3, seed=4)
    for across, up in ((P, P), (1.3 * P, P)):
        for wall in walls:
            wall["pressure"] = across if wall["velocity"][0] else up
        sim.set_walls([{**w, "points": p.tolist()} for w, p in zip(walls, sim.wall_points, strict=True)])
        sim.advance(2.5)
        held = sim.report()["wall_pressures_N_m"]
        expected = {"west_wall": across, "east_wall": across, "top_wall": up, "base_wall": up}
        assert held == pytest.approx(expected, rel=0.01)
        assert sim.flags() == []


def test_what_is_wrong_with_pressures() -> None:
    for said, keys in {
        "force and `pressure` exclude each other": {"force": 1.0},
        "pressure needs a `velocity`": {"velocity": [0.0, 0.0]},
        "pressure goes with a `velocity` alone": {"rock": {"angle": 0.1, "frequency": 1.0}},
        "needs a `force` or a `pressure`": {"pressure": 0.0, "mass": 1.0},
        r"must be at least 0 N/m": {"pressure": -1.0},
    }.items():
        with pytest.raises(sand.SandError, match=said):
            sand.Scene(size=[1.0, 1.0], walls=[lid(**keys)])
