"""Whether grains that are put somewhere overlap others, walls or edges there: disc by disc, on the host."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand.measure import discs as on_host
from taichi_sand.measure.discs import Kinds
from taichi_sand.scene.nearby import close_pairs, near_walls, off_walls
from taichi_sand.world.search.images import folded, offset_of
from taichi_sand.world.walls.build import wall_segments


@dataclass(frozen=True)
class Discs:
    """Discs of grains, a row each."""

    position: np.ndarray  # (n, 2) [m], within the box where it is periodic
    radius: np.ndarray  # (n,) [m]
    grain: np.ndarray  # (n,) id

    def but(self, ids: np.ndarray) -> "Discs":
        """Without those of these grains."""
        keep = ~np.isin(self.grain, ids)
        return Discs(self.position[keep], self.radius[keep], self.grain[keep])


def discs_of(sim: Any, ids: np.ndarray, position: np.ndarray, angle: np.ndarray, radius: np.ndarray, kind: np.ndarray) -> Discs:
    """The discs of grains at `position` (n, 2) [m], of `radius` (n,) [m] around them, turned by `angle` (n,)."""
    found = on_host.discs_of(Kinds(sim.scene), kind, position, angle, radius)
    return Discs(folded(found.place, sim.world, sim.scene.size), found.radius, np.asarray(ids)[found.owner])


def with_images(discs: Discs, sim: Any, reach: float) -> Discs:
    """These discs, and what is seen of them beyond periodic edges, as far as `reach` [m]."""
    position, rows = discs.position, np.arange(len(discs.radius))
    for axis in np.flatnonzero(sim.scene.periodic)[::-1]:
        side = sim.scene.size[axis]
        for sign in (-1, 1):
            seen = np.flatnonzero(position[:, axis] < reach) if sign > 0 else np.flatnonzero(position[:, axis] > side - reach)
            seen = seen[seen < len(rows)]
            moved = position[seen].copy()
            moved[:, axis] += sign * side
            if axis == 1 and sim.world.sheared:
                moved[:, 0] = (moved[:, 0] + sign * offset_of(sim.world)) % sim.scene.size[0]
            position, rows = np.concatenate([position, moved]), np.concatenate([rows, rows[seen]])
    return Discs(position, discs.radius[rows], discs.grain[rows])


def between(sim: Any, new: Discs, others: Discs) -> tuple[float, int, int]:
    """Deepest overlap [m] of one of the discs `new` with another's, or with one of `others`, and the ids of both grains; 0 if none does."""
    reach = 2 * float(max(new.radius.max(initial=0.0), others.radius.max(initial=0.0)))
    every = Discs(*(np.concatenate(pair) for pair in zip(vars(new).values(), vars(others).values(), strict=True)))
    every = with_images(every, sim, reach)
    first, second = close_pairs(new.position, every.position, reach)
    apart = new.grain[first] != every.grain[second]
    first, second = first[apart], second[apart]
    way = new.position[first] - every.position[second]
    overlap = new.radius[first] + every.radius[second] - np.hypot(way[:, 0], way[:, 1])
    if not len(overlap):
        return 0.0, -1, -1
    worst = int(np.argmax(overlap))
    return float(overlap[worst]), int(new.grain[first[worst]]), int(every.grain[second[worst]])


def with_walls(sim: Any, new: Discs, walls: np.ndarray | None = None) -> tuple[float, int]:
    """Deepest overlap [m] of one of the discs `new` with a wall, or an edge that is one, and the id of its grain; 0 if none does. The
    walls are those there are, or straight parts (m, 2, 2) [m].
    """
    walls = wall_segments(sim.world, sim.scene) if walls is None else walls
    disc, wall = near_walls(new.position, walls, float(new.radius.max(initial=0.0)))
    deep, who = [new.radius[disc] - off_walls(new.position[disc], walls[wall])[0]], [new.grain[disc]]
    for axis, sides in enumerate((("left", "right"), ("bottom", "top"))):
        for side, far in zip(sides, (0.0, sim.scene.size[axis]), strict=True):
            if getattr(sim.scene.edges, side) == "wall":
                deep.append(new.radius - np.abs(new.position[:, axis] - far))
                who.append(new.grain)
    overlap, grain = np.concatenate(deep), np.concatenate(who)
    worst = int(np.argmax(overlap)) if len(overlap) else -1
    return (float(overlap[worst]), int(grain[worst])) if len(overlap) else (0.0, -1)
