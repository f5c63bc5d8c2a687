"""Walls that are shaken along an ellipse, or rock, and edges whose surface moves: what grains get of it, in closed form."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import OPEN, Disc, G, R, simulate

import taichi_sand as sand
from taichi_sand.scene import moving
from taichi_sand.world.walls.build import standing_walls

KINDS = ("rigid", "md")
SHAKE = {"amplitude": [0.004, 0.003], "frequency": 5.0, "phase": [0.7, 0.7 + math.pi / 2]}
ROCK = {"angle": 0.3, "frequency": 2.0}


def at(time: float) -> np.ndarray:
    """Displacement by SHAKE [m]."""
    amplitude, phase, omega = np.array(SHAKE["amplitude"]), np.array(SHAKE["phase"]), math.tau * SHAKE["frequency"]
    return amplitude * (np.sin(omega * time + phase) - np.sin(phase))


@pytest.mark.parametrize("kind", KINDS)
def test_around_an_ellipse(kind: str) -> None:
    """A floor goes around an ellipse, below 1 g: a disc on it goes up and down with it, and, of no friction, not to and fro."""
    floor = {"points": [[0.02, 0.1], [0.18, 0.1]], "shake": SHAKE}
    sim = simulate([Disc(0.1, 0.1 + R)], (0.2, 0.3), {"kind": kind, "tolerance": 0.002}, gravity=(0.0, -G), walls=[floor], mu=0.0)
    for _ in range(15):
        sim.advance(0.033)
        place = sim.positions[0] - (0.1, 0.1 + R)
        assert place[1] == pytest.approx(at(sim.time)[1], abs=0.02 * 0.003 + 0.01 * R) and abs(place[0]) < 1e-6
        assert standing_walls(sim.world, sim.scene)[0] == pytest.approx(np.array(floor["points"]) + at(sim.time), abs=1e-7)
    speed = moving.top_speed(sim.scene.walls[0])
    assert speed >= np.hypot(*(np.diff([at(t) for t in np.linspace(0, 0.2, 2000)], axis=0).T)).max() / 1e-4 * (1 - 1e-3)


@pytest.mark.parametrize("phase", [math.pi / 2, -math.pi / 2])
def test_an_ellipse_carries_along(phase: float) -> None:
    """A bar on a floor with friction that goes around: the floor moves one way while it presses most, so that is where the bar goes, and
    with the other sense of rotation the other way.
    """
    floor = {"points": [[0.02, 0.05], [0.98, 0.05]], "shake": {"amplitude": [0.003, 0.001], "frequency": 12.0, "phase": [0.0, phase]}}
    grains = [{"shape": "3x1", "radius": R, "positions": [[0.5, 0.05 + R]]}]
    sim = simulate(grains, (1.0, 0.3), {"kind": "rigid"}, gravity=(0.0, -G), walls=[floor], mu=0.3)
    sim.advance(24 / 12.0)
    assert -math.copysign(1.0, phase) * (sim.positions[0, 0] - 0.5) > 0.02


@pytest.mark.parametrize("kind", KINDS)
def test_bounces_off_a_wall_that_rocks(kind: str) -> None:
    """Head-on at time 0, when it turns fastest: v' = (1 + e) r angle ω. Then the wall is where the law has it, and turns back."""
    arm, e, gap = 0.2, 0.6, 1e-5
    wall = {"points": [[0.1, 0.5], [0.5, 0.5]], "rock": ROCK, "pivot": [0.1, 0.5]}
    keys: dict[str, Any] = {"step": 5e-4} if kind == "rigid" else {"stiffness": 2e7, "step": 2e-6}
    sim = simulate([Disc(0.1 + arm, 0.5 + R + gap)], (0.7, 1.0), {"kind": kind, "restitution": e, **keys}, walls=[wall], edges=OPEN, mu=0.0)
    sim.advance(0.002)
    speed = ROCK["angle"] * math.tau * ROCK["frequency"]
    assert sim.velocities[0, 1] == pytest.approx((1 + e) * arm * speed, rel=5e-3)
    for _ in range(3 if kind == "rigid" else 1):
        sim.advance(0.02)
        turn = ROCK["angle"] * math.sin(math.tau * ROCK["frequency"] * sim.time)
        tip = np.array([0.1, 0.5]) + 0.4 * np.array([math.cos(turn), math.sin(turn)])
        assert standing_walls(sim.world, sim.scene)[0][1] == pytest.approx(tip, abs=1e-5)
    assert sim.flags() == []


@pytest.mark.parametrize("kind", KINDS)
def test_an_edge_is_a_belt(kind: str) -> None:
    """A bar on the lower edge, whose surface moves to the right: v = mu g t, then the belt's."""
    mu, speed = 0.3, 0.25
    table = {
        "size": [80 * R, 30 * R],
        "edges": {"surface_velocity": {"bottom": speed}},
        "grains": [{"shape": "3x1", "radius": R, "positions": [[20 * R, R]]}],
        "solver": {"kind": kind, "tolerance": 0.005, "restitution": 0.0},
        "effects": {"friction": {"mu": mu}},
    }
    sim = sand.Simulation(sand.Scene(**table), threads=1)
    sim.advance(0.6 * speed / (mu * G))
    assert sim.velocities[0, 0] == pytest.approx(mu * G * sim.time, rel=0.03)
    sim.advance(0.8 * speed / (mu * G))
    assert sim.velocities[0, 0] == pytest.approx(speed, rel=2e-3) and sim.flags() == []


def test_what_is_wrong_with_edges_and_rocking() -> None:
    wall = {"points": [[0.1, 0.5], [0.5, 0.5]]}
    for said, table in {
        r'edges.surface_velocity.top = 1 but edges.top = "open"': {"edges": {"top": "open", "surface_velocity": {"top": 1.0}}},
        r"edges.surface_velocity.left = 1 needs a table \[effects.friction\]": {"edges": {"surface_velocity": {"left": 1.0}}},
        "surface_velocity does not go with a `rock`": {"walls": [{**wall, "rock": ROCK, "surface_velocity": 1.0}]},
        "pivot needs a `spin` or a `rock`": {"walls": [{**wall, "pivot": [0.0, 0.0]}]},
        r"walls\[0\].rock.angle is missing": {"walls": [{**wall, "rock": {"frequency": 1.0}}]},
    }.items():
        with pytest.raises(sand.SandError, match=said):
            sand.Scene(size=[1.0, 1.0], **table)
