"""Steering from Python: grains come, go, are set and pushed while a simulation goes on, and functions are called on time."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import G, R, digest, fresh_taichi

import taichi_sand as sand
from taichi_sand.play.snapshot import restore, take
from taichi_sand.run.calling import mean_speed

RHO = 2000.0
M = RHO * math.pi * R**2
SIZE = (16 * R, 24 * R)
KINDS = ("md", "rigid")


def scene_of(kind: str, *, count: int = 8, effects: dict[str, Any] | None = None, **keys: Any) -> sand.Scene:
    """A layer of discs on the floor of a box."""
    grains = [{"radius": R, "density": RHO, "positions": [[(2 * k + 1) * R, R] for k in range(count)]}]
    effects = {"friction": {"mu": 0.4}, "push": {}} if effects is None else effects
    table = {"size": SIZE, "gravity": (0.0, -G), "solver": {"kind": kind, "tolerance": 0.01}, "grains": grains, "effects": effects}
    return sand.Scene(**{**table, **keys})


@pytest.fixture(scope="module", params=KINDS)
def made(request: pytest.FixtureRequest) -> tuple[sand.Simulation, Any]:
    """A simulation with room for 55 grains more, and its start."""
    fresh_taichi()
    sim = sand.Simulation(scene_of(request.param), threads=1)
    sim.advance(0.2)
    return sim, take(sim)


@pytest.fixture
def sim(made: tuple) -> sand.Simulation:
    """At its start, a layer of eight at rest."""
    restore(*made)
    made[0].calls.found.clear()
    return made[0]


def row_of(sim: sand.Simulation, grain: int) -> int:
    return int(np.flatnonzero(sim.ids == grain)[0])


def weights(sim: sand.Simulation) -> float:
    """What the floor bears, in grains."""
    return sim.report()["floor_force_N"] / (M * G)


def test_a_push_gives_force_times_time(sim: sand.Simulation) -> None:
    """Momentum F t and spin T t / I to rounding, from rest and in flight; let go, it flies on as it does."""
    grain = sim.add([[5 * R, 16 * R]], radius=R)[0]
    force, torque, inertia = np.array([0.4 * M * G, 1.1 * M * G]), 2e-2 * M * G * R, 0.5 * M * R**2
    sim.push(grain, force=force, torque=torque)
    start = sim.time
    sim.advance(0.1)
    t, at = sim.time - start, row_of(sim, grain)
    assert M * sim.velocities[at] == pytest.approx((force + np.array([0.0, -M * G])) * t, rel=2e-5)
    assert inertia * sim.spins[at] == pytest.approx(torque * t, rel=2e-5)
    sim.push([grain], force=np.zeros((1, 2)))
    before, start = sim.velocities[at], sim.time
    sim.advance(0.05)
    assert sim.velocities[at] == pytest.approx(before + np.array([0.0, -G * (sim.time - start)]), rel=2e-5)
    assert np.abs(sim.velocities[:8]).max() < 1e-3 and sim.flags() == []


def test_a_pushed_grain_is_borne(sim: sand.Simulation) -> None:
    """One that rests, pushed down with twenty times its weight, rests on, and no deeper than the tolerance; pushed up with half of it the
    floor bears half; pushed along by more than 3 mu times its weight it slides, at (F - mu m g) / m (physics.md A9).
    """
    sim.push(3, force=(0.0, -20 * M * G))
    sim.advance(0.3)
    assert weights(sim) == pytest.approx(28, rel=1e-3) and sim.report()["overlap_max"] < 1.5 * 0.01
    assert sim.report()["speed_max_m_s"] < 1e-3
    sim.push(3, force=[0.0, 0.5 * M * G])
    sim.advance(0.3)
    assert weights(sim) == pytest.approx(7.5, rel=1e-3)
    sim.remove([6, 7])
    sim.push(3)
    sim.push(5, force=(6 * 0.4 * M * G, 0.0))
    start, at = sim.time, row_of(sim, 5)
    before = sim.velocities[at, 0]
    sim.advance(0.03)
    assert sim.velocities[at, 0] - before == pytest.approx((6 * 0.4 - 0.4) * G * (sim.time - start), rel=0.02)


def test_set_state_and_the_flight_after_it(sim: sand.Simulation) -> None:
    """A parabola from where a grain was put; what is not given stays; neighbours that lose it do not notice anything but that."""
    at, before = row_of(sim, 4), sim.positions
    place, speed = np.array([6 * R, 12 * R]), np.array([0.3, 0.8])
    sim.set_state(4, positions=[place], velocities=speed, spins=5.0)
    start = sim.time
    assert sim.positions[at] == pytest.approx(place, rel=1e-6) and sim.velocities[at] == pytest.approx(speed)
    sim.advance(0.1)
    t = sim.time - start
    fallen = 0.5 * G * t * (t + sim.step)  # of symplectic Euler
    assert sim.positions[at] == pytest.approx(place + speed * t - [0.0, fallen], abs=1e-3 * R)
    assert sim.spins[at] == 5.0
    others = np.flatnonzero(sim.ids != 4)
    assert np.abs(sim.positions - before)[others].max() < 1e-2 * R and weights(sim) == pytest.approx(7, rel=1e-3)
    sim.set_state([4, 2], angles=[0.5, -0.5])
    assert sim.angles[[at, row_of(sim, 2)]] == pytest.approx([0.5, -0.5])
    whole = sim.positions
    sim.set_state(sim.ids, positions=whole)
    assert sim.positions == pytest.approx(whole, abs=1e-9)


def test_the_floor_bears_what_is_there(sim: sand.Simulation) -> None:
    """Grains that are added fall, rest and weigh, those taken out do not; ids are never used again. Without friction walls bear nothing."""
    sim.set("effects.friction.mu", 0.0)
    x = np.arange(8) * 2 * R + R
    added = sim.add(np.stack([x, np.full(8, 4 * R)], axis=1), radius=R, velocities=(0.0, -0.2))
    assert added.tolist() == list(range(8, 16)) and sim.count == 16
    assert sim.advance_until("rest", at_most=5.0)
    assert weights(sim) == pytest.approx(16, rel=2e-3)
    sim.remove(added[::2])
    more = sim.add([(4 * R, 16 * R)], radius=np.float32(0.8 * R), kind="disc")
    assert more.tolist() == [16] and set(sim.ids) == {*range(8), *added[1::2], 16}
    assert sim.advance_until("rest", at_most=5.0)
    assert weights(sim) == pytest.approx(12.64, rel=2e-3)
    assert (sim.lost, sim.taken, sim.made) == (0, 4, 17) and sim.flags() == []


def test_wrong_arguments_change_nothing(sim: sand.Simulation) -> None:
    """Each is refused in a sentence that names function, argument and value, and what is allowed."""
    before, steps = digest(sim), sim.step
    point, nan = [[8 * R, 12 * R]], math.nan
    wrong: dict[str, Callable[[], Any]] = {
        r"add: positions\[0\]\[1\] = nan .* finite": lambda: sim.add([[R, nan]], radius=R),
        r"add: positions\[1\] = .*outside the box, x 0 … 0\.\d+, y": lambda: sim.add([point[0], [R, 30 * R]], radius=R),
        r"add: positions must be numbers of shape \(n, 2\)": lambda: sim.add([R, 8 * R], radius=R),
        r"add: positions must be numbers of": lambda: sim.add("here", radius=R),
        r"add: radius = \[.*\] must be numbers of shape \(1,\)": lambda: sim.add(point, radius=[R, R]),
        r"add: radius = -.* must be at least 1e-06 m": lambda: sim.add(point, radius=-R),
        r"add: radius = .* must be at most 0\.005 m, .*until = 0": lambda: sim.add(point, radius=[1.01 * R]),
        r"add: velocities\[0\]\[0\] = inf": lambda: sim.add(point, radius=R, velocities=(math.inf, 0.0)),
        r"add: kind = 3 must be the number of a .* 0 … 0": lambda: sim.add(point, radius=R, kind=3),
        r'add: kind = "dics" .* did you mean `disc`': lambda: sim.add(point, radius=R, kind="dics"),
        r"add: grain 8 would overlap grain 2 by .* more than .* m, which is allowed": lambda: sim.add([[5 * R, 2.5 * R]], radius=R),
        r"add: grain 9 would overlap grain 8|add: grain 8 would overlap grain 9": lambda: sim.add([point[0], point[0]], radius=R),
        r"add: grain 8 would overlap a wall or an edge": lambda: sim.add([[0.5 * R, 12 * R]], radius=R),
        r"remove: ids: there is no grain 8": lambda: sim.remove(8),
        r"remove: ids: there is no grain -1": lambda: sim.remove([0, -1]),
        r"remove: ids: a grain is named twice": lambda: sim.remove([1, 1]),
        r"remove: ids = 0\.5 must be whole numbers": lambda: sim.remove(0.5),
        r"set_state: velocities = .* must be numbers of shape \(2, 2\)": lambda: sim.set_state([0, 1], velocities=np.zeros((3, 2))),
        r"set_state: spins\[0\] = nan": lambda: sim.set_state(0, spins=nan),
        r"set_state: grain 0 would overlap grain 5": lambda: sim.set_state(0, positions=[[11 * R, 2 * R]]),
        r"set_state: positions\[0\] = .* outside": lambda: sim.set_state(0, positions=[[-R, 2 * R]]),
        r"push: force = .* must be numbers of shape \(1, 2\)": lambda: sim.push(0, force=1.0 + 1j),
        r"push: torque\[0\] = inf": lambda: sim.push(0, torque=math.inf),
        r"push: ids: there is no grain 77": lambda: sim.push(77, force=(1, 1)),
        r"every: seconds = 0 must be a number greater than 0": lambda: sim.every(0, print),
        r"every: function = 3 must be a function": lambda: sim.every(0.1, 3),
        r'advance_until: condition = "still" must be "rest", an event or a function': lambda: sim.advance_until("still", at_most=1.0),
        r"advance_until: at_most = -1 must be a number of 0 or more": lambda: sim.advance_until("rest", at_most=-1),
    }
    for text, act in wrong.items():
        with pytest.raises(sand.SandError, match=text):
            act()
    assert (digest(sim), sim.step, sim.made, sim.removed, sim.calls.found) == (before, steps, 8, 0, [])
    assert sim.add(np.empty((0, 2)), radius=R).tolist() == [] and sim.remove([]) is None


def test_every_is_on_time(sim: sand.Simulation) -> None:
    """To the nearest step, for hours: times do not drift, whatever the launches and strides, and when the step changes on the way."""
    times: list[float] = []
    start = sim.time
    handle = sim.every(0.01, lambda s: times.append(s.time - start))
    for _ in range(7):
        sim.advance(0.03)
    sim.set("solver.tolerance", 0.02)
    sim.advance(0.19)
    assert len(times) == 40
    assert np.abs(np.array(times) - 0.01 * np.arange(1, 41)).max() <= 0.51 * max(sim.step, 1e-3 if sim.scene.solver.kind == "rigid" else 0)
    handle.stop()
    sim.advance(0.05)
    assert len(times) == 40
    often: list[int] = []
    quick = sim.every(0.4 * sim.step, lambda s: often.append(s.steps))
    first = sim.steps
    sim.advance_steps(5)
    assert often == list(range(first + 1, first + 6))
    quick.stop()


def test_functions_that_are_called_may_change_it(sim: sand.Simulation, tmp_path: Path) -> None:
    """They add, set and stop, and see whole states; they cannot advance; what they raise leaves all whole, and the next call is on time."""
    calls: list[float] = []

    def pour(s: sand.Simulation) -> None:
        calls.append(s.time)
        s.add([[8 * R, 20 * R]], radius=R, velocities=(0.0, -1.0))
        s.set("solver.tolerance", 0.02 if len(calls) % 2 else 0.01)
        if len(calls) == 3:
            raise RuntimeError("enough")

    start = sim.time
    handle = sim.every(0.05, pour)
    with pytest.raises(RuntimeError, match="enough"):
        sim.advance(1.0)
    assert len(calls) == 3 and sim.count == 11 and sim.world.pace[None].done == sim.steps and sim.runner is None
    sim.advance_to(start + 0.21)
    assert len(calls) == 4 and calls[-1] - start == pytest.approx(0.2, abs=1e-3)
    handle.stop()
    nested = sim.every(0.01, lambda s: s.advance(0.1))
    with pytest.raises(sand.SandError, match="cannot advance the simulation"):
        sim.advance(0.1)
    nested.stop()
    sim.advance(0.05)
    assert sim.time == pytest.approx(start + 0.27, abs=2e-3) and sim.flags() == []


def test_until_something_holds(sim: sand.Simulation) -> None:
    """A function is asked at once and then every so often; who has come to rest must have been slow for 0.2 s."""
    start = sim.time
    assert sim.advance_until(lambda s: True, at_most=1.0) and sim.time == start
    assert not sim.advance_until(lambda s: False, at_most=0.05) and sim.time == pytest.approx(start + 0.05, abs=sim.step)
    grain = sim.add([[8 * R, 12 * R]], radius=R)[0]
    dropped = sim.time
    assert sim.advance_until(lambda s: s.positions[row_of(s, grain), 1] < 6 * R, at_most=1.0, every=0.001)
    assert sim.time - dropped == pytest.approx(math.sqrt(2 * 6 * R / G), abs=0.002)
    rests = sim.time
    assert sim.advance_until("rest", at_most=5.0) and sim.time >= rests + 0.2
    assert mean_speed(sim.world) < 1e-3 * math.sqrt(G * 2 * R)
    sim.set("gravity", (0.0, 0.0))
    sim.set_state(sim.ids, velocities=(1e-3, 0.0))
    assert not sim.advance_until("rest", at_most=0.1)


def test_resumed_with_pushes_to_the_same_bits(sim: sand.Simulation, tmp_path: Path) -> None:
    """Also under grains that were added, and after undo."""
    sim.add([[8 * R, 8 * R], [4 * R, 8 * R]], radius=[R, 0.7 * R])
    sim.push([0, 8], force=[[0.3 * M * G, 0.0], [0.0, M * G]], torque=[0.0, 1e-3 * M * G * R])
    sim.advance(0.05)
    sim.save(tmp_path / "pushed.npz")
    moment = take(sim)
    sim.advance(0.1)
    end = digest(sim)
    restore(sim, moment)
    sim.advance(0.1)
    assert digest(sim) == end
    again = sand.Simulation.resume(tmp_path / "pushed.npz", threads=1)
    again.advance(0.1)
    assert digest(again) == end and again.add([[8 * R, 20 * R]], radius=R).tolist() == [10]


def steer(room: int, threads: int = 1) -> str:
    """A hundred grains come, some go, some are pushed; the state at the end."""
    sim = sand.Simulation(scene_of("rigid", effects={"friction": {"mu": 0.4}}), threads=threads, room=room)
    x, y = np.meshgrid(np.arange(7) * 2.2 * R + 1.2 * R, np.arange(7) * 2.2 * R + 4 * R)
    added = sim.add(np.stack([x.ravel(), y.ravel()], axis=1), radius=R)
    sim.advance(0.1)
    more = sim.add(np.stack([x[0], np.full(7, 22.5 * R)], axis=1), radius=0.9 * R)
    sim.advance(0.05)
    sim.remove(added[3::7])
    sim.push(more, force=(0.2 * M * G, 0.0), torque=1e-2 * M * G * R)
    sim.advance(0.2)
    assert sim.count == 8 + 49 + 7 - 7 and sim.flags() == []
    return digest(sim)


def test_room_grows_and_effects_come_to_the_same_bits() -> None:
    """More grains than there was room for, and a first push, in the middle of a flow: all goes on as where there was room for them."""
    fresh_taichi()
    few = steer(0)
    fresh_taichi()
    assert steer(100) == few


def test_an_empty_box_that_announces_what_will_come() -> None:
    """Grains of any announced size come into it, and are made for: a heavy one and a light one fall, rest and weigh."""
    fresh_taichi()
    source = {"radius": [0.5 * R, 2 * R], "density": RHO, "rate": 1.0, "until": 0.0, "region": [0.0, 0.0, 8 * R, 8 * R]}
    sim = sand.Simulation(scene_of("rigid", grains=[], sources=[source], effects={}), threads=1)
    sim.advance(0.1)
    assert sim.count == 0 and sim.bed.diameter == pytest.approx(2.5 * R)
    sim.add([[4 * R, 4 * R], [10 * R, 4 * R]], radius=[2 * R, 0.5 * R])
    assert sim.advance_until("rest", at_most=5.0) and weights(sim) == pytest.approx(4.25, rel=1e-3)
    with pytest.raises(sand.SandError, match=r"at most 0\.01 m"):
        sim.add([[4 * R, 12 * R]], radius=2.1 * R)
    bare = sand.Simulation(scene_of("rigid", grains=[], effects={}), threads=1)
    with pytest.raises(sand.SandError, match="neither grains nor sources"):
        bare.add([[4 * R, 12 * R]], radius=R)


SHELF = [[2 * R, 6 * R], [14 * R, 6 * R]]
PROPELLER = {"points": [[6 * R, 20 * R], [10 * R, 20 * R]], "spin": 3.0}


@pytest.mark.parametrize("kind", KINDS)
def test_walls_start_stop_and_go(kind: str, tmp_path: Path) -> None:
    """A shelf on which grains rest is lifted, moved along, stopped and taken away; another wall that turns goes on all the while; resumed
    on the way to the same bits.
    """
    fresh_taichi()
    rows = [[(3 + 2 * k) * R, 7 * R] for k in range(4)]
    sim = sand.Simulation(scene_of(kind, grains=[{"radius": R, "density": RHO, "positions": rows}], walls=[{"points": SHELF}]), threads=1)
    sim.advance(0.2)
    before, start = sim.positions, sim.time
    sim.set_walls([{"points": SHELF, "velocity": [0.0, 0.1]}, PROPELLER])
    sim.advance(0.2)
    t = sim.time - start
    assert sim.positions - before == pytest.approx(np.tile([0.0, 0.1 * t], (4, 1)), abs=2e-2 * R)
    assert sim.wall_points[0] == pytest.approx(np.array(SHELF) + np.array([0.0, 0.1 * t]), abs=1e-6)
    sim.save(tmp_path / "lifted.npz")
    sim.advance(0.1)
    lifted = digest(sim)
    sim.set_walls([{"points": sim.wall_points[0], "velocity": [0.15, 0.0]}, PROPELLER])
    sim.advance(0.04)  # discs that a floor sets rolling come to a third of its speed
    assert sim.velocities[:, 0] == pytest.approx(0.05, rel=0.05)
    sim.set_walls([PROPELLER, {"points": sim.wall_points[0]}])
    sim.advance(0.1)
    assert sim.wall_points[0][1] == pytest.approx(
        R * np.array([8 + 2 * math.cos(3 * sim.time - 0.6), 20 + 2 * math.sin(3 * sim.time - 0.6)]), abs=0.01 * R
    )
    with pytest.raises(sand.SandError, match=r"walls\[0\]"):
        sim.set_walls([{"points": SHELF, "velocity": [0.0, "up"]}])
    sim.set_walls([])
    assert sim.advance_until("rest", at_most=5.0)
    assert weights(sim) == pytest.approx(4, rel=2e-3) and sim.flags() == []
    again = sand.Simulation.resume(tmp_path / "lifted.npz", threads=1)
    again.advance(0.1)
    assert digest(again) == lifted


def test_a_recorder_that_is_running_sees_it_all(sim: sand.Simulation, tmp_path: Path) -> None:
    """Frames have the grains of their moments, and the ids that they have."""
    hoomd = pytest.importorskip("gsd.hoomd", reason="the extra `data` is not installed")
    recorder = sim.record(tmp_path / "run.gsd", every=0.02)
    start = sim.count
    first = sim.add([[8 * R, 12 * R], [8 * R, 16 * R]], radius=[R, 0.9 * R])
    sim.advance(0.03)
    sim.remove([0, first[0]])
    sim.set_state(first[1], positions=[[8 * R, 20 * R]])
    sim.advance(0.03)
    recorder.stop()
    with hoomd.open(str(tmp_path / "run.gsd"), "r") as frames:
        counts = [frame.particles.N for frame in frames]
        ids = [frame.log["particles/id"].ravel().tolist() for frame in frames]
    assert counts[0] == start and start + 2 in counts and counts[-1] == start
    assert ids[-1] == sim.ids.tolist() == [*range(1, 8), 9]
