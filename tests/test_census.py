"""Grains that come, go, are held and pulled at while it runs: contacts that stay keep their force, momentum is what the hand gave."""

import numpy as np
import pytest
from helpers import D, M, R

import taichi_sand as sand
from taichi_sand.play import snapshot
from taichi_sand.world import edit
from taichi_sand.world.extras import hand

G = 9.81
COLUMN = 6


@pytest.fixture(scope="module", params=["rigid", "md"])
def column(request: pytest.FixtureRequest) -> tuple[sand.Simulation, snapshot.Snapshot]:
    """A column of discs at rest between close walls, and the moment when it was."""
    rows = [[R, R + k * D * 0.999] for k in range(COLUMN)]
    scene = sand.Scene(
        size=[D * 1.0001, 20 * D],
        solver={"kind": request.param, "tolerance": 0.01},
        grains=[{"radius": R, "positions": rows}],
        effects={"friction": {}},
    )
    sim = sand.Simulation(scene, threads=1, room=8, hand=True)
    sim.advance(1.0)
    return sim, snapshot.take(sim)


def state(sim: sand.Simulation) -> bytes:
    return b"".join(np.ascontiguousarray(a).tobytes() for a in (sim.ids, sim.positions, sim.velocities, sim.angles, sim.spins))


def test_a_snapshot_brings_everything_back_bit_for_bit(column: tuple) -> None:
    sim, start = column
    snapshot.restore(sim, start)
    sim.advance(0.1)
    after = state(sim)
    snapshot.restore(sim, snapshot.from_bytes(snapshot.to_bytes(start)))
    sim.advance(0.1)
    assert state(sim) == after


def test_what_stays_keeps_its_load_when_the_top_is_taken_away(column: tuple) -> None:
    sim, start = column
    snapshot.restore(sim, start)
    places, whole = edit.places(sim.world)
    assert sorted(whole[:, 0]) == list(range(COLUMN))
    top = np.argmax(places[:, 1])
    edit.remove(sim.world, np.array([top]))
    sim.removed += 1
    sim.renew()
    assert sim.count == COLUMN - 1 and sim.lost == 0 and whole[top, 0] not in sim.ids
    fastest = 0.0
    for _ in range(20):
        sim.advance(0.002)
        fastest = max(fastest, np.abs(sim.velocities).max())
    assert fastest < 0.05 * np.sqrt(G * D)  # nothing jumps; with the lost contact's impulse it would be 0.5
    sim.advance(0.5)
    assert sim.report()["floor_force_N"] == pytest.approx((COLUMN - 1) * M * G, rel=0.02)


def test_added_grains_fall_and_carry(column: tuple) -> None:
    sim, saved = column
    snapshot.restore(sim, saved)
    new = {"position": np.array([[R, 12 * D], [R, 14 * D]]), "velocity": np.zeros((2, 2)), "kind": np.zeros(2)}
    new |= {"angle": np.zeros(2), "spin": np.zeros(2), "radius": np.full(2, R), "mass": np.full(2, M), "inertia": np.full(2, M * R**2 / 2)}
    edit.add(sim.world, new, sim.made)
    sim.made += 2
    sim.renew()
    assert list(sim.ids) == list(range(COLUMN + 2))
    start = sim.time
    sim.advance(0.05)
    t = sim.time - start  # whole steps
    assert sim.positions[-1, 1] == pytest.approx(14 * D - G * t * (t + sim.step) / 2, abs=0.005 * D)  # symplectic Euler
    sim.advance(1.0)
    assert sim.report()["floor_force_N"] == pytest.approx((COLUMN + 2) * M * G, rel=0.02)


def test_held_grains_stay_and_fall_when_let_go(column: tuple) -> None:
    sim, start = column
    snapshot.restore(sim, start)
    _, whole = edit.places(sim.world)
    slot = np.flatnonzero(whole[:, 0] == COLUMN - 1)
    edit.hold(sim.world, slot, np.zeros((1, 2)))
    edit.remove(sim.world, np.flatnonzero(whole[:, 0] == COLUMN - 2))
    sim.removed += 1
    sim.renew()
    before = sim.positions[-1]
    sim.advance(0.1)
    assert np.array_equal(sim.positions[-1], before)
    _, whole = edit.places(sim.world)
    assert list(whole[whole[:, 2] == 1, 0]) == [COLUMN - 1]
    edit.hold(sim.world, np.flatnonzero(whole[:, 0] == COLUMN - 1), np.array([[1 / M, 2 / (M * R**2)]]))
    sim.renew()
    sim.advance(0.02)
    assert sim.velocities[-1, 1] == pytest.approx(-G * 0.02, rel=0.1)


def test_the_hand_gives_the_momentum_it_says(column: tuple) -> None:
    """A free grain pulled by the limited spring: m v = impulse of the hand - m g t, and no more force than the limit."""
    sim, start = column
    snapshot.restore(sim, start)
    now = sim.hand.now
    top = COLUMN - 1
    y = sim.positions[top, 1]
    values = {"work": hand.GRAB, "grain": top, "rate": 4000.0, "drag": 1.0, "limit": 5 * M * G, "reach": 0.0}
    now[None] = {**values, "place": [R, y + 5 * D], "velocity": [0.0, 0.0], "given": [0.0, 0.0]}
    t = sim.time
    sim.advance(0.03)
    given = now[None].given.to_numpy()
    t = sim.time - t
    assert given[1] == pytest.approx(5 * M * G * t, rel=0.01)  # far away the limit holds
    assert M * sim.velocities[top, 1] == pytest.approx(given[1] - M * G * t, rel=0.01)


def test_a_new_tolerance_and_gravity_take_hold_without_compiling(column: tuple) -> None:
    sim, start = column
    snapshot.restore(sim, start)
    step, compiled = sim.step, sim.clock.compile
    solver = sim.scene.solver.model_copy(update={"tolerance": 0.0025})
    sim.retune(sim.scene.model_copy(update={"solver": solver}))
    ratio = sim.step / step
    assert ratio == pytest.approx(0.5, rel=0.01) or (sim.scene.solver.kind == "rigid" and 0.5 <= ratio <= 1)
    time = sim.time
    sim.advance(0.3)
    assert sim.time == pytest.approx(time + 0.3, abs=sim.step)
    assert sim.report()["floor_force_N"] == pytest.approx(COLUMN * M * G, rel=0.03)
    sim.retune(sim.scene.model_copy(update={"gravity": (0.0, -2 * G)}))
    sim.advance(0.5)
    assert sim.report()["floor_force_N"] == pytest.approx(2 * COLUMN * M * G, rel=0.03)
    assert sim.clock.compile == compiled
