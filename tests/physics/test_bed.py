"""Many grains: the weight on a floor (physics.md B1) and the order that slow pouring brings (B13)."""

import math

import numpy as np
import pytest
from helpers import D, G, R, simulate
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_frictionless_bed_gives_its_weight(kind: str) -> None:
    """B1: a bed without friction, sizes +-20 %, 15 d wide and 20 d deep, presses on the floor with its weight, to 1 %; sides aside."""
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": 300, "fill": "lattice", "pitch": 1.25, "jitter": 0.1}]
    sim = simulate(grains, (15 * D, 40 * D), {"kind": kind, "restitution": 0.1, "precision": 32}, gravity=(0, -G), seed=4)
    sim.advance(3.0)
    weight = 2650 * math.pi * (sim.radii**2).sum() * G
    loads = []
    for _ in range(5):
        sim.advance(0.02)
        loads.append(sim.report()["floor_force_N"])
    assert np.mean(loads) == pytest.approx(weight, rel=0.01)
    assert sim.flags() == []


BOXES, WIDTH, HEIGHT = 5, 22.4 * D, 60 * D


def pour(radii: tuple[float, ...], slowly: bool) -> list[dict[str, float]]:
    """Five boxes with differently placed grains, side by side in one simulation, filled all at once or through a slot of 3.6 d.

    Returns for each box the mean psi6 of the inside of its bed and the share of it that its largest crystal holds.
    """
    walls, grains = [], []
    for k in range(BOXES):
        left = k * WIDTH
        if k:
            walls.append({"points": [[left, 0.0], [left, HEIGHT]]})
        low = 0.0
        if slowly:
            low = 0.5 * HEIGHT
            middle, half = left + WIDTH / 2, 1.8 * D
            walls += [{"points": [[side, low + 4 * D], [middle + s * half, low - 4 * D]]} for side, s in ((left, -1), (left + WIDTH, 1))]
        region = [left + 0.1 * D, low + (6 * D if slowly else 0.1 * D), left + WIDTH - 0.1 * D, HEIGHT]
        grains += [{"radius": r, "count": 280 // len(radii), "region": region, "density": 1000.0} for r in radii]
    solver = {"kind": "rigid", "restitution": 0.1, "tolerance": 0.02, "precision": 32}
    sim = simulate(grains, (BOXES * WIDTH, HEIGHT), solver, gravity=(0, -G), walls=walls, mu=0.05, seed=8)
    sim.advance(6.0)
    assert np.hypot(*sim.velocities.T).mean() < 0.02 * math.sqrt(G * D)
    x, r = sim.positions, sim.radii
    inside = [(x[:, 0] > k * WIDTH) & (x[:, 0] < (k + 1) * WIDTH) & (x[:, 1] < 0.5 * HEIGHT) for k in range(BOXES)]
    return [order(x[member], r[member]) for member in inside]


def order(x: np.ndarray, r: np.ndarray) -> dict[str, float]:
    """Mean psi6 away from walls and surface, and the largest domain: neighbours that are turned by less than 5 degrees."""
    assert len(x) > 240
    pairs = cKDTree(x).query_pairs(1.3 * 2 * r.max(), output_type="ndarray")
    way = x[pairs[:, 1]] - x[pairs[:, 0]]
    near = np.hypot(*way.T) < 1.3 * (r[pairs[:, 0]] + r[pairs[:, 1]])
    pairs, way = pairs[near], way[near]
    sixth = np.exp(6j * np.arctan2(way[:, 1], way[:, 0]))
    total, count = np.zeros(len(x), complex), np.zeros(len(x))
    for end in (0, 1):
        np.add.at(total, pairs[:, end], sixth)
        np.add.at(count, pairs[:, end], 1)
    psi = total / np.maximum(count, 1)
    margin = 3 * r.mean() * 2
    bulk = (x[:, 0] > x[:, 0].min() + margin) & (x[:, 0] < x[:, 0].max() - margin)
    bulk &= (x[:, 1] > margin) & (x[:, 1] < np.percentile(x[:, 1], 90) - margin)
    turn = np.angle(psi[pairs[:, 0]] * psi[pairs[:, 1]].conj()) / 6
    alike = (abs(turn) < math.radians(5)) & (abs(psi[pairs]) > 0.7).all(1)
    links = coo_matrix((np.ones(alike.sum()), pairs[alike].T), shape=(len(x), len(x)))
    _, domain = connected_components(links, directed=False)
    return {"psi6": float(abs(psi[bulk]).mean()), "domain": float(np.bincount(domain).max() / len(x))}


def test_slow_pouring_orders() -> None:
    """B13: equal, slippery discs poured at 0.2 layers per sqrt(d/g) are more ordered than those that fell all at once: mean over five
    boxes by more than two standard errors, crystals too; discs of two sizes, 1 : 1.4, stay below 0.65 either way.
    """
    slow, fast = pour((R,), True), pour((R,), False)
    for key in ("psi6", "domain"):
        a, b = np.array([box[key] for box in slow]), np.array([box[key] for box in fast])
        error = math.sqrt((a.var(ddof=1) + b.var(ddof=1)) / BOXES)
        assert a.mean() - b.mean() > 2 * error, (key, a, b)
    mixed = pour((0.8 * R, 1.12 * R), True)
    assert np.mean([box["psi6"] for box in mixed]) < 0.65
