"""Tables of pairs that turn out too small grow in the same step: no contact is missed, and all ends in the bits of a table large enough."""

from pathlib import Path
from typing import Any

import pytest
from helpers import G, digest, fresh_taichi, simulate

import taichi_sand as sand
from taichi_sand.play.snapshot import from_bytes, restore, take, to_bytes
from taichi_sand.run.growing import rooms_of
from taichi_sand.world import build
from taichi_sand.world.search.growth import Rooms

SIZE = (0.4, 0.3)
LID = {"points": [[0.0, 0.2], [0.4, 0.2]], "velocity": [0.0, -0.05], "force": 2000.0}
BUMPS = {"points": [[0.4 * k / 160, 0.01 + 0.001 * (k % 2)] for k in range(161)]}
"""Pieces of a quarter of a diameter."""
BED = {"radius": [0.004, 0.006], "count": 250, "region": [0.0, 0.02, 0.4, 0.2]}
BOULDERS = {"positions": [[0.1, 0.25, 0.03], [0.3, 0.25, 0.03]]}
CASES: dict[str, dict[str, Any]] = {
    "discs": {"grains": [BED], "walls": [BUMPS]},
    "clumps and a lid": {"grains": [{**BED, "shape": "triangle", "radius": 0.003, "count": 120}], "walls": [BUMPS, LID]},
    "boulders": {"grains": [BED, BOULDERS], "walls": [BUMPS]},
    "asleep": {"grains": [{**BED, "count": 120}], "walls": [BUMPS], "effects": {"sleeping": {"speed": 0.05, "time": 0.05}}},
    "bonds": {"grains": [BED], "walls": [BUMPS], "effects": {"bonds": {"strength": 20.0, "reach": 0.2}}},
    "periodic": {"grains": [BED], "walls": [BUMPS], "edges": {"left": "periodic", "right": "periodic"}},
}


def small_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables with next to no room to start with."""
    monkeypatch.setattr(
        build,
        "foreseen",
        lambda parts, d, n, discs, shares, boulders, entries, least: Rooms(
            1, 1, 4 if boulders[1] else 0, 4 if boulders[1] else 0, 16 if entries else 0
        ).joined(least),
    )


def run(case: str, kind: str, path: Path | None = None, seconds: float = 0.3, **more: Any) -> sand.Simulation:
    """The case after so long; with a `path` saved and resumed half-way."""
    keys = {"mu": 0.5, "gravity": (0, -G), **CASES[case], **more}
    effects = keys.pop("effects", {})
    solver = {"kind": kind, "precision": 32, "tolerance": 0.05}
    sim = simulate(keys.pop("grains"), SIZE, solver, **keys, **({"effects": {"friction": {"mu": 0.5}, **effects}} if effects else {}))
    sim.advance(0.5 * seconds)
    if path:
        sim.save(path)
        del sim
        fresh_taichi()
        sim = sand.Simulation.resume(path, threads=1)
    sim.advance(0.5 * seconds)
    return sim


@pytest.mark.parametrize(
    ("case", "kind"),
    [
        ("discs", "rigid"),
        pytest.param("asleep", "md", marks=pytest.mark.slow),
        pytest.param("clumps and a lid", "md", marks=pytest.mark.slow),
        pytest.param("boulders", "rigid", marks=pytest.mark.slow),
        pytest.param("asleep", "rigid", marks=pytest.mark.slow),
        pytest.param("bonds", "rigid", marks=pytest.mark.slow),
        pytest.param("periodic", "md", marks=pytest.mark.slow),
    ],
)
def test_grown_tables_change_no_bit(case: str, kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """From next to no room, saved and resumed on the way: the same bits as with room for all."""
    expected = digest(run(case, kind))
    small_rooms(monkeypatch)
    sim = run(case, kind, tmp_path / "half.npz")
    assert digest(sim) == expected and sim.flags() == []
    grown = rooms_of(sim.world)
    assert grown.rows > 1 and grown.walls > 1


def test_undo_after_tables_have_grown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A moment from before, with small tables, is gone back to bit for bit; and one of large tables in a simulation of small ones."""
    small_rooms(monkeypatch)
    sim = run("discs", "rigid", seconds=0.0, hand=True)
    start, early = take(sim), rooms_of(sim.world)
    sim.advance(0.1)
    first, grown, later = digest(sim), rooms_of(sim.world), take(sim)
    assert grown.rows + grown.walls > early.rows + early.walls
    restore(sim, start)
    assert sim.time == 0.0
    sim.advance(0.1)
    assert digest(sim) == first
    other = from_bytes(to_bytes(later))
    del sim
    fresh_taichi()
    sim = run("discs", "rigid", seconds=0.0, hand=True)
    restore(sim, other)
    assert digest(sim) == first and rooms_of(sim.world) == grown
