"""Conveyor belts: walls with a surface velocity, in both solvers (Coulomb's law at the contact)."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import G, R, fresh_taichi

import taichi_sand as sand

MU, V = 0.3, 0.25
BELT = [[4 * R, 10 * R], [76 * R, 10 * R]]
KINDS = ("md", "rigid")
BAR = {"shape": "bar", "radius": R, "density": 2000.0, "positions": [[20 * R, 11 * R]]}
SHAPE = {"name": "bar", "discs": [[2.0 * k, 0.0, 1.0] for k in range(-3, 4)]}


def made(kind: str, points: list, speed: float, **keys: Any) -> sand.Simulation:
    """A bar, a row of seven discs that hang together, lies on a belt."""
    wall = {"points": points, "surface_velocity": speed}
    table = {"size": [80 * R, 30 * R], "gravity": (0.0, -G), "shapes": [SHAPE], "grains": [BAR], "walls": [wall]}
    solver = {"kind": kind, "tolerance": 0.005, "restitution": 0.0}
    return sand.Simulation(sand.Scene(**{**table, "solver": solver, "effects": {"friction": {"mu": MU}}, **keys}), threads=1)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bar_comes_to_the_speed_of_a_belt(kind: str) -> None:
    """It is accelerated by mu g until it moves with the belt, after v / (mu g) within 2 %, and then rests on it; the way it has slipped is
    v² / (2 mu g). The other way around it slows down, and a line that is drawn the other way carries it the other way.
    """
    fresh_taichi()
    sim = made(kind, BELT, 0.0)
    sim.advance(0.3)
    sim.set_walls([{"points": BELT, "surface_velocity": V}])
    start, place, speeds = sim.time, sim.positions[0, 0], []
    handle = sim.every(5e-4, lambda s: speeds.append((s.time - start, s.velocities[0, 0])))
    sim.advance(2 * V / (MU * G))
    handle.stop()
    time, speed = np.array(speeds).T
    rising = (speed > 0.1 * V) & (speed < 0.9 * V)
    slope, zero = np.polyfit(time[rising], speed[rising], 1)
    assert (V - zero) / slope == pytest.approx(V / (MU * G), rel=0.02)
    assert speed[-1] == pytest.approx(V, rel=1e-3) and abs(sim.spins[0]) < 1e-2
    slipped = V * (sim.time - start) - (sim.positions[0, 0] - place)
    assert slipped == pytest.approx(V**2 / (2 * MU * G) - 0.5 * V * sim.step, rel=0.02)  # symplectic Euler moves it by the new velocity
    sim.set_walls([{"points": BELT[::-1], "surface_velocity": 0.5 * V}])
    sim.advance(2.5 * V / (MU * G))
    assert sim.velocities[0, 0] == pytest.approx(-0.5 * V, rel=1e-3) and sim.flags() == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_disc_rolls_on_a_belt(kind: str) -> None:
    """A disc on a belt comes to a third of its speed, rolling (its surface moves back with it); at both ends of the belt it falls off."""
    fresh_taichi()
    disc = {"radius": R, "density": 2000.0, "positions": [[20 * R, 11 * R]]}
    sim = made(kind, BELT, V, grains=[disc], shapes=[])
    sim.advance(0.3)
    assert sim.velocities[0, 0] == pytest.approx(V / 3, rel=0.02)
    assert sim.spins[0] * R == pytest.approx(2 * V / 3, rel=0.02)
    sim.advance(math.ceil(60 * R / (V / 3)))
    assert sim.positions[0, 1] < 2 * R and sim.flags() == []


def test_a_belt_needs_friction() -> None:
    """Without it, and for walls that turn, it is refused; as is one too fast for a step that the scene fixes."""
    for text, keys in {
        r"walls\[0\].surface_velocity = 1 needs a table \[effects.friction\]": {"effects": {}},
        r"walls\[0\].surface_velocity does not go with a `spin`": {"walls": [{"points": BELT, "surface_velocity": 1.0, "spin": 1.0}]},
    }.items():
        with pytest.raises(sand.SandError, match=text):
            made("rigid", BELT, 1.0, **keys)
    with pytest.raises(sand.SandError, match="can be followed"):
        made("rigid", BELT, 1e3, solver={"kind": "rigid", "step": 1e-4})
