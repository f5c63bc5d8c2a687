"""How much of a wall with `pressure` grains can load: from side to side between what stands beside it, or to its own ends.

Seen along its course, a wall is loaded as far as it reaches across it, and no farther than the walls and edges that it meets there. Which
these are is found as it sets out, in the height of its foremost point; where they move, the length follows them from then on.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_sand.scene.moving import corners, moving_walls, pivot_at
from taichi_sand.scene.nearby import images, segments

SLACK = 1e-9
"""So near to its end a wall is met, in lengths of the box: users draw them just so long."""


def spans(scene: Any) -> tuple[np.ndarray, np.ndarray]:
    """Of every wall of `scene` that moves: its own lower and upper end across its course, and those of what is beside it, each at time 0
    (n, 4) [m]; and which of the moving walls the latter are, -1 for what stands still, (n, 2). One without `pressure` has a length of 1.
    """
    found = moving_walls(scene)
    rows = [_span(scene, found, m) if wall.pressure else ([0.0, 1.0, 0.0, 1.0], [-1, -1]) for m, wall in enumerate(found)]
    own, beside = [row[0] for row in rows], [row[1] for row in rows]
    return np.array(own, float).reshape(-1, 4), np.array(beside, np.int32).reshape(-1, 2)


def _span(scene: Any, found: Sequence[Any], m: int) -> tuple[list[float], list[int]]:
    wall = found[m]
    way = np.array(wall.velocity) / math.hypot(*wall.velocity)
    across, points = np.array([-way[1], way[0]]), np.array(wall.points)
    low, high = float((points @ across).min()), float((points @ across).max())
    if any(scene.periodic) and high - low > (around := _around(scene, across)):
        low, high = 0.5 * (low + high) + np.array([-0.5, 0.5]) * around
    inside = np.clip(points, 0.0, scene.size) @ across
    front, middle = float((points @ way).max()), 0.5 * float(inside.min() + inside.max())
    sides, owners = [low, high], [-1, -1]
    for number, pieces in _others(scene, wall):
        ahead, off = pieces @ way - front, pieces @ across
        slack = SLACK * max(scene.size)
        for (a, b), (start, end) in zip(ahead, off, strict=True):
            if min(a, b) <= slack and max(a, b) >= -slack:
                share = min(1.0, max(0.0, -a / (b - a))) if a != b else 0.0
                at = start + share * (end - start)
                k = int(at > middle)
                if (at > sides[0]) if k == 0 else (at < sides[1]):
                    sides[k], owners[k] = float(at), number
    return [low, high, *sides], owners


def _around(scene: Any, across: np.ndarray) -> float:
    """Once around the box in this direction [m], if it is that of a periodic axis; infinite if not."""
    return min((scene.size[axis] for axis in range(2) if scene.periodic[axis] and abs(across[axis]) > 1 - 1e-9), default=math.inf)


def _others(scene: Any, wall: Any) -> list[tuple[int, np.ndarray]]:
    """The pieces (k, 2, 2) [m] of every other wall, with its number among those that move, -1 if it stands still, and of the edges."""
    movers, found = moving_walls(scene), []
    for other in scene.walls:
        if other is not wall:
            number = next((m for m, one in enumerate(movers) if one is other), -1)
            found.append((number, images(segments([corners(other)]), scene.size, scene.periodic)))
    (w, h), far = scene.size, 1e3 * max(scene.size)
    lines = {
        "left": [[0, -far], [0, far]],
        "right": [[w, -far], [w, far]],
        "bottom": [[-far, 0], [far, 0]],
        "top": [[-far, h], [far, h]],
    }
    edges = [line for side, line in lines.items() if getattr(scene.edges, side) == "wall"]
    return [*found, (-1, np.array(edges, float).reshape(-1, 2, 2))]


def loaded_length(scene: Any, wall: Any, times: Sequence[float]) -> float:
    """How much of a moving wall of `scene` grains can load [m] when the clocks of all that move show `times` [s]."""
    found = moving_walls(scene)
    m = next(k for k, one in enumerate(found) if one is wall)
    (low, high, *sides), beside = (part[m] for part in spans(scene))
    way = np.array(wall.velocity) / math.hypot(*wall.velocity)
    for k, n in enumerate(beside):
        if n >= 0:
            sides[k] += float((pivot_at(found[n], times[n]) - pivot_at(found[n], 0.0)) @ [-way[1], way[0]])
    return max(0.0, min(high, sides[1]) - max(low, sides[0]))
