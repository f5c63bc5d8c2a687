"""What takes minutes: walls of damp sand (physics.md B17), and slopes dug at their foot, asleep or awake. `pytest -m slow`."""

from typing import Any

import numpy as np
import pytest
from helpers import fresh_taichi

import taichi_sand as sand
from taichi_sand.world import census

pytestmark = pytest.mark.slow

D = 0.006
RADII = [0.45 * D, 0.55 * D]
CRITICAL = 2.1
"""H_c / (Bo d) of a vertical cut, for 3.5 contacts a grain and an angle of friction of 22 degrees (physics.md B17)."""


def wall_stands(bond: float, height: float, seconds: float) -> bool:
    """Whether a wall of damp sand `height` [d] high stands after `seconds`: a box of sand comes to rest, then its front is taken away."""
    fresh_taichi()
    width = max(15.0, height) * D
    size = [2.5 * width + height * D, 1.6 * height * D]
    front = {"points": [[width, 0.0], [width, size[1]]], "friction": 0.0}
    grains = {"radius": RADII, "fill": "hexagonal", "region": [0.0, 0.0, width, 1.12 * height * D]}
    effects = {"friction": {"mu": 0.4}, "cohesion": {"bond": bond}, "sleeping": {}}
    scene = sand.Scene(size=size, grains=[grains], walls=[front], solver={"kind": "md", "tolerance": 0.02}, effects=effects)
    sim = sand.Simulation(scene, threads=1)
    sim.advance(1.0)
    sim.set_walls([])
    sim.advance(seconds)
    assert not sim.flags()
    gone = sim.positions[:, 0] > width + 2 * D
    return bool(gone.mean() < 0.03)


def test_a_damp_wall_stands_a_minute_and_a_high_one_falls() -> None:
    """B17: at Bo = 5 a wall of 0.3 H_c stands for 60 s; one of 4 H_c falls."""
    assert wall_stands(5.0, 0.3 * CRITICAL * 5.0, 60.0)
    assert not wall_stands(5.0, 4 * CRITICAL * 5.0, 3.0)


TOWERS, CREST = 0.2, 0.21
"""Grains that start above TOWERS belong to the tops of the towers, and damp ones stay above CREST [m]."""


def test_the_rigid_sandcastle() -> None:
    """Damp it stands for a minute, door and towers, but for a loose grain in a hundred; dry or flooded its towers are gone after 4 s."""
    for wetness, seconds in ((0.1, 60.0), (0.0, 4.0), (0.4, 4.0)):
        fresh_taichi()
        scene = sand.load("sandcastle", ["solver.kind=rigid", f"effects.moisture.wetness={wetness}"])
        sim = sand.Simulation(scene, threads=1)
        start = sim.positions[:, 1]
        sim.advance(min(4.0, seconds))
        early = sim.positions
        sim.advance(seconds - 4.0)
        assert not sim.flags()
        top = sim.positions[start > TOWERS, 1]
        if wetness == 0.1:
            assert top.max() > CREST and np.quantile(np.abs(sim.positions - early), 0.99) < D
            x, y = sim.positions.T
            assert not ((np.abs(x - 0.395) < 0.02) & (np.abs(y - 0.08) < 0.02)).any()  # the door is open
        else:
            assert top.max() < 0.75 * CREST


def slope(sim: Any) -> float:
    """Angle of the surface of a heap in the left corner [degrees]: a line through the highest grains of its middle part."""
    x, y = sim.positions.T
    columns = np.floor(x / (2 * D)).astype(int)
    top = np.array([y[columns == k].max(initial=0.0) for k in range(columns.max() + 1)])
    foot = int(np.argmax(top < 3 * D)) if (top < 3 * D).any() else len(top)
    ends = slice(max(1, foot // 6), max(foot - foot // 6, 4))
    return float(np.degrees(np.arctan(-np.polyfit((np.arange(len(top)) * 2 * D)[ends], top[ends], 1)[0])))


def dug(sleeping: bool, seed: int) -> tuple[float, float]:
    """Angle of a heap at rest, and after its foot has been dug away [degrees]."""
    fresh_taichi()
    grains = {"radius": RADII, "count": 1500, "region": [0.0, 0.0, 0.2, 0.35]}
    effects = {"friction": {"mu": 0.5}, "rolling": {"mu": 0.1}, **({"sleeping": {}} if sleeping else {})}
    scene = sand.Scene(size=[1.0, 0.4], grains=[grains], walls=[{"points": [[0.2, 0.0], [0.2, 0.4]]}], effects=effects, seed=seed)
    sim = sand.Simulation(scene, threads=1)
    sim.advance(1.0)
    sim.set_walls([])
    sim.advance(4.0)
    first = slope(sim)
    if sleeping:
        assert sim.report()["grains_asleep"] > 0.9 * sim.count
    for _ in range(3):  # three spades full
        numbers, _whole = census.places(sim.world)
        x, y = numbers[:, 0], numbers[:, 1]
        foot = x[y > 4 * D].max()
        hole = np.flatnonzero((np.abs(x - foot) < 4 * D) & (y < 8 * D))
        census.remove(sim.world, hole)
        sim.removed += len(hole)
        sim.renew()
        sim.advance(2.0)
    return first, slope(sim)


def test_a_hole_at_the_foot_gives_the_same_slope_asleep() -> None:
    """Mean of five heaps: after digging at the foot the slope is the same with sleeping as without, within 1 degree."""
    found = np.array([[dug(sleeping, seed) for sleeping in (False, True)] for seed in range(5)])
    awake, asleep = found[:, 0, 1], found[:, 1, 1]
    assert abs(awake.mean() - asleep.mean()) < 1.0, found
