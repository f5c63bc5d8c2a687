"""Walls with `force`: without `mass` they press with exactly that force, with one they obey Newton (a = (F - P) / M), never faster than
their `velocity`."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import OPEN, D, G, M, R, listed, simulate

KINDS = ("rigid", "md")
COLUMNS, ROWS = 6, 4
TOP = D + (ROWS - 1) * R * math.sqrt(3)
BED = [[(2 * k + 1 + row % 2) * R, R + row * R * math.sqrt(3), R] for row in range(ROWS) for k in range(COLUMNS - row % 2)]
WEIGHT = len(BED) * M * G


def lid_on_bed(kind: str, force: float, speed: float, mass: float | None = None) -> Any:
    """A lid that has 0.15 s to go before it meets a bed of discs, which has come to rest by then."""
    at = TOP + 0.15 * speed
    wall = {"points": [[0.0, at], [COLUMNS * D, at]], "velocity": [0.0, -speed], "force": force, "mass": mass}
    return simulate([{"positions": BED}], (COLUMNS * D, 0.4), {"kind": kind}, gravity=(0.0, -G), walls=[wall])


def loads(sim: Any, until: float, start: float = 0.12) -> np.ndarray:
    """Rows of time and of what the floor bears beyond the weight [N], in every few steps from `start` on."""
    rows = []
    sim.advance(start)
    stride = max(1, round(2.5e-4 / sim.step))
    while sim.time < until:
        sim.advance_steps(stride)
        rows.append((sim.time, sim.report()["floor_force_N"] - WEIGHT))
    return np.array(rows)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("force", [0.005, 0.5, 20.0])
@pytest.mark.parametrize("speed", [0.02, 2.0])
def test_lids_without_mass_press_with_their_force(kind: str, force: float, speed: float) -> None:
    """A force F that is put on at once is borne twice at the first swing, and F at rest; the lid brings no momentum with it."""
    force *= WEIGHT
    sim = lid_on_bed(kind, force, speed)
    found = loads(sim, 0.45)
    assert np.abs(found[:, 1]).max() < 2.2 * force
    sim.advance(0.3)
    assert sim.report()["floor_force_N"] - WEIGHT == pytest.approx(force, rel=0.01)
    assert sim.report()["overlap_max"] < 0.03 and sim.flags() == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_light_lid_on_a_bed_without_friction(kind: str) -> None:
    """2 N on 200 discs that weigh 409 N: the floor bears twice that beyond the weight at most once the bed has settled, and 2 N at rest,
    within 2 % of it. What rests without friction rests on the shape of its contacts alone.
    """
    grains = [{"radius": [0.0045, 0.0055], "fill": "hexagonal", "region": [0.0, 0.0, 0.2, 0.12], "count": 200}]
    lid = {"points": [[0.0, 0.2], [0.2, 0.2]], "velocity": [0.0, -0.2], "force": 2.0}
    sim = simulate(grains, (0.2, 0.4), {"kind": kind, "tolerance": 0.02}, gravity=(0, -G), walls=[lid], seed=3)
    sim.advance(3.4)
    beyond = []
    for _ in range(20):
        sim.advance(0.005)
        beyond.append(sim.report()["floor_force_N"] - sim.report()["mass_kg"] * G)
    assert beyond == pytest.approx([2.0] * 20, rel=0.02)
    assert sim.report()["overlap_p99"] < 0.02 and sim.flags() == []


SHAKEN = {"points": [[0.0, 0.015], [COLUMNS * D, 0.015]], "shake": {"amplitude": [0.0, 0.003], "frequency": 15.0}}


def pushed(at: float, speed: float, force: float) -> dict[str, Any]:
    """A lid at this height, without mass."""
    return {"points": [[0.0, at], [COLUMNS * D, at]], "velocity": [0.0, speed], "force": force}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("share", "gravity", "other"),
    [(5.0, G, None), (5.0, G, SHAKEN), (0.05, G, SHAKEN), (5.0, 0.0, pushed(0.01, 0.3, 5.0 * WEIGHT))],
    ids=["jammed bed", "shaken", "light and shaken", "from both sides"],
)
def test_lids_press_with_their_force_whatever_goes_on(kind: str, share: float, gravity: float, other: Any) -> None:
    """On a bed that lies, is shaken with 2.7 g, or is pushed from below too: never more than their force; now and then less, where the
    bed falls away from them faster than they may follow.
    """
    force = share * WEIGHT
    walls = [pushed(0.2, -1.0, force), *([other] if other else [])]
    grains = [{"radius": [0.9 * R, 1.1 * R], "count": len(BED), "region": [0.0, 0.02, COLUMNS * D, 0.12]}]
    sim = simulate(grains, (COLUMNS * D, 0.4), {"kind": kind, "tolerance": 0.02}, gravity=(0.0, -gravity), walls=walls, mu=0.5, seed=2)
    sim.advance(1.0)
    presses = []
    for _ in range(120):
        sim.advance_steps(3)
        presses.append(float(sim.wall_forces()["force"][0, 1]) / force)
    assert max(presses) < 1.002 and np.mean(presses) > 0.98
    assert sim.flags() == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mass", [0.05, 2.0])
def test_lids_with_mass_bring_their_momentum(kind: str, mass: float) -> None:
    """v sqrt(k M) + 2 F is the most that a spring k bears of a mass M that comes at v and is pushed by F. At rest it is F."""
    force, speed, mass = 5 * WEIGHT, 0.5, mass * WEIGHT / G
    sim = lid_on_bed(kind, force, speed, mass)
    found = loads(sim, 0.45)
    constants = sim.solver.constants[None]
    k = constants.stiffness if kind == "md" else M * (math.tau * 0.25 / sim.step) ** 2
    assert force < np.abs(found[:, 1]).max() < speed * math.sqrt(k * mass) + 2 * force
    sim.advance(0.3)
    assert sim.report()["floor_force_N"] - WEIGHT == pytest.approx(force, rel=0.01)


def flight(kind: str, disc: list[float], restitution: float, **keys: Any) -> Any:
    """One disc without gravity below a lid that runs down at 0.5 m/s at most."""
    lid = {"points": [[0.02, 0.5], [0.18, 0.5]], "velocity": [0.0, -0.5], **keys}
    return simulate([{"positions": [disc]}], (0.2, 1.0), {"kind": kind, "restitution": restitution}, walls=[lid], edges=OPEN)


def lid_speed(sim: Any) -> float:
    """How fast the lid runs down [m/s]."""
    return 0.5 * float(sim.world.movers.rate[0])


@pytest.mark.parametrize("kind", KINDS)
def test_lids_in_free_flight(kind: str) -> None:
    """With mass v = F t / M up to its velocity, without at once."""
    sim = flight(kind, [0.1, 0.1, R], 0.5, force=2.0, mass=0.8)
    sim.advance(0.1)
    assert lid_speed(sim) == pytest.approx(2.0 / 0.8 * sim.time, rel=0.01)
    sim.advance(0.2)
    assert lid_speed(sim) == pytest.approx(0.5)
    sim = flight(kind, [0.1, 0.1, R], 0.5, force=2.0)
    sim.advance(0.01)
    assert lid_speed(sim) == pytest.approx(0.5)


@pytest.mark.parametrize("kind", KINDS)
def test_one_grain_in_flight_feels_just_the_force(kind: str) -> None:
    """Without mass: a disc thrown against the lid at 0.3 m/s, with any restitution, is slowed by F / m, turned, and ends at its speed."""
    force = 0.2
    sim = flight(kind, [0.1, 0.49 - R, R, 0.0, 0.3], 1.0, force=force)
    meets = 0.01 / 0.8
    for _ in range(4):
        sim.advance(0.15)
        assert sim.velocities[0, 1] == pytest.approx(0.3 - force / M * (sim.time - meets), abs=0.01)
    sim.advance(0.6)
    assert sim.velocities[0, 1] == pytest.approx(-0.5, rel=0.02)
    assert lid_speed(sim) <= 0.5 * (1 + 1e-6)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_one_grain_hits_a_lid_with_mass(kind: str, restitution: float) -> None:
    """Two masses: u' = u - (1 + e) M / (m + M) u of the disc, V' = (1 + e) m / (m + M) u of the lid."""
    u, mass = 0.4, 4 * M
    sim = flight(kind, [0.1, 0.49 - R, R, 0.0, u], restitution, force=1e-6, mass=mass)
    sim.advance(0.06)
    bar = 1e-4 if kind == "rigid" else 0.03
    assert sim.velocities[0, 1] == pytest.approx(u - (1 + restitution) * mass / (M + mass) * u, abs=bar * u)
    assert lid_speed(sim) == pytest.approx(-(1 + restitution) * M / (M + mass) * u, abs=bar * u)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mass", [None, 0.5])
def test_two_lids_press_from_both_sides(kind: str, mass: float | None) -> None:
    """Without gravity a row of discs between two lids that push with 3 N each comes to rest and bears 3 N."""
    discs = [[0.1 + (2 * k - 4) * (R + 1e-4), 0.1, R] for k in range(5)]
    lids = [{"points": [[x, 0.05], [x, 0.15]], "velocity": [v, 0.0], "force": 3.0, "mass": mass} for x, v in ((0.03, 0.2), (0.17, -0.2))]
    sim = simulate([{"positions": discs}], (0.2, 0.2), {"kind": kind}, walls=lids)
    sim.advance(1.0)
    borne = [float(contact.force[0]) for contact in listed(sim) if contact.force[0] > 0.01 * 3.0]
    assert len(borne) == 6 and borne == pytest.approx([3.0] * 6, rel=0.01)
    assert np.abs(sim.velocities).max() < 0.01
