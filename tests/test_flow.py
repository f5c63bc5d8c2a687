"""Grains that come and go while the simulation runs: [[sources]] and [[sinks]]."""

from pathlib import Path

import numpy as np
import pytest
from helpers import G, digest, fresh_taichi

import taichi_sand as sand
from taichi_sand import SandError
from taichi_sand.scene.room import Room
from taichi_sand.world import sources

MU = {"friction": {"mu": 0.3}}


def stream(rate: float, duration: float, threads: int = 1, **keys):
    """Grains rain from the top of a chute into a sink at its bottom."""
    fresh_taichi()
    source = {"radius": [0.003, 0.005], "rate": rate, "region": [0.05, 0.5, 0.75, 0.58], "velocity": [0.0, -1.0]}
    scene = sand.Scene(
        size=[0.8, 0.6], gravity=[0.0, -G], seed=4, duration=duration, sources=[source], sinks=[{"region": [0.0, 0.0, 0.8, 0.06]}],
        walls=[{"points": [[0.0, 0.2], [0.3, 0.1]]}, {"points": [[0.8, 0.2], [0.5, 0.1]]}], effects=MU, **keys,
    )  # fmt: skip
    return sand.Simulation(scene, threads=threads)


@pytest.mark.slow
def test_ten_thousand_come_and_go(tmp_path: Path) -> None:
    """Every grain is accounted for, ids rise and are never given twice; two threads and a resumed run end in the same bits."""
    sim = stream(4000.0, 2.5)
    seen: set[int] = set()
    for _ in range(5):
        before = sim.made
        sim.advance(0.25)
        ids = set(sim.ids.tolist())
        assert len(ids) == sim.count and all(number < before or number not in seen for number in ids)
        assert not {number for number in ids if number < before} - seen - set(range(before))
        seen |= ids
    sim.save(tmp_path / "half.npz")
    sim.advance(1.25)
    report = sim.report()
    assert report["grains_made"] == pytest.approx(10_000, abs=70) and report["grains_lost"] == 0 and report["flags"] == []
    assert report["grains_made"] - report["grains_removed"] == report["grains"] == sim.count < 4000
    assert report["overlap_max"] < 0.2 and sim.ids.max() == report["grains_made"] - 1
    expected, again = digest(sim), stream(4000.0, 2.5, threads=2)
    again.advance(2.5)
    assert digest(again) == expected
    fresh_taichi()
    resumed = sand.Simulation.resume(tmp_path / "half.npz", threads=2)
    resumed.advance(1.25)
    assert digest(resumed) == expected and resumed.report()["grains_removed"] == report["grains_removed"]


def test_full_table_stops_the_source() -> None:
    """There is room for what comes within the duration; later the source says that it makes none, and goes on when there is room."""
    fresh_taichi()
    source = {"radius": 0.004, "rate": 200.0, "region": [0.0, 0.2, 0.3, 0.3]}
    sim = sand.Simulation(sand.Scene(size=[0.3, 0.3], duration=0.1, sources=[source]), threads=1)
    sim.advance(1.0)
    assert sim.count == sim.world.capacity - 1 < 200 and sim.lost == 0
    assert any("table of grains full" in flag for flag in sim.flags())
    assert np.isfinite(sim.positions).all() and (sim.positions > 0).all()


def test_a_source_ends_and_starts_them_as_it_says() -> None:
    """`until`; grains of several discs, with the mass of their shape, at the velocity of the source."""
    fresh_taichi()
    source = {"shape": "triangle", "radius": 0.004, "rate": 60.0, "region": [0.1, 0.1, 0.5, 0.5], "velocity": [0.3, 0.0], "until": 0.2}
    sim = sand.Simulation(sand.Scene(size=[0.8, 0.6], gravity=[0, 0], duration=1, sources=[source]), threads=1)
    sim.advance(0.5)  # nobody gets to the wall
    assert sim.count == 12
    report = sim.report()
    assert report["momentum_Ns"][0] == pytest.approx(0.3 * report["mass_kg"])
    assert report["mass_kg"] == pytest.approx(12 * 3 * 2650 * np.pi * 0.004**2, rel=1e-4)


CROWDED = {"radius": [0.002, 0.008], "rate": 600.0, "region": [0.1, 0.5, 0.3, 0.56]}
REGIONS = {"free": (75.0, CROWDED["region"]), "busy": (600.0, CROWDED["region"]), "full": (3000.0, CROWDED["region"])}
REGIONS |= {"slot": (600.0, [0.1, 0.4, 0.116, 0.56]), "square": (600.0, [0.1, 0.4, 0.116, 0.416])}
"""The last two only just take the largest."""


def crowded(kind: str, where: str) -> sand.Scene:
    """Radii of 2 to 8 mm, uniformly, fall out of a narrow region, through an open floor."""
    rate, region = REGIONS[where]
    return sand.Scene(
        size=[0.4, 0.6],
        seed=1,
        duration=3000 / rate,  # room for as many everywhere, so that nothing is compiled twice
        edges={"bottom": "open"},
        solver={"kind": kind, "tolerance": 0.05},
        sources=[{**CROWDED, "rate": rate, "region": region}],
    )


@pytest.mark.parametrize("where", REGIONS)
@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_sources_make_the_sizes_asked_for(kind: str, where: str) -> None:
    """Mean radius within 1 % of 5 mm, a quarter below 3.5 and above 6.5 mm within 0.02 (or within one grain of those made, where these are
    few), at a rate that finds room and at those that do not: who is late is counted, and flagged from a tenth on.
    """
    sim, seen = sand.Simulation(crowded(kind, where), threads=1), {}
    for _ in range(20):
        sim.advance(0.05)
        seen |= dict(zip(sim.ids.tolist(), sim.radii, strict=True))
        assert sim.report()["overlap_max"] < 0.2
    radii, report = np.array(list(seen.values())), sim.report()
    assert len(radii) == report["grains_made"] >= 20
    one = 1.0 / len(radii)
    assert radii.mean() == pytest.approx(0.005, rel=max(0.01, one))
    assert (radii < 0.0035).mean() == pytest.approx(0.25, abs=max(0.02, one)) == (radii > 0.0065).mean()
    due = REGIONS[where][0] * sim.time
    assert report["grains_waiting"] == pytest.approx(due - report["grains_made"], abs=due / 40 + 1)  # due since they last looked
    late = report["grains_waiting"] > 0.1 * due
    assert late == (where in ("full", "slot", "square"))
    assert late == any("wait for room" in flag for flag in sim.flags()) and len(sim.flags()) == late


def test_a_crowded_source_goes_on_where_it_was(tmp_path: Path) -> None:
    """What waits is the same after a checkpoint, to the bits."""
    sim = sand.Simulation(crowded("rigid", "full"), threads=1)
    sim.advance(0.3)
    assert sim.report()["grains_waiting"] > 100
    sim.save(tmp_path / "there.npz")
    sim.advance(0.2)
    there = digest(sim), sim.made
    del sim
    again = sand.Simulation.resume(tmp_path / "there.npz", threads=1)
    again.advance(0.2)
    assert (digest(again), again.made) == there


def test_sizes_come_evenly_and_at_random() -> None:
    """Of the first n numbers: halves and quarters to 1.5 / n, nearly always the mean to 1 / n; the second of a pair comes from the other
    half, in no order; any piece may be asked for by itself, and seeds differ.
    """
    count, seen = np.arange(1, 4097), set()
    for seed in (0, 1, 7, 123456, 2**62 - 1):
        numbers = sources.evenly(np.arange(4096), seed)
        seen.add(numbers[0])
        assert (numbers > 0).all() and (numbers < 1).all() and len(np.unique(numbers)) == 4096
        assert (sources.evenly(np.arange(1000, 1010), seed) == numbers[1000:1010]).all()
        assert (np.abs(np.cumsum(numbers - 0.5)) < 1.0).mean() > 0.95
        for low, high in ((0.0, 0.25), (0.25, 0.5), (0.5, 1.0), (0.75, 1.0)):
            inside = np.cumsum((numbers >= low) & (numbers < high))
            assert np.abs(inside - (high - low) * count).max() <= 1.5
        assert np.corrcoef(numbers[0::2], numbers[1::2])[0, 1] == pytest.approx(-0.75, abs=0.04)
        assert abs(np.corrcoef(numbers[1:-1:2], numbers[2::2])[0, 1]) < 0.1
        lower = numbers[0::2] < 0.5
        assert lower.mean() == pytest.approx(0.5, abs=0.05) and abs(np.corrcoef(lower[:-1], lower[1:])[0, 1]) < 0.1
    assert len(seen) == 5


@pytest.mark.parametrize("seed", range(12))
def test_room_is_found_where_there_is_some(seed: int) -> None:
    """Beside a search over 25 600 points: whenever that finds room for a disc, so do darts and map; what they find is free. Walls of short
    and long pieces, regions as narrow as the disc.
    """
    rng = np.random.default_rng(seed)
    region = np.array([0.1, 0.1, 0.1 + rng.choice([0.02, 0.05, 0.2]), 0.2])
    position, radius = rng.uniform(0.08, 0.32, (rng.integers(0, 160), 2)), rng.uniform(0.002, 0.01)
    sizes = rng.uniform(0.3, 1.0, len(position)) * radius
    ends = rng.uniform(0.05, 0.35, (4, 2))
    walls = np.stack([ends, ends + rng.normal(0, 1, (4, 2)) * rng.choice([0.002, 0.05, 3.0], (4, 1))], axis=1)
    room = Room(region, 0.01, walls, position, sizes, rng)
    x, y = (np.linspace(region[k] + radius, region[k + 2] - radius, 160) for k in (0, 1))
    points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    for _ in range(12):
        reach = min(radius, 0.01)
        clear = np.full(len(points), np.inf)
        for place, size in zip(room.position, room.radius, strict=True):
            clear = np.minimum(clear, np.hypot(*(points - place).T) - size)
        for start, end in walls:
            share = np.clip(((points - start) @ (end - start)) / ((end - start) @ (end - start)), 0, 1)
            clear = np.minimum(clear, np.hypot(*(points - start - share[:, None] * (end - start)).T))
        place = room.find(reach)
        if place is None:
            assert clear.max() < reach
            break
        assert (region[:2] - 1e-12 <= place - reach).all() and (place + reach <= region[2:] + 1e-12).all()
        assert room.clear(place[None], 1.0)[0] >= reach * (1 - 2e-6)
        room.add(place, reach)


def test_wrong_sources_are_told() -> None:
    """In a sentence, with the key."""
    good = {"radius": 0.004, "rate": 60.0, "region": [0.1, 0.1, 0.5, 0.5]}
    for tables, text in (
        ({"sources": [{**good, "rate": 0.0}]}, r"sources\[0\].rate = 0 must be greater than 0"),
        ({"sources": [{**good, "region": [0.1, 0.1, 0.105, 0.5]}]}, "narrower than its largest grain"),
        ({"sources": [{**good, "region": [0.1, 0.1, 0.05, 0.5]}]}, "x0 < x1"),
        ({"sources": [{**good, "shape": "dsic"}]}, "disc"),
        ({"sources": [{**good, "radius": [0.4, 0.1]}]}, "low not above high"),
        ({"sinks": [{"region": [0.0, 0.0, 2.0, 0.1]}]}, "must lie inside the box"),
        ({"sinks": [{"regoin": [0.0, 0.0, 0.2, 0.1]}]}, "region"),
        ({"walls": [{"points": [[0, 0], [0.1, 0.1]], "shake": {"amplitude": [0, 0.1], "freq": 3}}]}, "frequency"),
        ({"walls": [{"points": [[0, 0], [0.1, 0.1]], "force": 3.0}]}, "needs a `velocity`"),
        ({"walls": [{"points": [[0, 0], [0.1, 0.1]], "pivot": [0.1, 0.1]}]}, "needs a `spin`"),
    ):
        with pytest.raises(SandError, match=text):
            sand.Scene(size=[0.6, 0.6], **tables)
