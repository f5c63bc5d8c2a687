"""Bonds: the frequency of a pair, stability at any stiffness, momenta, free fall, breaking (physics.md A20, C12)."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import D, G, M, R, digest, kinetic, simulate
from helpers import Disc as Grain

import taichi_sand as sand
from taichi_sand import SandError
from taichi_sand.play.session import Session
from taichi_sand.world import edit
from taichi_sand.world.extras.links import ends_of

SIZE = (0.4, 0.4)
SOLVERS = {"md": {"kind": "md", "restitution": 0.5}, "rigid": {"kind": "rigid"}}
HEXAGON = {"fill": "hexagonal", "radius": R, "count": 30, "pitch": 1.2, "region": [0.15, 0.15, 0.23, 0.3], "bonded": True}
"""Thirty discs that do not touch, each bonded to its up to six neighbours."""


def bonded(grains: list[dict[str, Any]], solver: dict[str, Any], **keys: Any) -> sand.Simulation:
    """A simulation of bonded grains; `bonds` are keys of the effect."""
    return simulate(grains, SIZE, solver, effects={"friction": {"mu": 0.3}, "bonds": keys.pop("bonds", {})}, **keys)


def throw(sim: sand.Simulation, speed: float, seed: int) -> np.ndarray:
    """Gives all grains random velocities [m/s]; returns them."""
    twist = sim.world.grains.twist.to_numpy()
    twist[: sim.count, :2] = np.random.default_rng(seed).uniform(-speed, speed, (sim.count, 2))
    sim.world.grains.twist.from_numpy(twist)
    sim.renew()
    return sim.velocities


def momenta(sim: sand.Simulation) -> tuple[np.ndarray, float]:
    """Momentum and angular momentum about the origin of equal discs, spins included, from the state alone."""
    x, v = sim.positions, sim.velocities
    return M * v.sum(0), float(M * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0] + 0.5 * R**2 * sim.spins).sum())


@pytest.mark.parametrize("name", SOLVERS)
def test_frequency_of_a_pair(name: str) -> None:
    """A20: omega = sqrt(k / m*), within 1 % at h = T / 50, from ten periods; the amplitude stays."""
    weights = 1000.0
    omega = math.sqrt(weights * M * G / D / (M / 2))
    speed = 0.05 * D * omega / 2
    rows = [[0.2 - 0.6 * D, 0.2, R, -speed, 0], [0.2 + 0.6 * D, 0.2, R, speed, 0]]
    grains = [{"positions": rows, "bonded": True}]
    sim = bonded(grains, {**SOLVERS[name], "step": 2 * math.pi / omega / 50}, bonds={"stiffness": weights, "damping": 0.0})
    stretch = []
    for _ in range(500):
        sim.advance_steps(1)
        stretch.append(sim.positions[1, 0] - sim.positions[0, 0] - 1.2 * D)
    stretch = np.array(stretch)
    rising = np.flatnonzero((stretch[:-1] < 0) & (stretch[1:] >= 0))
    moments = rising - stretch[rising] / (stretch[rising + 1] - stretch[rising])
    period = np.polyfit(np.arange(len(moments)), moments, 1)[0] * sim.step
    assert len(moments) >= 9 and 2 * math.pi / period == pytest.approx(omega, rel=0.01)
    assert np.abs(stretch[-50:]).max() == pytest.approx(0.05 * D, rel=0.01)


@pytest.mark.parametrize("share", [0.1, 1.0, 2.5])
@pytest.mark.parametrize("name", SOLVERS)
def test_stiff_bonds_are_stable(name: str, share: float) -> None:
    """C12: bonds for which the step that the tolerance asks is omega h = 0.1, 1, 2.5: the step follows them, and energy does not rise;
    P and L stay (A20). A step of one's own that is too long for them is refused with the limit.
    """
    plain = simulate([{**HEXAGON, "bonded": False}], SIZE, SOLVERS[name], mu=0.3, gravity=(0, -G)).step
    weights = (share / plain) ** 2 * (M / 2) * D / (M * G)
    sim = bonded([HEXAGON], SOLVERS[name], gravity=(0, -G), bonds={"stiffness": weights, "damping": 0.0})
    omega = math.sqrt(weights * 12 * G / D)  # of a disc amid six others, from above
    assert sim.step <= plain and sim.step * omega < 1.001 and len(ends_of(sim.world, 1)) == 69
    sim.set("gravity.1", 0.0)
    discs = [Grain(0, 0)] * sim.count
    throw(sim, 0.001 * D * omega, 1)
    start, (p, turn) = kinetic(sim, discs), momenta(sim)
    most, moving = 0.0, M * np.abs(sim.velocities).sum()
    for _ in range(20):
        sim.advance_steps(100)
        most = max(most, kinetic(sim, discs))
    (p_end, turn_end) = momenta(sim)
    assert most < 1.2 * start and sim.flags() == []
    assert np.abs(p_end - p).max() < 1e-13 * moving
    assert abs(turn_end - turn) < 1e-12 * moving * 0.2
    if share > 1:
        with pytest.raises(SandError, match=r"solver\.step: a step of .* is beyond what the effects of this scene allow"):
            bonded([HEXAGON], {**SOLVERS[name], "step": plain}, gravity=(0, -G), bonds={"stiffness": weights})


@pytest.mark.parametrize("name", SOLVERS)
def test_free_fall_of_a_triangle(name: str) -> None:
    """A20: three touching discs held by bonds fly as a rigid body would: the centre on a parabola, the spin constant, nothing else."""
    row = [0.2, 0.3, R, 0.3, 0.5, 0.4, 3.0]
    grains = [{"shape": "triangle", "positions": [row], "bonded": True}]
    sim = bonded(grains, SOLVERS[name], gravity=(0, -G))
    assert sim.count == 3 and len(ends_of(sim.world, 1)) == 3
    assert sim.positions.mean(axis=0) == pytest.approx(row[:2], abs=1e-12)
    p, _ = momenta(sim)
    assert p == pytest.approx(3 * M * np.array(row[3:5]), rel=1e-12)
    about = momenta_about_centre(sim)
    assert about == pytest.approx(3 * (M * 4 * R**2 / 3 + M * R**2 / 2) * row[6], rel=1e-9)
    sim.advance(0.1)
    time = sim.time
    foreseen = np.array(row[:2]) + np.array(row[3:5]) * time + 0.5 * np.array([0, -G]) * time * (time + sim.step)
    assert np.abs(sim.positions.mean(axis=0) - foreseen).max() < 1e-9
    assert momenta_about_centre(sim) == pytest.approx(about, rel=1e-9)
    sides = np.hypot(*(sim.positions - np.roll(sim.positions, 1, axis=0)).T)
    assert np.abs(sides - D).max() < 2e-3 * D


def momenta_about_centre(sim: sand.Simulation) -> float:
    """Angular momentum of equal discs about their centre of mass."""
    x, v = sim.positions - sim.positions.mean(0), sim.velocities - sim.velocities.mean(0)
    return float(M * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0] + 0.5 * R**2 * sim.spins).sum())


@pytest.mark.parametrize("name", SOLVERS)
def test_bonds_break_at_their_strength(name: str, tmp_path: Path) -> None:
    """A load let go on a spring swings to twice its weight: bonds of 2.2 weights hold one disc, not two. What broke stays broken, in a
    checkpoint too.
    """
    tops = [[0.1, 0.3, R, 0, 0], [0.2, 0.3, R, 0, 0]]
    chains = [[[0.1, 0.3 - 1.1 * D, R, 0, 0]], [[0.2, 0.3 - 1.1 * D, R, 0, 0], [0.2, 0.3 - 2.2 * D, R, 0, 0]]]
    grains = [{"positions": [tops[k], *chains[k]], "bonded": True} for k in range(2)]
    sim = bonded(grains, SOLVERS[name], gravity=(0, -G), bonds={"stiffness": 200.0, "damping": 0.0, "strength": 2.2})
    edit.hold(sim.world, np.flatnonzero(np.isin(sim.world.grains.id.to_numpy()[: sim.count], (0, 2))), np.zeros((2, 2)))
    sim.renew()
    sim.advance(0.1)
    assert sorted(map(tuple, ends_of(sim.world, 0).tolist())) == [(2, 3)]
    assert sorted(map(tuple, ends_of(sim.world, 1).tolist())) == [(0, 1), (3, 4)]
    assert sim.report()["bonds"] == 2 and sim.report()["bonds_broken"] == 1
    x = sim.positions
    assert x[3, 1] < 0.3 - 1.1 * D - 0.03 and x[1, 1] > 0.3 - 1.1 * D - 2.05 * D / 200
    sim.save(tmp_path / "state.npz")
    sim.advance(0.05)
    there = digest(sim)
    del sim
    again = sand.Simulation.resume(tmp_path / "state.npz", threads=1)
    again.advance(0.05)
    assert digest(again) == there


ALL_SOLVERS = {**SOLVERS, "verlet": {"kind": "md", "integrator": "velocity_verlet"}, "rk4": {"kind": "md", "integrator": "rk4"}}
BREAKING = {"soft": (1000.0, 50.0), "stiff": (1e5, 500.0), "weak": (2e4, 10.0)}
"""Stiffness [weights/d] and strength [weights]: at the step of the contacts omega h is 0.03 to 0.2, at that of the bonds 0.9."""


def parted(name: str, bond: tuple[float, float], fast: float, damping: float) -> tuple[float, bool, np.ndarray]:
    """Two discs that fly apart `fast` times as fast as breaks their bond, and on along x: the kinetic energy that is gone then, over
    S^2 / 2k, whether the bond holds, and the momentum gained over what there was.
    """
    stiffness, strength = bond
    energy = 0.5 * (strength * M * G) ** 2 / (stiffness * M * G / D)
    speed = fast * math.sqrt(2 * energy / (M / 2)) / 2
    rows = [[0.4 + 0.55 * sign * D, 0.5, R, sign * speed + 1.0, 0.5] for sign in (-1, 1)]
    values = {"stiffness": stiffness, "damping": damping, "strength": strength}
    sim = simulate([{"positions": rows, "bonded": True}], (1.0, 1.0), ALL_SOLVERS[name], effects={"bonds": values})
    start = sim.velocities
    period = 2 * math.pi / math.sqrt(stiffness * 2 * G / D)
    for _ in range(4):
        sim.advance_steps(math.ceil(period / 4 / sim.step) + 2)
    energies = [0.5 * M * (v**2).sum() for v in (start, sim.velocities)]
    holds = len(ends_of(sim.world, 1)) == 1
    return (energies[0] - energies[1]) / energy, holds, (sim.velocities - start).sum(0) / start.sum(0)


@pytest.mark.parametrize("name", ALL_SOLVERS)
def test_a_broken_bond_has_taken_its_energy(name: str) -> None:
    """S^2 / 2k, with all of the pull up to the strength S, is gone from the motion of two discs, at the step they have by themselves, from
    the slowest that breaks the bond to those that break it within a step; momentum stays. Slower ones do not break it.
    """
    for bond in BREAKING.values():
        for fast in (1.03, 1.1, 1.5, 3.0, 10.0, 30.0):
            taken, holds, gained = parted(name, bond, fast, 0.0)
            assert not holds and taken == pytest.approx(1.0, rel=0.01), (bond, fast)
            assert np.abs(gained).max() < 1e-12
        assert parted(name, bond, 0.97, 0.0)[1]


@pytest.mark.parametrize("name", SOLVERS)
def test_its_dashpot_has_taken_what_it_takes_until_then(name: str) -> None:
    """With a damping ratio of 0.1, beside the motion of two discs on a spring and a dashpot, integrated here in steps of 1e-4 / omega."""
    for bond in BREAKING.values():
        for fast in (1.5, 3.0, 10.0):
            x, v, h = 0.0, fast, 1e-4
            while x < 1:
                v -= h * (x + 0.2 * v)
                x += h * v
            assert parted(name, bond, fast, 0.1)[0] == pytest.approx(fast**2 - v**2, rel=0.12), (bond, fast)


@pytest.mark.parametrize("name", SOLVERS)
def test_torn_bonds_leave_heat(name: str) -> None:
    """Thirty bonded discs torn apart: motion, what bonds hold and heat add up; the heat is S^2 / 2k for each bond that broke."""
    stiffness, strength = 2000.0, 5.0
    values = {"stiffness": stiffness, "damping": 0.0, "strength": strength}
    solver = {"kind": name, "restitution": 1.0, "precision": 64}
    sim = simulate([HEXAGON], SIZE, solver, effects={"bonds": values, "heat": {}})
    energy = 0.5 * (strength * M * G) ** 2 / (stiffness * M * G / D)
    centre = sim.positions - sim.positions.mean(0)
    twist = sim.world.grains.twist.to_numpy()
    twist[: sim.count, :2] = 3.0 * centre[np.argsort(sim.world.grains.id.to_numpy()[: sim.count])]
    sim.world.grains.twist.from_numpy(twist)
    sim.renew()
    start = 0.5 * M * (sim.velocities**2).sum()
    sim.advance(0.05)
    report = sim.report()
    held = sim.world.links.held.to_numpy().sum()
    assert 10 < report["bonds_broken"] <= 69
    assert report["kinetic_energy_J"] + report["heat_J"] + held == pytest.approx(start, rel=1e-7)
    assert report["heat_J"] == pytest.approx(report["bonds_broken"] * energy, rel=0.1)


def test_bonds_in_the_window() -> None:
    """Switched off, on again after the grains have gone apart, and taken over by the other solver: no bond snaps, what broke is broken."""
    grains = [{"shape": "triangle", "positions": [[0.1, 0.1, R], [0.3, 0.1, R]], "bonded": True}]
    session = Session(sand.Scene(size=SIZE, grains=grains, gravity=(0, 0), effects={"bonds": {}}, solver={"kind": "md"}), threads=1)
    session.do(["effect", "bonds", False])
    twist = session.sim.world.grains.twist.to_numpy()
    twist[session.sim.world.grains.id.to_numpy() == 5] = [0.5, 0.0, 0.0, 0.0]
    session.sim.world.grains.twist.from_numpy(twist)
    session.sim.advance(0.05)
    session.do(["effect", "bonds", True])
    kept = [[0, 1], [0, 2], [1, 2], [3, 4]]
    assert session.message == "" and ends_of(session.sim.world, 1).tolist() == kept
    session.do(["solver", "rigid"])
    assert session.message == "" and ends_of(session.sim.world, 1).tolist() == kept
    session.sim.advance(0.05)
    assert session.sim.report()["speed_max_m_s"] == pytest.approx(0.5, rel=1e-4)


def test_wrong_bonds_are_told() -> None:
    grains = [{"shape": "fat", "radius": R, "count": 1, "bonded": True}]
    shapes = [{"name": "fat", "discs": [[0, 0, 1], [1, 0, 1]]}]
    with pytest.raises(
        SandError, match=r"grains\[0\]\.bonded = true cannot be had for shape = .fat.: its discs overlap, and would be pushed apart"
    ):
        sand.Scene(size=SIZE, grains=grains, shapes=shapes, effects={"bonds": {}})
    with pytest.raises(SandError, match=r"effects\.bonds: does not fit \[effects\.sleeping\]"):
        sand.Simulation(sand.Scene(size=SIZE, grains=[HEXAGON], effects={"bonds": {}, "sleeping": {}}), threads=1)
