"""The report: complete, well-formed, and right: against sums over the plain state, brute force, and known packings."""

import json
import math

import numpy as np
import pytest
from helpers import D, Disc, G, M, R, listed, simulate

KEYS = """time_s steps grains grains_lost pairs contacts tolerance overlap_mean overlap_p99 overlap_max kinetic_energy_J
potential_energy_J momentum_Ns angular_momentum_Nms packing_fraction coordination bed_height_m floor_force_N wall_force_N
speed_max_m_s step_s wall_time_s compile_time_s real_time_factor ns_per_grain_step stages_s solver effects arch threads
precision flags""".split()
SETTLE = {"radius": [0.008, 0.012], "density": 1000.0, "count": 1000, "fill": "lattice", "pitch": 1.3, "jitter": 0.1}
SIZE = (2 * 0.01 * math.sqrt(1000) * 1.5,) * 2


@pytest.fixture(scope="module", params=["rigid", "md"])
def settled(request: pytest.FixtureRequest):
    """The settle scene at N = 1000 after 2 s: report and state."""
    sim = simulate([SETTLE], SIZE, {"kind": request.param, "precision": 32, "tolerance": 0.02}, gravity=(0, -G), mu=0.5, seed=12345)
    sim.advance(2.0)
    state = {name: getattr(sim, name) for name in ("positions", "velocities", "spins", "radii")}
    state["contacts"] = listed(sim)
    return request.param, sim.report(), sim.report(), state


def test_report_is_complete(settled) -> None:
    """Every key of design.md section 6, plain JSON, finite; twice the same but for the clock."""
    kind, report, again, _ = settled
    assert not set(KEYS) - set(report)
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["solver"] == kind and report["effects"] == ["friction"] and report["arch"] == "cpu"
    assert report["precision"] == 32 and report["threads"] == 1 and report["flags"] == []
    assert report["time_s"] == pytest.approx(2.0, abs=report["step_s"]) and report["grains"] == 1000
    assert report["real_time_factor"] == pytest.approx(report["time_s"] / report["wall_time_s"])
    assert report["ns_per_grain_step"] == pytest.approx(1e9 * report["wall_time_s"] / report["steps"] / 1000)
    clock = {"wall_time_s", "compile_time_s", "real_time_factor", "ns_per_grain_step", "stages_s"}
    assert {k: v for k, v in report.items() if k not in clock} == {k: v for k, v in again.items() if k not in clock}


def test_settle_scene_is_at_rest(settled) -> None:
    """Issue 2: overlaps, kinetic energy and packing of the settle scene; coordination of B3; the floor carries at most the weight."""
    _, report, _, state = settled
    weight = 1000 * math.pi * (state["radii"] ** 2).sum() * G
    assert report["overlap_mean"] <= 0.012 and report["overlap_p99"] <= 0.05
    assert report["kinetic_energy_J"] / 1000 < 1e-4 * weight / 1000 * 0.01
    assert 0.80 <= report["packing_fraction"] <= 0.86
    assert 3.0 <= report["coordination"] <= 4.2
    down = sum(-(c.force[0] * c.normal[1] + c.force[1] * c.normal[0]) for c in state["contacts"] if c.wall)
    assert down == pytest.approx(weight, rel=0.01)
    floor = sum(c.force[0] for c in state["contacts"] if c.wall and c.normal[1] < -0.5)
    assert report["floor_force_N"] == pytest.approx(floor, rel=1e-5) and 0.7 * weight < floor < 1.2 * weight
    sizes = sum(math.hypot(*c.force) for c in state["contacts"] if c.wall)
    assert report["wall_force_N"] == pytest.approx(sizes, rel=1e-5)
    x, r = state["positions"], state["radii"]
    assert (x[:, 0] > 0).all() and (x[:, 0] < SIZE[0]).all() and (x[:, 1] > 0).all()
    area = math.pi * (r**2).sum() / SIZE[0]
    assert area / 0.86 < report["bed_height_m"] < area / 0.76


def test_report_agrees_with_the_state(settled) -> None:
    """Energies, momenta, overlaps and contacts, summed here in f64 over the positions and velocities, all pairs by brute force."""
    _, report, _, state = settled
    x, v, w, r = (state[name] for name in ("positions", "velocities", "spins", "radii"))
    mass = 1000 * math.pi * r**2
    inertia = mass * r**2 / 2
    assert report["kinetic_energy_J"] == pytest.approx(0.5 * (mass * (v**2).sum(1)).sum() + 0.5 * (inertia * w**2).sum(), rel=1e-5)
    assert report["potential_energy_J"] == pytest.approx((mass * G * x[:, 1]).sum(), rel=1e-6)
    assert report["momentum_Ns"] == pytest.approx((mass @ v).tolist(), rel=1e-4, abs=1e-9)
    spin = mass @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + inertia @ w
    assert report["angular_momentum_Nms"] == pytest.approx(spin, rel=1e-4, abs=1e-9)
    assert report["speed_max_m_s"] == pytest.approx(np.hypot(*v.T).max(), rel=1e-6)
    gap = np.hypot(*(x[:, None] - x[None]).transpose(2, 0, 1)) - r[:, None] - r[None]
    walls = np.stack([x[:, 0], SIZE[0] - x[:, 0], x[:, 1]], 1) - r[:, None]
    overlaps = -np.concatenate([gap[np.triu_indices(len(x), 1)], walls.ravel()]) / (2 * r.mean())
    touching = overlaps[overlaps > 0]
    assert (overlaps > 1e-6).sum() <= report["contacts"] <= (overlaps > -1e-6).sum()  # f32: some just touch
    assert report["pairs"] >= report["contacts"]
    assert report["overlap_max"] == pytest.approx(touching.max(), rel=1e-3)
    assert report["overlap_mean"] * report["contacts"] == pytest.approx(touching.sum(), rel=2e-3)
    assert report["overlap_p99"] == pytest.approx(np.percentile(touching, 99), rel=1e-2)


@pytest.mark.parametrize("fill, expected", [("hexagonal", math.pi / (2 * math.sqrt(3))), ("lattice", math.pi / 4)])
def test_packing_of_lattices(fill: str, expected: float) -> None:
    """B2: 0.9069 and 0.7854, to 1 %, wherever the box ends."""
    grains = [{"radius": R, "fill": fill, "region": [0.0, 0.0, 0.413, 0.297]}]
    sim = simulate(grains, (0.6, 0.5), {"kind": "rigid"})
    assert sim.report()["packing_fraction"] == pytest.approx(expected, rel=0.01)


def test_report_of_a_single_disc() -> None:
    """Numbers that one can do in the head: a spinning disc at rest on the floor, and fixed ones that count in no sum."""
    k = 2e5
    discs = [Disc(0.05, R - M * G / k, spin=3.0), Disc(0.02, 0.05, fixed=True)]
    sim = simulate(discs, (0.1, 0.1), {"kind": "md", "k_r": k, "step": 1e-5}, gravity=(0, -G))
    sim.advance_steps(1)
    report = sim.report()
    assert report["floor_force_N"] == pytest.approx(M * G, rel=1e-6) == report["wall_force_N"]
    assert report["overlap_max"] == pytest.approx(M * G / k / D, rel=1e-6) == report["overlap_mean"]
    assert report["contacts"] == 1 and report["coordination"] == 0.0 and report["packing_fraction"] == 0.0
    assert report["kinetic_energy_J"] == pytest.approx(0.5 * (M * R**2 / 2) * 9, rel=1e-6)
    assert report["potential_energy_J"] == pytest.approx(M * G * (R - M * G / k), rel=1e-6)
    assert report["bed_height_m"] == pytest.approx(D, rel=1e-3)


def test_report_without_grains() -> None:
    """An empty box is a legal scene."""
    report = simulate([], (0.1, 0.1), {"kind": "rigid"}).report()
    assert report["grains"] == 0 and report["contacts"] == 0 and report["kinetic_energy_J"] == 0
    assert json.loads(json.dumps(report, allow_nan=False)) == report
