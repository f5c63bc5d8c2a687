"""The clock: what is compiled counts as compiling whatever stage calls it first, and no time counts twice."""

from pathlib import Path

import pytest
import taichi as ti
from helpers import D, G, R, simulate

import taichi_sand as sand
from taichi_sand.run import clock as clocks
from taichi_sand.taichi_support import compiling

SOLVER = {"kind": "rigid"}
GRAINS = [{"positions": [[0.1, R + k * D] for k in range(5)], "radius": R}]


def test_stages_within_stages_count_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A look of 10 s of which 3 s are a march within, 2 of these compiling, and 1 s more is compiling: by a clock that is set by hand."""
    now = {"time": 0.0}
    monkeypatch.setattr(clocks.time, "perf_counter", lambda: now["time"])
    monkeypatch.setattr(compiling, "spent", {"seconds": 5.0})

    def pass_by(seconds: float, compiled: float = 0.0) -> None:
        now["time"] += seconds
        compiling.spent["seconds"] += compiled

    clock = clocks.Clock()
    with clock.stage("compile"):
        pass_by(7.0, 4.0)
    with clock.stage("look"):
        pass_by(4.0)
        with clock.stage("march"):
            pass_by(3.0, 2.0)
        pass_by(3.0, 1.0)
    with pytest.raises(KeyboardInterrupt), clock.stage("march"):
        pass_by(2.0)
        raise KeyboardInterrupt
    assert clock.stages == pytest.approx({"look": 6.0, "march": 3.0})
    assert clock.wall == pytest.approx(9.0) and clock.compile == pytest.approx(10.0)


def test_a_kernel_compiled_amid_the_march_is_no_cost_of_it() -> None:
    """A kernel that takes most of a second to compile and nothing to run, first called in a stage; then again, when it costs little."""
    sim = simulate(GRAINS, (0.2, 0.2), SOLVER, gravity=(0, -G))

    @ti.kernel
    def long_winded(x: ti.f32) -> ti.f32:
        total = x
        for k in ti.static(range(30)):
            for n in range(10):
                total = ti.sin(total) * n + 0.001 * k
        return total

    wall, before = sim.clock.wall, sim.clock.compile
    with sim.clock.stage("march"):
        long_winded(1.0)
    first = sim.clock.compile - before
    assert first > 0.05 and sim.clock.wall - wall < 0.2 * first
    with sim.clock.stage("march"):
        long_winded(2.0)
    assert sim.clock.compile - before == first


def test_cost_counts_what_was_done_here(tmp_path: Path) -> None:
    """The figures of a simulation that was resumed are about what it did since; grains that left count while they were there."""
    scene = sand.Scene(
        size=[0.3, 0.3],
        edges={"right": "open"},
        gravity=[0, -G],
        grains=[*GRAINS, {"positions": [[0.28, 0.2]], "radius": R, "velocity": [0.2, 0]}],
    )
    sim = sand.Simulation(scene, threads=1)
    for _ in range(50):
        sim.advance(0.01)
    report = sim.report()
    assert report["grains"] == 5 and 5 * report["steps"] < sim.clock.grain_steps < 6 * report["steps"]
    assert report["ns_per_grain_step"] == pytest.approx(1e9 * report["wall_time_s"] / sim.clock.grain_steps)
    assert report["real_time_factor"] == pytest.approx(report["time_s"] / report["wall_time_s"])
    sim.save(tmp_path / "half.npz")
    again = sand.Simulation.resume(tmp_path / "half.npz", threads=1)
    again.advance(0.1)
    report = again.report()
    assert report["time_s"] > 0.5
    assert report["real_time_factor"] == pytest.approx(0.1 / report["wall_time_s"], rel=0.05)
    assert again.clock.grain_steps == 5 * round(0.1 / again.step)
