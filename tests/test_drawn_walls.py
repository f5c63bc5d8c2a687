"""Walls of any pieces: nobody passes one, whatever is drawn, and every contact of a disc with a wall that there is is listed."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

import taichi_sand as sand
from taichi_sand import SandError
from taichi_sand.run import simulation
from taichi_sand.scene.nearby import off_walls, segments
from taichi_sand.world import build
from taichi_sand.world.search.growth import Rooms

D, SIZE = 0.01, (0.5, 0.3)
MOST = 300
GIVEN = (Phase.explicit, Phase.generate)  # to make a failing example smaller takes many minutes
QUIET = settings(
    max_examples=60, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck), phases=GIVEN, print_blob=True
)


@pytest.fixture(scope="module", autouse=True)
def one_structure() -> Iterator[None]:
    """All examples have tables of the same size to start with, so that kernels are compiled once, and now and then for larger tables."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "WALL_ROOM", (32768, 65536))
        patch.setattr(build, "foreseen", lambda *_given: Rooms(8, 4).joined(_given[-1]))
        yield


@st.composite
def polylines(draw: st.DrawFn) -> list[np.ndarray]:
    """A wall, in one piece or with a slot that nobody fits through: pieces of 0.05 to 50 d at any angle, also beyond the box."""
    seed = draw(st.integers(0, 10**6))
    random, piece = np.random.default_rng(seed), D * 10 ** draw(st.floats(math.log10(0.05), math.log10(50)))
    count = draw(st.integers(1, min(200, max(2, int(6 * sum(SIZE) / piece)))))
    start = random.uniform(0.1, 0.9, 2) * SIZE
    if draw(st.booleans()):  # a smooth curve, else one that turns anywhere
        turn = np.cumsum(random.normal(0, draw(st.floats(0, 0.3)), count)) + random.uniform(0, 2 * np.pi)
    else:
        turn = random.uniform(0, 2 * np.pi, count)
    length = piece * (random.uniform(0.5, 1.0, count) if draw(st.booleans()) else np.ones(count))
    points = np.vstack([start, start + np.cumsum(length[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1), axis=0)])
    if len(points) > 3 and draw(st.booleans()):
        points = np.vstack([points, points[:1]])
    return [points]


@st.composite
def walls_with_slots(draw: st.DrawFn) -> tuple[list[np.ndarray], np.ndarray]:
    """One to three walls, each perhaps cut in two by a slot of 0.05 to 0.89 d; and the segments nobody may cross, slots included."""
    lines, barriers = [], []
    for _ in range(draw(st.integers(1, 3))):
        (points,) = draw(polylines())
        barriers.append(points)
        k = draw(st.integers(0, len(points) - 2))
        way = points[k + 1] - points[k]
        slot = draw(st.floats(0.05, 0.89)) * D
        if draw(st.booleans()) and np.hypot(*way) > 3 * slot:
            half = 0.5 * slot * way / np.hypot(*way)
            middle = points[k] + 0.5 * way
            lines += [np.vstack([points[: k + 1], middle - half]), np.vstack([middle + half, points[k + 1 :]])]
        else:
            lines.append(points)
    return lines, segments(barriers)


def crossed(before: np.ndarray, after: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """Which of the ways before -> after (n, 2) cross a segment of `walls` (m, 2, 2)."""
    way, along = (after - before)[:, None], (walls[:, 1] - walls[:, 0])[None]
    off = walls[None, :, 0] - before[:, None]
    area = way[..., 0] * along[..., 1] - way[..., 1] * along[..., 0]
    area = np.where(np.abs(area) < 1e-30, 1e-30, area)
    on_way = (off[..., 0] * along[..., 1] - off[..., 1] * along[..., 0]) / area
    on_wall = (off[..., 0] * way[..., 1] - off[..., 1] * way[..., 0]) / area
    return ((on_way >= 0) & (on_way <= 1) & (on_wall >= 0) & (on_wall <= 1)).any(axis=1)


def inside(wall: np.ndarray) -> bool:
    """Whether some of a wall lies in the box, so that it may be there."""
    return not any((wall[:, k] < 0).all() or (wall[:, k] > SIZE[k]).all() for k in range(2))


def missed(sim: Any, walls: np.ndarray) -> int:
    """Brute force: how many discs that overlap a line of a wall, where they project onto it, have no wall row in the neighbour list that
    is as deep.
    """
    sim.renew()  # md keeps the gaps of the last list build
    x, r, w = sim.positions, sim.radii, sim.world
    slots = np.argsort(w.grains.id.to_numpy()[: sim.count])
    deepest = np.full(sim.count, np.inf)
    rows = slice(w.blocks.wall_start[0], w.blocks.wall_end[0])
    np.minimum.at(deepest, w.pairs.first.to_numpy()[rows], w.pairs.gap.to_numpy()[rows])
    count = 0
    for k in range(len(x)):
        gap = off_walls(np.tile(x[k], (len(walls), 1)), walls)[0].min() - r[k]
        count += int(gap < -1e-3 * D and deepest[slots[k]] > gap + 2e-3 * D)
    return count


def nobody_passes(kind: str, drawn: tuple[list[np.ndarray], np.ndarray], count: int, speed: float, seed: int) -> None:
    lines, barriers = drawn
    lines = [line for line in lines if inside(line)]
    assume(lines)
    grains = {"radius": [0.45 * D, 0.55 * D], "count": count, "region": [0, 0, *SIZE], "speed": [0, speed]}
    walls = [{"points": line.tolist()} for line in lines]
    try:
        scene = sand.Scene(size=SIZE, seed=seed, grains=[grains], walls=walls, solver={"kind": kind}, effects={"friction": {"mu": 0.3}})
        sim = sand.Simulation(scene, threads=1, room=MOST - count)
    except SandError as error:
        assert "fit" in str(error) or "same as" in str(error), error
        assume(False)
        return
    wall_lines = segments(lines)
    for _ in range(40):
        before = sim.positions
        sim.advance(0.005)
        over = crossed(before, sim.positions, barriers)
        assert not over.any(), (np.flatnonzero(over), before[over], sim.positions[over], sim.time)
    assert missed(sim, wall_lines) == 0
    assert sim.flags() == [] and sim.count == count


@pytest.mark.parametrize("kind", ["rigid", "md"])
@given(drawn=walls_with_slots(), count=st.integers(1, MOST), speed=st.floats(0, 3), seed=st.integers(0, 999))
@QUIET
def test_nobody_passes_a_drawn_wall(kind: str, drawn: tuple[list[np.ndarray], np.ndarray], count: int, speed: float, seed: int) -> None:
    """Discs fall and fly among walls, among slots narrower than 0.9 d: none is ever beyond one, no contact is missed, and no flag is up."""
    nobody_passes(kind, drawn, count, speed, seed)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rigid", "md"])
@given(drawn=walls_with_slots(), count=st.integers(1, MOST), speed=st.floats(0, 3), seed=st.integers(0, 999))
@settings(QUIET, max_examples=1000)
def test_nobody_passes_a_thousand_drawn_walls(
    kind: str, drawn: tuple[list[np.ndarray], np.ndarray], count: int, speed: float, seed: int
) -> None:
    """The same, often."""
    nobody_passes(kind, drawn, count, speed, seed)
