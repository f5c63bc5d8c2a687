"""Grains that come and go while the simulation runs: [[sources]] and [[sinks]]."""

from pathlib import Path

import numpy as np
import pytest
from helpers import G, digest, fresh_taichi

import taichi_sand as sand
from taichi_sand import SandError

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
    sim = sand.Simulation(sand.Scene(size=[0.6, 0.6], gravity=[0, 0], duration=1, sources=[source]), threads=1)
    sim.advance(0.5)
    assert sim.count == 12
    report = sim.report()
    assert report["momentum_Ns"][0] == pytest.approx(0.3 * report["mass_kg"])
    assert report["mass_kg"] == pytest.approx(12 * 3 * 2650 * np.pi * 0.004**2, rel=1e-4)


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
