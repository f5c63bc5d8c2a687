"""Discs in a row: bounces (physics.md A11), columns (A13), Newton's cradle (A14). Downwards, and sideways or upside down."""

import math

import numpy as np
import pytest
from helpers import D, Disc, G, K, M, R, chain_forces, simulate, unit

from taichi_sand.study.validate.reference import chain, first_bounce, zeta_for
from taichi_sand.study.validate.setups import NARROW, column

T_C = math.pi * math.sqrt(M / 2 / K)


def apex(sim, below: float) -> float:
    """Height [m] of the disc's lowest point at the top of its flight, by energy, from its present free flight."""
    y, v = sim.positions[0, 1] - R - below, sim.velocities[0, 1]
    return y + v * abs(v) / (2 * G) if v > 0 else y + v**2 / (2 * G)


def test_rigid_bounces() -> None:
    """A11: every bounce keeps e^2 of the height, to 1 %, down to the restitution threshold 0.3 sqrt(g d).

    An impact is answered up to v h above the floor: the step has to be small against H / v of the last bounces.
    """
    e, height = 0.8, 0.1
    solver = {"kind": "rigid", "restitution": e, "step": 2e-5}
    sim = simulate([Disc(0.05, R + height)], (0.1, 0.2), solver, gravity=(0, -G))
    top, bounces, time = height, 0, math.sqrt(2 * height / G)
    while e * math.sqrt(2 * G * top) > 1.1 * 0.3 * math.sqrt(G * D):
        flight = 2 * e * math.sqrt(2 * top / G)
        sim.advance(time + flight / 2 - sim.time)
        found = apex(sim, 0.0)
        assert found == pytest.approx(e**2 * top, rel=0.01), bounces
        time += 2 * math.sqrt(2 * found / G)
        top, bounces = found, bounces + 1
    assert bounces >= 5
    sim.advance(1.0)
    assert abs(sim.velocities[0, 1]) < 1e-6 and sim.positions[0, 1] == pytest.approx(R, abs=1e-3 * D)


def test_md_bounces_lower() -> None:
    """A11: a soft floor gives a lower bounce, as the ODE says; the loss goes with delta_max / H, as k^(-1/2). e = 1 keeps the height."""
    height, losses = 0.05, []
    for k in (K / 400, K / 20, K):
        t_c = math.pi * math.sqrt(M / k)
        solver = {"kind": "md", "k_r": k, "restitution": 0.9, "step": t_c / math.sqrt(2) / 100}
        sim = simulate([Disc(0.05, R + height)], (0.1, 0.2), solver, gravity=(0, -G))
        sim.advance(math.sqrt(2 * height / G) + 2 * t_c)
        expected = first_bounce(height, M, k, 2 * zeta_for(0.9) * math.sqrt(k * M), G)
        # The step in which it first touches is the first order of the scheme (A18): 1e-3 of the speed at t_c/100.
        assert apex(sim, 0.0) == pytest.approx(expected, rel=3e-3)
        losses.append(abs(0.81 * height - expected))
    assert losses[0] > 2 * losses[1] > 4 * losses[2]
    solver = {"kind": "md", "k_r": K, "restitution": 1.0, "step": T_C / 100}
    sim = simulate([Disc(0.05, R + height)], (0.1, 0.2), solver, gravity=(0, -G))
    sim.advance(16 * 2 * math.sqrt(2 * height / G))
    assert sim.velocities[0, 1] ** 2 / 2 + G * (sim.positions[0, 1] - R) == pytest.approx(G * height, rel=1e-3)


COLUMNS = [(5, 270.0), (20, 270.0), (100, 270.0), (5, 180.0), (5, 0.0), (5, 90.0)]
"""Number of discs, and where down is: what differs at the other walls is the wall, not the column."""


@pytest.mark.parametrize("count, angle", COLUMNS)
@pytest.mark.parametrize("law", ["linear", "hertz"])
def test_md_column(law: str, angle: float, count: int) -> None:
    """A13: laid down in balance, a column stays: contact i carries i m g, sag n (n+1)/2 m g/k, and nothing moves sideways."""
    k_r = 2e6 if law == "linear" else 2e6 / math.sqrt(1e-4 * D)
    dents = (np.arange(1, count + 1) * M * G / k_r) ** (1.0 if law == "linear" else 2 / 3)
    far, down = 1.2 * count * D, unit(angle)
    size = (far, NARROW) if down[0] else (NARROW, far)
    solver = {"kind": "md", "law": law, "k_r": k_r, "restitution": 0.3, "step": 1e-5}
    sim = simulate(column(count, down, dents, far), size, solver, gravity=(G * down).tolist())
    start = sim.positions.copy()
    sim.advance(0.2)
    assert chain_forces(sim, count) == pytest.approx(np.arange(1, count + 1) * M * G, rel=1e-4)
    assert abs(sim.positions - start).max() < 1e-6 * D
    assert abs((sim.positions - start)[:, 0 if down[1] else 1]).max() < 1e-6 * D


def test_md_column_settles() -> None:
    """A13: five discs dropped with gaps come to rest one above the other, with the same forces and sag."""
    k = 2e5
    discs = [Disc(0.05, R + 1.1 * D * i) for i in reversed(range(5))]
    sim = simulate(discs, (0.1, 0.1), {"kind": "md", "k_r": k, "restitution": 0.2, "step": 2e-5}, gravity=(0, -G))
    sim.advance(2.0)
    assert chain_forces(sim, 5) == pytest.approx(np.arange(1, 6) * M * G, rel=1e-3)
    assert 9 * R - sim.positions[0, 1] == pytest.approx(15 * M * G / k, rel=1e-3)
    assert abs(sim.positions[:, 0] - 0.05).max() < 1e-6 * D


@pytest.mark.parametrize("count, angle", COLUMNS)
def test_rigid_column(count: int, angle: float) -> None:
    """A13: from just touching, after 5 s: contact i carries i m g to 2 %, overlaps within the tolerance, nothing sideways."""
    far, down = 1.2 * count * D, unit(angle)
    size = (far, NARROW) if down[0] else (NARROW, far)
    solver = {"kind": "rigid", "restitution": 0.1, "tolerance": 0.02}
    sim = simulate(column(count, down, np.zeros(count), far), size, solver, gravity=(G * down).tolist())
    start = sim.positions.copy()
    sim.advance(5.0)
    assert chain_forces(sim, count) == pytest.approx(np.arange(1, count + 1) * M * G, rel=0.02)
    assert abs((sim.positions - start)[:, 0 if down[1] else 1]).max() < 1e-6 * D
    assert sim.report()["overlap_max"] <= 0.02 * 1.05
    assert np.hypot(*sim.velocities.T).max() < 1e-3 * math.sqrt(G * D)


@pytest.mark.parametrize("angle", [0.0, 17.0, 45.0, 90.0])
def test_rigid_cradle(angle: float) -> None:
    """A14, documented model: sequential impulses; three balls with small gaps pass the whole motion on: 0, 0, 1."""
    along, gap = unit(angle), 0.05 * D
    discs = [Disc(*(np.array([0.05, 0.05]) + k * (D + gap) * along), *(along if k == 0 else (0, 0))) for k in range(3)]
    sim = simulate(discs, (0.2, 0.2), {"kind": "rigid", "restitution": 1.0, "step": 1e-5})
    sim.advance(5e-3)
    assert sim.velocities @ along == pytest.approx([0, 0, 1], abs=1e-6)
    assert abs(sim.velocities @ unit(angle + 90)).max() < 1e-6


@pytest.mark.parametrize("angle", [0.0, 17.0, 45.0, 90.0])
@pytest.mark.parametrize("law, expected", [("linear", (-0.130, 0.150, 0.980)), ("hertz", (-0.071, 0.076, 0.995))])
def test_md_cradle(law: str, expected: tuple[float, ...], angle: float) -> None:
    """A14, documented model: three touching balls share the blow as their springs do; sum v = 1, sum v^2 = 1."""
    along = unit(angle)
    k, beta = (K, 1.0) if law == "linear" else (K / math.sqrt(7e-5), 1.5)
    discs = [Disc(*(np.array([0.05, 0.05]) + k * D * along), *(along if k == 0 else (0, 0))) for k in range(3)]
    sim = simulate(discs, (0.2, 0.2), {"kind": "md", "law": law, "k_r": k, "restitution": 1.0, "step": T_C / 400})
    sim.advance(3e-3)
    v = sim.velocities @ along
    assert v == pytest.approx(expected, abs=1.5e-3)
    assert v == pytest.approx(chain(np.full(3, M), np.array([1.0, 0, 0]), np.zeros(2), k, beta), abs=1.5e-3)
    assert v.sum() == pytest.approx(1, abs=1e-12) and (v**2).sum() == pytest.approx(1, abs=1e-4)
