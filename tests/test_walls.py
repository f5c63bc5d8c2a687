"""Walls that change while the simulation runs, and walls that move."""

from pathlib import Path

import pytest
from helpers import D, Disc, G, R, digest, fresh_taichi, simulate

import taichi_sand as sand
from taichi_sand import SandError

SHELF = {"points": [[0.0, 0.1], [0.1, 0.1]]}
OTHER = {"points": [[0.12, 0.1], [0.2, 0.1]]}


def on_shelves(kind: str):
    """Two discs at rest on two shelves."""
    discs = [Disc(0.05, 0.1 + R), Disc(0.16, 0.1 + R)]
    sim = simulate(discs, (0.2, 0.2), {"kind": kind}, gravity=(0.0, -G), walls=[SHELF, OTHER])
    sim.advance(0.3)
    return sim


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_erased_and_drawn_walls(kind: str) -> None:
    """The grain on an erased shelf falls freely, the other feels nothing; a shelf drawn below catches it."""
    sim = on_shelves(kind)
    start, time, push = sim.positions, sim.time, sim.report()["wall_force_N"]
    sim.set_walls([OTHER])
    assert sim.report()["wall_force_N"] == pytest.approx(0.5 * push, rel=1e-6)  # what the other shelf carries is remembered
    sim.advance(0.08)
    moved = sim.positions - start
    assert sim.velocities[0, 1] == pytest.approx(-G * (sim.time - time), rel=0.01) and moved[0, 1] < -2 * D
    assert abs(moved[1]).max() < 1e-3 * D
    sim.set_walls([OTHER, {"points": [[0.01, 0.05], [0.09, 0.05]]}])
    sim.advance(0.5)
    assert sim.positions[0, 1] == pytest.approx(0.05 + R, abs=0.02 * D) and sim.flags() == []


def test_changed_walls_in_a_checkpoint(tmp_path: Path) -> None:
    """A checkpoint goes on with the walls of its moment."""
    sim = on_shelves("rigid")
    sim.set_walls([OTHER])
    sim.advance(0.02)
    sim.save(tmp_path / "fall.npz")
    sim.advance(0.05)
    expected = digest(sim)
    fresh_taichi()
    resumed = sand.Simulation.resume(tmp_path / "fall.npz", threads=1)
    assert len(resumed.scene.walls) == 1
    resumed.advance(0.05)
    assert digest(resumed) == expected


def test_walls_that_cannot_be_had_change_nothing() -> None:
    """Wrong tables and too many of them are told, and leave all as it was."""
    sim = on_shelves("rigid")
    for walls, text in (
        ([{"points": [[0.0, 0.1]]}], r"walls\[0\].points"),
        ([{"points": [[0.0, 0.1], [0.1, 0.9]]}], "lies outside the box"),
        ([{"points": [[0.0, 0.1], [0.1, 0.1]], "friction": 0.3}], "effects.friction"),
        ([SHELF] * 500, "no room for so many walls"),
    ):
        with pytest.raises(SandError, match=text):
            sim.set_walls(walls)
    sim.advance(0.1)
    assert sim.positions[:, 1] == pytest.approx(0.1 + R, abs=0.02 * D) and len(sim.scene.walls) == 2
