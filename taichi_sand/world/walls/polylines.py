"""Polylines as they are drawn: cut off at the box, with corners that are one where they are in one place, and straight where they are."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from taichi_sand.scene.nearby import close_pairs

WELD = 1e-3
"""Points closer than this are the same, in diameters of the smallest grain: users round coordinates, and grains overlap by more."""
STRAIGHT = 1e-4
"""A line may replace pieces that are nowhere farther off it than this, in the same diameters."""


OWN = 3
"""Numbers that are of a wall: coefficient of friction (< 0: none of its own), surface velocity along it [m/s], number of its material."""
Own = tuple[float, float, int]


class Frame(NamedTuple):
    """What polylines are joined in: the box, or for walls that move what of it moves along."""

    size: np.ndarray  # [m]
    wraps: np.ndarray  # which axes are periodic, (2,) bool
    walled: tuple[bool, ...]  # which edges end what reaches them: left, right, bottom, top
    unit: float  # diameter of the smallest grain [m]
    longest: float  # no line is longer [m]: a grain then never sees one part twice, here and beyond a periodic edge

    def home(self, points: np.ndarray) -> np.ndarray:
        """These points, shifted to within the box where it is periodic."""
        turns = np.where(self.wraps, np.floor((points + WELD * self.unit) / self.size), 0.0)
        return points - turns * self.size

    def nearest(self, points: np.ndarray, to: np.ndarray) -> np.ndarray:
        """The images of `points` that are nearest to the points `to`."""
        turns = np.where(self.wraps, np.round((to - points) / self.size), 0.0)
        return points + turns * self.size


class Lines(NamedTuple):
    """The pieces of polylines, a row each."""

    ends: np.ndarray  # numbers of the points they run between, (n, 2)
    start: np.ndarray  # [m], (n, 2)
    way: np.ndarray  # from start to end [m], (n, 2)
    own: np.ndarray  # see OWN, (n, 3)

    def along(self) -> np.ndarray:
        """Directions, (n, 2)."""
        return self.way / np.hypot(*self.way.T)[:, None]


def clipped(points: np.ndarray, frame: Frame) -> Iterator[np.ndarray]:
    """What of a polyline lies inside the box, or outside in a direction that is periodic, in pieces."""
    piece: list[np.ndarray] = []
    for start, end in pairwise(points):
        first, last = 0.0, 1.0
        for axis in np.flatnonzero(~frame.wraps):
            way = end[axis] - start[axis]
            edges = np.array([0.0, frame.size[axis]]) - start[axis]
            if way == 0:
                last = last if edges[0] <= 0 <= edges[1] else -1.0
            else:
                first, last = max(first, (edges / way).min()), min(last, (edges / way).max())
        if first > 0 or first >= last:
            yield from ([np.array(piece)] if len(piece) > 1 else [])
            piece = []
        if first < last:
            piece = piece or [start + first * (end - start)]
            piece.append(end if last == 1.0 else start + last * (end - start))
            if last < 1:
                yield np.array(piece)
                piece = []
    if len(piece) > 1:
        yield np.array(piece)


def thinned(points: np.ndarray, least: float) -> np.ndarray:
    """Corners at least so far apart; first and last stay."""
    kept = [points[0]]
    for point in points[1:-1]:
        if math.dist(point, kept[-1]) >= least:
            kept.append(point)
    if len(kept) > 1 and math.dist(points[-1], kept[-1]) < least:
        kept.pop()
    return np.array([*kept, points[-1]])


def lay(polylines: list[tuple[np.ndarray, Own]], frame: Frame) -> tuple[Lines, np.ndarray]:
    """The pieces, with corners that are the same in the same place, and the places [m] of all corners, (m, 2), by their numbers."""
    weld = WELD * frame.unit
    thin = [(thinned(np.asarray(points, float), 2 * weld), own) for points, own in polylines]
    corners = np.concatenate([points for points, _ in thin] or [np.empty((0, 2))])
    number = welded(frame.home(corners), weld, frame)
    places = frame.home(corners)
    owns = np.concatenate([np.tile(own, (len(points), 1)) for points, own in thin] or [np.empty((0, OWN))])
    last = np.cumsum([len(points) for points, _ in thin]) - 1
    rows = np.setdiff1d(np.arange(len(corners)), last)
    snapped = frame.nearest(places[number], corners)
    ends, way = np.stack([number[rows], number[rows + 1]], axis=1).reshape(-1, 2), snapped[rows + 1] - snapped[rows]
    seen: dict[tuple, int] = {}
    for k, ((a, b), (x, y)) in enumerate(zip(ends.tolist(), np.round(way / weld).tolist(), strict=True)):
        if x or y:
            seen.setdefault((a, b, x, y) if (a, x, y) <= (b, -x, -y) else (b, a, -x, -y), k)
    once = np.array(list(seen.values()), int)
    return Lines(ends[once], snapped[rows][once], way[once], owns[rows][once]), places


def welded(points: np.ndarray, weld: float, frame: Frame) -> np.ndarray:
    """For each point the number of the first one that it is one with."""
    shifts = np.array([[x, y] for x in ((0, 1) if frame.wraps[0] else (0,)) for y in ((0, 1) if frame.wraps[1] else (0,))])
    number = np.arange(len(points))
    for shift in shifts:
        for i, j in zip(*close_pairs(points, points + shift * frame.size, weld), strict=True):
            i, j = root(number, i), root(number, j)
            number[max(i, j)] = min(i, j)
    return np.array([root(number, i) for i in range(len(points))], int)


def root(number: np.ndarray, i: int) -> int:
    """The first of those that i has been found one with."""
    while number[i] != i:
        i = number[i]
    return i


def straightened(points: np.ndarray, most: float) -> list[int]:
    """Numbers of the points between which a path is straight: it goes forward, and is nowhere farther off than `most` [m]."""
    corners, last = [0], len(points) - 1
    while corners[-1] < last:
        a = corners[-1]
        good, step = a + 1, 1
        while step:  # by steps that double until one is too long, and halve from there on
            tried = min(good + step, last)
            if tried > good and is_straight(points[a : tried + 1], most):
                good, step = tried, 2 * step
            else:
                step //= 2
        corners.append(good)
    return corners


def is_straight(points: np.ndarray, most: float) -> bool:
    """Whether a path runs forward along the line from its first point to its last, at most so far off [m]."""
    chord = points[-1] - points[0]
    length = np.hypot(*chord)
    if length == 0:
        return False
    from_first = points - points[0]
    gone, off = from_first @ chord / length, (chord[0] * from_first[:, 1] - chord[1] * from_first[:, 0]) / length
    return bool((np.abs(off) <= most).all() and (np.diff(gone) > 0).all())
