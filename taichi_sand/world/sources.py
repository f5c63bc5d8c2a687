"""[[sources]]: grains made while the simulation runs, between launches, wherever there is room for them in the region of the source.

Which grain is the n-th of a source is decided before there is room for it, and it is made before the one after it: so what has been made
has the sizes that were asked for. Grains that are due and have no room yet are counted, as late.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from taichi_sand.scene.grains import Pack
from taichi_sand.scene.room import Room
from taichi_sand.scene.shapes import inertia, mass
from taichi_sand.scene.sizes import limits, spread
from taichi_sand.world import edit
from taichi_sand.world.flags import SOURCE_FULL, raise_flag
from taichi_sand.world.tables import World, steps_within
from taichi_sand.world.walls.build import wall_segments

INTERVAL = 1 / 60
"""Simulated time between two looks at what is due [s]."""
LATE, FEWEST_LATE = 0.1, 2
"""A source is late when more than this share of what was due, and more than so many grains, still wait."""
GOLDEN = (math.sqrt(5) - 1) / 2
DIGITS = 10
"""Two to that is the most grains in a row that are spread evenly; the means of so many are the same to five digits."""
CHUNK = 256
"""Grains whose sizes are drawn at once."""


class Flow(NamedTuple):
    """Since when a source has been making grains."""

    since: float | None  # [s]; None: it makes none
    before: int  # grains that it was asked for until then


def room_for(scene: Any) -> int:
    """Grains that the sources of `scene` make within its duration."""
    return sum(math.ceil(source.rate * min(scene.duration, math.inf if source.until is None else source.until)) for source in scene.sources)


def grains_of(scene: Any, index: int, position: np.ndarray, radius: np.ndarray, angle: np.ndarray) -> dict[str, np.ndarray]:
    """Grains of source `index` as edit.add takes them: at `position` (n, 2), `radius` (n,) [m] of their discs, `angle` (n,)."""
    source, count = scene.sources[index], len(radius)
    form = scene.form(source.shape)
    reach = form.reach * radius
    return {
        "position": position,
        "velocity": np.tile(np.array(source.velocity, float), (count, 1)),
        "angle": angle,
        "spin": np.zeros(count),
        "radius": reach,
        "mass": mass(form, reach, source.density),
        "inertia": inertia(form, reach, source.density),
        "kind": np.full(count, len(scene.grains) + index, np.int32),
    }


def foreseen(scene: Any, pack: Pack) -> Pack:
    """`pack` and of each source a smallest and a largest grain: what tables, stiffness and step are to be made for."""
    for index, source in enumerate(scene.sources):
        middle = np.reshape(source.region, (2, 2)).mean(0)
        grains = grains_of(scene, index, np.tile(middle, (2, 1)), np.array(limits(source.radius)), np.zeros(2))
        grains |= {"fixed": np.zeros(2, bool), "body": np.full(2, -1, np.int32)}
        pack = replace(pack, **{name: np.concatenate([getattr(pack, name), values]) for name, values in grains.items()})
    return pack


def steps_between(step: float) -> int:
    """Steps of `step` [s] between two looks at what is due."""
    return steps_within(INTERVAL, step)


def due(source: Any, flow: Flow, time: float) -> int:
    """Grains that a source has been asked for until `time` [s]."""
    if flow.since is None:
        return flow.before
    seconds = (time if source.until is None else min(time, source.until)) - flow.since
    return flow.before + math.floor(source.rate * max(0.0, seconds) + 1e-6)


def waiting(scene: Any, world: World, flows: Sequence[Flow], time: float) -> list[int]:
    """Grains of each source, which makes them as `flows` say, that are late at `time` [s], as they have found no room."""
    asked = [due(source, flow, time) for source, flow in zip(scene.sources, flows, strict=True)]
    return [number - int(world.flow.made[index]) for index, number in enumerate(asked)]


def late(scene: Any, world: World, flows: Sequence[Flow], time: float) -> list[str]:
    """A sentence for each source that is more than LATE behind."""
    found = []
    for index, number in enumerate(waiting(scene, world, flows, time)):
        asked = due(scene.sources[index], flows[index], time)
        if number > max(LATE * asked, FEWEST_LATE):
            found.append(
                f"sources[{index}] has made {asked - number} of the {asked} grains that were due: {number} wait for room in its region, "
                "as each comes after the one before it. A larger region, a lower rate, or a velocity that carries them off helps."
            )
    return found


def evenly(numbers: np.ndarray, seed: int) -> np.ndarray:
    """The members `numbers` (n,) of a sequence from 0 … 1 that is random but fills it evenly: of its first n, any half or quarter has its
    share to about one, and their mean is off by less than one over n.

    Of every two in a row one is in the lower half, of every four one in each quarter, and so on: van der Corput's sequence of base 2 with
    digits that are flipped at random, as Owen (1995) does, but anew for each such two, four, …, so that they come in no order.
    """
    digits = np.zeros(len(numbers), np.int64)  # so far, as a whole number
    for level in range(DIGITS):
        block = numbers >> (level + 1)
        flips = mixed(((block << level) + digits).astype(np.uint64) + np.uint64(level << 58), seed) & np.uint64(1)
        digits = 2 * digits + ((numbers >> level & 1) ^ flips.astype(np.int64))
    rest = (mixed(numbers.astype(np.uint64) + np.uint64(DIGITS << 58), seed) >> np.uint64(11)) * 0.5**53
    return (digits + rest) * 0.5**DIGITS


def mixed(x: np.ndarray, seed: int) -> np.ndarray:
    """64 random bits that belong to those of `x`, uint64, and a seed (Steele, Lea & Flood 2014: splitmix64, twice)."""
    for start in (np.uint64(seed), np.uint64(0)):
        x = x + start + np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        x = x ^ (x >> np.uint64(31))
    return x


def draw(scene: Any, index: int, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Radii of discs [m] and angles of the grains `first`, first + 1, … (count,) of source `index`: always the same, whoever asks when.

    The radii follow one another `evenly`, the angles by the golden ratio.
    """
    source, numbers = scene.sources[index], np.arange(first, first + count)
    rng = np.random.default_rng([scene.seed, index])
    size, turn = evenly(numbers, int(rng.integers(2**62))), (rng.uniform() + GOLDEN * numbers) % 1.0
    angle = np.pi * (2 * turn - 1) if source.angle == "random" else np.full(count, float(source.angle))
    return spread(source.radius, size), angle


def pour(scene: Any, world: World, flows: Sequence[Flow], first_id: int, time: float) -> int:
    """Makes the grains that are due at `time` [s], in their order: where one finds no room, it and those after it stay due. So what has
    been made has the sizes that were asked for, also where small grains would find more room. Returns how many it made.
    """
    count = 0
    late_ones = waiting(scene, world, flows, time)
    there = places_of(world) if any(number > 0 for number in late_ones) else None
    for index, number in enumerate(late_ones):
        if number <= 0 or there is None:
            continue
        room = edit.room(world)
        if room <= 0:
            raise_flag(world, SOURCE_FULL, index)
            continue
        grains = settle(scene, world, index, min(number, room), *there)
        if found := len(grains["radius"]):
            edit.add(world, grains, first_id + count)
            count += found
            world.flow.made[index] += found
            there = np.concatenate([there[0], grains["position"]]), np.concatenate([there[1], grains["radius"]])
    return count


def places_of(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 2) and radii (n,) of the grains there are [m], with the images that a periodic box has of them."""
    numbers, _ = edit.places(world)
    position, radius = numbers[:, :2], numbers[:, 2]
    for shift in images(world):
        position, radius = np.concatenate([position, numbers[:, :2] + shift]), np.concatenate([radius, numbers[:, 2]])
    return position, radius


def images(world: World) -> list[np.ndarray]:
    """Ways to the neighbours of a periodic box [m], without itself."""
    size = world.box[None].size
    steps = [(-size[k], 0.0, size[k]) if world.periodic[k] else (0.0,) for k in (0, 1)]
    return [np.array([x, y]) for x in steps[0] for y in steps[1] if x or y]


def settle(scene: Any, world: World, index: int, most: int, position: np.ndarray, radius: np.ndarray) -> dict[str, np.ndarray]:
    """As many of the next `most` grains of source `index` as find room one after the other among those at `position` (n, 2), of `radius`
    (n,) [m], as edit.add takes them.
    """
    rng = np.random.default_rng([scene.seed, index, world.pace[None].done])  # a resumed run draws the same
    walls = wall_segments(world, scene)
    source, made = scene.sources[index], int(world.flow.made[index])
    reach = scene.form(source.shape).reach
    room = Room(source.region, reach * limits(source.radius)[1], walls, position, radius, rng)
    places, sizes, angles = [], [], []
    for k in range(most):
        if k % CHUNK == 0:
            drawn = draw(scene, index, made + k, min(CHUNK, most - k))
        size, angle = drawn[0][k % CHUNK], drawn[1][k % CHUNK]
        place = room.find(reach * size)
        if place is None:
            break
        room.add(place, reach * size)
        places.append(place)
        sizes.append(size)
        angles.append(angle)
    return grains_of(scene, index, np.array(places).reshape(-1, 2), np.array(sizes), np.array(angles))
