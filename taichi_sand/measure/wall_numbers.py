"""Which wall a part of the walls' table belongs to.

Walls are numbered as the [[walls]] of the scene; after them come the four edges of the box: left, right, bottom, top, whether they are
walls or not. Straight pieces of several walls that go on in one another are one part of the table: a contact then belongs to the wall
whose piece is nearest.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand.scene import moving
from taichi_sand.scene.nearby import images, segments
from taichi_sand.world.walls.build import SIDES, wall_parts
from taichi_sand.world.walls.joints import Part

BESIDE = 1e-2
"""A piece of a wall lies on a part if it is nowhere farther off than this, in diameters of the smallest grain: a hundred times what
straight lines may leave out, and ten times what is welded."""


@dataclass
class WallNumbers:
    """Candidates for every part: rows start[k] … start[k + 1] - 1 of `pieces`, each the number of a wall and a segment of it [m]."""

    walls: Any  # of the scene they are those of
    start: np.ndarray  # (parts + 1,), i32
    pieces: np.ndarray  # (n, 5): number, x, y of one end, x, y of the other; f32


def names(scene: Any) -> list[str]:
    """What each wall is called, by number: its name, if no other has it, or `walls[k]`; and the edges."""
    given = [wall.name for wall in scene.walls]
    own = [name if name and name not in SIDES and given.count(name) == 1 else f"walls[{k}]" for k, name in enumerate(given)]
    return own + list(SIDES)


def wall_numbers(scene: Any, unit: float) -> WallNumbers:
    """Those of a scene whose smallest grain has diameter `unit` [m]."""
    still = [k for k, wall in enumerate(scene.walls) if not moving.moves(wall)]
    movers = [k for k, wall in enumerate(scene.walls) if moving.moves(wall)]
    assert len(movers) == len(moving.moving_walls(scene))
    found = [images(segments([moving.corners(scene.walls[k])]), scene.size, scene.periodic) for k in still]
    pieces = np.concatenate([np.empty((0, 2, 2)), *found])
    owner = np.repeat(still, [len(one) for one in found]).astype(int)
    edges = [len(scene.walls) + k for k, side in enumerate(SIDES) if getattr(scene.edges, side) == "wall"]
    rows: list[np.ndarray] = []
    for k, part in enumerate(wall_parts(scene, unit)):
        if part.side == 1:
            rows.append(nowhere(edges[k]))
        elif part.mover >= 0:
            rows.append(nowhere(movers[part.mover]))
        else:
            rows.append(candidates(part, pieces, owner, BESIDE * unit))
    start = np.cumsum([0] + [len(row) for row in rows]).astype(np.int32)
    return WallNumbers(scene.walls, start, np.concatenate([np.zeros((1, 5)), *rows])[1:].astype(np.float32))


def nowhere(number: int) -> np.ndarray:
    """The row of a wall that a part belongs to whatever is touched."""
    return np.array([[number, 0.0, 0.0, 0.0, 0.0]])


def candidates(part: Part, pieces: np.ndarray, owner: np.ndarray, beside: float) -> np.ndarray:
    """Rows of `pieces` (n, 2, 2), of walls `owner` (n,), that lie on a part; a single one if all are of one wall, or the part is an end."""
    a, way = pieces[:, 0], pieces[:, 1] - pieces[:, 0]
    if part.side == -1:
        share = np.clip(((part.point - a) * way).sum(1) / np.maximum((way**2).sum(1), 1e-300), 0.0, 1.0)
        off = np.hypot(*(a + share[:, None] * way - part.point).T)
        on = off <= max(beside, off.min())
        return nowhere(owner[on].min())
    across = np.array([-part.along[1], part.along[0]])
    places = np.sort((pieces - part.point) @ part.along, axis=1)
    low, high = np.maximum(places[:, 0], part.bounds[0]), np.minimum(places[:, 1], part.bounds[1])
    off = np.abs((pieces - part.point) @ across).max(axis=1)
    on = (high - low > beside) & (off <= beside)
    if not on.any():  # shorter than what is told apart
        on = (np.abs(0.5 * (low + high) - np.clip(0.5 * (low + high), *part.bounds)) + off) <= off.min() + beside
    own = owner[on]
    return nowhere(own.min()) if (own == own[0]).all() else np.column_stack([own, pieces[on].reshape(-1, 4)])
