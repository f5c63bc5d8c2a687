"""Every number of the report is one that it can be: bundled scenes, both solvers, every 0.1 s."""

import math
import time
from typing import Any

import numpy as np
import pytest
from helpers import fresh_taichi

import taichi_sand as sand
from taichi_sand.errors import SandError
from taichi_sand.scene import loading

SMALLER = {"avalanche": ["scale=0.02"]}
QUICK = (("avalanche_sleep", "rigid", 1.1, 0.02), ("sandcastle", "rigid", 0.5, 0.1))
"""Until when and how often [s]: in the first, sleepers at walls are woken many times before the end."""
LONGEST = 2.0
"""Simulated time of the whole [s]."""
CLOCK = ("wall_time_s", "compile_time_s")
GROWING = ("time_s", "steps", *CLOCK, "grains_lost", "grains_made", "grains_removed", "bonds_broken", "depth")
"""What never falls."""


def numbers_of(report: dict[str, Any]) -> dict[str, float]:
    """All single numbers of a report, those in lists and tables too."""
    found = {}
    for key, value in report.items():
        inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else [("", value)]
        found |= {f"{key}.{name}": float(number) for name, number in inner if isinstance(number, int | float)}
    return found


def check(sim: sand.Simulation, report: dict[str, Any], before: dict[str, Any] | None) -> None:
    """Holds each number of `report` to what it can be, from the plain state of `sim` and from the report `before` it."""
    assert all(math.isfinite(value) for value in numbers_of(report).values())
    check_counts(sim, report)
    check_contacts(sim, report)
    check_motion(sim, report)
    for key in (
        "time_s",
        "steps",
        "wall_time_s",
        "compile_time_s",
        "grains_lost",
        "grains_made",
        "grains_removed",
        "bonds_broken",
        "depth",
    ):
        assert key not in report or before is None or report[key] >= before[key], key
    assert report["step_s"] > 0 and report["tolerance"] == sim.scene.solver.tolerance
    assert sum(report["stages_s"].values()) == pytest.approx(report["wall_time_s"], rel=1e-6)
    assert report["real_time_factor"] >= 0 and report["ns_per_grain_step"] >= 0 and min(report["stages_s"].values(), default=0) >= 0


def check_counts(sim: sand.Simulation, report: dict[str, Any]) -> None:
    """Whole numbers: grains, pairs, bonds."""
    grains = report["grains"]
    made, removed = report.get("grains_made", sim.made), report.get("grains_removed", 0)
    assert grains == len(sim.ids) and made == grains + report["grains_lost"] + removed and min(report["grains_lost"], removed) >= 0
    assert 0 <= report.get("grains_asleep", 0) <= grains
    assert report["pairs"] >= report["contacts"] >= 0
    discs = max((len(form.discs) for form in map(sim.scene.form_of, (*sim.scene.grains, *sim.scene.sources))), default=1)
    walls = 4 * discs + sum(len(wall.points) for wall in sim.scene.walls)
    assert report["pairs"] <= grains * discs * (discs * (grains - 1) / 2 + walls)
    assert report["depth"] >= 1 or not grains


def check_contacts(sim: sand.Simulation, report: dict[str, Any]) -> None:
    """Overlaps, coordination and forces: no overlap is deeper than the largest grain is wide, and a planar graph of contacts, a node a
    grain and one a wall, has less than three edges a node (of clumps, as many for every disc).
    """
    widest = 2 * sim.radii.max(initial=0.0) / sim.bed.diameter
    discs = max((len(form.discs) for form in map(sim.scene.form_of, (*sim.scene.grains, *sim.scene.sources))), default=1)
    for key in ("overlap_mean", "overlap_p99"):
        assert 0 <= report[key] <= report["overlap_max"] * (1 + 1e-9) <= widest, key  # a mean is rounded
    assert (report["overlap_max"] > 0) == (report["contacts"] > 0)
    assert 0 <= report["coordination"] <= 6 * discs
    assert 0 <= report["packing_fraction"] <= 1
    assert abs(report["floor_force_N"]) <= report["wall_force_N"] * (1 + 1e-6)
    if "wetness_mean" in report:
        assert 0 <= report["wetness_mean"] <= 1
    if "heat_J" in report:
        assert report["heat_J"] >= -1e-6 * abs(report["potential_energy_J"])


def check_motion(sim: sand.Simulation, report: dict[str, Any]) -> None:
    """Energies and momenta, between what mass, speeds and places allow."""
    x, v, spins, radii = sim.positions, sim.velocities, np.abs(sim.spins), sim.radii
    if not len(x):
        return
    mass = masses(sim)
    speed = np.hypot(*v.T)
    fastest = report["speed_max_m_s"]
    assert fastest == pytest.approx(speed.max(), rel=1e-5, abs=1e-12)
    assert fastest <= sim.numbers["speed_cap"] * (1 + 1e-5)
    most = 0.5 * (mass * (speed**2 + (radii * spins) ** 2)).sum()
    least = 0.5 * (mass * speed**2).sum()
    assert least * (1 - 1e-4) <= report["kinetic_energy_J"] <= most * (1 + 1e-4) + 1e-30
    assert math.hypot(*report["momentum_Ns"]) <= (mass * speed).sum() * (1 + 1e-4) + 1e-30
    turning = mass * (np.hypot(*x.T) * speed + radii**2 * spins)
    assert abs(report["angular_momentum_Nms"]) <= turning.sum() * (1 + 1e-4) + 1e-30
    potential = -(mass * (x @ np.array(sim.scene.gravity))).sum()
    assert report["potential_energy_J"] == pytest.approx(potential, rel=1e-4, abs=1e-9 * mass.sum())
    assert 0 <= report["bed_height_m"] <= 2 * (np.hypot(*np.ptp(x, axis=0)) + 2 * radii.max())


def masses(sim: sand.Simulation) -> np.ndarray:
    """Of the grains there are, in their order, fixed ones 0 [kg], from the tables."""
    count, w = sim.count, sim.world
    inverse = w.grains.mobility.to_numpy()[:count, 0].astype(float)
    if w.sleeps:
        awake = w.sleep.state[None].awake
        inverse[awake:] = w.sleep.mobility.to_numpy()[awake:count, 0]
    order = np.argsort(w.grains.id.to_numpy()[:count], kind="stable")
    return np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1.0), 0.0)[order]


def watch(name: str, kind: str, until: float, every: float) -> None:
    """Reads the report of a bundled scene every so often [s]."""
    fresh_taichi()
    try:
        sim = sand.Simulation(sand.load(name, [f"solver.kind={kind}", *SMALLER.get(name, [])]), threads=1)
    except SandError as error:
        assert "does not fit" in str(error)  # an effect of the scene is only for the other solver
        return
    called = time.perf_counter()
    before = sim.report()
    check(sim, before, None)
    end = min(until, sim.scene.duration)
    while sim.time < end - sim.step:
        sim.advance(every)
        last, called = called, time.perf_counter()
        report = sim.report()
        elapsed = time.perf_counter() - last  # what measuring took counts in the next report
        assert sum(report[key] - before[key] for key in CLOCK) <= elapsed
        check(sim, report, before)
        before = report


@pytest.mark.parametrize("name, kind, until, every", QUICK)
def test_reports_can_be_true(name: str, kind: str, until: float, every: float) -> None:
    watch(name, kind, until, every)


@pytest.mark.slow
@pytest.mark.parametrize("kind", loading.KINDS)
@pytest.mark.parametrize("name", loading.bundled())
def test_reports_of_all_scenes_can_be_true(name: str, kind: str) -> None:
    watch(name, kind, LONGEST, 0.1)
