"""What is measured of each grain for its colour, against NumPy and against arithmetic by hand."""

import math

import numpy as np
import pytest
from view_world import start_taichi, world_of

from taichi_sand.measure import structure
from taichi_sand.world.tables import World

D = 0.02


@pytest.fixture(autouse=True)
def taichi() -> None:
    start_taichi()


def measured(measure, world: World) -> np.ndarray:
    """In the order of the slots, which in these worlds is that of the grains."""
    out = np.full(world.capacity, np.nan, np.float32)
    measure(world, out)
    return out[: world.count[None]]


def hexagonal(columns: int, rows: int) -> np.ndarray:
    """Places of a hexagonal lattice of pitch D in the unit box."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    return np.stack([(x + 0.5 * (y % 2) + 0.75) * D, (y * math.sqrt(0.75) + 0.75) * D], -1).reshape(-1, 2)


def brute_order(places: np.ndarray, radius: np.ndarray, period: tuple[float, float] | None = None) -> np.ndarray:
    way = places[None] - places[:, None]
    if period:
        way -= np.array(period) * np.round(way / period)
    distance = np.hypot(way[..., 0], way[..., 1])
    near = (distance < structure.NEAR * (radius[:, None] + radius[None])) & ~np.eye(len(places), dtype=bool)
    sixth = np.where(near, np.exp(6j * np.arctan2(way[..., 1], way[..., 0])), 0).sum(1)
    count = near.sum(1)
    return np.where(count >= structure.FEWEST_NEIGHBOURS, np.abs(sixth) / np.maximum(count, 1), 0.0)


def inner(places: np.ndarray) -> np.ndarray:
    """Grains more than two diameters from the rim of the set."""
    low, high = places.min(0) + 2 * D, places.max(0) - 2 * D
    return ((places > low) & (places < high)).all(1)


def test_order_of_a_hexagonal_crystal_is_1() -> None:
    places = hexagonal(20, 20)
    order = measured(structure.order, world_of(places, D / 2))
    assert order[inner(places)] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(("jitter", "expected"), [(0.02, 0.987), (0.05, 0.923)])
def test_order_of_a_jittered_crystal(jitter: float, expected: float) -> None:
    """physics.md B13."""
    places = hexagonal(45, 50)
    moved = places + np.random.default_rng(1).normal(0, jitter * D, places.shape)
    order = measured(structure.order, world_of(moved, D / 2))
    assert order[inner(places)].mean() == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("spread", [1.0, 2.5])
def test_order_equals_brute_force(periodic: bool, spread: float) -> None:
    random = np.random.default_rng(8)
    size = (0.3, 0.25)
    places = random.uniform(0, 1, (600, 2)) * size
    radius = random.uniform(1 / spread, 1.0, 600) * 0.006
    world = world_of(places, radius, size, periodic=(periodic, periodic))
    expected = brute_order(places, radius, size if periodic else None)
    assert measured(structure.order, world) == pytest.approx(expected, abs=2e-3)
    assert (expected == 0).any() and (expected > 0.5).any()


def test_order_in_a_box_few_grains_wide_counts_nobody_twice() -> None:
    size = (0.11, 0.11)
    places = np.random.default_rng(2).uniform(0, 0.11, (40, 2))
    world = world_of(places, 0.01, size, periodic=(True, True))
    assert measured(structure.order, world) == pytest.approx(brute_order(places, np.full(40, 0.01), size), abs=2e-3)


def test_few_neighbours_make_no_order() -> None:
    assert (measured(structure.order, world_of([(0.5, 0.5), (0.5 + D, 0.5)], D / 2)) == 0).all()


def test_two_grains_in_one_place_do_no_harm() -> None:
    assert np.isfinite(measured(structure.order, world_of([(0.5, 0.5)] * 5, D / 2))).all()


def test_speed_energy_and_orientation() -> None:
    world = world_of([(0.2, 0.2), (0.5, 0.5)], 0.1, velocity=[(3, -4), (0, 0)], spin=[0, -2], angle=[math.pi / 2, -math.pi / 2])
    assert measured(structure.speed, world) == pytest.approx([5, 0])
    assert measured(structure.energy, world) == pytest.approx([0.5 * 2 * 25, 0.5 * 4 * 4])
    assert measured(structure.orientation, world) == pytest.approx([0.25, 0.75], abs=1e-6)


def test_fixed_grains_have_no_energy() -> None:
    assert measured(structure.energy, world_of([(0.2, 0.2)], 0.1, velocity=[(3, 4)], fixed=[0])) == pytest.approx([0])


def test_force_and_pressure_sum_what_pushes() -> None:
    """A middle grain between two others and on a wall; a pulling contact does not count."""
    places = [(0.2, 0.1), (0.4, 0.1), (0.6, 0.1)]
    world = world_of(places, 0.1, pairs=[(0, 1, 3.0), (1, 2, -7.0)], wall_pairs=[(1, (0.0, -1.0), 0.0, 5.0)])
    assert measured(structure.force, world) == pytest.approx([3, 8, 0])
    assert measured(structure.pressure, world) == pytest.approx(np.array([3, 8, 0]) / (2 * math.pi * 0.1))


def test_pressure_of_a_square_under_load() -> None:
    """A grain squeezed with P from four sides: mean stress is sum(f r) / (2 A)."""
    around = [(0.3, 0.5), (0.7, 0.5), (0.5, 0.3), (0.5, 0.7)]
    world = world_of([(0.5, 0.5), *around], 0.1, pairs=[(0, k, 10.0) for k in range(1, 5)])
    assert measured(structure.pressure, world)[0] == pytest.approx(4 * 10 * 0.1 / (2 * math.pi * 0.1**2))


def test_forces_of_a_resting_stack_carry_its_weight() -> None:
    """The engine's own forces: the lowest of n discs carries n m g below and (n - 1) m g above."""
    import taichi_sand as sand

    n, radius = 4, 0.01
    rows = [[0.05, (2 * k + 1) * radius, radius] for k in range(n)]
    scene = sand.Scene(size=(0.1, 0.2), grains=[{"positions": rows}], solver={"kind": "md", "restitution": 0.1})
    sim = sand.Simulation(scene)
    sim.advance(1.0)
    weight = 2650 * math.pi * radius**2 * 9.81
    out = np.zeros(sim.world.capacity, np.float32)
    structure.force(sim.world, out)
    by_id = out[: sim.count][np.argsort(sim.world.grains.id.to_numpy()[: sim.count])]
    assert by_id == pytest.approx([(2 * (n - k) - 1) * weight for k in range(n)], rel=0.02)
