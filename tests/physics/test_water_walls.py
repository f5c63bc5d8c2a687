"""Walls and boulders in the water: what holds it, drives it, and is as wide as its cells."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import G, fresh_taichi

import taichi_sand as sand

RHO = 1000.0
STONE = {"positions": [[0.01, 0.39]], "radius": 0.003, "fixed": True}
"""Of which there must be one."""


def wet(**keys: Any) -> sand.Simulation:
    """A scene with water in cells of 12 mm, without grains but a stone."""
    fresh_taichi()
    scene = {"size": [0.6, 0.4], "grains": [STONE], "effects": {"water": {"cell": 2.0}}, **keys}
    return sand.Simulation(sand.Scene(**scene), threads=1)


def places(sim: sand.Simulation) -> np.ndarray:
    """Of the markers [m]."""
    f = sim.pausing["water"].fluid
    now = f.now[None]
    return (f.place.to_numpy()[: now.markers].astype(float) - 0.5) * [now.width, now.height]


def test_a_dam_holds() -> None:
    """Behind a wall that leans no drop gets to the other side, and on the floor there are ρ g h."""
    wall = np.array([[0.203, 0.0], [0.333, 0.4]])
    sim = wet(water=[{"region": [0.0, 0.0, 0.2, 0.25]}], walls=[{"points": wall.tolist()}])
    sim.advance(4.0)
    place = places(sim)
    assert (place[:, 0] < wall[0, 0] + (wall[1, 0] - wall[0, 0]) * place[:, 1] / 0.4).all()
    slope = 0.13 / 0.4
    depth = (math.sqrt(0.203**2 + 2 * slope * 0.2 * 0.25) - 0.203) / slope  # as much water between the edge and the wall
    columns, pressure = floor_pressure(sim)
    inside = columns < 0.19
    now = sim.pausing["water"].fluid.now[None]
    assert pressure[inside] == pytest.approx(RHO * G * (depth - 0.5 * now.height), rel=0.03)
    assert (pressure[columns > 0.22] == 0).all()


def floor_pressure(sim: sand.Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the lowest cells [m], and the pressure there [Pa]."""
    f = sim.pausing["water"].fluid
    now = f.now[None]
    table = f.cells.pressure.to_numpy()[: (now.columns + 2) * (now.rows + 2)].reshape(now.columns + 2, now.rows + 2)
    return (np.arange(now.columns) + 0.5) * now.width, table[1:-1, 1] * now.density / now.step


def test_a_piston_drives_water() -> None:
    """A wall that moves into the water takes all of it along: it rises by what the wall takes from its length."""
    speed, start, depth = 0.05, 0.1, 0.1
    walls = [{"points": [[start, 0.0], [start, 0.4]], "velocity": [speed, 0.0]}]
    sim = wet(water=[{"region": [0.103, 0.0, 0.6, depth]}], walls=walls)
    for _ in range(3):
        sim.advance(1.0)
        x = start + speed * sim.time
        place = places(sim)
        assert (place[:, 0] > x).all()
        assert 2 * place[:, 1].mean() == pytest.approx(depth * 0.497 / (0.6 - x), rel=0.03)
    assert sim.report()["water_speed_max_m_s"] < 4 * speed


def test_a_drum_keeps_its_water() -> None:
    """A drum that turns, half full of water and grains, loses at most 1 % of its water in two seconds."""
    angle = np.linspace(0.0, 2 * np.pi, 41)[:-1]
    points = 0.2 + 0.18 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    walls = [{"points": points.tolist(), "closed": True, "spin": 1.0, "pivot": [0.2, 0.2]}]
    grains = [{"radius": 0.003, "count": 300, "region": [0.12, 0.06, 0.28, 0.2]}]
    more = {"size": [0.4, 0.4], "grains": grains, "effects": {"water": {"cell": 2.0}, "friction": {}}}
    sim = wet(water=[{"region": [0.09, 0.06, 0.31, 0.2]}], walls=walls, **more)
    sim.advance(2.0)
    place = places(sim)
    assert (np.hypot(*(place - 0.2).T) > 0.18).mean() < 0.01
    assert not [flag for flag in sim.flags() if "not finite" in flag]


def test_boulders() -> None:
    """Grains two and a half cells wide: one of half the density of water floats half under, a heavy one weighs what is left of it."""
    wide = 0.03
    stones = {"positions": [[0.007 * k + 0.005, 0.595] for k in range(80)], "radius": 0.003, "fixed": True}  # keep the cells small
    boulders = [{"positions": [[x, y]], "radius": wide / 2, "density": rho} for x, y, rho in ((0.15, 0.4, 500.0), (0.45, 0.016, 2650.0))]
    sim = wet(size=[0.6, 0.6], water=[{"region": [0.0, 0.0, 0.6, 0.4]}], grains=[stones, *boulders])
    assert sim.pausing["water"].fluid.boulders
    sim.advance(2.0)
    heights = []
    for _ in range(10):
        sim.advance(0.05)
        heights.append(sim.positions[-2, 1])
    assert np.mean(heights) == pytest.approx(0.4, abs=0.1 * wide)
    assert sim.report()["floor_force_N"] == pytest.approx((2650 - RHO) * math.pi * wide**2 / 4 * G, rel=0.02)
