"""What polylines are made of for grains: straight lines, and the ends where a grain may meet a corner.

They are made with the knowledge of all lines that meet anywhere: of one wall, of several, and across periodic edges. Points closer than
WELD are one. Lines that go on nearly straight form a path; of a path, what is straight becomes one line, whoever drew the pieces. Where
a path bends a little, the lines on both sides end at the plane that halves the angle between them: there is no gap and nothing double.
Elsewhere a grain meets a line where its centre projects onto it, and an end only where it lies beyond every line that meets there: in a
wedge between two of them, or nowhere. So no corner counts twice, and a joint of flush lines is not felt.
"""

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from taichi_sand.world.walls.polylines import STRAIGHT, WELD, Frame, Lines, Own, lay, straightened

FAR = 1e30
ASIDE = 1e-4
"""One line ends and the next begins so far beyond the corner, in the same diameters: users lay grains exactly above corners, where
rounding would let them meet both lines, or none."""
BEND = 0.1
"""Lines that meet at less than this make up a path [rad]. Where it bends outward, the line that a grain meets instead of a corner is at
most 1 - cos(BEND / 2), 0.0013 radii, too high."""


@dataclass
class Part:
    """One straight line or end, in box coordinates [m]."""

    point: np.ndarray
    along: np.ndarray  # direction of a line; of an end the first direction that leads off
    bounds: np.ndarray  # of a line from where to where it runs, from `point`; of an end the second direction that leads off
    side: int  # 1 = grains are always on its left (an edge of the box), 0 = a line with two sides, -1 = an end
    friction: float = -1.0  # < 0: that of the effect
    surface: tuple[float, float] = (0.0, 0.0)  # velocity of its surface as it stands [m/s]
    mover: int = -1  # which moving wall it belongs to; -1 = it stands still
    material: int = 0  # number of its material, as in scene.materials
    slopes: tuple[float, float] = (0.0, 0.0)  # by how much its bounds shift for every metre to the left of the line

    @property
    def length(self) -> float:
        """Of a line [m]; 0 of an end."""
        return 0.0 if self.side == -1 else float(self.bounds[1] - self.bounds[0])

    def key(self) -> bytes:
        """What makes it the same part in another table: whatever has come to meet it there."""
        return np.concatenate([self.point, self.along, self.bounds, [self.side, self.friction, self.mover, self.material]]).tobytes()


Link = dict[tuple[int, int], tuple[int, int]]
"""From an end of a line (number, 0 = start or 1 = end) to the end of the line that goes on there."""


def join(polylines: list[tuple[np.ndarray, Own]], frame: Frame, mover: int = -1) -> list[Part]:
    """Lines and ends of polylines, each its corners (n, 2) [m] and what `Lines.own` has of it, that move together."""
    lines, places = lay(polylines, frame)
    if not len(lines.ends):
        return []
    around = star(lines)
    link = linked(lines, around)
    ways: dict[tuple[int, int], np.ndarray] = {}
    parts = [part for path in paths(lines, link) for part in path_parts(lines, path, link, frame, mover, ways)]
    free = [point for point, halves in around.items() if not any(half in link for half, _ in halves)]
    shown = ~covered(places[free], lines, frame)
    return parts + [end for point in np.array(free)[shown] for end in corner(places[point], around[point], ways, lines, mover)]


Star = dict[int, list[tuple[tuple[int, int], np.ndarray]]]


def star(lines: Lines) -> Star:
    """By point: the ends of lines that meet there, each with the direction in which its line leads away."""
    found: Star = defaultdict(list)
    for k, ((a, b), along) in enumerate(zip(lines.ends.tolist(), lines.along(), strict=True)):
        found[a].append(((k, 0), along))
        found[b].append(((k, 1), -along))
    return found


def linked(lines: Lines, around: Star) -> Link:
    """Which line goes on where another one ends, nearly straight; the straightest first."""
    link: Link = {}
    for halves in around.values():
        ways = np.array([way for _, way in halves])
        bend = np.pi - np.arccos(np.clip(ways @ ways.T, -1.0, 1.0))
        near = np.argwhere(np.triu(bend < BEND, 1))
        for i, j in near[np.argsort(bend[near[:, 0], near[:, 1]], kind="stable")]:
            one, other = halves[i][0], halves[j][0]
            if one not in link and other not in link:
                link[one], link[other] = other, one
    return link


Path = list[tuple[int, int]]
"""Lines, each with the end at which it is entered."""


def paths(lines: Lines, link: Link) -> list[Path]:
    """All lines, in paths as long as they are; those that end in themselves start where they bend most."""
    done: set[int] = set()
    found = []
    count = range(len(lines.ends))
    for start in [(k, end) for end in (0, 1) for k in count if (k, end) not in link] + [(k, 0) for k in count]:
        path: Path = []
        here: tuple[int, int] | None = start
        while here is not None and here[0] not in done:
            path.append(here)
            done.add(here[0])
            here = link.get((here[0], 1 - here[1]))
        if path:
            found.append(path)
    for path in found:
        if path[0] in link:
            ways = directions(lines, path)
            turn = int(np.argmin((ways * np.roll(ways, 1, axis=0)).sum(axis=1)))
            path[:] = path[turn:] + path[:turn]
    return found


def directions(lines: Lines, path: Path) -> np.ndarray:
    """Of the lines of a path, as it runs, (n, 2)."""
    numbers, entered = np.array(path).T
    return lines.along()[numbers] * (1 - 2 * entered[:, None])


def path_parts(lines: Lines, path: Path, link: Link, frame: Frame, mover: int, ways: dict[tuple[int, int], np.ndarray]) -> list[Part]:
    """The straight lines of a path, which end where it bends at the planes that halve the angle; notes in `ways` how they lead away from
    its ends.
    """
    numbers, entered = np.array(path).T
    steps = lines.way[numbers] * (1 - 2 * entered[:, None])
    start = lines.start[numbers[0]] + entered[0] * lines.way[numbers[0]]
    points = np.concatenate([start[None], start + np.cumsum(steps, axis=0)])
    own = lines.own[numbers] * np.stack([np.ones(len(path)), 1 - 2 * entered, np.ones(len(path))], axis=1)
    corners = straightened(points, STRAIGHT * frame.unit)
    chords = np.diff(points[corners], axis=0)
    lengths = np.hypot(*chords.T)
    along = chords / lengths[:, None]
    after = np.roll(along, -1, axis=0)
    half = np.tan(0.5 * np.arctan2(along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0], (along * after).sum(axis=1)))
    closed = path[0] in link
    if not closed:
        half[-1] = 0.0
        ways[path[0]], ways[path[-1][0], 1 - path[-1][1]] = along[0], -along[-1]
    parts = []
    for k, (a, b) in enumerate(pairwise(corners)):
        length = once_around(chords[k], frame) if len(chords) == 1 else lengths[k]
        places = np.minimum((points[a : b + 1] - points[a]) @ along[k], length)
        over = ASIDE * frame.unit * np.array([k > 0 or closed, k < len(chords) - 1 or closed])
        spans = pieces(np.concatenate([[over[0]], places[1:-1], [length + over[1]]]), own[a:b], frame.longest)
        for n, (start, end, (friction, speed, material)) in enumerate(spans):
            slopes = (float(half[k - 1]) if n == 0 else 0.0, float(-half[k]) if n == len(spans) - 1 else 0.0)
            part = Part(points[a], along[k], np.array([start, end]), 0, friction, tuple(speed * along[k]), mover, int(material), slopes)
            parts.append(part)
    return parts


def pieces(places: np.ndarray, own: np.ndarray, longest: float) -> list[tuple[float, float, np.ndarray]]:
    """What of a line through `places` (n + 1,) [m] is alike, and no longer than `longest` [m]: from, to, and what is its `own` (n, OWN)."""
    changes = [0, *(1 + np.flatnonzero(np.diff(own, axis=0).any(axis=1))), len(own)]
    found: list[tuple[float, float, np.ndarray]] = []
    for first, last in pairwise(changes):
        start, end = places[first], places[last]
        cuts = np.linspace(start, end, max(1, math.ceil((end - start) / longest - 1e-9)) + 1)
        found += [(float(s), float(e), own[first]) for s, e in pairwise(cuts) if e > s]
    return found


def once_around(chord: np.ndarray, frame: Frame) -> float:
    """Length of a straight line [m]: where it goes around a periodic box along its axis, no more than once."""
    for axis in np.flatnonzero(frame.wraps):
        if abs(chord[1 - axis]) < WELD * frame.unit and abs(chord[axis]) > frame.size[axis]:
            return float(frame.size[axis])
    return float(np.hypot(*chord))


def covered(points: np.ndarray, lines: Lines, frame: Frame) -> np.ndarray:
    """Which points (n, 2) lie on a line, between its ends, or on an edge that is a wall: no grain gets beyond a line that ends there."""
    weld, found = WELD * frame.unit, np.zeros(len(points), bool)
    for edge in np.flatnonzero(frame.walled):
        found |= np.abs(points[:, edge // 2] - (edge % 2) * frame.size[edge // 2]) < weld
    along, lengths = lines.along(), np.hypot(*lines.way.T)
    turns = np.where(frame.wraps, np.ceil(np.abs(lines.way).max(axis=0) / frame.size) + 1, 0).astype(int)
    for x in range(-turns[0], turns[0] + 1):
        for y in range(-turns[1], turns[1] + 1):
            shifted = points + np.array([x, y]) * frame.size
            for start, way, length in zip(frame.home(lines.start), along, lengths, strict=True):
                seen = shifted - start
                gone = seen @ way
                off = np.abs(seen[:, 0] * way[1] - seen[:, 1] * way[0])
                found |= (off < weld) & (gone > weld) & (gone < length - weld)
    return found


def corner(place: np.ndarray, halves: list, led: dict[tuple[int, int], np.ndarray], lines: Lines, mover: int) -> Iterator[Part]:
    """The end at a point where lines meet, if a disc can lie beyond all of them: within half a turn they leave room for it."""
    ways = np.array([led[half] for half, _ in halves])
    angle = np.arctan2(ways[:, 1], ways[:, 0])
    order = np.argsort(angle, kind="stable")
    gaps = np.diff(angle[order], append=angle[order[0]] + 2 * np.pi)
    widest = int(np.argmax(gaps))
    if gaps[widest] > np.pi:
        first, second = order[(widest + 1) % len(order)], order[widest]
        meeting = [number for (number, _), _ in halves]
        friction, _, material = lines.own[meeting[0]]
        ends = (-ways[first], -ways[second])
        yield Part(place, *ends, -1, float(friction), around_corner(lines, meeting), mover, int(material))


def around_corner(lines: Lines, meeting: list[int]) -> tuple[float, float]:
    """Surface velocity of a corner of these lines [m/s]: their mean speed, in the mean of their directions."""
    speeds = lines.own[meeting, 1]
    mean = (speeds[:, None] * lines.along()[meeting]).mean(axis=0)
    return tuple((mean * np.abs(speeds).mean() / max(float(np.hypot(*mean)), 1e-30)).tolist())
