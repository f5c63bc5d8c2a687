"""Where grains start: counts, regions, patterns, no overlaps, repeatable, mass and inertia."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taichi_sand import Scene
from taichi_sand.errors import SandError
from taichi_sand.scene import loading
from taichi_sand.scene.grains import Pack
from taichi_sand.scene.nearby import close_pairs, off_walls, segments
from taichi_sand.scene.packing import pack

ROUNDING = 1e-9


def place(*grains: dict, size: tuple[float, float] = (1.0, 1.0), **scene: object) -> Pack:
    return pack(Scene(size=size, grains=list(grains), **scene))


def worst_overlap(grains: Pack) -> float:
    first, second = close_pairs(grains.position, grains.position, 2 * grains.radius.max())
    first, second = first[first < second], second[first < second]
    distance = np.hypot(*(grains.position[first] - grains.position[second]).T)
    return float((grains.radius[first] + grains.radius[second] - distance).max(initial=0.0))


def is_inside(grains: Pack, x0: float, y0: float, x1: float, y1: float) -> bool:
    low, high = grains.position - grains.radius[:, None], grains.position + grains.radius[:, None]
    return bool((low >= np.array([x0, y0]) - ROUNDING).all() and (high <= np.array([x1, y1]) + ROUNDING).all())


def test_count_places_that_many_without_overlap() -> None:
    grains = place({"radius": [0.01, 0.02], "count": 600, "region": [0.1, 0.2, 0.9, 1.0]})
    assert len(grains) == 600
    assert worst_overlap(grains) <= 0
    assert is_inside(grains, 0.1, 0.2, 0.9, 1.0)
    assert 0.01 <= grains.radius.min() and grains.radius.max() <= 0.02
    assert grains.radius.std() == pytest.approx(0.01 / np.sqrt(12), rel=0.1)


@pytest.mark.parametrize("packing", [0.2, 0.5, 0.65, 0.74])
@pytest.mark.parametrize("ratio", [1.0, 1.5, 8.0])
def test_random_places_up_to_dense(packing: float, ratio: float) -> None:
    area = np.pi * 0.005**2 * (1 + ratio + ratio**2) / 3
    grains = place({"radius": [0.005, 0.005 * ratio], "count": int(packing / area)})
    assert worst_overlap(grains) <= 0
    assert is_inside(grains, 0, 0, 1, 1)


def test_random_places_are_spread_evenly() -> None:
    grains = place({"radius": 0.003, "count": 4000})
    quarter = (grains.position < 0.5) @ [1, 2]
    assert np.bincount(quarter) == pytest.approx(1000, rel=0.15)


def test_kinds_in_one_region_mix() -> None:
    table = {"radius": [0.008, 0.012], "count": 700}
    grains = place(table, {**table, "density": 100.0}, {"radius": 0.1, "positions": [[0.5, 0.5]]})
    assert worst_overlap(grains) <= 0
    assert np.bincount(grains.kind).tolist() == [700, 700, 1]
    assert (np.diff(grains.kind) >= 0).all(), "in the order of the tables"
    assert np.abs(grains.position[grains.kind == 0].mean(0) - grains.position[grains.kind == 1].mean(0)).max() < 0.05


def test_grains_keep_clear_of_walls() -> None:
    line = [[0.0, 0.3], [0.5, 0.5], [1.0, 0.1]]
    for table in (
        {"radius": [0.01, 0.02], "count": 800},
        {"radius": 0.01, "fill": "hexagonal"},
        {"radius": 0.02, "fill": "lattice"},
    ):
        grains = place(table, walls=[{"points": line, "closed": True}])
        for wall in segments([np.array([*line, line[0]])]):
            distance, _ = off_walls(grains.position, np.repeat(wall[None], len(grains), axis=0))
            assert (distance >= grains.radius - ROUNDING).all()


def test_lattice() -> None:
    grains = place({"radius": 0.05, "fill": "lattice"})
    assert len(grains) == 100
    assert np.allclose(np.unique(grains.position.round(9)), np.arange(0.05, 1, 0.1))
    assert np.allclose(grains.position[:10, 1], 0.05), "from the bottom upwards"


def test_lattice_rows_are_centred() -> None:
    grains = place({"radius": 0.05, "fill": "lattice", "region": [0, 0, 1, 0.28]}, size=(1.0, 1.0))
    assert len(grains) == 20
    grains = place({"radius": 0.05, "fill": "lattice", "pitch": 1.3})
    assert grains.position[:, 0].min() == pytest.approx(1 - grains.position[:, 0].max())
    assert np.diff(grains.position[:7, 0]) == pytest.approx(0.13)


def test_hexagonal() -> None:
    grains = place({"radius": 0.01, "fill": "hexagonal"})
    assert worst_overlap(grains) <= ROUNDING
    assert is_inside(grains, 0, 0, 1, 1)
    assert (np.pi * grains.radius**2).sum() > 0.88
    first, second = close_pairs(grains.position, grains.position, 0.0201)
    neighbours = np.bincount(first[first != second])
    inner = ((grains.position > 0.05) & (grains.position < 0.95)).all(axis=1)
    assert (neighbours[inner] == 6).all()


def test_count_with_fill_takes_the_first() -> None:
    few = place({"radius": 0.05, "fill": "lattice", "count": 12})
    assert len(few) == 12
    assert few.position[-1] == pytest.approx([0.15, 0.15])


def test_fill_random_is_loose() -> None:
    grains = place({"radius": 0.01, "fill": "random"})
    assert (np.pi * grains.radius**2).sum() == pytest.approx(0.5, abs=0.01)
    assert worst_overlap(grains) <= 0


def test_jitter_stays_within_its_bounds() -> None:
    still = place({"radius": [0.008, 0.012], "fill": "lattice", "pitch": 1.3}, seed=3)
    moved = place({"radius": [0.008, 0.012], "fill": "lattice", "pitch": 1.3, "jitter": 0.1, "count": 100}, seed=3)
    assert len(still) > len(moved) == 100
    row = moved.position[:30, 1] - moved.position[:30, 1].mean()
    assert 0.0005 < np.abs(row).max() <= 0.002


def test_positions_are_taken_as_they_are() -> None:
    grains = place({"positions": [[0.5, 0.5, 0.1, 1, 2, 0.3, 4], [0.5, 0.5, 0.2, 0, 0, 0, 0]], "velocity": [1, 1], "spin": 2, "angle": 1})
    assert grains.position.tolist() == [[0.5, 0.5], [0.5, 0.5]]
    assert grains.velocity.tolist() == [[2, 3], [1, 1]]
    assert grains.radius.tolist() == [0.1, 0.2]
    assert grains.angle.tolist() == [1.3, 1.0]
    assert grains.spin.tolist() == [6, 2]


def test_speed_and_angle_at_random() -> None:
    grains = place({"radius": 0.005, "count": 2000, "speed": [1, 2], "angle": "random", "velocity": [10, 0]})
    speed = np.hypot(*(grains.velocity - [10, 0]).T)
    assert 1 <= speed.min() and speed.max() <= 2
    assert np.abs(grains.velocity.mean(0) - [10, 0]).max() < 0.1
    assert -np.pi <= grains.angle.min() < -3 and 3 < grains.angle.max() <= np.pi


def test_mass_and_inertia_of_discs() -> None:
    grains = place({"radius": 0.005, "count": 1, "density": 2650.0}, {"radius": 0.1, "count": 1, "fixed": True})
    assert grains.mass[0] == pytest.approx(0.2081, rel=1e-3)  # the standard disc of the reference cases
    assert grains.inertia[0] == pytest.approx(2.602e-6, rel=1e-3)
    assert grains.fixed.tolist() == [False, True]
    assert grains.kind.dtype == np.int32


def test_no_grains() -> None:
    grains = place()
    assert len(grains) == 0
    assert grains.position.shape == (0, 2)


def test_same_seed_same_grains() -> None:
    tables = (
        {"radius": [0.01, 0.02], "count": 400, "angle": "random"},
        {"radius": 0.01, "fill": "lattice", "region": [0, 0, 1, 0.1]},
    )
    one, two, other = place(*tables, seed=1), place(*tables, seed=1), place(*tables, seed=2)
    for name in Pack.__dataclass_fields__:
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
    assert not np.array_equal(one.position, other.position)


def test_a_table_draws_the_same_whatever_stands_beside_it() -> None:
    table = {"radius": [0.01, 0.02], "fill": "lattice", "count": 50, "angle": "random"}
    alone, beside = place(table), place(table, {"radius": 0.05, "positions": [[0.9, 0.9]]})
    assert np.array_equal(alone.radius, beside.radius[:50])
    assert np.array_equal(alone.angle, beside.angle[:50])


@pytest.mark.parametrize(("scale", "count"), [(1, 1000), (5, 5000), (20, 20000), (0.1, 100)])
def test_settle_at_every_size(scale: float, count: int) -> None:
    scene = loading.load("settle", [f"scale={scale}"])
    grains = pack(scene)
    assert len(grains) == count
    assert scene.size[0] == pytest.approx(2 * 0.01 * np.sqrt(count) * 1.5)
    assert worst_overlap(grains) <= ROUNDING
    assert is_inside(grains, 0, 0, *scene.size)


@pytest.mark.parametrize("name", loading.bundled())
def test_bundled_scenes_start_without_overlap(name: str) -> None:
    scene = loading.load(name)
    grains = pack(scene)
    assert len(grains) or scene.sources
    if len(grains):
        assert worst_overlap(grains) <= ROUNDING
        assert is_inside(grains, 0, 0, *scene.size)


def test_the_hourglass_is_large_enough() -> None:
    assert len(pack(loading.load("hourglass"))) >= 4000


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"radius": 0.01, "count": 4000}, r"grains\[0\]: count 4000 does not fit the region: room for about 2\d\d\d"),
        ({"radius": 0.01, "count": 3000, "fill": "lattice"}, "room for about 2500"),
        ({"radius": 0.6, "count": 1}, "not one grain of this size fits"),
        ({"radius": 0.6, "fill": "lattice"}, "not one grain of this size fits"),
        ({"radius": 0.1, "count": 1, "region": [0, 0, 0.1, 1]}, "not one grain of this size fits"),
        ({"radius": 1e-6, "fill": "lattice"}, "more than the 4000000"),
        ({"radius": 1e-6, "fill": "random"}, "more than the 4000000"),
    ],
)
def test_what_does_not_fit_gets_a_sentence(table: dict, words: str) -> None:
    with pytest.raises(SandError, match=words):
        place(table)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.002, 0.2),
    st.floats(1.0, 20.0),
    st.integers(1, 300),
    st.sampled_from([None, "lattice", "hexagonal", "random"]),
    st.integers(0, 5),
)
def test_any_table_fits_or_is_refused(radius: float, ratio: float, count: int, fill: str | None, seed: int) -> None:
    table = {"radius": [radius, radius * ratio], "count": count, "fill": fill}
    walls = [{"points": [[0, 0.5], [0.7, 0.4]]}]
    try:
        grains = place(table, {"radius": 0.01, "positions": [[0.3, 0.7]]}, walls=walls, seed=seed)
    except SandError as error:
        assert "fit" in str(error)
        return
    assert len(grains) == count + 1
    assert worst_overlap(grains) <= ROUNDING
    assert is_inside(grains, 0, 0, 1, 1)
