"""What grains fall, are thrown and blown: stiffness (md) and step (rigid) follow the fastest, and go back when it is over."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import RHO, D, Disc, G, R, digest, simulate

import taichi_sand as sand

FLOOR = 0.02


def dropped(heights: list[float], solver: dict[str, Any], floor: bool = False, **keys: Any) -> Any:
    """Discs let fall from so many diameters above the floor, each on its own: the edge of the box, or a wall."""
    ground = FLOOR if floor else 0.0
    discs = [Disc(2 * D * (k + 1), ground + R + h * D) for k, h in enumerate(heights)]
    size = (2 * D * (len(heights) + 1), ground + (max(heights) + 4) * D)
    walls = [{"points": [[0.0, FLOOR], [size[0], FLOOR]]}] if floor else []
    return simulate(discs, size, {"precision": 32, **solver}, gravity=(0, -G), walls=walls, **keys)


def energies(sim: Any, ground: float) -> np.ndarray:
    """Energy of each disc over its mass and g [m], above the floor; the velocities are those amid the step before."""
    above, v = sim.positions[:, 1] - R - ground, sim.velocities[:, 1] - 0.5 * sim.step * G
    return above + v**2 / (2 * G)


@pytest.mark.parametrize("tolerance", [0.1, 0.02, 0.005])
@pytest.mark.parametrize("floor", [False, True])
def test_elastic_discs_keep_the_energy_of_their_fall(floor: bool, tolerance: float) -> None:
    """md, e = 1: from 1 to 100 d, every time that a disc flies its energy is that of the start within 1 %, and nobody is slowed down or
    put back; though each has its own height, and the others are in the middle of a bounce when contacts become stiffer.
    """
    heights = np.array([1.0, 3.0, 15.0, 40.0, 100.0])
    sim = dropped(heights.tolist(), {"kind": "md", "tolerance": tolerance, "restitution": 1.0}, floor)
    stiffest = sim.numbers["stiffness"]
    for _ in range(250):
        sim.advance(0.01)
        flying = sim.positions[:, 1] - R > (FLOOR if floor else 0.0)
        found = energies(sim, FLOOR if floor else 0.0) / (heights * D)
        assert found[flying] == pytest.approx(1.0, abs=0.01), (sim.time, found)
        stiffest = max(stiffest, sim.numbers["stiffness"])
    assert sim.flags() == []
    impact = 0.5 * sim.bed.mass * 2 * G * 100 * D / (tolerance * D**2)  # dents of sqrt(2 tolerance) d
    assert impact < stiffest < 3 * impact


def test_a_fall_that_is_over_costs_no_more(tmp_path: Path) -> None:
    """Inelastic discs fall 60 d and lie still: contacts are as soft as those that never fell; a checkpoint amid the fall goes on to the
    same bits, and so do pieces.
    """
    solver = {"kind": "md", "restitution": 0.3}
    sim = dropped([60.0, 60.0], solver)
    soft = sim.numbers["stiffness"]
    sim.advance(0.3)
    assert sim.numbers["stiffness"] > 3 * soft
    sim.save(tmp_path / "fall.npz")
    sim.advance(2.7)
    assert sim.numbers["stiffness"] == pytest.approx(soft) and sim.flags() == []
    assert np.abs(sim.velocities).max() < 1e-3 * math.sqrt(G * D) and sim.report()["overlap_max"] < 0.02
    final, steps = digest(sim), sim.steps
    del sim
    sim = sand.Simulation.resume(tmp_path / "fall.npz", threads=1)
    while sim.steps < steps:
        sim.advance_steps(min(777, steps - sim.steps))
    assert digest(sim) == final


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_light_discs_fly_as_fast_as_the_wind(kind: str) -> None:
    """Drag in a wind of 25 m/s: v' = b (u - v)^2, v = u b u t / (1 + b u t); and in still air a fall has its terminal speed."""
    density = 2.0
    drag = {"density": 1.2, "coefficient": 1.0, "wind_x": 25.0}
    rate = 0.5 * 1.2 * 2 * R / (density * math.pi * R**2)  # b [1/m]
    sim = simulate([Disc(0.1, 0.2, density=density)], (30.0, 0.4), {"kind": kind, "precision": 32}, effects={"drag": drag})
    sim.advance(1.0)
    assert sim.velocities[0, 0] == pytest.approx(25 * rate * 25 / (1 + rate * 25), rel=0.01)
    assert sim.flags() == []
    del sim
    still = {"drag": {"density": 1.2, "coefficient": 1.0}}
    discs = [Disc(0.1, 49.0, density=10.0)]
    sim = simulate(discs, (0.2, 50.0), {"kind": kind, "precision": 32}, gravity=(0, -G), effects=still)
    sim.advance(3.0)
    terminal = math.sqrt(2 * 10.0 * math.pi * R**2 * G / (1.2 * 2 * R))
    assert -sim.velocities[0, 1] == pytest.approx(terminal * math.tanh(3 * G / terminal), rel=0.01)
    assert sim.flags() == []


def test_a_bed_does_not_feel_that_contacts_become_stiffer_or_softer() -> None:
    """md: stiffness goes up nine times and back in a bed at rest with friction: it rises and sinks by what its overlaps change, and moves
    no faster than that.
    """
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": 100, "fill": "lattice", "pitch": 1.1}]
    sim = simulate(grains, (10 * D, 20 * D), {"kind": "md", "precision": 32}, gravity=(0, -G), mu=0.5)
    sim.advance(2.5)
    unit = math.sqrt(G * D)
    assert np.abs(sim.velocities).max() < 2e-3 * unit
    for tolerance in (0.02 / 9, 0.02):
        before = sim.positions
        sim.retune(sim.scene.model_copy(update={"solver": sim.scene.solver.model_copy(update={"tolerance": tolerance})}))
        fastest = 0.0
        for _ in range(40):
            sim.advance(0.1 / 40)
            fastest = max(fastest, float(np.abs(sim.velocities).max()))
        moved = np.abs(sim.positions - before).max()
        print(tolerance, fastest / unit, moved / D)
        assert fastest < 0.15 * unit and moved < 11 * 0.02 * D
        sim.advance(0.9)
        report = sim.report()
        assert 0.3 * tolerance < report["overlap_p99"] < tolerance and report["speed_max_m_s"] < 5e-3 * unit


def test_collisions_keep_their_energy_when_contacts_change() -> None:
    """md, e = 1, f64: pairs at every phase of a collision part as fast as they met, whether contacts become four times as stiff or as soft;
    but for the one at its deepest, which loses energy where they become stiffer.
    """
    speed, phases = 0.3, 16
    contact = math.pi * math.sqrt(2 * 0.02 / 2) * D / speed  # dents of sqrt(2 tolerance) d on a wall
    for tolerance in (0.005, 0.08):
        discs = []
        for k in range(phases):
            half = R + speed * (1.1 - k / phases) * contact
            discs += [Disc(14 * D * (k + 1) - half, 0.1, speed), Disc(14 * D * (k + 1) + half, 0.1, -speed)]
        sim = simulate(discs, (14 * D * (phases + 1), 0.2), {"kind": "md", "restitution": 1.0, "tolerance": 0.02})
        sim.advance(1.1 * contact)
        places = sim.positions[:, 0].reshape(-1, 2)
        assert np.count_nonzero(np.diff(places).ravel() < 0.99 * D) > 12
        stiffness = sim.numbers["stiffness"]
        sim.retune(sim.scene.model_copy(update={"solver": sim.scene.solver.model_copy(update={"tolerance": tolerance})}))
        assert sim.numbers["stiffness"] == pytest.approx(stiffness * 0.02 / tolerance)
        sim.advance(4 * contact)
        after = np.abs(sim.velocities[:, 0]) / speed
        assert after.max() < 1.01 and np.sort(after)[2:].min() > 0.99 and after.min() > 0.49, after


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_natural_time_is_what_counts(kind: str) -> None:
    """Grains of 10 µm, 1 cm and 100 m that fall and settle make the same number of steps in the same number of sqrt(d/g)."""
    steps = []
    for d in (1e-5, 1e-2, 1e2):
        grains = [{"radius": [0.4 * d, 0.6 * d], "count": 60, "fill": "lattice", "pitch": 1.2, "region": [0.0, 5 * d, 10 * d, 20 * d]}]
        sim = simulate(grains, (10 * d, 20 * d), {"kind": kind, "precision": 32}, gravity=(0, -G), mu=0.5)
        sim.advance(60 * math.sqrt(d / G))
        steps.append(sim.steps)
        report = sim.report()
        assert sim.flags() == [] and report["overlap_p99"] < 0.02 and report["speed_max_m_s"] < 0.02 * math.sqrt(G * d)
        del sim
    assert max(steps) < 1.03 * min(steps), steps


@pytest.mark.parametrize(("kind", "ratio", "seconds", "speed"), [("rigid", 1e6, 4.0, 1e-3), ("md", 1e4, 4.0, 0.05)])
def test_heavy_rests_on_light(kind: str, ratio: float, seconds: float, speed: float) -> None:
    """A disc 1e6 (md: 1e4) times as heavy falls on three that fill the floor, and on one between walls: overlaps within the tolerance.

    (md rocks on for some 10 s: the dashpot of a contact goes with the light mass, see the stress case.)
    """
    light = [Disc(R + k * D, R) for k in range(3)]
    heavy = Disc(1.6 * D, R + 2 * D, radius=1.5 * R, density=ratio * RHO / 1.5**2)
    sim = simulate([*light, heavy], (3 * D, 8 * D), {"kind": kind, "precision": 32}, gravity=(0, -G), mu=0.5)
    sim.advance(seconds)
    report = sim.report()
    assert report["overlap_max"] < 0.02 and report["speed_max_m_s"] < speed * math.sqrt(G * D) and sim.flags() == []


def slots(kind: str, tolerance: float) -> np.ndarray:
    """How far discs have sunk [d] that were laid on slots of 1 - 1.4, 1 - 0.5 times the share by which they wedge soft contacts apart.

    Pressed into a slot of (1 - a) d a disc of weight W pushes its corners aside with at most 1.09 k R a^(3/2), k = 2.3 W / (x d) from the
    tolerance x: it falls through below a = (0.8 x)^(2/3). Discs on the floor leave room in the table of wall contacts.
    """
    share = (0.8 * tolerance) ** (2 / 3)
    widths = [D * (1 - 1.4 * share), D * (1 - 0.5 * share)]
    middles, ends = (0.05, 0.15), [0.0]
    for middle, width in zip(middles, widths, strict=True):
        ends += [middle - width / 2, middle + width / 2]
    walls = [{"points": [[a, 0.05], [b, 0.05]]} for a, b in zip(ends[::2], [*ends[1::2], 0.2], strict=True)]
    discs = [Disc(m, 0.05 + math.sqrt(R**2 - w**2 / 4) + 1e-3 * D) for m, w in zip(middles, widths, strict=True)]
    discs += [Disc(0.01 + 0.02 * k, R) for k in range(10)]
    sim = simulate(discs, (0.2, 0.1), {"kind": kind, "tolerance": tolerance, "precision": 32}, gravity=(0, -G), walls=walls)
    sim.advance(1.0)
    assert sim.flags() == []
    return (0.05 - sim.positions[:2, 1]) / D


@pytest.mark.parametrize("tolerance", [0.02, 0.005, 0.0005])
@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_screens_cut_where_the_tolerance_says(kind: str, tolerance: float) -> None:
    """What falls through a slot is smaller than it by (0.8 x)^(2/3) at most: 6.3 % at 0.02, 0.54 % at 0.0005, the tightest there is."""
    stays, falls = slots(kind, tolerance)
    assert stays < 0 and falls > 0.5
