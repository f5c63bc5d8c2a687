"""The dial: what is asked as `tolerance` is kept, also by a pile that grows deeper than it was at the start."""

from pathlib import Path
from typing import Any

import pytest
from helpers import digest, fresh_taichi, simulate

import taichi_sand as sand
from taichi_sand.solvers.tolerance import RIGID_LOAD, SAG

FUNNEL = [{"points": [[0.0, 0.5], [0.26, 0.25], [0.26, 0.0]]}, {"points": [[0.6, 0.5], [0.34, 0.25], [0.34, 0.0]]}]


def funnel() -> Any:
    """A wide layer of 160 discs, 3 deep, that drains into a silo 8 grains wide."""
    grains = [{"radius": [0.0045, 0.0055], "count": 160, "region": [0.05, 0.5, 0.55, 0.6]}]
    return simulate(grains, (0.6, 0.7), {"kind": "rigid", "precision": 32}, gravity=(0, -9.81), walls=FUNNEL)


def test_growing_pile_keeps_its_tolerance(tmp_path: Path) -> None:
    """The step follows the depth; what a checkpoint interrupts and what runs in pieces comes out bit for bit the same."""
    sim = funnel()
    before = sim.step, sim.bed.depth
    sim.advance(1.5)
    sim.save(tmp_path / "half.npz")
    sim.advance(1.5)
    report = sim.report()
    assert 160 / 8 * 0.8 < report["depth"] < 160 / 8 * 1.2 and report["depth"] > 2 * before[1]
    unhurried = SAG * (0.02 * sim.bed.diameter / (RIGID_LOAD * before[1] * 9.81)) ** 0.5  # the first step, were there no fall to follow
    assert sim.step < 0.7 * unhurried and sim.step < before[0]
    assert report["overlap_mean"] < 0.25 * report["tolerance"] and sim.flags() == []
    assert sim.time == pytest.approx(3.0, abs=sim.step)
    final, steps = digest(sim), sim.steps
    fresh_taichi()
    sim = sand.Simulation.resume(tmp_path / "half.npz", threads=1)
    sim.advance_steps(100)
    sim.advance_steps(steps - sim.steps)
    assert digest(sim) == final and sim.report()["depth"] == report["depth"]
