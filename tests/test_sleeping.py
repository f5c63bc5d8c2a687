"""Sleep: what rests costs nothing and does not move; who is disturbed wakes; nobody notices that a neighbour sleeps."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import digest, fresh_taichi

import taichi_sand as sand
from taichi_sand.world import build, edit

G, D, RADIUS, DENSITY = 9.81, 0.02, 0.01, 1000.0
WEIGHT = DENSITY * np.pi * RADIUS**2 * G * D
"""m g d of a grain of the bed [J]."""
QUICK = {"speed": 0.05, "time": 0.05}
"""Falls asleep early, so that tests are short."""
BED = {"radius": RADIUS, "density": DENSITY, "fill": "hexagonal", "count": 100, "region": [0.0, 0.0, 0.3, 0.16]}
FALLING = {"positions": [[0.15, 0.9]], "radius": 0.012, "density": DENSITY}
LEAVING = {"positions": [[0.15, 0.6]], "radius": 0.012, "density": DENSITY, "velocity": [1.5, 0.0]}


def bed(kind: str, sleeping: dict[str, float] | None, ball: dict[str, Any] = FALLING, threads: int = 1) -> sand.Simulation:
    """A bed of 100 behind a low wall, and a ball that falls onto it (0.39 s later) or flies over it and out (0.3 s)."""
    fresh_taichi()
    scene = sand.Scene(
        size=[0.6, 1.2],
        edges={"right": "open", "top": "open"},
        walls=[{"points": [[0.3, 0.0], [0.3, 0.3]]}],
        grains=[BED, ball],
        solver={"kind": kind},
        effects={"friction": {"mu": 0.5}, **({} if sleeping is None else {"sleeping": sleeping})},
    )
    return sand.Simulation(scene, threads=threads)


def asleep(sim: sand.Simulation) -> int:
    return int(sim.report()["grains_asleep"])


SOLVERS = [pytest.param("md", marks=pytest.mark.slow), "rigid"]
"""What both solvers do by the same code is tried with `md` among the slow tests."""


@pytest.mark.parametrize("kind", SOLVERS)
def test_falling_asleep_and_waking_costs_no_energy(kind: str) -> None:
    """The kinetic energy that sleep takes, and that waking sets free, is below 1e-6 m g d a grain; forces and overlaps stay."""
    sim = bed(kind, {}, LEAVING)
    while asleep(sim) < 100 and sim.time < 6:
        before = sim.report()
        sim.advance(1 / 60)
        after = sim.report()
        if asleep(sim):
            assert abs(after["kinetic_energy_J"] - before["kinetic_energy_J"]) < 1e-6 * WEIGHT * 100
    assert asleep(sim) == 100 and sim.time < 6
    resting = sim.report()
    assert resting["floor_force_N"] == pytest.approx(WEIGHT / D * 100, rel=0.02)
    here = sim.positions
    sim.renew()
    woken = sim.report()
    assert woken["grains_asleep"] == 0
    for key in ("contacts", "overlap_mean", "overlap_max", "floor_force_N", "coordination", "packing_fraction", "potential_energy_J"):
        assert woken[key] == pytest.approx(resting[key], rel=1e-6), key
    sim.advance(0.1)
    assert sim.report()["kinetic_energy_J"] < 1e-6 * WEIGHT * 100
    assert np.abs(sim.positions - here).max() < 2e-3 * D  # a rigid pile still creeps to its place


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_a_sleeping_pile_does_not_move_a_bit(kind: str) -> None:
    """60 s asleep change nothing; a grain that leaves meanwhile is counted, and nobody else is."""
    sim = bed(kind, QUICK, LEAVING)
    sim.advance(0.25)
    assert asleep(sim) == 100 and sim.count == 101
    resting = sim.positions[:100]
    sim.advance(0.25)
    assert sim.count == 100 and sim.lost == 1 and list(sim.ids) == list(range(100))
    assert (sim.positions == resting).all()
    before = digest(sim)
    sim.advance(59.5)
    assert digest(sim) == before and asleep(sim) == 100
    assert not sim.flags()


RULES = {"foreseen impact": {"share": 10.0}, "imbalance": {"impact": 1e3}}
"""Each with the other rule out of action."""


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_a_falling_grain_wakes(kind: str, rule: str) -> None:
    sim = bed(kind, {**QUICK, **RULES[rule]})
    sim.advance(0.36)
    assert asleep(sim) == 100
    before = sim.positions[:100]
    sim.advance(0.09)
    assert 0 < asleep(sim) < 100
    assert np.abs(sim.positions[:100] - before).max() > 1e-6 * D


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_changes_by_hand_wake(kind: str) -> None:
    """Gravity, a parameter of an effect, a grain that comes, one that goes."""
    sim = bed(kind, QUICK)

    def sleeps() -> bool:
        for _ in range(20):
            sim.advance(0.1)
            if asleep(sim) == sim.count:
                return True
        return False

    sim.advance(0.6)  # the ball has landed
    assert sleeps()
    sim.retune(sim.scene.model_copy(update={"gravity": (0.5, -G)}))
    assert asleep(sim) == 0 and sleeps()
    sim.set("effects.friction.mu", 0.4)
    assert asleep(sim) == 0 and sleeps()
    top = int(np.argmax(sim.positions[:, 1]))
    _, whole = edit.places(sim.world)
    edit.remove(sim.world, np.flatnonzero(whole[:, 0] == top))
    sim.removed += 1
    sim.renew()
    assert asleep(sim) == 0 and sim.count == 100 and top not in sim.ids and sleeps()
    ball = {"position": [[0.45, 0.05]], "velocity": [[0.0, 0.0]], "angle": [0.0], "spin": [0.0], "radius": [RADIUS], "kind": [0]}
    mass = DENSITY * np.pi * RADIUS**2
    ball |= {"mass": [mass], "inertia": [mass * RADIUS**2 / 2]}
    edit.add(sim.world, {name: np.array(values) for name, values in ball.items()}, sim.made)
    sim.made += 1
    sim.renew()
    assert asleep(sim) == 0 and sim.count == 101
    sim.advance(0.1)
    assert sim.count == 101 and not sim.flags()


@pytest.mark.parametrize("kind", SOLVERS)
def test_resumes_with_sleepers(kind: str, tmp_path: Path) -> None:
    sim = bed(kind, QUICK)
    sim.advance(0.3)
    assert asleep(sim) == 100
    sim.save(tmp_path / "there.npz")
    sim.advance(0.3)
    end = digest(sim)
    del sim
    fresh_taichi()
    sim = sand.Simulation.resume(tmp_path / "there.npz", threads=1)
    sim.advance(0.3)
    assert digest(sim) == end


def test_strips_sleep_to_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """In parallel strips: one thread and two give the same bits through sleep, impact and loss."""
    monkeypatch.setattr(build, "STRIPS_FROM", 50)
    ends = []
    for threads in (1, 2):
        sim = bed("rigid", QUICK, threads=threads)
        assert sim.world.layout == "strips"
        sim.advance(0.36)
        assert asleep(sim) == 100
        sim.advance(0.2)
        ends.append((digest(sim), asleep(sim)))
        del sim
    assert ends[0] == ends[1]


@pytest.mark.parametrize("kind", SOLVERS)
def test_clumps_sleep_and_wake(kind: str) -> None:
    """A heap of triangles falls asleep and does not move a bit; woken by hand every contact is as it was; a falling disc wakes some."""
    fresh_taichi()
    heap = {
        "shape": "triangle",
        "radius": 0.5 * RADIUS,
        "density": DENSITY,
        "count": 40,
        "region": [0.0, 0.0, 0.2, 0.25],
        "angle": "random",
    }
    ball = {"positions": [[0.1, 0.4]], "radius": 0.012, "density": DENSITY, "velocity": [0.0, 4.0]}  # is back after 0.89 s
    effects = {"friction": {"mu": 0.5}, "sleeping": QUICK}
    scene = sand.Scene(size=[0.2, 2.0], grains=[heap, ball], solver={"kind": kind}, effects=effects, seed=3)
    sim = sand.Simulation(scene, threads=1)
    sim.advance(0.7)
    assert asleep(sim) == 40
    resting, here = sim.report(), sim.positions[:40]
    sim.renew()
    woken = sim.report()
    assert woken["grains_asleep"] == 0
    for key in ("contacts", "overlap_mean", "overlap_max", "floor_force_N", "coordination"):
        assert woken[key] == pytest.approx(resting[key], rel=1e-6, abs=1e-8), key  # places have 24 bits
    sim.advance(0.15)
    assert asleep(sim) == 40
    assert np.abs(sim.positions[:40] - here).max() < 0.03 * D  # QUICK sleepers had not come to rest
    here = sim.positions[:40]
    sim.advance(0.01)
    assert (sim.positions[:40] == here).all()
    fewest = 40
    for _ in range(8):
        sim.advance(1 / 60)
        fewest = min(fewest, asleep(sim))
    assert fewest < 40
    assert np.abs(sim.positions[:40] - here).max() > 1e-6 * D


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_waking_a_few_changes_nothing_else(kind: str) -> None:
    """Who sleeps at one place is woken, then who does at another: every contact is as it was, and no sleeper out of balance."""
    sim = bed(kind, QUICK, LEAVING)
    sim.advance(0.35)
    assert asleep(sim) == 100
    keys = ("contacts", "overlap_mean", "overlap_max", "floor_force_N", "coordination", "packing_fraction", "potential_energy_J")
    resting, here, sleep = sim.report(), sim.positions, sim.world.sleep
    left = [100]
    for slot in (0, 60, 95, 99):  # at the left wall, amid, at the right wall
        x, y = sim.world.grains.site[slot]
        sleep.woken[int(x) * int(sim.world.box[None].sites[1]) + int(y)] = 1
        sleep.state[None].due = 1
        sim._march(0)
        left.append(asleep(sim))
        assert 0 < left[-1] < left[-2] and (sim.positions == here).all()
        free = sim.world.grains.mobility.to_numpy()[:100, 0] > 0
        assert free[: 100 - left[-1]].all() and not free[100 - left[-1] :].any()
        found = sim.report()
        for key in keys:
            assert found[key] == pytest.approx(resting[key], rel=1e-6), key
    sim.renew()
    found = sim.report()
    for key in keys:
        assert found[key] == pytest.approx(resting[key], rel=1e-6), key
    sim.advance(1.0)
    assert asleep(sim) == 100


@pytest.mark.parametrize("kind", SOLVERS)
def test_a_moving_wall_wakes(kind: str) -> None:
    """A lid comes down onto a sleeping bed: who it is about to touch wakes before it does, and nobody sleeps under it."""
    fresh_taichi()
    bed = {"radius": RADIUS, "density": DENSITY, "fill": "hexagonal", "count": 58, "region": [0.0, 0.0, 0.3, 0.3]}
    top = 2 * RADIUS + 3 * np.sqrt(3) * RADIUS
    lid = {"points": [[0.0, top + 0.3], [0.3, top + 0.3]], "velocity": [0.0, -0.3]}
    scene = sand.Scene(
        size=[0.3, 0.4], grains=[bed], walls=[lid], solver={"kind": kind}, effects={"friction": {"mu": 0.5}, "sleeping": QUICK}
    )
    sim = sand.Simulation(scene, threads=1)
    sim.advance(0.4)
    assert asleep(sim) == 58
    here = sim.positions
    sim.advance(0.57)
    assert asleep(sim) < 58 and np.abs(sim.positions - here).max() < 0.02 * D
    assert sim.positions[:, 1].max() + RADIUS < top + 0.3 - 0.3 * sim.time
    sim.advance(0.2)
    assert asleep(sim) < 58 and "wall" in sim.flags()[0]  # it waits, jammed


def test_off_lays_nothing_by() -> None:
    """Without the effect there is no table of sleep, and the neighbour list has two parts."""
    sim = bed("rigid", None)
    assert sim.world.sleep is None and sim.world.pairs.first.shape[0] == 2 * sim.world.half
    assert "grains_asleep" not in sim.report()
