"""Time adds up: any loop of strides ends where one long stride does, and does what that does."""

import math
from pathlib import Path

import numpy as np
import pytest
from helpers import Disc, G, M, R, digest, fresh_taichi, simulate
from hypothesis import given, settings
from hypothesis import strategies as st

import taichi_sand as sand
from taichi_sand.output.film import steps_of
from taichi_sand.world.tables import MOST_STEPS, steps_within

KINDS = ("md", "rigid")


@pytest.fixture(scope="module", params=KINDS)
def flight(request: pytest.FixtureRequest) -> sand.Simulation:
    """One disc in free flight, with steps of 1/480 s."""
    soft = {"stiffness": 2e3 * M} if request.param == "md" else {}
    return simulate([Disc(0.5, 0.5)], (1.0, 1.0), {"kind": request.param, "step": 1 / 480, **soft})


@pytest.mark.parametrize(("strides", "stride"), [(120, 1 / 60), (400, 0.005), (2000, 0.001), (5000, 1e-4), (7, 0.1)])
def test_loops_end_where_they_should(flight: sand.Simulation, strides: int, stride: float) -> None:
    start = flight.time - flight.owed
    for _ in range(strides):
        flight.advance(stride)
    assert abs(flight.time - start - strides * stride) <= 0.5 * flight.step * (1 + 1e-6) + abs(flight.owed)
    assert abs(flight.owed) <= 0.5 * flight.step * (1 + 1e-6)


@settings(max_examples=60, deadline=None)
@given(strides=st.lists(st.floats(0, 0.02) | st.floats(0, 1e-3), max_size=60))
def test_any_strides_add_up(flight: sand.Simulation, strides: list[float]) -> None:
    """Within half a step of the sum, at every moment."""
    start, total = flight.time + flight.owed, 0.0
    for stride in strides:
        flight.advance(stride)
        total += stride
        assert abs(flight.time - start - total) <= 0.5 * flight.step * (1 + 1e-6)


@settings(max_examples=30, deadline=None)
@given(strides=st.lists(st.floats(0, 0.02), max_size=20), between=st.floats(0, 0.01))
def test_any_moment_is_met(flight: sand.Simulation, strides: list[float], between: float) -> None:
    """Whatever was left over before."""
    flight.advance(between)
    moment = flight.time
    for stride in strides:
        moment += stride
        flight.advance_to(moment)
        assert abs(flight.time - moment) <= 0.5 * flight.step * (1 + 1e-6)


def test_a_loop_until_a_time_ends(flight: sand.Simulation) -> None:
    end, rounds = flight.time + 9.5 * flight.step, 0  # ten steps, whatever the last bit of a time
    while flight.time < end:
        flight.advance(flight.step / 7)
        rounds += 1
    assert rounds <= 70 + 4 and flight.time == pytest.approx(end + 0.5 * flight.step)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -1e-3, "1", None, True, [1.0], np.float32("nan"), 1e300])
def test_no_number_of_seconds(flight: sand.Simulation, wrong: object) -> None:
    steps = flight.steps
    with pytest.raises(sand.SandError, match=r"^advance\("):
        flight.advance(wrong)  # type: ignore[arg-type]
    assert flight.steps == steps
    flight.advance(np.float32(flight.step))
    assert flight.steps == steps + 1


def test_frames_of_a_film_are_as_far_apart_as_they_say(flight: sand.Simulation) -> None:
    """Every frame within half a step of its time, whatever the rate; and the last one is the end."""
    for seconds, fps in ((0.5, 7), (0.3, 25), (0.01, 30)):
        start, shares = flight.time + flight.owed, []
        for share in steps_of(flight, seconds, fps):
            shares.append(share)
            ideal = seconds if share == 1.0 else len(shares) / fps
            assert abs(flight.time - start - ideal) <= 0.5 * flight.step * (1 + 1e-6)
        assert shares[-1] == 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_pieces_are_the_whole(kind: str, tmp_path: Path) -> None:
    """A heap whose step follows its depth: strides below and above the step, and a checkpoint with time left over, give the same bits."""
    fresh_taichi()
    grains = [{"radius": [0.8 * R, R], "count": 60, "fill": "lattice", "pitch": 1.3, "jitter": 0.2}]
    sources = [{"radius": R, "rate": 40.0, "region": [0.0, 0.25, 0.15, 0.3], "until": 0.4}]
    keys = {"grains": grains, "sources": sources, "duration": 1.0, "effects": {"moisture": {}, "cohesion": {}}}
    scene = sand.Scene(size=[0.15, 0.3], gravity=(0.0, -G), solver={"kind": kind, "tolerance": 0.1}, **keys)
    whole = sand.Simulation(scene, threads=1)
    whole.advance(0.6)
    expected = (digest(whole), whole.steps, whole.time)
    del whole
    sim, rng = sand.Simulation(scene, threads=1), np.random.default_rng(3)
    strides = rng.exponential([5e-3, 1e-4] * 40)
    strides *= 0.6 / strides.sum()
    for k, stride in enumerate(strides):
        sim.advance(stride)
        if k == 41:
            owed, path = sim.owed, tmp_path / "some.npz"
            assert owed != 0.0
            sim.save(path)
            del sim
            sim = sand.Simulation.resume(path, threads=1)
            assert sim.owed == owed
    assert (digest(sim), sim.steps, sim.time) == expected


@pytest.mark.parametrize("step", [1e-3, 1e-6, 6e-12, 1e-300])
def test_pauses_are_counted_in_steps_of_any_size(step: float) -> None:
    """A light grain in a storm of dense gas has steps of picoseconds: those between two pauses are still a number that kernels hold."""
    count = steps_within(1 / 60, step)
    assert 1 <= count <= MOST_STEPS == np.iinfo(np.int32).max
    assert count == MOST_STEPS or count == pytest.approx(1 / 60 / step, abs=1)
    assert steps_within(step / 2, step) == 1
