"""Where in a region there is room for a disc: darts while there is much, then a map of clearances, refined where need be. NumPy only.

The clearance of a point is its distance to the nearest surface. It changes by no more than one moves, so that a disc of radius r has no
room within s of a point whose clearance is below r - s. What looks at squares smaller and smaller and leaves out those without room so
finds a place wherever there is one.
"""

import numpy as np

from taichi_sand.scene.nearby import close_pairs, off_walls

DARTS, THROWS = 16, 8
"""Random places tried at once for one disc; a map is made when none of them is free, or for the discs after so many: it costs as much."""
COARSE, MOST_CELLS = 0.7, 20_000
"""Side of a square of the map, in radii of the largest disc, and most squares."""
EXACT = 1e-6
"""A disc is thought so much smaller, of its radius: where a gap is as wide as it is, rounding decides nothing."""
FINEST = 1e-4
"""Squares are no longer divided when they are so small, in radii."""


class Room:
    """The free space of a region.

    Args:
        region: x0, y0, x1, y1 [m], in which discs lie as a whole.
        largest: radius of the largest disc that there is to be room for [m].
        walls: segments (m, 2, 2) [m]; position (n, 2), radius (n,): discs that are there [m].
        rng: where places are drawn from.
    """

    def __init__(
        self, region: np.ndarray, largest: float, walls: np.ndarray, position: np.ndarray, radius: np.ndarray, rng: np.random.Generator
    ) -> None:
        self.low, self.high, self.largest, self.rng = np.array(region[:2], float), np.array(region[2:], float), largest, rng
        near = ((position > self.low - largest - radius[:, None]) & (position < self.high + largest + radius[:, None])).all(axis=1)
        self.position, self.radius = position[near], radius[near]
        self.walls = self._pieces(walls)
        self.thrown = 0  # discs that darts have been thrown for
        self.clearance: np.ndarray | None = None  # of the map (columns, rows), up to `most`; None = not needed yet
        self.points, self.side, self.most = np.empty((0, 0, 2)), np.zeros(2), 0.0

    def _pieces(self, walls: np.ndarray) -> np.ndarray:
        """The segments in reach of the region, in pieces not longer than a disc is wide."""
        near = (walls.max(axis=1) > self.low - self.largest).all(axis=1) & (walls.min(axis=1) < self.high + self.largest).all(axis=1)
        walls = walls[near]
        counts = np.maximum(1, np.ceil(np.hypot(*(walls[:, 1] - walls[:, 0]).T) / (2 * self.largest)).astype(int))
        which = np.repeat(np.arange(len(walls)), counts)
        part = (np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts))[:, None]
        start, way, whole = walls[which, 0], walls[which, 1] - walls[which, 0], counts[which][:, None]
        pieces = np.stack([start + way * (part / whole), start + way * ((part + 1) / whole)], axis=1)
        near = (pieces.max(axis=1) > self.low - self.largest).all(axis=1) & (pieces.min(axis=1) < self.high + self.largest).all(axis=1)
        return pieces[near]

    def clear(self, points: np.ndarray, most: float) -> np.ndarray:
        """Clearance of points (n, 2), as far as it is below `most` [m], (n,)."""
        found = np.full(len(points), most)
        first, second = close_pairs(points, self.position, most + self.radius.max(initial=0.0))
        np.minimum.at(found, first, np.hypot(*(points[first] - self.position[second]).T) - self.radius[second])
        first, second = close_pairs(points, self.walls.mean(axis=1), most + self.largest)
        np.minimum.at(found, first, off_walls(points[first], self.walls[second])[0])
        return found

    def add(self, place: np.ndarray, radius: float) -> None:
        """A disc lies at `place` (2,) from now on."""
        self.position, self.radius = np.concatenate([self.position, place[None]]), np.append(self.radius, radius)
        if self.clearance is not None:  # of the squares that can be so close
            reach = radius + self.most
            first = np.maximum(0, np.floor((place - reach - self.points[0, 0]) / self.side).astype(int))
            last = np.maximum(0, np.ceil((place + reach - self.points[0, 0]) / self.side).astype(int) + 1)
            around = (slice(first[0], last[0]), slice(first[1], last[1]))
            way = self.points[around] - place
            np.minimum(self.clearance[around], np.hypot(way[..., 0], way[..., 1]) - radius, out=self.clearance[around])

    def find(self, radius: float) -> np.ndarray | None:
        """A random place (2,) for a disc, or None if there is none."""
        low, high = self.low + radius, self.high - radius
        high = np.maximum(low, high)  # of the largest that fits they may differ by rounding
        enough = radius * (1 - EXACT)
        if self.clearance is None and self.thrown < THROWS:
            self.thrown += 1
            darts = self.rng.uniform(low, high, (DARTS, 2))
            free = self.clear(darts, radius) >= enough
            if free.any():
                return darts[np.argmax(free)]
        if self.clearance is None:
            self._map()
        assert self.clearance is not None
        first = np.ceil((low - self.points[0, 0]) / self.side).astype(int)
        last = np.floor((high - self.points[0, 0]) / self.side).astype(int) + 1
        inside = self.clearance[first[0] : last[0], first[1] : last[1]]
        free = np.flatnonzero(inside >= enough)
        if len(free):
            at = np.array(np.unravel_index(free[self.rng.integers(len(free))], inside.shape)) + first
            return np.clip(self._shaken(self.points[tuple(at)], float(self.clearance[tuple(at)]) - radius), low, high)
        return self._search(low, high, radius, enough)

    def _map(self) -> None:
        """Lays squares over the region, at random by up to one of them, and looks how clear the middle of each is."""
        span = self.high - self.low
        side = max(COARSE * self.largest, float(np.sqrt(span.prod() / MOST_CELLS)))
        count = np.ceil(span / side).astype(int)
        side = span / count
        shift = self.rng.uniform(-0.5, 0.5, 2)
        x, y = (self.low[k] + (np.arange(count[k] + 1) + shift[k]) * side[k] for k in (0, 1))
        self.points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        self.side, self.most = side, self.largest + float(np.hypot(*side))
        self.clearance = self.clear(self.points.reshape(-1, 2), self.most).reshape(self.points.shape[:2])

    def _shaken(self, point: np.ndarray, room: float) -> np.ndarray:
        """A random place around `point` that is as good if that has `room` to spare [m]."""
        angle, way = self.rng.uniform(0, 2 * np.pi), max(0.0, min(room, float(self.side.max()))) * np.sqrt(self.rng.uniform())
        return point + way * np.array([np.cos(angle), np.sin(angle)])

    def _search(self, low: np.ndarray, high: np.ndarray, radius: float, enough: float) -> np.ndarray | None:
        """Divides the squares of the map that may hold a place between the corners `low` and `high` until one is found."""
        assert self.clearance is not None
        half = self.side / 2
        near = ((self.points + half >= low) & (self.points - half <= high)).all(axis=-1)
        cells = self.points[near & (self.clearance >= enough - float(np.hypot(*half)))]
        while len(cells):
            places = np.clip(cells, low, high)
            clearance = self.clear(places, radius)
            free = np.flatnonzero(clearance >= enough)
            if len(free):
                return places[self.rng.choice(free)]
            size = float(np.hypot(*half))
            if size < FINEST * radius:
                return None
            cells = cells[clearance >= enough - size]
            half = half / 2
            cells = (cells[:, None] + half * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])).reshape(-1, 2)
            cells = cells[((cells + half >= low) & (cells - half <= high)).all(axis=1)]
        return None
