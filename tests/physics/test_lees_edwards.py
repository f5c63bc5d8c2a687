"""Boxes whose images slide (Lees and Edwards 1972): nothing tells where the box is cut, and shear is what it is between walls."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import D, R, digest, fresh_taichi, simulate

import taichi_sand as sand
from taichi_sand.measure.flowing import shear
from taichi_sand.measure.named import inertial_number, shear_friction

KINDS = ("md", "rigid")
SIZE = np.array([16 * D, 12 * D])
EDGES = dict.fromkeys(("left", "right", "bottom", "top"), "periodic")


def box(kind: str, rate: float, rows: np.ndarray, **keys: Any) -> Any:
    """Discs x, y, radius, vx, vy, a row each, with velocities beside those of the flow that is at rest in the middle of the box."""
    return simulate([{"positions": rows.tolist()}], SIZE, {"kind": kind, **keys}, edges={**EDGES, "shear_rate": rate}, mu=0.3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rate", [2.0, -3.0])
def test_an_impact_over_the_edge(kind: str, rate: float) -> None:
    """Two discs meet head-on in the middle of the box, or over its edge, where the image above has slid by then: what they do to one
    another is the same, and in the laboratory their velocities differ by those of the flow where the pair is.
    """
    speed, wait = 0.5, 0.05
    found = []
    for shift in (0.0, 0.5 * SIZE[1]):
        apart = speed * wait + R
        rows = np.array([[0.5 * SIZE[0], 0.5 * SIZE[1] - apart, R, 0.0, speed], [0.5 * SIZE[0], 0.5 * SIZE[1] + apart, R, 0.0, -speed]])
        rows[1, 0] -= 2 * rate * apart * wait  # which the flow makes up for
        rows[:, 1] = (rows[:, 1] + shift) % SIZE[1]
        sim = box(kind, rate, rows, restitution=0.8, **({"step": 1e-4} if kind == "rigid" else {}))
        before = sim.velocities.copy()
        assert before[1, 0] - before[0, 0] + (rate * SIZE[1] if shift else 0.0) == pytest.approx(2 * rate * apart)
        sim.advance(2.5 * wait)
        found.append(sim.velocities[1] - sim.velocities[0] + ((rate * SIZE[1], 0.0) if sim.positions[1, 1] < sim.positions[0, 1] else 0.0))
        assert sim.spins == pytest.approx(np.full(2, sim.spins[0]), rel=1e-6) and sim.flags() == []
    assert found[1] == pytest.approx(found[0], abs=1e-4 * speed)
    assert found[0][1] > 0.5 * speed


@pytest.mark.parametrize("kind", KINDS)
def test_it_does_not_matter_where_the_box_is_cut(kind: str) -> None:
    """A gas of hard grains in shear, and the same moved up by 0.37 and to the right by 0.21 of the box, with the flow's velocity there:
    after many impacts, those over edges too, all are where the others are, moved on by the flow.
    """
    rate, until, rng = 3.0, 0.12, np.random.default_rng(3)
    places = np.array([[x, y] for x in np.arange(1, 16, 2) for y in np.arange(1, 12, 2)]) * D + rng.uniform(-0.2, 0.2, (48, 2)) * D
    velocities = rng.uniform(-0.4, 0.4, (48, 2))
    move = np.array([0.21, 0.37]) * SIZE
    found = []
    for shift in (np.zeros(2), move):
        moved = places + shift
        turns = np.floor(moved[:, 1] / SIZE[1])
        moved[:, 1] -= turns * SIZE[1]  # at time 0 images lie straight above one another
        moved[:, 0] %= SIZE[0]
        rows = np.column_stack([moved, np.full(48, R), velocities])
        sim = box(kind, rate, rows, restitution=0.8, **({"step": 2e-4} if kind == "rigid" else {"stiffness": 2e5, "step": 1e-5}))
        sim.advance(until)
        assert sim.flags() == []
        found.append((sim.positions, sim.velocities, sim.time))
    (one, speeds, time), (other, _, _) = found
    off = speeds - np.stack([rate * (one[:, 1] - SIZE[1] / 2), np.zeros(48)], axis=1)
    assert (off**2).sum() < 0.9 * (velocities**2).sum()  # they have met
    way = other - one - move - (rate * move[1] * time, 0.0)
    slid = rate * SIZE[1] * time
    turns = np.round(way[:, 1] / SIZE[1])
    way -= np.stack([turns * slid, turns * SIZE[1]], axis=1)
    way[:, 0] -= np.round(way[:, 0] / SIZE[0]) * SIZE[0]
    bar = 1e-6 if kind == "md" else 1e-3
    assert np.abs(way).max() < bar * D


@pytest.mark.parametrize("kind", KINDS)
def test_free_flight_in_shear(kind: str) -> None:
    """A single disc keeps its velocity in space; each time it leaves above it comes in below, slower by γ̇ H and shifted by γ̇ H t."""
    rate = 2.0
    sim = box(kind, rate, np.array([[*(0.5 * SIZE), R, 0.1, 0.9], [0.1 * SIZE[0], 0.5 * SIZE[1], R, 0.0, 0.9]]))
    for _ in range(6):
        sim.advance(0.1)
        height = 0.5 * SIZE[1] + 0.9 * sim.time
        times = np.array([(k * SIZE[1] + 0.5 * SIZE[1]) / 0.9 for k in range(1 + math.floor(height / SIZE[1]))])
        times = times[times < sim.time]
        gone = 0.5 * SIZE[0] + 0.1 * sim.time - (rate * SIZE[1] * sim.time) * len(times)
        way = sim.positions[0] - (gone, height - len(times) * SIZE[1])
        way -= np.round(way / SIZE) * SIZE
        if abs(height / SIZE[1] - round(height / SIZE[1])) > 0.1:  # it comes in with the next list
            assert np.abs(way).max() < 1e-6
            assert sim.velocities[0] == pytest.approx([0.1 - rate * SIZE[1] * len(times), 0.9], abs=1e-9)


def sheared(kind: str, rate: float, fill: float, seed: int = 1) -> sand.Simulation:
    """400 discs as those of da Cruz et al. (2005) in a box of 20 d whose images slide, filled to this packing fraction."""
    fresh_taichi()
    radii, count = (0.0016, 0.0024), 400
    area = math.pi * (radii[0] ** 2 + radii[0] * radii[1] + radii[1] ** 2) / 3
    width = 0.08
    size = [width, count * area / fill / width]
    table = {"size": size, "gravity": [0.0, 0.0], "seed": seed, "edges": {**EDGES, "shear_rate": rate}}
    grains = [{"radius": list(radii), "count": count, "fill": "random"}]
    solver = {"kind": kind, "tolerance": 0.005, "restitution": 0.1}
    return sand.Simulation(sand.Scene(**table, grains=grains, solver=solver, effects={"friction": {"mu": 0.4}}), threads=1)


@pytest.mark.parametrize("kind", KINDS)
def test_it_goes_on_from_a_checkpoint(kind: str, tmp_path: Path) -> None:
    """To the same bits; what is measured of it is within the box, and its mean stress is symmetric, as no torque acts from outside."""
    sim = sheared(kind, 2.4, 0.7)
    sim.advance(0.3)
    sim.save(tmp_path / "state.npz")
    other = sand.Simulation.resume(tmp_path / "state.npz")
    for one in (sim, other):
        one.advance(0.2)
    assert digest(sim) == digest(other)
    rate, stress, _ = shear(sim)
    assert rate == pytest.approx(2.4, rel=0.35) and stress[0, 1] < 0
    point = sim.contacts()["point"]
    assert len(point) and ((point >= 0) & (point <= sim.scene.size)).all()


LAW = (0.25, 1.1)
"""μ(I) = 0.25 + 1.1 I of discs ± 20 %, friction 0.4 and restitution 0.1 (da Cruz et al. 2005)."""


def flow(sim: sand.Simulation, strain: float, rate: float) -> tuple[float, float]:
    """Mean I and μ of a flow over so much strain, after as much again."""
    sim.advance(strain / rate)
    rows = []
    for _ in range(100):
        sim.advance(0.01 * strain / rate)
        rows.append((inertial_number(sim), shear_friction(sim)))
    return tuple(np.mean(rows, axis=0))


@pytest.mark.slow
def test_shear_between_walls_and_images_obeys_one_law() -> None:
    """Between rough walls (the scene `shear_cell`) and in a box whose images slide: μ of the published law within 10 %, and that of the
    other within 5 %, at the I of each.
    """
    fresh_taichi()
    walls = sand.Simulation(sand.load("shear_cell"), threads=1)
    rate = 0.29 / 0.12
    found = {"walls": flow(walls, 8.0, rate)}
    for kind in KINDS:
        found[kind] = flow(sheared(kind, rate, 0.78), 8.0, rate)
    print(found)
    over = {name: mu / (LAW[0] + LAW[1] * number) for name, (number, mu) in found.items()}
    assert all(abs(ratio - 1) < 0.1 for ratio in over.values()), over
    assert all(abs(over[kind] / over["walls"] - 1) < 0.05 for kind in KINDS), over


def test_what_is_wrong_with_shear() -> None:
    table = {"size": [0.2, 0.2], "edges": {**EDGES, "shear_rate": 1.0}, "grains": [{"radius": 0.005, "count": 20}]}
    for said, keys in {
        "needs four edges that are periodic": {"edges": {"shear_rate": 1.0}},
        r"does not go with \[\[walls\]\]": {"walls": [{"points": [[0.0, 0.0], [0.1, 0.1]]}]},
        r"does not go with \[effects.sleeping\]": {"effects": {"sleeping": {}}},
    }.items():
        with pytest.raises(sand.SandError, match=said):
            sand.Scene(**{**table, **keys})
    with pytest.raises(sand.SandError, match="too short for a box periodic along x"):
        sand.Simulation(sand.Scene(**{**table, "size": [0.04, 0.2], "grains": [{"radius": 0.005, "count": 5}]}))
