"""The dial: what is asked as `tolerance` is kept, also by a pile that grows deeper than it was at the start."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import digest, simulate

import taichi_sand as sand
from taichi_sand.solvers.tolerance import FLOW_SOFTNESS, RIGID_LOAD, SAG

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
    del sim
    sim = sand.Simulation.resume(tmp_path / "half.npz", threads=1)
    sim.advance_steps(100)
    sim.advance_steps(steps - sim.steps)
    assert digest(sim) == final and sim.report()["depth"] == report["depth"]


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_what_presses_on_a_pile_is_seen_by_its_overlaps(kind: str) -> None:
    """A piston bears on 150 discs with thrice their weight, which their depth does not tell: first they overlap by more than is allowed."""
    grains = [{"radius": [0.004, 0.006], "count": 150, "region": [0.0, 0.0, 0.15, 0.2]}]
    force = 3 * 150 * 2650 * math.pi * 0.005**2 * 9.81
    plate = {"closed": True, "points": [[0.001, 0.2], [0.149, 0.2], [0.149, 0.22], [0.001, 0.22]], "velocity": [0.0, -0.1], "force": force}
    sim = simulate(grains, (0.15, 0.25), {"kind": kind, "precision": 32, "tolerance": 0.01}, gravity=(0, -9.81), mu=0.5, walls=[plate])
    worst = 0.0
    for _ in range(12):
        sim.advance(0.5)
        worst = max(worst, sim.report()["overlap_p99"])
    report = sim.report()
    assert worst > 1.3 * report["tolerance"] and 0.2 < report["overlap_p99"] / report["tolerance"] <= 1, (worst, report["overlap_p99"])
    assert sim.bed.strain < 16 and sim.flags() == []


def test_who_is_at_rest_is_not_stirred_for_little() -> None:
    """Contacts of a flow that is over stay as stiff where steps would be a tenth longer, and soften where it is half."""
    grains = [{"radius": 0.005, "count": 24, "fill": "hexagonal", "region": [0.0, 0.0, 0.06, 0.1]}]
    sim = simulate(grains, (0.06, 0.1), {"kind": "md", "precision": 32, "tolerance": 0.02}, gravity=(0, -9.81), mu=0.5)
    sim.advance(1.0)
    rest, overlap = sim.numbers["stiffness"], 0.02 * sim.bed.diameter
    for longer, stays in ((1.1, True), (1.5, False)):
        flow = FLOW_SOFTNESS * overlap / math.pi * math.sqrt(2 * rest / sim.bed.mass) * longer
        sim._adopt(sim.scene, replace(sim.bed, flow=flow), sim.over)
        step = sim.step
        sim.advance(1.0)
        before = sim.positions
        sim.advance(4.0)
        assert sim.step == (step if stays else pytest.approx(longer * step, rel=1e-3))
        if stays:
            assert np.abs(sim.positions - before).max() < 1e-6 * sim.bed.diameter
