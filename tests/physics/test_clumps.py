"""Grains of several discs: mass and motion, contacts with levers, and that discs are clumps of one (physics.md A9, A12, A20, C3, C23)."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import OPEN, RHO, D, G, K, M, R, fresh_taichi

import taichi_sand as sand
from taichi_sand.scene.shapes import BUILT_IN, form, union_moments

SOLVERS = {
    "md": {"kind": "md", "stiffness": 2e6, "tolerance": 0.001, "restitution": 0.3},
    "rigid": {"kind": "rigid", "step": 5e-4, "restitution": 0.0},
}


def make(grains: list[dict[str, Any]], size: tuple[float, float], solver: dict[str, Any], **keys: Any) -> sand.Simulation:
    """A simulation in f64 unless `solver` says otherwise."""
    fresh_taichi()
    return sand.Simulation(sand.Scene(size=size, grains=grains, solver={"precision": 64, **solver}, **keys), threads=1)


def discs_of(sim: sand.Simulation, shape: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n, 2) and radii (n,) of all discs, and which grain each is part of, from the state alone."""
    rows = form(shape, BUILT_IN[shape]).discs
    arm = rows[None, :, :2] * sim.radii[:, None, None]
    c, s = np.cos(sim.angles)[:, None], np.sin(sim.angles)[:, None]
    turned = np.stack([c * arm[..., 0] - s * arm[..., 1], s * arm[..., 0] + c * arm[..., 1]], axis=-1)
    owner = np.repeat(np.arange(len(sim.radii)), len(rows))
    return (sim.positions[:, None] + turned).reshape(-1, 2), (sim.radii[:, None] * rows[:, 2]).ravel(), owner


@pytest.mark.parametrize(
    ("shape", "mass", "inertia"), [("disc", 1, 0.5), ("2x1", 2, 3), ("3x1", 3, 9.5), ("triangle", 3, 5.5), ("square", 4, 10)]
)
def test_inertia(shape: str, mass: float, inertia: float) -> None:
    """A20: touching discs, in units of the mass of one and its radius."""
    one = form(shape, BUILT_IN[shape])
    assert one.area * one.reach**2 / math.pi == pytest.approx(mass, rel=1e-12)
    assert mass * one.inertia * one.reach**2 == pytest.approx(inertia, rel=1e-12)


def test_overlapping_discs_count_once() -> None:
    """Area, centre and second moment of unions: two discs against the lens formula, a chain with a hidden disc against random points."""
    gap = 1.2
    lens = 2 * math.acos(gap / 2) - gap / 2 * math.sqrt(4 - gap**2)
    area, _, _ = union_moments(np.array([[0, 0, 1], [gap, 0, 1.0]]))
    assert area == pytest.approx(2 * math.pi - lens, rel=1e-12)
    discs = np.array([[0, 0, 1], [0.9, 0.4, 0.7], [1.6, -0.3, 0.8], [0.1, 0.1, 0.2], [0, 0, 1]])
    points = np.random.default_rng(1).uniform(-2, 3, (2_000_000, 2))
    covered = np.zeros(len(points), bool)
    for x, y, radius in discs:
        covered |= np.hypot(points[:, 0] - x, points[:, 1] - y) < radius
    area, first, second = union_moments(discs)
    assert area == pytest.approx(25 * covered.mean(), rel=3e-3)
    assert first == pytest.approx(25 * (points * covered[:, None]).mean(axis=0), rel=1e-2, abs=1e-2)
    assert second == pytest.approx(25 * ((points**2).sum(axis=1) * covered).mean(), rel=5e-3)


@pytest.mark.parametrize("kind", ["md", "rigid"])
@pytest.mark.usefixtures("arithmetic_as_written")
def test_a_clump_of_one_follows_a_disc(kind: str) -> None:
    """Bit for bit, through a pour onto a line and a floor: levers, headings and disc numbers change nothing of a disc.

    In the arithmetic as written: left free, the compiler fuses other products into other sums.
    """
    states = []
    for shape in ("disc", "one"):
        grains = [{"shape": shape, "radius": [0.004, 0.006], "count": 120, "angle": "random"}]
        keys = {"walls": [{"points": [[0.05, 0.2], [0.15, 0.1]]}], "effects": {"friction": {"mu": 0.4}}, "seed": 3}
        sim = make(grains, (0.2, 0.3), {"kind": kind, "precision": 32}, shapes=[{"name": "one", "discs": [[0, 0, 1]]}], **keys)
        assert sim.world.clumps == (shape == "one")
        sim.advance(0.4)
        states.append((sim.positions, sim.velocities, sim.spins, sim.angles))
    for one, other in zip(*states, strict=True):
        assert (one == other).all()


@pytest.mark.parametrize("name", SOLVERS)
def test_free_flight(name: str) -> None:
    """A20: the centre of mass flies on a parabola to 1e-9, the spin does not change."""
    shapes = ("2x1", "3x1", "triangle", "square")
    rows = [{"shape": s, "positions": [[0.2 + 0.2 * k, 0.5, R, 0.1 * k, 1.0, 0.3, 5.0 * k - 7]]} for k, s in enumerate(shapes)]
    sim = make(rows, (1, 1), SOLVERS[name], gravity=(0, -G), edges=OPEN)
    start, v, spin, turn = sim.positions, sim.velocities, sim.spins, sim.angles
    sim.advance_steps(max(1, round(0.3 / sim.step)))
    time = sim.time
    foreseen = start + v * time + 0.5 * np.array([0, -G]) * time * (time + sim.step)  # symplectic Euler's parabola
    assert np.abs(sim.positions - foreseen).max() < 1e-9
    assert np.abs(sim.spins - spin).max() < 1e-9
    assert np.abs(np.angle(np.exp(1j * (sim.angles - turn - spin * time)))).max() < 1e-9


@pytest.mark.parametrize("name", SOLVERS)
def test_impact_off_centre(name: str) -> None:
    """A bar falls flat-out on one end disc (the floor under its left end): impulse (1 + e) v / (1/m + a^2/I), frictionless, exact."""
    mass, inertia, arm, speed = 2 * M, 3 * M * R**2, R, 1.0
    solver = {
        "md": {"kind": "md", "law": "custom", "k_r": K, "k_d": 0.0, "alpha": 0.0, "beta": 1.0, "step": 2e-7},
        "rigid": {"kind": "rigid", "step": 1e-4, "restitution": 1.0},
    }
    gap = 2e-5
    wall = {"points": [[0.04, 0.05], [0.05, 0.05]]}
    bar = {"shape": "2x1", "positions": [[0.045 + R, 0.05 + R + gap, R, 0.0, -speed]]}
    sim = make([bar], (0.1, 0.1), solver[name], gravity=(0, 0), walls=[wall])
    sim.advance(6e-4 if name == "md" else 3e-4)
    impulse = 2 * speed / (1 / mass + arm**2 / inertia)
    assert sim.velocities[0, 1] == pytest.approx(-speed + impulse / mass, abs=3e-3)
    assert sim.spins[0] == pytest.approx(-arm * impulse / inertia, rel=3e-3)


@pytest.mark.parametrize("name", SOLVERS)
def test_conservation(name: str) -> None:
    """A15 for clumps: without walls, sliding and colliding with friction keeps P to 1e-13 and L to 1e-12."""
    random = np.random.default_rng(2)
    places = np.stack(np.meshgrid(np.arange(5), np.arange(5)), -1).reshape(-1, 2) * 0.032 + 0.15
    rows = [[*p, R, *(0.3 * (0.21 - p) / 0.06 + random.normal(0, 0.2, 2)), random.uniform(0, 6), random.normal(0, 20)] for p in places]
    half = len(rows) // 2
    grains = [{"shape": "triangle", "positions": rows[:half]}, {"shape": "3x1", "positions": rows[half:]}]
    sim = make(grains, (0.45, 0.45), SOLVERS[name], gravity=(0, 0), edges=OPEN, effects={"friction": {"mu": 0.5}})
    before = sim.report()
    sim.advance(0.2)
    after = sim.report()
    assert sim.world.pace[None].list_builds > 3 and after["kinetic_energy_J"] < 0.95 * before["kinetic_energy_J"]
    masses = 3 * M
    scale = masses * np.hypot(*sim.velocities.T).sum()
    assert np.abs(np.subtract(after["momentum_Ns"], before["momentum_Ns"])).max() < 1e-13 * scale
    assert abs(after["angular_momentum_Nms"] - before["angular_momentum_Nms"]) < 1e-12 * scale * 0.45


@pytest.mark.parametrize("name", SOLVERS)
def test_static_threshold(name: str) -> None:
    """A9: a 2x1 clump lies still on a slope below tan(theta) = mu, and slides above it, bracketed within 2 %; it slides with
    g (sin - mu cos) and, thrown on the flat, stops after v^2 / (2 mu g).
    """
    mu = 0.5
    places = [[0.1, R, R]]
    for factor, slides in ((0.98, False), (1.02, True)):
        theta = math.atan(mu * factor)
        gravity = (G * math.sin(theta), -G * math.cos(theta))
        sim = make([{"shape": "2x1", "positions": places}], (1.0, 0.1), SOLVERS[name], gravity=gravity, effects={"friction": {"mu": mu}})
        sim.advance(0.1)
        start, v = sim.positions[0, 0], sim.velocities[0, 0]
        sim.advance(0.4)
        moved = sim.positions[0, 0] - start
        if slides:
            pull = G * (math.sin(theta) - mu * math.cos(theta))
            assert moved == pytest.approx(v * 0.4 + pull * 0.4**2 / 2, rel=0.02)
        else:
            assert abs(moved) < 1e-4 * D and abs(sim.velocities[0, 0]) < 1e-6
        del sim
    v0 = 1.0
    thrown = {"shape": "2x1", "positions": [[0.1, R, R, v0, 0.0]]}
    sim = make([thrown], (1.0, 0.1), SOLVERS[name], gravity=(0, -G), effects={"friction": {"mu": mu}})
    sim.advance(0.5)
    assert sim.positions[0, 0] - 0.1 == pytest.approx(v0**2 / (2 * mu * G), rel=5e-3)
    assert abs(sim.velocities[0, 0]) < 1e-6


def test_squeezed_pair() -> None:
    """A12 with clumps of one: two grains, masses 2 : 1, squeezed between walls, swing in the modes 0.634 and 2.366 k/m about the rest."""
    r, k, gap, m = 5e-4, 1e3, 1.8e-3, RHO * math.pi * 5e-4**2
    rows = [{"shape": "one", "positions": [[x, 0.002, r]], "density": rho} for x, rho in ((4.2e-4, 2 * RHO), (1.40e-3, RHO))]
    solver = {"kind": "md", "law": "custom", "alpha": 0.0, "beta": 1.0, "k_d": 0.0, "k_r": k, "step": 1e-7}
    sim = make(rows, (gap, 0.004), solver, gravity=(0, 0), shapes=[{"name": "one", "discs": [[0, 0, 1]]}])
    rest = np.array([(gap - r) / 3, gap - (gap - r) / 3])
    values, modes = np.linalg.eig(k / m * np.array([[1.0, -0.5], [-1.0, 2.0]]))
    assert sorted(values * m / k) == pytest.approx([0.634, 2.366], abs=1e-3)
    amounts = np.linalg.solve(modes, sim.positions[:, 0] - rest)
    worst = 0.0
    for _ in range(10):
        sim.advance(1e-4)
        foreseen = modes @ (amounts * np.cos(np.sqrt(values) * sim.time))
        worst = max(worst, np.abs(sim.positions[:, 0] - rest - foreseen).max())
    assert worst < 1e-3 * np.abs(amounts).max()


@pytest.mark.parametrize("name", SOLVERS)
def test_nothing_is_missed(name: str) -> None:
    """C23 for clumps that fly, spin and collide: every two discs of different grains that overlap are listed, against brute force."""
    random = np.random.default_rng(6)
    side = 8
    places = (np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2) + 0.5) * 0.04
    rows = []
    for place in places:
        angle, speed = random.uniform(0, 2 * math.pi), 10 ** random.uniform(-1, 0.7)
        motion = [speed * math.cos(angle), speed * math.sin(angle), random.uniform(0, 6), random.normal(0, 100)]
        rows.append([*place, R * random.uniform(0.5, 1.0), *motion])
    solver = {"kind": "rigid", "step": 2e-4} if name == "rigid" else {"kind": "md", "stiffness": 1e6, "step": 1e-5}
    sim = make([{"shape": "3x1", "positions": rows}], (0.32, 0.32), {**solver, "restitution": 1.0}, gravity=(0, 0))
    met = 0
    for _ in range(40):
        sim.advance_steps(7 if name == "rigid" else 61)
        place, radius, owner = discs_of(sim, "3x1")
        way = place[:, None] - place[None]
        apart = owner[:, None] != owner[None]
        touching = np.triu(np.hypot(way[..., 0], way[..., 1]) < radius[:, None] + radius[None], 1) & apart
        missed = {(int(a), int(b)) for a, b in np.argwhere(touching)} - listed_discs(sim, 3)
        assert not missed
        met += (np.triu(np.hypot(way[..., 0], way[..., 1]) < 1.1 * (radius[:, None] + radius[None]), 1) & apart).sum()
        assert place.min() > 0 and place.max() < 0.32
    assert met > 10 and sim.flags() == []


def listed_discs(sim: sand.Simulation, discs: int) -> set[tuple[int, int]]:
    """Pairs of discs that the last list build listed; disc k of grain i is i * discs + k."""
    w = sim.world
    rows = slice(w.blocks.pair_start[0], w.blocks.pair_end[0])
    ids = w.grains.id.to_numpy()
    first, second, key = (getattr(w.pairs, name).to_numpy()[rows] for name in ("first", "second", "discs"))
    real = first != second
    ends = np.stack([ids[first] * discs + key // 64, ids[second] * discs + key % 64], 1)[real]
    found = {(int(min(a, b)), int(max(a, b))) for a, b in ends}
    assert len(found) == len(ends), "a pair is listed twice"
    return found


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_squares_stand(kind: str) -> None:
    """C2, short: a pyramid of squares, base 6, each on two contacts with each below, stands: its top sinks by less than 0.5 % of H."""
    half = 2 * R
    rows = [[0.15 + (2 * k - (5 - level)) * half, (2 * level + 1) * half, R] for level in range(6) for k in range(6 - level)]
    solver = {"kind": kind, "tolerance": 0.01, "precision": 32}
    sim = make([{"shape": "square", "positions": rows}], (0.3, 0.15), solver, effects={"friction": {"mu": 0.5}})
    start = sim.positions[-1, 1]
    sim.advance(1.0)
    middle = sim.positions[-1, 1]
    sim.advance(1.0)
    assert start - middle < 0.005 * 12 * half and middle - sim.positions[-1, 1] < 1e-3 * D
    assert np.abs(sim.angles).max() < 0.01 and sim.report()["flags"] == []


def test_heavy_on_light() -> None:
    """C3, md: a disc a thousand times as heavy on three small ones that fill the floor: settles, overlap <= 10 % of a small one."""
    small = {"positions": [[R, R], [3 * R, R], [5 * R, R]], "radius": R}
    heavy = {"positions": [[3 * R, 5 * R, 3 * R]], "density": RHO * 1000 / 9}
    sim = make([small, heavy], (6 * R, 0.1), {"kind": "md", "tolerance": 0.02, "precision": 32}, effects={"friction": {}})
    sim.advance(3.0)
    report = sim.report()
    assert report["flags"] == [] and report["overlap_max"] * sim.bed.diameter < 0.1 * D
    assert report["speed_max_m_s"] < 1e-3 * math.sqrt(G * D)
