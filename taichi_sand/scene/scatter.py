"""Random places for discs that do not overlap: darts while they hit, then the rest is squeezed in and pushed apart."""

from dataclasses import dataclass, field

import numpy as np

from taichi_sand.scene.nearby import close_pairs, near_walls, off_walls

ROUNDS = 20  # of darts
PUSHES = 2000  # most rounds of pushing apart
PATIENCE = 150  # rounds in which the worst overlap must shrink; else the worst discs are thrown anew
DENSEST = 0.78  # part of the free area that discs can cover; denser random packings of discs jam
MARGIN = 1e-3  # radii are enlarged by this much while discs are pushed apart, so that it ends


@dataclass
class Taken:
    """What is in the way: walls (m, 2, 2) and discs placed already."""

    walls: np.ndarray
    position: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    radius: np.ndarray = field(default_factory=lambda: np.empty(0))

    def add(self, position: np.ndarray, radius: np.ndarray) -> None:
        """Adds discs, position (n, 2) and radius (n,)."""
        self.position = np.concatenate([self.position, position])
        self.radius = np.concatenate([self.radius, radius])

    def free(self, position: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """Returns (n,) bool: which discs would touch neither a wall nor a disc here."""
        clear = np.ones(len(position), bool)
        disc, wall = near_walls(position, self.walls, radius.max(initial=0.0))
        clear[disc[off_walls(position[disc], self.walls[wall])[0] < radius[disc]]] = False
        first, second = close_pairs(position, self.position, radius.max(initial=0.0) + self.radius.max(initial=0.0))
        clear[first[_overlap(position, radius, self.position, self.radius, first, second) > 0]] = False
        return clear


def scatter(radius: np.ndarray, boxes: np.ndarray, taken: Taken, rng: np.random.Generator) -> np.ndarray | None:
    """Finds places for discs.

    Args:
        radius: (n,) m.
        boxes: (n, 4) x0, y0, x1, y1 m, which each disc lies in as a whole.
        taken: what it must not overlap.

    Returns:
        (n, 2) m, or None if they do not fit.
    """
    order = np.argsort(-radius, kind="stable")  # the large ones first, while there is room
    sizes = radius[order]
    low, high = boxes[order, :2] + sizes[:, None], boxes[order, 2:] - sizes[:, None]
    if (low > high).any():
        return None
    places = rng.uniform(low, high)
    waiting = np.arange(len(sizes))
    there = Taken(taken.walls, taken.position, taken.radius)
    for _ in range(ROUNDS):
        hit = _hits(places[waiting], sizes[waiting], there)
        there.add(places[waiting[hit]], sizes[waiting[hit]])
        waiting = waiting[~hit]
        if not len(waiting):
            break
        places[waiting] = rng.uniform(low[waiting], high[waiting])
    if len(waiting) and not _push_apart(places, sizes, low, high, taken, rng):
        return None
    found = np.empty_like(places)
    found[order] = places
    return found


def _hits(position: np.ndarray, radius: np.ndarray, there: Taken) -> np.ndarray:
    """Which of these darts land on free ground and touch no earlier dart of the same throw that does."""
    hit = there.free(position, radius)
    landed = np.flatnonzero(hit)
    first, second = close_pairs(position[landed], position[landed], 2 * radius.max())
    first, second = landed[first], landed[second]
    touching = (first < second) & (_overlap(position, radius, position, radius, first, second) > 0)
    hit[second[touching]] = False
    return hit


def _push_apart(places: np.ndarray, radius: np.ndarray, low: np.ndarray, high: np.ndarray, taken: Taken, rng: np.random.Generator) -> bool:
    """Moves discs, in place, until none overlaps; False if that does not come about."""
    count, skin = len(radius), 0.4 * float(radius.mean())
    position = np.concatenate([places, taken.position])
    reach = np.concatenate([radius, taken.radius])
    searched = np.full_like(position, np.inf)
    best = np.inf
    for turn in range(PUSHES):
        if not (np.abs(position - searched) < skin / 3).all():
            searched = position.copy()
            first, second = close_pairs(position, position, 2 * reach.max() + skin)
            near = _overlap(position, reach, position, reach, first, second) > -skin
            keep = near & (first < second) & (first < count)  # what is taken stays where it is
            pairs = first[keep], second[keep]
            walls = near_walls(position[:count], taken.walls, radius.max() + skin)
        push, worst = _push(position, reach, count, pairs)
        wall_push, wall_worst = _push_off(position[:count], radius, taken.walls, walls)
        worst = max(worst, wall_worst)
        if worst <= 0:
            places[:] = position[:count]
            return True
        if turn % PATIENCE == PATIENCE - 1:
            if worst > 0.8 * best:  # something is wedged in that does not get out by itself
                stuck = _stuck(position, reach, count, pairs, taken)
                position[:count][stuck] = rng.uniform(low[stuck], high[stuck])
                continue
            best = worst
        position[:count] = np.clip(position[:count] + 0.9 * push + wall_push, low, high)
    return False


def _stuck(position: np.ndarray, radius: np.ndarray, count: int, pairs: tuple[np.ndarray, np.ndarray], taken: Taken) -> np.ndarray:
    """Which of the first `count` discs (count,) overlap the most, two dozen at most, and those that walls or taken discs hold."""
    stuck = ~taken.free(position[:count], 0.99 * radius[:count])
    depth = _overlap(position, radius, position, radius, *pairs)
    worst = pairs[1][np.argsort(-depth, kind="stable")[:24]]
    stuck[worst[worst < count]] = True
    return stuck


def _push(position: np.ndarray, radius: np.ndarray, count: int, pairs: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, float]:
    """How far the first `count` discs should move out of each other, (count, 2), and the worst overlap there is [m]."""
    first, second = pairs
    offset = position[second] - position[first]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    contact = radius[first] + radius[second]
    share = np.where(second < count, 0.5, 1.0)
    size = share * np.maximum(contact * (1 + MARGIN) - distance, 0.0)
    step = size[:, None] * np.where(distance[:, None] > 0, offset / np.maximum(distance, 1e-300)[:, None], [1.0, 0.0])
    moves = [np.bincount(second, axis, len(radius)) - np.bincount(first, axis, len(radius)) for axis in step.T]
    return np.stack(moves, axis=1)[:count], float((contact - distance).max(initial=0.0))


def _push_off(
    position: np.ndarray, radius: np.ndarray, walls: np.ndarray, pairs: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, float]:
    """Pushes discs that overlap walls off them."""
    disc, wall = pairs
    distance, away = off_walls(position[disc], walls[wall])
    size = np.maximum(radius[disc] * (1 + MARGIN) - distance, 0.0)
    moves = [np.bincount(disc, size * axis, len(radius)) for axis in away.T]
    return np.stack(moves, axis=1), float((radius[disc] - distance).max(initial=0.0))


def _overlap(
    position: np.ndarray, radius: np.ndarray, others: np.ndarray, reach: np.ndarray, first: np.ndarray, second: np.ndarray
) -> np.ndarray:
    """Overlap [m] of position[first] with others[second], > 0 where they do."""
    offset = position[first] - others[second]
    return radius[first] + reach[second] - np.hypot(offset[:, 0], offset[:, 1])
