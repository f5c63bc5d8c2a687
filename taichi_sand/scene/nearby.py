"""Which points lie near each other, and how far points are from walls: NumPy only, for the packing."""

import numpy as np


def close_pairs(points: np.ndarray, others: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns index pairs (i, j), points[i] and others[j] at most `reach` apart, and some a little farther.

    Args:
        points: (n, 2); others: (m, 2); reach: > 0, all in m.
    """
    if not len(points) or not len(others):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    low, high = np.minimum(points.min(axis=0), others.min(axis=0)), np.maximum(points.max(axis=0), others.max(axis=0))
    side = max(reach, float(np.sqrt((high - low + reach).prod() / (4 * len(others) + 16))))  # no more cells than a few per point
    corner = low - 1.5 * side  # a rim of empty cells all around
    columns, rows = ((high - corner) // side).astype(np.int64) + 2
    cell, home = _cells(others, corner, side, rows), _cells(points, corner, side, rows)
    order = np.argsort(cell, kind="stable")
    before = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=columns * rows + 1))])  # points in earlier cells
    firsts, seconds = [], []
    for column in (-1, 0, 1):  # the three cells of a column stand next to each other
        start = before[home + column * rows - 1]
        count = before[home + column * rows + 2] - start
        first = np.repeat(np.arange(len(points)), count)
        within = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
        second = order[np.repeat(start, count) + within]
        near = ((points[first] - others[second]) ** 2).sum(axis=1) <= (1.001 * reach) ** 2
        firsts.append(first[near])
        seconds.append(second[near])
    return np.concatenate(firsts), np.concatenate(seconds)


def _cells(points: np.ndarray, corner: np.ndarray, side: float, rows: int) -> np.ndarray:
    column_row = ((points - corner) // side).astype(np.int64)
    return column_row[:, 0] * rows + column_row[:, 1]


def segments(polylines: list[np.ndarray]) -> np.ndarray:
    """Returns the segments (m, 2, 2) of polylines, each (corners, 2)."""
    parts = [np.stack([line[:-1], line[1:]], axis=1) for line in polylines]
    return np.concatenate(parts) if parts else np.empty((0, 2, 2))


def images(walls: np.ndarray, size: tuple[float, float], periodic: tuple[bool, bool]) -> np.ndarray:
    """Returns the segments `walls` (m, 2, 2) and their images beyond `periodic` edges of a box of `size` [m], up to half a box from it."""
    for axis in np.flatnonzero(periodic):
        side = size[axis]
        low, high = walls[:, :, axis].min(axis=1), walls[:, :, axis].max(axis=1)
        first, last = np.ceil(-high / side - 0.5).astype(int), np.floor(1.5 - low / side).astype(int)
        count = np.maximum(last - first + 1, 0)
        turn = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)
        walls = np.repeat(walls, count, axis=0)
        walls[:, :, axis] += (turn * side)[:, None]
    return walls


def near_walls(points: np.ndarray, walls: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns index pairs (i, s), points[i] in reach of the segment walls[s] (m, 2, 2), and some a little farther."""
    firsts, seconds = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for index, ends in enumerate(walls):
        low, high = ends.min(axis=0) - reach, ends.max(axis=0) + reach
        first = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
        firsts.append(first)
        seconds.append(np.full(len(first), index))
    return np.concatenate(firsts), np.concatenate(seconds)


def off_walls(points: np.ndarray, walls: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the distance (n,) of each point to its segment, and the unit vectors (n, 2) that lead away from it.

    Args:
        points: (n, 2) m; walls: (n, 2, 2) m, a segment for each.
    """
    along = walls[:, 1] - walls[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    share = np.clip(((points - walls[:, 0]) * along).sum(axis=1) / length**2, 0.0, 1.0)
    offset = points - walls[:, 0] - share[:, None] * along
    distance = np.hypot(offset[:, 0], offset[:, 1])
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]  # for a point on the line itself
    away = np.where(distance[:, None] > 0, offset / np.maximum(distance, 1e-300)[:, None], normal)
    return distance, away
