"""Liquid bridges (physics.md D7): pull-off force, energy to tear, capture speed, in both solvers."""

import math

import numpy as np
import pytest
from helpers import D, Disc, G, K, M, R, simulate

import taichi_sand as sand

T_C = math.pi * math.sqrt(M / 2 / K)
SOLVERS = {
    "md": {"kind": "md", "k_r": K, "restitution": 0.5, "step": T_C / 30},
    "rigid": {"kind": "rigid", "restitution": 0.5, "step": 4e-5, "tolerance": 0.001},
}
BOND, RUPTURE = 5.0, 0.1
ENERGY = BOND * M * G * RUPTURE * D / 2
"""F_c S_c / 2 [J]; without gravity the weight is that on earth."""
WET = {"cohesion": {"bond_number": BOND, "rupture": RUPTURE}}
MIDDLE = 0.05


def pair(name: str, gap: float, speed: float, effects: dict):
    """Two discs `gap` apart that move apart at `speed`."""
    discs = [Disc(MIDDLE + side * (R + gap / 2), MIDDLE, side * speed / 2) for side in (-1, 1)]
    return simulate(discs, (0.1, 0.1), SOLVERS[name], effects=effects)


@pytest.mark.parametrize("name", SOLVERS)
def test_pull_off_force(name: str) -> None:
    """A disc hangs from a fixed one if F_c is 2 % above its weight, and falls if it is 2 % below."""
    for bond, hangs in ((0.98, False), (1.02, True)):
        discs = [Disc(MIDDLE, 0.08, fixed=True), Disc(MIDDLE, 0.08 - D + 1e-7)]
        effects = {"cohesion": {"bond_number": bond, "rupture": RUPTURE}}
        sim = simulate(discs, (0.1, 0.1), SOLVERS[name], gravity=(0, -G), effects=effects)
        sim.advance(0.3)
        sunk = (0.08 - D - sim.positions[1, 1]) / D
        assert abs(sunk) < 1e-3 if hangs else sunk > 1
        del sim


@pytest.mark.parametrize("name", SOLVERS)
def test_energy_to_tear(name: str) -> None:
    """Two touching discs flung apart lose F_c S_c / 2, within 5 %; never having touched, nothing."""
    speed = 1.5 * math.sqrt(2 * ENERGY / (M / 2))
    for gap, loss in ((-2e-8, ENERGY), (0.02 * D, 0.0)):
        sim = pair(name, gap, speed, WET)
        sim.advance(0.05)
        left = float(np.diff(sim.velocities[:, 0])[0])
        assert M / 4 * (speed**2 - left**2) == pytest.approx(loss, rel=0.05, abs=1e-9)
        del sim


@pytest.mark.parametrize("name", SOLVERS)
def test_capture_speed(name: str) -> None:
    """After an impact at v with restitution e discs stick if m* (e v)² / 2 < F_c S_c / 2: bracketed within 5 %."""
    limit = math.sqrt(2 * ENERGY / (M / 2)) / SOLVERS[name]["restitution"]
    for share, sticks in ((0.95, True), (1.05, False)):
        sim = pair(name, 2e-4, -share * limit, WET)
        sim.advance(0.2)
        apart = (sim.positions[1, 0] - sim.positions[0, 0]) / D - 1
        assert apart < RUPTURE if sticks else apart > 2 * RUPTURE
        del sim


def chain_holds(name: str, count: int) -> bool:
    """Whether a chain of `count` discs on bridges of 10 weights holds on a fixed one, loaded slowly: gravity grows from 0 in 2 s."""
    discs = [Disc(0.1, 0.48 - k * D * (1 - 1e-4), fixed=k == 0) for k in range(count + 1)]
    solver = {"md": {"kind": "md"}, "rigid": {"kind": "rigid", "tolerance": 0.01}}[name]
    sim = simulate(discs, (0.2, 0.5), solver, gravity=(0, -G), effects={"cohesion": {"bond_number": 10.0, "rupture": RUPTURE}})
    for k in range(101):
        sim.world.box[None].gravity = (0.0, -G * k / 100)
        sim.advance(0.02)
    sim.advance(0.5)
    gaps = -np.diff(np.sort(sim.positions[:, 1])[::-1]) / D - 1
    return bool(gaps.max() < RUPTURE)


@pytest.mark.parametrize("name", SOLVERS)
def test_a_chain_loaded_slowly_holds_its_bond_number(name: str) -> None:
    """The uppermost bridge bears all discs below: it holds 9 weights with a bond of 10, not 11."""
    assert chain_holds(name, 9) and not chain_holds(name, 11)


def test_a_wet_heap_comes_to_rest() -> None:
    """Rigid discs of sizes +-20 %, Bo = 20, pull against one another everywhere: they rest as dry ones do, and do not shake."""
    grains = {"radius": [0.4 * D, 0.6 * D], "fill": "hexagonal", "region": [20 * D, 0.0, 40 * D, 12 * D]}
    effects = {"friction": {"mu": 0.5}, "rolling": {"mu": 0.1}, "cohesion": {"bond_number": 20.0}}
    sim = sand.Simulation(sand.Scene(size=[60 * D, 20 * D], grains=[grains], effects=effects, seed=1), threads=1)
    sim.advance(2.0)
    report = sim.report()
    weight = float((sim.radii**2).sum()) * math.pi * 2650 * G
    assert report["kinetic_energy_J"] < 1e-6 * weight * D
    assert report["floor_force_N"] == pytest.approx(weight, rel=0.01)  # less what bridges pull up
