"""Heat: what contacts take out of the motion is found again in the grains, and spreads by the law of diffusion."""

import math

import numpy as np
import pytest
from helpers import D, Disc, G, M, R, kinetic, simulate

from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.walls.build import standing_walls

K = 2e6
T_C = math.pi * math.sqrt(M / 2 / K)
SOLVERS = {
    "md": {"kind": "md", "k_r": K, "restitution": 0.4, "step": T_C / 30},
    "rigid": {"kind": "rigid", "restitution": 0.4, "step": 2e-4, "tolerance": 0.001},
}
CAPACITY = 800.0
WET = {"friction": {"mu": 0.5}, "rolling": {"mu": 0.1}, "cohesion": {"bond_number": 20.0}}
ALL = {**WET, "heat": {"capacity": CAPACITY, "conduction": 5.0}}


def heat(sim, discs) -> float:
    """Heat of all grains [J]: what has become temperature, and what is booked since."""
    count, ids = sim.count, sim.world.grains.id.to_numpy()[: sim.count]
    mass = np.array([disc.mass for disc in discs])[ids]
    table = sim.world.carried
    return float((table.temperature.to_numpy()[:count] * mass).sum() * CAPACITY + table.warmth.to_numpy()[:count].sum())


def held(sim) -> float:
    """Elastic energy of all pairs [J], md."""
    w, effect = sim.world, next(e for e in sim.solver.effects if offers(e, "store"))
    rows = effect.held.to_numpy()
    spans = [(w.blocks.pair_start[0], w.blocks.pair_end[0]), (w.blocks.wall_start[0], w.blocks.wall_end[0])]
    return float(sum(rows[low:high].sum() for low, high in spans))


@pytest.mark.parametrize("name", SOLVERS)
def test_energy_lost_is_heat_gained(name: str) -> None:
    """36 sticky, rough discs collide without gravity, among them and with walls: energy and heat add up to 1e-9 at any moment."""
    rng = np.random.default_rng(4)
    places = [(0.02 * (k % 6 + 1), 0.02 * (k // 6 + 1)) for k in range(36)]
    discs = [Disc(x, y, *rng.normal(0, 0.5, 2), spin=rng.normal(0, 50), radius=R * rng.uniform(0.7, 1.2)) for x, y in places]
    start = kinetic_of(discs)
    sim = simulate(discs, (0.14, 0.14), SOLVERS[name], effects=ALL)
    for _ in range(3):
        sim.advance(0.05)
        stored = held(sim) if name == "md" else 0.0
        assert kinetic(sim, discs) + stored + heat(sim, discs) == pytest.approx(start, rel=1e-9)
    assert kinetic(sim, discs) < 0.5 * start
    assert (sim.world.carried.temperature.to_numpy() > -1e-9).all()


def kinetic_of(discs) -> float:
    """Kinetic energy at the start [J]."""
    return sum(0.5 * d.mass * (d.vx**2 + d.vy**2) + 0.25 * d.mass * d.radius**2 * d.spin**2 for d in discs)


@pytest.mark.parametrize("name", SOLVERS)
def test_a_fall_warms(name: str) -> None:
    """A column falls 50 d and comes to rest, in 32 bits: m g H is found as heat within 1e-3, and all of it in the grains that fell."""
    discs = [Disc(0.05 + 1e-4 * k, 0.5 + 1.1 * D * k) for k in range(5)] + [Disc(0.5, R, fixed=True)]
    settings = {**SOLVERS[name], "precision": 32}
    effects = {"friction": {"mu": 0.5}, "rolling": {"mu": 0.3}, "heat": {"capacity": CAPACITY}}
    sim = simulate(discs, (0.6, 0.7), settings, gravity=(0, -G), effects=effects)
    before = sim.report()["potential_energy_J"]
    sim.advance(2.5)
    after = sim.report()
    lost = before - after["potential_energy_J"] - after["kinetic_energy_J"]
    assert lost > 4.9 * M * G * 0.5
    assert heat(sim, discs) == pytest.approx(lost, rel=1e-3)
    assert sim.report()["heat_J"] == pytest.approx(heat(sim, discs), rel=1e-5)


@pytest.mark.parametrize("name", SOLVERS)
def test_drops_warm_at_any_step(name: str) -> None:
    """Discs dropped from 2.5, 10 and 40 d beside 100 poured ones, at the step of the dial and a shorter one: what is lost is heat, and what
    contacts at rest hold, to 1e-3.
    """
    discs = [Disc(0.02 + 0.04 * k, R + height * D, radius=R) for k, height in enumerate((2.5, 10.0, 40.0))]
    discs += [Disc(0.2 + 1.3 * D * (k % 10), 0.02 + 1.3 * D * (k // 10), radius=R * (0.8 + 0.004 * k)) for k in range(100)]
    effects = {"friction": {"mu": 0.5}, "rolling": {"mu": 0.3}, "heat": {"capacity": CAPACITY}}
    longest = 0.0
    for share in (1.0, 0.25):
        solver = {"kind": name, "restitution": 0.3, "precision": 32} | ({"step": share * longest} if longest else {})
        sim = simulate(discs, (0.4, 0.6), solver, gravity=(0, -G), effects=effects)
        longest = sim.step
        before = sim.report()["potential_energy_J"]
        sim.advance(1.5)
        after = sim.report()
        lost = before - after["potential_energy_J"] - after["kinetic_energy_J"]
        assert sim.flags() == [] and lost > 52 * M * G * D
        stored = held(sim) if name == "md" else 0.0
        assert heat(sim, discs) + stored == pytest.approx(lost, rel=1e-3), share


def test_heat_spreads_as_it_should() -> None:
    """Along a row of discs between walls the variance of the heat grows by 2 D t, D = rate d²/2; none is lost."""
    count, rate = 41, 2.0
    pitch = D * (1 - 1e-4)
    discs = [Disc(pitch * (k + 0.5), 0.05) for k in range(count)]
    solver = {**SOLVERS["rigid"], "step": 1 / 240}
    sim = simulate(discs, (count * pitch, 0.1), solver, effects={"heat": {"capacity": CAPACITY, "conduction": rate}})
    slots = np.argsort(sim.world.grains.id.to_numpy()[:count])
    table = sim.world.carried.temperature
    table[int(slots[count // 2])] = 1.0
    sim.advance(2.5)
    found = table.to_numpy()[np.argsort(sim.world.grains.id.to_numpy()[:count])]
    x = sim.positions[:, 0] - sim.positions[count // 2, 0]
    assert found.sum() == pytest.approx(1.0, abs=1e-9)
    assert (found * x**2).sum() / (2 * 2.5) == pytest.approx(rate * D**2 / 2, rel=0.02)
    assert (found * x).sum() == pytest.approx(0.0, abs=0.05 * D)


@pytest.mark.parametrize("name", SOLVERS)
def test_work_of_a_wall_with_force_is_found_again(name: str) -> None:
    """A wall without mass pushes a disc with F from the start, onto the floor: F times its way is motion, held by springs, or heat."""
    force, disc = 0.5, Disc(0.1, R + 0.006)
    top = disc.y + R
    lid = {"points": [[0.0, top + 1e-7], [0.2, top + 1e-7]], "velocity": [0.0, -0.5], "force": force}
    sim = simulate([disc], (0.2, 0.2), SOLVERS[name], effects={"heat": {"capacity": CAPACITY}}, walls=[lid])
    for _ in range(6):
        sim.advance(0.025)
        way = top - standing_walls(sim.world, sim.scene)[0][0, 1]
        stored = held(sim) if name == "md" else 0.0
        assert kinetic(sim, [disc]) + stored + heat(sim, [disc]) == pytest.approx(force * way, rel=0.01)
    assert way > 0.0059
