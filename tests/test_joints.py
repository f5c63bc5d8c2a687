"""Lines and ends of walls: what is drawn in pieces, by one wall or several, is one surface, with no gap and nothing double."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taichi_sand.scene.nearby import images, off_walls, segments
from taichi_sand.world.walls.joints import BEND, Part, join
from taichi_sand.world.walls.polylines import Frame, clipped

D = 0.01
BOX = np.array([1.0, 1.0])


def frame(periodic: tuple[bool, bool] = (False, False), walled: bool = False) -> Frame:
    wraps = np.array(periodic)
    return Frame(BOX, wraps, (walled,) * 4, D, 0.25 if wraps.any() else math.inf)


def parts_of(walls: list[list], where: Frame) -> list[Part]:
    """Parts of walls, each its points and its friction."""
    return join([(piece, (rough, 0.0, -1.0)) for points, rough in walls for piece in clipped(np.array(points, float), where)], where)


def active(parts: list[Part], x: np.ndarray) -> np.ndarray:
    """Distances (parts, n) of the places x (n, 2) from the parts that act there, infinite from others: as the contact kernel has it."""
    found = []
    for part in parts:
        rest = x - part.point
        if part.side == -1:
            distance = np.hypot(*rest.T)
            off = (rest @ part.along < 0) | (rest @ part.bounds < 0)
        else:
            left = part.along[0] * rest[:, 1] - part.along[1] * rest[:, 0]
            slid, distance = rest @ part.along, np.abs(left)
            off = (slid < part.bounds[0] + part.slopes[0] * left) | (slid >= part.bounds[1] + part.slopes[1] * left)
        found.append(np.where(off, np.inf, distance))
    return np.array(found).reshape(len(parts), len(x))


def floors(points: np.ndarray) -> list:
    """A wall for each piece, of other friction in turn, drawn forward and backward."""
    pairs = [points[k : k + 2][:: 1 if k % 3 else -1] for k in range(len(points) - 1)]
    return [(pair.tolist(), 0.2 + 0.1 * (k % 2)) for k, pair in enumerate(pairs)]


@pytest.mark.parametrize("piece", [0.05, 0.4, 1.25, 20.0])
def test_a_floor_of_pieces_is_a_line(piece: float) -> None:
    """A polyline of flush pieces is one part; walls of two frictions are as many lines as pieces, in turn, end to end, without an end."""
    places = np.append(np.arange(0, 1, piece * D), 1.0)
    points = np.stack([places, np.full(len(places), 0.1)], axis=1)
    one = parts_of([(points.tolist(), -1.0)], frame(walled=True))
    assert len(one) == 1 and one[0].bounds == pytest.approx([0, 1]) and one[0].slopes == (0.0, 0.0)
    many = parts_of(floors(points), frame(walled=True))
    assert len(many) == len(points) - 1 and all(part.side == 0 for part in many)
    x = np.stack([np.random.default_rng(1).uniform(0, 1, 5000), np.full(5000, 0.105)], axis=1)
    x[:1000, 0] = places[np.arange(1000) % len(places)]  # exactly above joints
    x = x[(x[:, 0] > 0) & (x[:, 0] < 1)]
    assert (np.isfinite(active(many, x)).sum(axis=0) == 1).all()


def test_ends_where_lines_meet() -> None:
    """A fan has its end in the room that it leaves; a star and a T have none; a corner has one outside; walls end at edges without one."""
    way = {a: [0.5 + 0.2 * math.cos(a), 0.5 + 0.2 * math.sin(a)] for a in (0.0, 1.0, 2.0, 2.5, 4.2)}

    def ends(*lines: list) -> list[np.ndarray]:
        return [part.point for part in parts_of([(line, -1.0) for line in lines], frame(walled=True)) if part.side == -1]

    def spokes(*angles: float) -> list:
        return [[[0.5, 0.5], way[a]] for a in angles]

    middle = [0.5, 0.5]
    for angles, count in (((0.0, 1.0, 2.0), 1), ((0.0, 2.5), 1), ((0.0, 2.0, 4.2), 0), ((0.0, 1.0, 2.5, 4.2), 0)):
        assert sum(np.allclose(end, middle) for end in ends(*spokes(*angles))) == count
    stem = ends([[0.2, 0.5], [0.8, 0.5]], [[0.5, 0.5], [0.5, 0.8]])
    assert sorted(end.tolist() for end in stem) == [[0.2, 0.5], [0.5, 0.8], [0.8, 0.5]]
    assert ends([[0.0, 0.3], [1.0, 0.3]], [[0.5, 0.3], [0.5, 1.0]]) == []
    assert len(ends([[-0.5, 0.3], [0.5, 0.3]])) == 1  # cut off at the edge
    closed = parts_of([([[0.2, 0.2], [0.4, 0.2], [0.4, 0.4], [0.2, 0.4], [0.2, 0.2]], -1.0)], frame())
    assert sum(part.side == 0 for part in closed) == 4 and sum(part.side == -1 for part in closed) == 4


@pytest.mark.parametrize("points", [[[0.0, 0.1], [1.0, 0.1]], [[-0.3, 0.1], [0.2, 0.1], [2.4, 0.1]], [[0.7, 0.1], [1.7, 0.1]]])
def test_a_floor_around_a_periodic_box(points: list) -> None:
    """A floor as long as the box, or longer, closes: everywhere one line acts, and there is no end."""
    parts = parts_of([(points, -1.0)], frame((True, False)))
    assert all(part.side == 0 and part.length <= 0.25 + 1e-9 for part in parts)
    assert sum(part.length for part in parts) == pytest.approx(1.0)
    x = np.random.default_rng(2).uniform(0, 1, (2000, 2)) * [1, 0.1] + [0, 0.1]
    seen = sum(np.isfinite(active(parts, x + np.array([turn, 0]))).sum(axis=0) for turn in range(-4, 5))
    assert (seen == 1).all()


def test_a_round_drum_has_no_ends() -> None:
    """A polygon of a thousand sides: lines that end at the planes between them, as near as it is everywhere, once."""
    angle = np.linspace(0, 2 * np.pi, 1001)
    points = 0.5 + 0.4 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points[-1] = points[0]
    parts = parts_of([(points.tolist(), -1.0)], frame())
    assert len(parts) <= 1000 and all(part.side == 0 for part in parts)
    way = np.random.default_rng(3).uniform(0, 2 * np.pi, 3000)
    x = 0.5 + (0.4 + 0.5 * D * np.where(np.arange(3000) % 2, 1, -1))[:, None] * np.stack([np.cos(way), np.sin(way)], axis=1)
    found = active(parts, x)
    assert (np.isfinite(found) & (found < D)).sum(axis=0).tolist() == [1] * 3000
    assert found.min(axis=0) == pytest.approx(np.full(3000, 0.5 * D), abs=5e-4 * D)


@st.composite
def curves(draw: st.DrawFn) -> np.ndarray:
    """Corners of a polyline: smooth, jagged, closed or not."""
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    count, piece = draw(st.integers(1, 40)), D * 10 ** draw(st.floats(-1.3, 1.3))
    bend = draw(st.sampled_from([0.0, 1e-4, 0.01, 0.05, 0.09, 0.2, 1.0, 3.0]))
    turn = np.cumsum(random.normal(0, bend, count)) + random.uniform(0, 6.3)
    steps = piece * random.uniform(0.3, 1.0, count)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = 0.5 + np.vstack([[0, 0], np.cumsum(steps, axis=0)])
    return np.vstack([points, points[:1]]) if count > 2 and draw(st.booleans()) else points


@settings(max_examples=200, deadline=None, derandomize=True, database=None)
@given(walls=st.lists(curves(), min_size=1, max_size=3), split=st.booleans(), periodic=st.booleans())
def test_no_gap_anywhere(walls: list[np.ndarray], split: bool, periodic: bool) -> None:
    """Wherever a disc's centre is, the part that acts nearest to it is as near as the wall is, by brute force: to a thousandth of a
    diameter and what bends of BEND are worth; walls drawn as one or every piece by itself, across a periodic edge too.
    """
    where = frame((True, True)) if periodic else frame()
    lines = [line for points in walls for line in (floors(points) if split else [(points.tolist(), -1.0)])]
    parts = parts_of(lines, where)
    drawn = [piece for points in walls for piece in clipped(points, where)]
    random = np.random.default_rng(4)
    pieces = segments(drawn)
    if not len(pieces):
        return
    some = pieces[random.integers(0, len(pieces), 400)]
    along = random.uniform(0, 1, (400, 1))
    x = some[:, 0] + along * (some[:, 1] - some[:, 0]) + random.normal(0, 0.3 * D, (400, 2))
    walls_there = pieces
    if periodic:
        x %= 1.0
        walls_there = images(pieces, (1.0, 1.0), (True, True))
    true = np.min([off_walls(x, np.broadcast_to(wall, (len(x), 2, 2)))[0] for wall in walls_there], axis=0)
    turns = [(a, b) for a in range(-3, 4) for b in range(-3, 4)] if periodic else [(0, 0)]
    found = np.min([active(parts, x + turn).min(axis=0) for turn in turns], axis=0)
    near = (true < D) & (true > 0.02 * D)
    allowed = 2e-3 * D + (1 - math.cos(BEND)) * true
    assert (np.abs(found - true) <= allowed)[near].all(), (x[near & (np.abs(found - true) > allowed)], found, true)
