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
    """B1: a bed without friction, sizes +-20 %, 15 d wide and 20 d deep, presses on the floor with its weight, to 1 %. It comes to rest:
    nobody is faster than 1e-3 sqrt(g d).
    """
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": 300, "fill": "lattice", "pitch": 1.25, "jitter": 0.1}]
    sim = simulate(grains, (15 * D, 40 * D), {"kind": kind, "restitution": 0.1, "precision": 32}, gravity=(0, -G), seed=4)
    sim.advance(3.0)
    weight = 2650 * math.pi * (sim.radii**2).sum() * G
    loads = []
    for _ in range(5):
        sim.advance(0.02)
        loads.append(sim.report()["floor_force_N"])
    assert np.mean(loads) == pytest.approx(weight, rel=0.01)
    sim.advance(1.5)
    assert np.hypot(*sim.velocities.T).max() < 1e-3 * math.sqrt(G * D)
    assert sim.report()["overlap_p99"] < 0.02 and sim.flags() == []


BOXES, WIDTH, HEIGHT = 10, 16.4 * D, 36 * D
LAYER, LAYERS = 14, 11
WALLS = [{"points": [[k * WIDTH, 0.0], [k * WIDTH, HEIGHT]]} for k in range(1, BOXES)]


def settle(rows: list[list[float]], seconds: float) -> list[list[float]]:
    """Rows x, y, radius, vx, vy, angle, spin after `seconds` in boxes side by side."""
    solver = {"kind": "rigid", "restitution": 0.1, "tolerance": 0.02, "precision": 32}
    grains = [{"positions": rows, "density": 1000.0}]
    sim = simulate(grains, (BOXES * WIDTH, HEIGHT), solver, gravity=(0, -G), walls=WALLS, mu=0.3)
    sim.advance(seconds)
    columns = (*sim.positions.T, sim.radii, *sim.velocities.T, 0 * sim.spins, sim.spins)
    return np.stack(columns, 1).tolist()


def all_at_once(radii: tuple[float, ...], seed: int = 1) -> list[list[float]]:
    """Random loose places all over the boxes, let fall together; the radii take turns."""
    random = np.random.default_rng(seed)
    rows: list[list[float]] = []
    for k in range(BOXES):
        box: list[list[float]] = []
        while len(box) < LAYER * LAYERS:
            radius = radii[len(box) % len(radii)]
            x, y = k * WIDTH + random.uniform(1.2 * R, WIDTH - 1.2 * R), random.uniform(1.2 * R, HEIGHT - 1.2 * R)
            if all(math.hypot(x - row[0], y - row[1]) > 1.02 * (radius + row[2]) for row in box):
                box.append([x, y, radius, 0, 0, 0, 0])
        rows += box
    return settle(rows, 3.0)


def layer_by_layer(seed: int = 1) -> list[list[float]]:
    """A layer of equal discs every 5 sqrt(d/g), each disc let fall from some diameters above the bed."""
    random = np.random.default_rng(seed)
    rows: list[list[float]] = []
    for layer in range(LAYERS):
        top = np.percentile([row[1] for row in rows], 99) if rows else 0.0
        for k in range(BOXES):
            for n in range(LAYER):
                x = k * WIDTH + (n + 0.5) * WIDTH / LAYER + random.uniform(-0.03, 0.03) * D
                rows.append([x, top + (2.5 + 2.2 * random.permutation(5)[0]) * D, R, 0, 0, 0, 0])
        rows = settle(rows, 5 * math.sqrt(D / G) if layer < LAYERS - 1 else 3.0)
    return rows


def order(rows: list[list[float]]) -> dict[str, np.ndarray]:
    """For each box: mean psi6 away from walls and surface, and the share of the bed that its largest crystal holds."""
    table = np.array(rows)
    boxes = [table[(table[:, 0] // WIDTH) == k] for k in range(BOXES)]
    found = [box_order(box[:, :2], box[:, 2]) for box in boxes]
    return {"psi6": np.array([psi for psi, _ in found]), "domain": np.array([share for _, share in found])}


def box_order(x: np.ndarray, r: np.ndarray) -> tuple[float, float]:
    """Neighbours are closer than 1.3 sums of the radii; a crystal: neighbours with psi6 > 0.7, turned by less than 5 degrees."""
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
    margin = 1.5 * D
    bulk = (x[:, 0] > x[:, 0].min() + margin) & (x[:, 0] < x[:, 0].max() - margin)
    bulk &= (x[:, 1] > margin) & (x[:, 1] < np.percentile(x[:, 1], 95) - margin)
    turn = np.angle(psi[pairs[:, 0]] * psi[pairs[:, 1]].conj()) / 6
    alike = (abs(turn) < math.radians(5)) & (abs(psi[pairs]) > 0.7).all(1)
    links = coo_matrix((np.ones(alike.sum()), pairs[alike].T), shape=(len(x), len(x)))
    _, domain = connected_components(links, directed=False)
    return float(abs(psi[bulk]).mean()), float(np.bincount(domain).max() / len(x))


@pytest.mark.slow
def test_slow_pouring_orders() -> None:
    """B13: equal discs poured at 0.2 layers per sqrt(d/g) are more ordered than those that fell all at once, and their crystals are
    larger, by more than two standard errors over ten boxes; discs of two sizes, 1 : 1.4, stay below 0.65.
    """
    slow, fast = order(layer_by_layer()), order(all_at_once((R,)))
    for key in ("psi6", "domain"):
        a, b = slow[key], fast[key]
        error = math.sqrt((a.var(ddof=1) + b.var(ddof=1)) / BOXES)
        assert a.mean() - b.mean() > 2 * error, (key, a, b)
    mixed = order(all_at_once((0.8 * R, 1.12 * R)))
    assert mixed["psi6"].mean() < 0.65
