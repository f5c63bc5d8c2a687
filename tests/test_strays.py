"""Grains that are listed by themselves between two list builds: nothing is missed, nothing is listed twice, and they move as others do."""

import math

import numpy as np
import pytest
from helpers import D, R, digest, fresh_taichi, listed
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import taichi_sand as sand

SIZE = (0.4, 0.3)
SIDE = 14
"""Grains of the bed along x."""
WALL = {"points": [[0.25, 0.0], [0.25, 0.08], [0.32, 0.12], [0.32, 0.2]]}
SOLVERS = {
    "rigid": {"kind": "rigid", "step": 2e-4, "precision": 64},
    "md": {"kind": "md", "stiffness": 1e6, "step": 1e-5, "precision": 64},
}
STEPS = {"rigid": 7, "md": 61}
Shot = tuple[float, float, float, float]


def shots(few: int) -> st.SearchStrategy[list[Shot]]:
    """Grains shot from places above the bed (shares of the room there), in directions [rad], at 1 to 20 m/s."""
    one = st.tuples(st.floats(0.05, 0.95), st.floats(0.05, 0.95), st.floats(0.0, 2 * math.pi), st.floats(0.0, 1.3))
    return st.lists(one, min_size=1, max_size=few, unique_by=lambda shot: (round(9 * shot[0]), round(6 * shot[1])))


def bed_and(shot: list[Shot], kind: str, mu: float = 0.3) -> sand.Simulation:
    """A heap of discs in a corner, a wall of three lines beside it, and those that are shot; no gravity."""
    rows = [[(k % SIDE + 0.6) * 1.02 * D, (k // SIDE + 0.6) * 1.02 * D, R * (0.8 + 0.2 * math.sin(k)), 0, 0] for k in range(5 * SIDE)]
    for x, y, angle, speed in shot:
        place = np.array([0.02, 0.07]) + np.array([round(9 * x) / 9, round(6 * y) / 6]) * (0.2, 0.2)
        rows.append([*place, 0.9 * R, 10**speed * math.cos(angle), 10**speed * math.sin(angle)])
    box = {"size": list(SIZE), "gravity": (0.0, 0.0), "walls": [WALL], "effects": {"friction": {"mu": mu}}}
    return sand.Simulation(sand.Scene(grains=[{"positions": rows}], solver=SOLVERS[kind], **box), threads=1)


def overlapping(sim: sand.Simulation) -> set[tuple[int, int]]:
    """By brute force: pairs of ids that overlap; of edges and the wall's lines none, as those that are not listed let grains through."""
    way = sim.positions[:, None] - sim.positions[None]
    gap = np.hypot(way[..., 0], way[..., 1]) - sim.radii[:, None] - sim.radii[None]
    return {(int(sim.ids[i]), int(sim.ids[j])) for i, j in np.argwhere(np.triu(gap < 0, 1))}


def wall_rows(sim: sand.Simulation) -> list[tuple[int, int]]:
    """Slots of grains and parts of walls of all rows of the neighbour list."""
    blocks, first, second = sim.world.blocks, sim.world.pairs.first.to_numpy(), sim.world.pairs.second.to_numpy()
    ends = zip(blocks.wall_start.to_numpy(), blocks.wall_end.to_numpy(), strict=True)
    return [(int(first[row]), int(second[row])) for start, end in ends for row in range(start, end)]


@pytest.mark.parametrize("kind", SOLVERS)
def test_nothing_is_missed_or_listed_twice(kind: str) -> None:
    """A few fast discs shoot through others at rest, hit them, a wall and the edges of the box: whatever overlaps is listed, once."""
    fresh_taichi()
    seen = {"steps": 0, "builds": 0, "strays": 0}

    @settings(max_examples=12, phases=[Phase.generate], deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(shots(5))
    def shoot(shot: list[Shot]) -> None:
        sim = bed_and(shot, kind)
        assert sim.world.relists
        for _ in range(30):
            sim.advance_steps(STEPS[kind])
            pairs = [(min(c.first, c.second), max(c.first, c.second)) for c in listed(sim) if not c.wall]
            walls = wall_rows(sim)
            assert len(set(pairs)) == len(pairs) and len(set(walls)) == len(walls)
            assert not overlapping(sim) - set(pairs)
            x = sim.positions
            assert x.min() > 0 and (x < SIZE).all() and sim.flags() == [] and sim.lost == 0
            seen["strays"] += int(sim.world.strays.count[None])
        seen["steps"] += sim.steps
        seen["builds"] += sim.world.pace[None].list_builds

    shoot()
    assert seen["strays"] > 100
    assert seen["steps"] > 8 * seen["builds"], seen


def test_strays_move_as_others_do() -> None:
    """Molecular dynamics with springs that remember, friction on a bent wall and restitution: with strays as with a list build before every
    step, to rounding; and saved in the middle to the same bits.
    """
    shot = [(0.1, 0.9, -1.2, 0.9), (0.5, 0.5, -0.3, 1.1), (0.9, 0.2, 0.2, 0.7)]
    fresh_taichi()
    ends = []
    for always in (False, True):
        sim = bed_and(shot, "md", mu=0.5)
        for _ in range(300):
            if always:
                sim.world.pace[None].spent = 1
            sim.advance_steps(5)
        ends.append((sim.positions, sim.spins, sim.world.pace[None].list_builds))
    assert ends[0][2] < 100 < ends[1][2]
    np.testing.assert_allclose(ends[0][0], ends[1][0], rtol=0, atol=1e-7 * D)
    np.testing.assert_allclose(ends[0][1], ends[1][1], rtol=0, atol=1e-5)


@pytest.mark.parametrize("kind", SOLVERS)
def test_saved_among_strays(kind: str, tmp_path) -> None:
    """A checkpoint between two list builds goes on to the same bits, whatever strides a run is cut into."""
    shot = [(0.1, 0.9, -1.2, 0.9), (0.5, 0.5, -0.3, 1.1), (0.9, 0.2, 0.2, 0.7)]
    fresh_taichi()
    whole = bed_and(shot, kind)
    whole.advance_steps(200)
    end = digest(whole)
    cut = bed_and(shot, kind)
    for _ in range(20):
        cut.advance_steps(5)
    assert cut.world.strays.count[None] > 0
    cut.save(tmp_path / "half.npz")
    again = sand.Simulation.resume(tmp_path / "half.npz", threads=1)
    again.advance_steps(100)
    assert digest(again) == end


@pytest.mark.parametrize("kind", SOLVERS)
def test_walls_that_move_are_set_among_strays(kind: str) -> None:
    """Where walls move nobody is listed alone: set in the middle of a flight they lose no contact, and taken back neither."""
    fresh_taichi()
    sim = bed_and([(0.1, 0.9, -1.2, 0.9), (0.5, 0.5, -0.3, 1.1), (0.9, 0.2, 0.2, 0.7)], kind)
    strays = []
    for walls in ([WALL], [WALL, {"points": [[0.38, 0.05], [0.38, 0.2]], "velocity": [-0.2, 0.0]}], [WALL]):
        sim.set_walls(walls)
        for _ in range(15):
            sim.advance_steps(STEPS[kind])
            pairs = [(min(c.first, c.second), max(c.first, c.second)) for c in listed(sim) if not c.wall]
            assert len(set(pairs)) == len(pairs) and not overlapping(sim) - set(pairs)
            strays.append(int(sim.world.strays.count[None]) if sim.world.relists else -1)
        assert sim.flags() == [] and sim.lost == 0
    assert max(strays[:15]) > 0 and set(strays[15:]) == {-1}, strays  # tables for walls that move are kept
