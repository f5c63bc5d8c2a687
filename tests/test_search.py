"""The neighbour list against all pairs, on random, clustered, edge and periodic sets; and that nothing is missed later on."""

import math

import numpy as np
import pytest
from helpers import PERIODIC, D, R, listed, simulate

from taichi_sand import SandError
from taichi_sand.world.search.cell_list import ROOM

SIZE = (0.4, 0.3)


def random_set(random: np.random.Generator) -> np.ndarray:
    return random.uniform(0, 1, (400, 2)) * SIZE


def clustered_set(random: np.random.Generator) -> np.ndarray:
    centres = random.uniform(0.1, 0.9, (5, 2)) * SIZE
    return np.clip(np.repeat(centres, 30, axis=0) + random.normal(0, 1.2 * D, (150, 2)), 0, SIZE)


def edge_set(random: np.random.Generator) -> np.ndarray:
    """On the edges and corners of the box, on multiples of the cell sizes met there, and two far apart."""
    along = np.linspace(0, 1, 40)
    sides = [np.stack([along, np.full(40, v)], 1) for v in (0.0, 1.0)] + [np.stack([np.full(40, v), along], 1) for v in (0.0, 1.0)]
    lattice = np.stack(np.meshgrid(np.arange(1, 20) / 20, np.arange(1, 12) / 12), -1).reshape(-1, 2)
    return np.vstack([*sides, lattice]) * SIZE


SETS = {"random": random_set, "clustered": clustered_set, "edge": edge_set}


def all_pairs(x: np.ndarray, r: np.ndarray, periodic: bool, within: float) -> set[tuple[int, int]]:
    """Brute force: pairs of discs whose gap is below `within` [m]."""
    way = x[:, None] - x[None]
    if periodic:
        way -= SIZE * np.round(way / SIZE)
    gap = np.hypot(way[..., 0], way[..., 1]) - r[:, None] - r[None]
    return {(int(i), int(j)) for i, j in np.argwhere(np.triu(gap < within, 1))}


def edge_pairs(x: np.ndarray, r: np.ndarray, within: float) -> set[tuple[int, int]]:
    """Brute force: pairs of discs and edges (0 left, 1 right, 2 bottom, 3 top)."""
    gaps = np.stack([x[:, 0], SIZE[0] - x[:, 0], x[:, 1], SIZE[1] - x[:, 1]], 1) - r[:, None]
    return {(int(i), int(k)) for i, k in np.argwhere(gaps < within)}


def check(sim, periodic: bool, within: float) -> None:
    """Every pair closer than `within` is listed, and none twice."""
    rows = listed(sim)
    pairs = [(min(c.first, c.second), max(c.first, c.second)) for c in rows if not c.wall]
    edges = [(c.first, c.second) for c in rows if c.wall]
    assert len(set(pairs)) == len(pairs) and len(set(edges)) == len(edges)
    x, r = sim.positions, sim.radii
    missed = all_pairs(x, r, periodic, within) - set(pairs)
    assert not missed
    if not periodic:
        assert not edge_pairs(x, r, within) - set(edges)


@pytest.mark.parametrize("periodic", [False, True])
def test_many_small_grains_beside_a_large_one(periodic: bool) -> None:
    """Cells that the largest grain makes wide hold hundreds of the others: more groups of them than there is room for at once."""
    small = D / 16
    heap = np.stack(np.meshgrid(*[0.2 + 1.1 * small * np.arange(24)] * 2), -1).reshape(-1, 2)
    large = np.stack(np.meshgrid(0.05 + 1.6 * D * np.arange(12), 0.05 + 1.6 * D * np.arange(5)), -1).reshape(-1, 2)
    rows = [[*place, small / 2, 0, 0] for place in heap] + [[*place, R, 0, 0] for place in (*large, heap[0] - R)]
    sim = simulate([{"positions": rows}], SIZE, {"kind": "rigid", "step": 1e-6}, edges=PERIODIC if periodic else {})
    sim.advance_steps(1)
    found = sim.world.grid.scratch.found.to_numpy()[: sim.count]
    assert found.max() > ROOM and sim.world.boulders == 0 and sim.flags() == []
    check(sim, periodic, 0.9 * float(sim.world.pace[None].skin))


@pytest.mark.parametrize("precision", [32, pytest.param(64, marks=pytest.mark.slow)])
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("name", SETS)
def test_search_lists_all_pairs(name: str, periodic: bool, precision: int) -> None:
    """At rest: all pairs within the skin, for discs of sizes 1 : 2, overlapping ones included."""
    random = np.random.default_rng(5)
    places = SETS[name](random)
    rows = [[*place, R * random.uniform(0.5, 1.0), 0, 0] for place in places]
    solver = {"kind": "rigid", "step": 1e-6, "precision": precision}
    sim = simulate([{"positions": rows}], SIZE, solver, edges=PERIODIC if periodic else {})
    start = sim.positions
    sim.advance_steps(1)
    assert sim.flags() == []
    way = np.abs(sim.positions - start)  # since the list build; what overlaps is pushed apart
    moved = float(np.hypot(*np.minimum(way, np.array(SIZE) - way).T).max())
    assert moved < 0.1 * float(sim.world.pace[None].skin)
    check(sim, periodic, 0.99 * float(sim.world.pace[None].skin) - 2 * moved)


@pytest.mark.parametrize("kind", ["md", "rigid"])
@pytest.mark.parametrize("periodic", [False, True])
def test_nothing_is_missed_later(periodic: bool, kind: str) -> None:
    """Fast discs, looked at after every few steps: whatever overlaps is listed, whatever is near an edge too."""
    random = np.random.default_rng(6)
    side = 16
    places = (np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2) + 0.5) / side * SIZE
    rows = []
    for place in places:
        angle, speed = random.uniform(0, 2 * math.pi), 10 ** random.uniform(-1, 1)
        rows.append([*place, R * random.uniform(0.5, 1.0), speed * math.cos(angle), speed * math.sin(angle)])
    solver = {"kind": "rigid", "step": 2e-4} if kind == "rigid" else {"kind": "md", "stiffness": 1e6, "step": 1e-5}
    sim = simulate([{"positions": rows}], SIZE, {**solver, "restitution": 1.0}, edges=PERIODIC if periodic else {})
    for _ in range(60):
        sim.advance_steps(7 if kind == "rigid" else 61)
        check(sim, periodic, 0.0)
        x = sim.positions
        assert periodic or (x.min() > 0 and (x < SIZE).all())
    assert sim.flags() == [] and sim.lost == 0


@pytest.mark.parametrize("gravity", [(0.0, 0.0), (0.0, -9.81)])
@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_lone_fast_disc_meets_the_walls(kind: str, gravity: tuple[float, float]) -> None:
    """A disc that flies alone, or many side by side, have no neighbours to search for, but walls ahead; lines too."""
    speed = 20.0
    rows = [[0.05 + 0.03 * k, 0.15, R, 0.0, -speed] for k in range(5)]
    wall = {"points": [[0.0, 0.05], [0.1, 0.05]]}
    solver = {"kind": "rigid", "step": 2e-4} if kind == "rigid" else {"kind": "md", "stiffness": 1e7, "step": 2e-6}
    sim = simulate([{"positions": rows}], SIZE, {**solver, "restitution": 1.0}, gravity=gravity, walls=[wall])
    for _ in range(100):
        sim.advance(0.5e-3)
        x = sim.positions
        assert (x > 0).all() and (x < SIZE).all()
        assert (x[x[:, 0] < 0.1, 1] > 0.05).all()
    assert sim.flags() == []
    del sim
    single = simulate([{"positions": rows[:1]}], SIZE, {**solver, "restitution": 1.0}, gravity=gravity, walls=[wall])
    single.advance(0.05)
    assert single.flags() == [] and single.positions[0, 1] > 0.05


def test_a_crowd_finds_room() -> None:
    """A hundred discs in one place have 25 times as many pairs as the table was made for: it grows, and none is missed."""
    random = np.random.default_rng(7)
    rows = [[*(np.array([0.2, 0.15]) + random.normal(0, 0.1 * D, 2)), R, 0, 0] for _ in range(100)]
    sim = simulate([{"positions": rows}], SIZE, {"kind": "rigid"})
    for _ in range(3):
        sim.advance_steps(1)
        check(sim, False, 0.0)
    assert sim.flags() == [] and len(listed(sim)) > 4000


def pair_forces(sim) -> dict[tuple[int, int], tuple[float, float]]:
    """Normal and tangential force of every pair of discs that carries one, by the ids of its discs."""
    w = sim.world
    rows = slice(w.blocks.pair_start[0], w.blocks.pair_end[0])
    ids, force = w.grains.id.to_numpy(), w.pairs.force.to_numpy()[rows]
    ends = np.sort(ids[np.stack([w.pairs.first.to_numpy()[rows], w.pairs.second.to_numpy()[rows]], 1)], axis=1)
    return {(int(a), int(b)): (float(n), float(t)) for (a, b), (n, t) in zip(ends, force, strict=True) if n > 0}


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_forces_follow_their_pairs(kind: str) -> None:
    """A list build between two steps changes no pair's force: what is reported and drawn is what the pairs carried."""
    random = np.random.default_rng(8)
    places = np.stack(np.meshgrid(np.arange(12) + 0.6, np.arange(12) + 0.6), -1).reshape(-1, 2) * 1.05 * D
    rows = [[*p, R * random.uniform(0.8, 1.0), *random.uniform(-0.2, 0.2, 2)] for p in places]
    sim = simulate([{"positions": rows}], SIZE, {"kind": kind}, gravity=(0, -9.81), mu=0.3)
    list_builds = 0
    for _ in range(6):
        sim.advance(0.05)
        before = pair_forces(sim)
        assert len(before) > 20
        sim.world.pace[None].spent = 1
        sim.advance_steps(0)
        assert pair_forces(sim) == before
        list_builds += 1
    assert sim.world.pace[None].list_builds > list_builds


def test_short_periodic_box_is_refused() -> None:
    """Where the widest cells fit less than three times, two discs would be neighbours twice: refused, with the length needed."""
    with pytest.raises(SandError, match="too short for a box periodic along x"):
        simulate([{"positions": [[0.02, 0.02, R, 0, 0]]}], (0.04, 0.3), {"kind": "rigid"}, edges={"left": "periodic", "right": "periodic"})
