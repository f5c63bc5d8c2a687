"""Restitution belongs to the pair: on a floor, along a wall, in a row and in a corner discs bounce as they do in free flight."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import INERTIA, D, Disc, G, M, R, simulate

LENGTH, HEIGHT = 30 * D, 6 * D
"""Of a lane; each lies above the one before."""
SOLVERS = {"md": {"kind": "md"}, "rigid": {"kind": "rigid", "step": 1 / 1000}}
THRESHOLD = 0.3 * math.sqrt(G * D)
"""Slowest impact of rigid discs at this step [m/s]."""
SITUATIONS = {"side": ((), True), "pair": ((8.0,), False), "row": ((8.0, 9.0, 10.0, 11.0, 12.0), False), "corner": ((29.0,), True)}
"""Where other discs are at rest along the lane [D], and whether the side of the box is what is hit last."""


def lanes(solver: dict[str, Any], e: float, speeds: list[float]) -> tuple[Any, list[tuple[str, float, int, int]]]:
    """A disc thrown with each of the speeds in each situation, on the floor of a lane and, in the next lane, falling; on falls of D / 3 at
    most. Returns the simulation, and situation, speed, number of the thrown disc and of all discs of each lane.
    """
    discs, walls, rows = [], [], []
    for v in speeds:
        for name, (others, side) in SITUATIONS.items():
            for height in (0.0, 3 * D):
                floor = D + HEIGHT * len(rows)
                walls.append({"points": [[0.0, floor], [LENGTH, floor]]})
                rows.append((name, v, len(discs), 1 + len(others)))
                shift = R if side else 0.0  # the last disc of a corner touches the side
                first = (others[0] - 1) * D + shift if others else LENGTH - R
                discs.append(Disc(first - 0.01 * v - 1e-4, floor + R + height, v, 0.0))
                discs += [Disc(x * D + shift, floor + R + height, 0.0, 0.0) for x in others]
    size = (LENGTH, D + HEIGHT * len(rows))
    return simulate(discs, size, {**solver, "restitution": e}, gravity=(0, -G), walls=walls), rows


def alone(name: str, e: float) -> np.ndarray:
    """Velocities of the discs of a lane, over that of the one thrown: impacts one after the other, physics.md A2."""
    others, side = SITUATIONS[name]
    v = np.array([1.0, *[0.0] * len(others)])
    for _ in range(100):
        for i in range(len(v) - 1):
            if v[i] > v[i + 1]:
                change = 0.5 * (1 + e) * (v[i] - v[i + 1])
                v[i], v[i + 1] = v[i] - change, v[i + 1] + change
        if side and v[-1] > 0:
            v[-1] *= -e
    return v


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("e", [1.0, 0.5, 0.1])
def test_restitution_is_that_of_the_pair(name: str, e: float) -> None:
    """At twice the threshold, 1 and 3 m/s velocities after all impacts are those of free flight within 2 % of the speed; those of a side,
    of a pair, and of a row at restitution 1 (Newton's cradle on a floor), of one impact after another (md: a row bears the blow at once).
    A disc of restitution 1 that slides along a floor into the side comes back as fast.
    """
    sim, rows = lanes(SOLVERS[name], e, [2 * THRESHOLD, 1.0, 3.0])
    sim.advance(0.03)
    assert sim.flags() == []
    found = [sim.velocities[first : first + count, 0] / v for _, v, first, count in rows]
    for k in range(0, len(rows), 2):
        situation, v = rows[k][:2]
        assert found[k] == pytest.approx(found[k + 1], abs=0.02), (situation, v)
        if situation in ("side", "pair") or (name == "rigid" and (e == 1.0 and situation in ("row", "corner"))):
            assert found[k] == pytest.approx(alone(situation, e), abs=0.02), (situation, v)


@pytest.mark.parametrize("name", SOLVERS)
def test_a_wall_hits_a_disc_on_a_floor(name: str) -> None:
    """A wall at 1 m/s gives a disc of restitution 1 at rest on a floor 2 m/s."""
    wall = {"points": [[0.0, 2e-3], [0.0, 4 * D]], "velocity": [1.0, 0.0]}
    solver = {**SOLVERS[name], "restitution": 1.0}
    sim = simulate([Disc(3 * D, R, 0, 0)], (60 * D, 4 * D), solver, gravity=(0, -G), walls=[wall])
    sim.advance(3 * D)
    assert sim.velocities[0] == pytest.approx((2.0, 0.0), abs=0.02)


def test_slow_impacts_come_to_rest() -> None:
    """Rigid discs that meet one another in flight, or fall onto a floor, rebound with the restitution asked for above the threshold
    max(0.3 √(g d), 4 g h), and not at all below it, wherever in a step they meet. (What is compared with it is the velocity of the middle
    of a step, g h / 2 or an eighth of it off at most.)
    """
    h, e = 1 / 240, 0.7
    slowest, speeds, phases = max(THRESHOLD, 4 * G * h), (0.3, 0.6, 1.3, 2.0), 6
    discs, count = [], len(speeds) * phases
    for k in range(count):
        v, late = speeds[k // phases] * slowest, (0.1 + k % phases / phases) * h
        discs += [Disc(D * (3 * k + 2), 40 * D, v, 0.0), Disc(D * (3 * k + 3) + v * (2 * h + late), 40 * D, 0.0, 0.0)]
        discs.append(Disc(D * (3 * k + 2), R + v * late - G * late**2 / 2, 0.0, G * (late + h / 2) - v))
    sim = simulate(discs, (D * (3 * count + 4), 50 * D), {"kind": "rigid", "step": h, "restitution": e}, gravity=(0, -G))
    sim.advance_steps(2)
    v, y = sim.velocities[2::3, 1], sim.positions[2::3, 1]
    rebound = np.sqrt(np.maximum(0.0, v**2 + 2 * G * (y - R - v * h / 2)))  # as they part; v is of half a step before
    sim.advance_steps(4)
    parted = sim.velocities[1::3, 0] - sim.velocities[0::3, 0]
    for k in range(count):
        speed, expected = speeds[k // phases] * slowest, e if speeds[k // phases] > 1 else 0.0
        assert parted[k] / speed == pytest.approx(expected, abs=0.01), speed
        assert rebound[k] / speed == pytest.approx(expected, abs=0.02), speed


def test_spin_of_fast_impacts_on_a_floor() -> None:
    """Discs fall 50 d onto a rough floor, grazing, and reach it anywhere in a step: spin = r J / I, J = μ (1 + e) m v_n, within 1 %."""
    mu, e, count = 0.2, 0.1, 12
    heights = 50 * D + np.linspace(0.0, 1.3, count) * D
    discs = [Disc(D * (2 * k + 2), R + height, 12.0, 0.0) for k, height in enumerate(heights)]
    sim = simulate(discs, (600 * D, 60 * D), {"kind": "rigid", "restitution": e, "tolerance": 0.02}, gravity=(0, -G), mu=mu)
    spins = np.zeros(count)
    while sim.time < 0.5:
        sim.advance_steps(1)
        spins = np.where(spins == 0.0, sim.spins, spins)
    assert sim.flags() == []
    assert abs(spins) == pytest.approx(R * mu * (1 + e) * M * np.sqrt(2 * G * heights) / INERTIA, rel=0.01)


def test_impacts_that_give_energy_stay_bounded() -> None:
    """With a restitution of 1.5 and a friction that drives, round after round in a step: speeds stay numbers, and all grains in the box."""
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": 300, "fill": "lattice", "pitch": 1.2, "region": [0.0, 0.0, 30 * D, 20 * D]}]
    sim = simulate(grains, (30 * D, 40 * D), {"kind": "rigid", "tolerance": 0.01, "precision": 32}, gravity=(0, -G), mu=0.5)
    sim.advance(0.5)
    for key, value in (("solver.restitution", 1.5), ("effects.friction.mu", -0.5)):
        sim.set(key, value, unphysical=True)
    for _ in range(20):
        sim.advance(0.05)
        assert np.hypot(*sim.velocities.T).max() < 1000 * sim.numbers["speed_cap"]  # of the step at hand; the next one slows them down
    assert sim.count == 300 and not any("number" in flag for flag in sim.flags())
