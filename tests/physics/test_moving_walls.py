"""Walls that move: what they give to the grains that they touch (physics.md A12, C24, C25), against closed forms."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import OPEN, D, Disc, G, R, listed, simulate

from taichi_sand.world.walls.build import standing_walls

SOLVERS: dict[str, dict[str, Any]] = {"rigid": {"kind": "rigid", "step": 1e-3}, "md": {"kind": "md", "stiffness": 2e7, "step": 2e-6}}
DOWN = (0.0, -G)


def solver(kind: str, restitution: float = 0.0) -> dict[str, Any]:
    return {**SOLVERS[kind], "restitution": restitution}


@pytest.mark.parametrize("kind", SOLVERS)
def test_bounces_off_moving_walls(kind: str) -> None:
    """Head-on: v' = (1 + e) V - e v along the normal, whether the wall is a line, a closed obstacle, or turns: V = ω r there."""
    gap, speed, e = 1e-5, 0.4, 0.6
    walls = [
        {"points": [[0.1, 0.05], [0.1, 0.15]], "velocity": [speed, 0.0]},
        {"points": [[0.4, 0.1], [0.35, 0.15], [0.3, 0.1], [0.35, 0.05]], "closed": True, "velocity": [0.5 * speed, 0.0]},
        {"points": [[0.6, 0.1], [0.9, 0.1]], "spin": 2.0, "pivot": [0.6, 0.1]},
    ]
    discs = [Disc(0.1 + R + gap, 0.1), Disc(0.4 + R + gap, 0.1, vx=-speed), Disc(0.8, 0.1 + R + gap)]
    sim = simulate(discs, (1.0, 0.2), solver(kind, e), walls=walls, edges=OPEN, mu=0.0)
    sim.advance(0.004)
    v = sim.velocities
    bar = 1e-3 if kind == "rigid" else 5e-3
    assert v[0] == pytest.approx([(1 + e) * speed, 0.0], rel=bar, abs=1e-9)
    assert v[1] == pytest.approx([(1 + e) * 0.5 * speed + e * speed, 0.0], rel=bar, abs=1e-9)
    assert v[2, 1] == pytest.approx((1 + e) * 2.0 * 0.2, rel=bar) and abs(v[2, 0]) < 0.01 * v[2, 1]
    assert sim.flags() == []


@pytest.mark.parametrize("kind", SOLVERS)
def test_conveyors_carry_along(kind: str) -> None:
    """A disc set down on a belt of speed V slides at first: v = μ g t, R ω = 2 μ g t; it rolls from t = V / (3 μ g) on, with v = V / 3."""
    speed, mu = 0.6, 0.3
    walls = [{"points": [[0.1, 0.1], [1.9, 0.1]], "velocity": [speed, 0.0]}]
    sim = simulate([Disc(1.0, 0.1 + R)], (2.5, 0.2), solver(kind), gravity=DOWN, walls=walls, edges=OPEN, mu=mu)
    slides = speed / (3 * mu * G)
    sim.advance(0.5 * slides)
    assert sim.velocities[0, 0] == pytest.approx(mu * G * sim.time, rel=0.03)
    assert R * sim.spins[0] == pytest.approx(2 * mu * G * sim.time, rel=0.03)
    sim.advance(2 * slides)
    assert sim.velocities[0, 0] == pytest.approx(speed / 3, rel=0.01)
    assert R * sim.spins[0] == pytest.approx(2 * speed / 3, rel=0.01)
    assert sim.velocities[0, 0] + R * sim.spins[0] == pytest.approx(speed, rel=1e-3)  # no slip


@pytest.mark.parametrize("kind", SOLVERS)
def test_turning_wall_drags_with_its_surface(kind: str) -> None:
    """A disc hits the flat side of a drum that turns, without gravity. Rigid, at high friction, it leaves without slip: a third of ω r
    along the wall; soft ones slide all along with a friction of 0.05: μ (1 + e) v_n.
    """
    radius, spin, corners, e = 0.3, -3.0, 6, 0.5
    at = [[0.5 + radius * math.cos(k * math.tau / corners), 0.5 + radius * math.sin(k * math.tau / corners)] for k in range(corners)]
    apothem = radius * math.cos(math.pi / corners)
    disc = Disc(0.5, 0.5 - apothem + R + 1e-5, vy=-1.0)
    mu, expected = (1.0, spin * apothem / 3) if kind == "rigid" else (0.05, -0.05 * (1 + e))
    sim = simulate([disc], (1.0, 1.0), solver(kind, e), walls=[{"points": at, "closed": True, "spin": spin}], mu=mu)
    sim.advance(0.003)
    assert sim.velocities[0] == pytest.approx([expected, e], rel=0.02)


@pytest.mark.parametrize("kind", SOLVERS)
@pytest.mark.parametrize("gamma", [0.9, 2.0])
def test_lifts_off_above_one_g(kind: str, gamma: float) -> None:
    """C25: a disc on a shaken floor, Γ = A w^2 / g: below 1 it never leaves it, above it flies off where the floor falls away.

    The flight starts where sin w t = 1 / Γ, and is a parabola from there.
    """
    frequency = 8.0
    omega = math.tau * frequency
    amplitude = gamma * G / omega**2
    floor = {"points": [[0.05, 0.1], [0.15, 0.1]], "shake": {"amplitude": [0.0, amplitude], "frequency": frequency}}
    keys = solver(kind) if kind == "rigid" else {**solver(kind), "stiffness": 2e6, "step": 5e-6}
    sim = simulate([Disc(0.1, 0.1 + R)], (0.2, 0.3), keys, gravity=DOWN, walls=[floor])
    times, gaps = [], []
    for _ in range(60):
        sim.advance(0.005 / frequency * 4)
        times.append(sim.time)
        gaps.append(sim.positions[0, 1] - R - 0.1 - amplitude * math.sin(omega * sim.time))
    if gamma < 1:
        assert np.abs(gaps).max() < 0.02 * D and sim.flags() == []
        return
    start = math.asin(1 / gamma) / omega
    fine = np.linspace(start, start + 1 / frequency, 4001)
    height = amplitude / gamma + amplitude * omega * math.cos(omega * start) * (fine - start) - 0.5 * G * (fine - start) ** 2
    flight = height - amplitude * np.sin(omega * fine)
    lands = fine[np.argmax(flight[1:] < 0) + 1]
    first = np.array([t < 0.9 * lands for t in times])
    expected = np.interp(np.array(times)[first], fine, flight, left=0.0)
    assert np.array(gaps)[first] == pytest.approx(expected, abs=0.05 * flight.max())
    assert flight.max() > 0.3 * D


def test_compressed_pair_between_walls() -> None:
    """A12: discs pressed between walls, m1 = 2 m2, swing about the static point with ω² = (k / m2) {(3 - √3) / 2, (3 + √3) / 2}."""
    k, gap = 1e5, 0.9 * 2 * D
    heavy, light = Disc(0.5 * D, 0.1, density=4000.0), Disc(gap - 0.5 * D, 0.1, density=2000.0)
    sim = simulate([heavy, light], (gap, 0.2), {"kind": "md", "k_r": k, "restitution": 1.0, "step": 2e-6})
    squares, modes = np.linalg.eig(k / light.mass * np.array([[1.0, -0.5], [-1.0, 2.0]]))
    still = np.array([gap - R, 2 * gap + R]) / 3  # each of the three contacts is pressed equally
    parts = np.linalg.solve(modes, np.array([heavy.x, light.x]) - still)
    assert sorted(squares * light.mass / k) == pytest.approx([(3 - 3**0.5) / 2, (3 + 3**0.5) / 2])
    for _ in range(40):
        sim.advance(5e-5)
        expected = still + modes @ (parts * np.cos(np.sqrt(squares) * sim.time))
        assert sim.positions[:, 0] == pytest.approx(expected, abs=0.01 * abs(np.array([heavy.x, light.x]) - still).max())


def squeezed(kind: str, **keys: Any) -> Any:
    """150 discs in a box, and a piston that sweeps it from the left at 0.2 m/s: it is jammed before it is through."""
    grains = [{"radius": [0.9 * R, R], "count": 150, "region": [0.02, 0.0, 0.3, 0.1]}]
    piston = {"points": [[0.001, 0.0], [0.001, 0.1]], "velocity": [0.2, 0.0], **keys}
    return simulate(grains, (0.3, 0.1), {"kind": kind, "precision": 32}, walls=[piston], mu=0.3, gravity=DOWN)


def piston_at(sim: Any) -> float:
    """Where the piston is, along x [m]."""
    return float(standing_walls(sim.world, sim.scene)[0][0, 0])


@pytest.mark.parametrize("kind", SOLVERS)
def test_piston_stops_where_grains_bear_its_force(kind: str) -> None:
    """C24, constant force: the piston pushes the grains together and stands still, with its force on them."""
    sim = squeezed(kind, force=20.0)
    sim.advance(1.0)
    grains, part = sim.positions, 0
    assert (grains[:, 0] > piston_at(sim) + 0.7 * R).all() and sim.flags() == []  # nobody is left behind it
    stands = piston_at(sim)
    sim.advance(0.5)
    assert abs(piston_at(sim) - stands) < 0.01 * D
    pushes = [-c.force[0] * c.normal[0] + c.force[1] * c.normal[1] for c in listed(sim) if c.wall and c.second == part]
    assert sum(pushes) == pytest.approx(20.0, rel=0.02)
    assert sim.report()["overlap_max"] < 0.05


@pytest.mark.parametrize("kind", SOLVERS)
def test_piston_without_limit_stalls(kind: str) -> None:
    """C24, constant speed: jammed, it is held up and says so; overlaps stay bounded, and nobody gets out."""
    sim = squeezed(kind)
    sim.advance(2.0)
    assert any("moving wall was held up" in flag for flag in sim.flags())
    assert piston_at(sim) < 0.25 and (sim.positions[:, 0] > piston_at(sim)).all()
    report = sim.report()
    assert sim.count == 150 and report["overlap_mean"] < (0.1 if kind == "rigid" else 0.03) and report["overlap_max"] < 0.5


def test_belt_slides_along_below_a_load() -> None:
    """A column that lands on a belt presses it in more deeply than a jam, but is not in its way: it goes on at its speed."""
    speed, top, count = 0.2, 0.05, 60
    walls = [{"points": [[0.02, top], [0.3, top]], "velocity": [speed, 0.0]}]
    discs = [Disc(0.2, top + 0.2 + (2 * k + 1) * R) for k in range(count)]
    sim = simulate(discs, (0.5, 1.5), {"kind": "rigid", "tolerance": 0.02}, walls=walls, edges=OPEN, mu=0.0, gravity=DOWN)
    deepest = 0.0
    while sim.time < 0.3:
        sim.advance(0.005)
        deepest = max(deepest, top + R - float(sim.positions[0, 1]))
    assert deepest > 0.06 * D
    assert sim.flags() == []
    assert standing_walls(sim.world, sim.scene)[0][0, 0] == pytest.approx(0.02 + speed * sim.time, rel=1e-6)
