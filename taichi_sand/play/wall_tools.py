"""Walls by hand: a stroke draws one, another rubs out what is under the brush."""

from itertools import pairwise

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.play.stroke import Stroke
from taichi_sand.scene.moving import moves
from taichi_sand.scene.nearby import images, near_walls, off_walls, segments
from taichi_sand.world import edit
from taichi_sand.world.walls.build import standing_walls

STEP, FLAT = 0.02, 0.15
"""A stroke is followed in steps of at least this length, and drawn by straight parts that are nowhere farther off than this [d]."""
SHORTEST = 0.5
"""Nothing shorter is drawn, or left over where walls are rubbed out [d]."""


def draw(stroke: Stroke) -> None:
    """Follows the hand, within the box; `build` makes a wall of it."""
    place = np.clip(stroke.place, 0.0, stroke.sim.scene.size)
    far = not stroke.path or np.hypot(*(place - stroke.path[-1])) > STEP * stroke.sim.bed.diameter
    if far:
        stroke.path.append(place)


def build(stroke: Stroke) -> None:
    """The line that was drawn becomes a wall. The grains that it would cut through are taken out, and it says how many."""
    sim, path = stroke.sim, np.array(stroke.path)
    diameter = sim.bed.diameter
    if np.hypot(*np.diff(path, axis=0).T).sum() < SHORTEST * diameter:
        raise SandError(f"a wall must be longer than {SHORTEST:g} grain: keep the button down and draw it")
    points = straightened(path, FLAT * diameter)
    sim.set_walls([*sim.scene.walls, {"points": points.tolist()}])
    gone = cut_through(stroke, points)
    sim.remove(gone)
    if len(gone):
        stroke.session.message = f"{len(gone)} {'grain' if len(gone) == 1 else 'grains'} stood in the way of the wall: taken out"


def cut_through(stroke: Stroke, points: np.ndarray) -> np.ndarray:
    """Ids of the free grains that a wall through `points` [m] would cut: deeper than what the tolerance lets overlap."""
    sim = stroke.sim
    places, whole = edit.places(sim.world)
    walls = images(segments([points]), sim.scene.size, sim.scene.periodic)
    grain, wall = near_walls(places[:, :2], walls, float(places[:, 2].max(initial=0.0)))
    distance, _ = off_walls(places[grain, :2], walls[wall])
    deep = places[grain, 2] - distance > sim.scene.solver.tolerance * sim.bed.diameter
    return whole[np.unique(grain[deep & (whole[grain, 2] == 0)]), 0]


def erase(stroke: Stroke) -> None:
    """Rubs out the parts of walls that lie under the brush; the edges of the box and walls that move stay."""
    sim, left, kept = stroke.sim, [], False
    for wall, points in zip(sim.scene.walls, standing_walls(sim.world, sim.scene), strict=True):
        pieces = rubbed_out(points, stroke.place, stroke.session.brush.size, SHORTEST * sim.bed.diameter)
        if pieces is None or moves(wall):
            left.append(wall)
            kept |= pieces is not None
        else:
            left += [wall.model_copy(update={"points": piece.tolist(), "closed": False}) for piece in pieces]
    if left != list(sim.scene.walls):
        sim.set_walls(left)
    elif kept:
        stroke.session.message = "a wall that moves cannot be rubbed out"


def straightened(path: np.ndarray, most: float) -> np.ndarray:
    """Corners of a line (n, 2) without those that it passes within `most` of (Douglas and Peucker 1973)."""
    keep = np.zeros(len(path), bool)
    keep[[0, -1]] = True
    parts = [(0, len(path) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        inner = path[first + 1 : last]
        ends = np.broadcast_to(path[[first, last]], (len(inner), 2, 2))
        still = (path[first] == path[last]).all()
        distance = np.hypot(*(inner - path[first]).T) if still else off_walls(inner, ends)[0]
        if distance.max() > most:
            middle = first + 1 + int(np.argmax(distance))
            keep[middle] = True
            parts += [(first, middle), (middle, last)]
    return path[keep]


def rubbed_out(points: np.ndarray, centre: np.ndarray, radius: float, shortest: float) -> list[np.ndarray] | None:
    """What is left of a line through `points` (n, 2) outside a circle, in pieces longer than `shortest`; None if all of it is."""
    pieces, open_end = [], [points[0]]
    touched = False
    for start, end in pairwise(points):
        way, off = end - start, start - centre
        a, b, c = way @ way, way @ off, off @ off - radius**2
        root = np.sqrt(max(b * b - a * c, 0.0))
        enter, leave = ((-b - root) / a, (-b + root) / a) if a else (0.0, 0.0)
        if b * b <= a * c or leave <= 0 or enter >= 1:
            open_end.append(end)
            continue
        touched = True
        if enter > 0:
            open_end.append(start + enter * way)
        pieces.append(open_end)
        open_end = [start + leave * way, end] if leave < 1 else []
    pieces.append(open_end)
    if not touched:
        return None
    if len(pieces) > 1 and pieces[0] and pieces[-1] and (points[0] == points[-1]).all():  # a closed line goes on at its start
        pieces[0] = pieces.pop() + pieces[0][1:]
    arrays = [np.array(piece) for piece in pieces if len(piece) > 1]
    return [piece for piece in arrays if np.hypot(*np.diff(piece, axis=0).T).sum() > shortest]
