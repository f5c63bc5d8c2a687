"""Walls that change while the simulation runs, and walls that move."""

from pathlib import Path

import numpy as np
import pytest
from helpers import D, Disc, G, R, digest, fresh_taichi, simulate

import taichi_sand as sand
from taichi_sand import SandError
from taichi_sand.world.walls.build import standing_walls

SHELF = {"points": [[0.0, 0.1], [0.1, 0.1]]}
OTHER = {"points": [[0.12, 0.1], [0.2, 0.1]]}


def on_shelves(kind: str):
    """Two discs at rest on two shelves."""
    discs = [Disc(0.05, 0.1 + R), Disc(0.16, 0.1 + R)]
    sim = simulate(discs, (0.2, 0.2), {"kind": kind}, gravity=(0.0, -G), walls=[SHELF, OTHER])
    sim.advance(0.3)
    return sim


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_erased_and_drawn_walls(kind: str) -> None:
    """The grain on an erased shelf falls freely, the other feels nothing; a shelf drawn below catches it."""
    sim = on_shelves(kind)
    start, time, push = sim.positions, sim.time, sim.report()["wall_force_N"]
    sim.set_walls([OTHER])
    assert sim.report()["wall_force_N"] == pytest.approx(0.5 * push, rel=1e-6)  # what the other shelf carries is remembered
    sim.advance(0.08)
    moved = sim.positions - start
    assert sim.velocities[0, 1] == pytest.approx(-G * (sim.time - time), rel=0.01) and moved[0, 1] < -2 * D
    assert abs(moved[1]).max() < 1e-3 * D
    sim.set_walls([OTHER, {"points": [[0.01, 0.05], [0.09, 0.05]]}])
    sim.advance(0.5)
    assert sim.positions[0, 1] == pytest.approx(0.05 + R, abs=0.02 * D) and sim.flags() == []


def test_changed_walls_in_a_checkpoint(tmp_path: Path) -> None:
    """A checkpoint goes on with the walls of its moment."""
    sim = on_shelves("rigid")
    sim.set_walls([OTHER])
    sim.advance(0.02)
    sim.save(tmp_path / "fall.npz")
    sim.advance(0.05)
    expected = digest(sim)
    del sim
    resumed = sand.Simulation.resume(tmp_path / "fall.npz", threads=1)
    assert len(resumed.scene.walls) == 1
    resumed.advance(0.05)
    assert digest(resumed) == expected


def test_walls_that_cannot_be_had_change_nothing() -> None:
    """Wrong tables and too many of them are told, and leave all as it was."""
    sim = on_shelves("rigid")
    for walls, text in (
        ([{"points": [[0.0, 0.1]]}], r"walls\[0\].points"),
        ([{"points": [[0.0, 0.3], [0.1, 0.9]]}], "lies wholly outside the box"),
        ([{"points": [[0.0, 0.1], [0.1, 0.1]], "friction": 0.3}], "effects.friction"),
        ([{"points": [[0.0, y], [0.1, y]]} for y in np.linspace(0.01, 0.19, 500)], "no room for so many walls"),
    ):
        with pytest.raises(SandError, match=text):
            sim.set_walls(walls)
    sim.advance(0.1)
    assert sim.positions[:, 1] == pytest.approx(0.1 + R, abs=0.02 * D) and len(sim.scene.walls) == 2


TURNING = {"points": [[0.2, 0.02], [0.38, 0.2], [0.2, 0.38], [0.02, 0.2]], "closed": True, "spin": 2.0, "pivot": [0.2, 0.2]}
PRESS = {"points": [[0.15, 0.25], [0.25, 0.25]], "velocity": [0.0, -0.1], "force": 5.0}
SHAKEN = {"points": [[0.19, 0.1], [0.21, 0.1]], "shake": {"amplitude": [0.003, 0.002], "frequency": 11.0}}


def churn(threads: int = 1):
    """Grains in a square drum that turns, with a plate that is pressed on them and a bar that shakes among them."""
    grains = {"radius": [0.004, 0.006], "count": 150, "region": [0.1, 0.11, 0.3, 0.24]}
    walls = [TURNING, PRESS, SHAKEN]
    return simulate([grains], (0.4, 0.4), {"kind": "rigid", "precision": 32}, gravity=(0.0, -G), walls=walls, mu=0.5, threads=threads)


def test_moving_walls_in_checkpoints_and_threads(tmp_path: Path) -> None:
    """Where a wall is follows from the steps done: resumed, or on two threads, all ends in the same bits; nobody leaves the drum."""
    sim = churn()
    sim.advance(1.0)
    sim.save(tmp_path / "half.npz")
    sim.advance(0.5)
    expected, walls = digest(sim), standing_walls(sim.world, sim.scene)
    assert sim.flags() == [] and np.hypot(*(sim.positions - 0.2).T).max() < 0.18
    angle = 2.0 * sim.time
    corner = 0.2 + 0.18 * np.array([np.sin(angle), -np.cos(angle)])
    assert walls[0][0] == pytest.approx(corner, abs=1e-6) and walls[1][0, 1] < 0.25
    del sim
    again = churn(threads=2)
    again.advance(1.5)
    assert digest(again) == expected
    fresh_taichi()
    resumed = sand.Simulation.resume(tmp_path / "half.npz", threads=2)
    resumed.advance(0.5)
    assert digest(resumed) == expected
    places = standing_walls(resumed.world, resumed.scene)
    resumed.set_walls([TURNING, PRESS, {"points": [[0.3, 0.2], [0.35, 0.2]]}, SHAKEN])
    assert [points.tolist() for points in (resumed.wall_points[k] for k in (0, 1, 3))] == [points.tolist() for points in places]
    resumed.advance(0.1)
    assert resumed.flags() == [] and len(standing_walls(resumed.world, resumed.scene)) == 4
    resumed.set_walls([TURNING])  # the others go, it turns on
    resumed.advance(0.1)
    angle = 2.0 * resumed.time
    assert resumed.wall_points[0][0] == pytest.approx(0.2 + 0.18 * np.array([np.sin(angle), -np.cos(angle)]), abs=1e-6)
    assert resumed.flags() == []


def test_walls_too_fast_are_refused() -> None:
    """With a step that the scene fixes, what cannot be followed is told; else the step follows the walls."""
    spinner = {"points": [[0.1, 0.1], [0.2, 0.1]], "spin": 40.0}
    with pytest.raises(SandError, match=r"walls\[0\]: moves at up to 2 m/s; with this step no more than"):
        simulate([Disc(0.05, 0.05)], (0.3, 0.3), {"kind": "rigid", "step": 0.01}, walls=[spinner])
    sim = simulate([Disc(0.05, 0.05)], (0.3, 0.3), {"kind": "rigid"}, walls=[spinner])
    assert sim.world.pace[None].speed_cap > 2.0


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_grains_among_fine_walls(kind: str) -> None:
    """Sixty grains rush along a floor of 250 lines shorter than they are wide: each meets many at once, and none is missed or lost."""
    floor = {"points": [[0.0042 * k, 0.03 + 0.0056 * (k % 2)] for k in range(251)]}
    grains = {"radius": [0.003, 0.004], "count": 60, "region": [0.05, 0.05, 0.95, 0.12], "velocity": [1.0, -1.0]}
    sim = simulate([grains], (1.05, 0.3), {"kind": kind, "precision": 32}, gravity=(0, -9.81), walls=[floor], mu=0.5)
    sim.advance(1.0)
    assert sim.flags() == [] and sim.count == 60 and sim.positions[:, 1].min() > 0.03


@pytest.mark.slow
@pytest.mark.parametrize("hand", [False, True])
def test_walls_set_in_mid_run_are_resumed(hand: bool, tmp_path: Path) -> None:
    """More of them, fewer, none that moves, others: a checkpoint is gone on from to the same bits."""
    turning, still = {"points": [[0.02, 0.02], [0.05, 0.02]], "spin": 1.0}, {"points": [[0.05, 0.06], [0.09, 0.06]]}
    sliding = {"points": [[0.02, 0.08], [0.04, 0.08]], "velocity": [0.01, 0.0]}
    shaken = {"points": [[0.06, 0.03], [0.08, 0.03]], "shake": {"amplitude": [0.0, 0.001], "frequency": 10.0}}
    grains = [{"radius": [0.003, 0.005], "count": 20}]
    scene = sand.Scene(size=(0.1, 0.1), grains=grains, walls=[turning, still, sliding], effects={"friction": {}})
    sim = sand.Simulation(scene, threads=1, hand=hand)
    for walls in ([sliding, still], [sliding, still, shaken], [still], [turning, still, sliding, shaken]):
        sim.set_walls(walls)
        sim.advance(0.03)
        sim.save(tmp_path / "state.npz")
        with sand.Simulation.resume(tmp_path / "state.npz", threads=1) as resumed:
            sim.advance(0.02)
            resumed.advance(0.02)
            assert np.array_equal(sim.positions, resumed.positions) and sim.flags() == []
