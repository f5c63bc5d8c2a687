"""Interrupted in the middle of things: time, steps, report and state agree, and what follows goes the same way to the same bits."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers import G, R, digest, fresh_taichi

import taichi_sand as sand
from taichi_sand.run import stepping
from taichi_sand.taichi_support.turns import Turn

MANY, FEW = 30, 5
"""Interrupts of a simulation: in the slow tests, and in all others."""
ANSWER = 0.5
"""Within which Ctrl-C is answered [s of CPU: the machine may be busy with other things]."""


def bed(kind: str, count: int, **effects: dict) -> sand.Scene:
    """A block of discs falls on a floor."""
    columns = round(2 * count**0.5)
    size = [2.4 * R * columns, 2.4 * R * (count / columns + 20)]
    grains = [{"radius": [0.8 * R, R], "count": count, "fill": "lattice", "pitch": 1.15, "jitter": 0.05}]
    return sand.Scene(size=size, gravity=(0.0, -G), solver={"kind": kind, "tolerance": 0.1}, grains=grains, effects=effects)


def interrupted(after: float, act: Callable[[], Any]) -> dict[str, float]:
    """Does `act`, in which Ctrl-C comes so many seconds later, and what it raises is to be that. Returns when it came, and when it was
    answered [s of CPU].
    """
    assert threading.current_thread() is threading.main_thread()
    times: dict[str, float] = {}

    def press() -> None:
        times["pressed"] = time.process_time()
        os.kill(os.getpid(), signal.SIGINT)

    handler, timer = signal.getsignal(signal.SIGINT), threading.Timer(after, press)
    with pytest.raises(KeyboardInterrupt):
        timer.start()
        act()
    times["answered"] = time.process_time()
    timer.join()
    assert signal.getsignal(signal.SIGINT) is handler is signal.default_int_handler
    return times


@pytest.fixture(autouse=True)
def ctrl_c() -> Iterator[None]:
    """Raises KeyboardInterrupt: a shell's background jobs are born deaf to it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "count", "wait"), [("rigid", 1000, 0.01), ("md", 1000, 0.01), ("rigid", 33000, 0.1), ("md", 33000, 0.1)])
def test_whole_after_every_interrupt(kind: str, count: int, wait: float) -> None:
    """Thirty of thirty, at random moments: list builds, pauses of an effect and looks at the depth among them."""
    whole_after_interrupts(kind, count, wait, MANY)


@pytest.mark.parametrize(("kind", "count", "wait"), [("rigid", 1000, 0.01), ("md", 33000, 0.1)])
def test_whole_after_an_interrupt(kind: str, count: int, wait: float) -> None:
    """The same, a few times."""
    whole_after_interrupts(kind, count, wait, FEW)


def whole_after_interrupts(kind: str, count: int, wait: float, rounds: int) -> None:
    """All agrees after Ctrl-C at random moments, and at the end it is where one without them is, bit for bit."""
    fresh_taichi()
    effects = {"cohesion": {"bond_number": 2.0}, "moisture": {}} if count < 2000 else {}
    scene = bed(kind, count, **effects)
    sim, rng = sand.Simulation(scene, threads=1), np.random.default_rng(count)
    sim.advance_steps(3)  # all is compiled
    for delay in rng.uniform(0.0, 2 * wait, rounds):
        times = interrupted(delay, partial(sim.advance, 3600.0))
        assert times["answered"] - times["pressed"] < ANSWER
        assert sim.world.pace[None].done == sim.steps
        assert sim.runner is None and abs(sim.owed) <= 0.5 * sim.step
    report = sim.report()
    assert report["steps"] == sim.steps and report["time_s"] == sim.time == pytest.approx(
        sim.epoch[1] + (sim.steps - sim.epoch[0]) * sim.step
    )
    sim.advance_steps(10)
    reached, steps = digest(sim), sim.steps
    del sim
    again = sand.Simulation(scene, threads=1)
    again.advance_steps(steps)
    assert steps > rounds and digest(again) == reached and again.flags() == []


@pytest.fixture(scope="module")
def small() -> sand.Simulation:
    fresh_taichi()
    return sand.Simulation(bed("rigid", 200), threads=1)


def test_out_of_a_callback(small: sand.Simulation) -> None:
    """What `progress` raises leaves all whole, at the moment that it was told of."""
    told = []

    def stop(share: float) -> None:
        told.append((share, small.steps, small.time))
        if len(told) == 5:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        small.advance(1.0, progress=stop)
    assert (small.steps, small.time) == told[-1][1:] and small.world.pace[None].done == small.steps
    interrupted(0.02, lambda: small.advance(3600.0, progress=lambda share: None))
    assert small.world.pace[None].done == small.steps
    small.advance(0.1)


def test_a_handler_of_the_users(small: sand.Simulation) -> None:
    """It is called, where all is whole; and unless it raises, what was asked for is finished."""
    seen = []
    before = signal.signal(signal.SIGINT, lambda number, frame: seen.append((number, small.world.pace[None].done == small.steps)))
    try:
        mine, steps, strides = signal.getsignal(signal.SIGINT), small.steps, 0
        threading.Timer(0.02, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        while not seen:
            small.advance(0.5)
            strides += 1
        asked = steps + strides * 0.5 / small.step  # what is left over of a stride is kept for the next
        assert seen == [(signal.SIGINT, True)] and abs(small.steps - asked) <= 1 and signal.getsignal(signal.SIGINT) is mine
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_launch_that_wakes_many_ends_early() -> None:
    """Sleepers cost nothing, until they wake up within a launch: what it was given to do may then take too long."""
    fresh_taichi()
    sim = sand.Simulation(bed("rigid", 100, sleeping={}), threads=1)
    pace, start = sim.world.pace[None], sim.steps
    assert stepping.steps_in_one(sim.world, sim.solver, 50, 99) == stepping.EARLY and pace.done == start + 1
    assert stepping.steps_in_one(sim.world, sim.solver, 49, 100) == stepping.DONE and pace.done == start + 50
    reached = digest(sim)
    del sim
    again = sand.Simulation(bed("rigid", 100, sleeping={}), threads=1)
    again.advance_steps(50)
    assert digest(again) == reached


@pytest.mark.parametrize("grains", [1, 1000, 100_000])
@pytest.mark.parametrize("cost", [5e-9, 5e-8, 5e-7])
def test_launches_are_short(grains: int, cost: float) -> None:
    """Whatever a step costs, and if it costs three times as much from now on: by a clock that is set by hand."""
    cadence = stepping.Cadence()
    for price in (*[cost] * 20, *[3 * cost] * 20):
        steps = cadence.steps(grains)
        assert steps == 1 or steps * grains * price < 0.35
        cadence.took(steps, steps * grains * price)
    assert steps == 1 or steps * grains * max(3 * cost, stepping.DEAREST) > 0.03  # nor too short


def test_turns() -> None:
    """A thread at a time; signals wait in the main one, also while it waits for its turn; taken again it is still one."""
    turn, order = Turn(), []

    def work() -> None:
        with turn:
            with turn:
                time.sleep(0.1)
            order.append("whole")  # the signal has come, and is still to be dealt with

    interrupted(0.05, work)
    assert order == ["whole"] and turn.depth == 0

    entered, leave = threading.Event(), threading.Event()

    def other() -> None:
        with turn:
            entered.set()
            leave.wait(10)

    thread = threading.Thread(target=other)
    thread.start()
    assert entered.wait(10)
    interrupted(0.05, turn.__enter__)  # it is not ours
    leave.set()
    thread.join()
    with turn:
        pass
    assert turn.waiting == 0
