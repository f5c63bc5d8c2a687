"""[[sources]]: grains made while the simulation runs, between launches, wherever there is room for them in the region of the source.

Which grain is the n-th of a source is decided before there is room for it, and it is made before the one after it: so what has been made
has the sizes that were asked for. Grains that are due and have no room yet are counted, as late.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_sand.scene.nearby import segments
from taichi_sand.scene.packing import Pack
from taichi_sand.scene.room import Room
from taichi_sand.scene.shapes import inertia, mass
from taichi_sand.world import census
from taichi_sand.world.flags import SOURCE_FULL, raise_flag
from taichi_sand.world.tables import World
from taichi_sand.world.wall_scene import standing_walls

INTERVAL = 1 / 60
"""Simulated time between two looks at what is due [s]."""
LATE, FEWEST_LATE = 0.1, 2
"""A source is late when more than this share of what was due, and more than so many grains, still wait."""
GOLDEN = (math.sqrt(5) - 1) / 2


def room_for(scene: Any) -> int:
    """Grains that the sources of `scene` make within its duration."""
    return sum(math.ceil(source.rate * min(scene.duration, math.inf if source.until is None else source.until)) for source in scene.sources)


def grains_of(scene: Any, index: int, position: np.ndarray, radius: np.ndarray, angle: np.ndarray) -> dict[str, np.ndarray]:
    """Grains of source `index` as census.add takes them: at `position` (n, 2), `radius` (n,) [m] of their discs, `angle` (n,)."""
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
        grains = grains_of(scene, index, np.tile(middle, (2, 1)), np.array(source.radius), np.zeros(2))
        grains |= {"fixed": np.zeros(2, bool), "body": np.full(2, -1, np.int32)}
        pack = replace(pack, **{name: np.concatenate([getattr(pack, name), values]) for name, values in grains.items()})
    return pack


def steps_between(step: float) -> int:
    """Steps of `step` [s] between two looks at what is due."""
    return max(1, math.floor(INTERVAL / step))


def due(source: Any, time: float) -> int:
    """Grains that a source has been asked for until `time` [s]."""
    return math.floor(source.rate * (time if source.until is None else min(time, source.until)) + 1e-6)


def waiting(scene: Any, world: World, time: float) -> list[int]:
    """Grains of each source that are late at `time` [s], as they have found no room."""
    return [due(source, time) - int(world.flow.made[index]) for index, source in enumerate(scene.sources)]


def late(scene: Any, world: World, time: float) -> list[str]:
    """A sentence for each source that is more than LATE behind."""
    found = []
    for index, number in enumerate(waiting(scene, world, time)):
        asked = due(scene.sources[index], time)
        if number > max(LATE * asked, FEWEST_LATE):
            found.append(
                f"sources[{index}] has made {asked - number} of the {asked} grains that were due: {number} wait for room in its region, "
                "as each comes after the one before it. A larger region, a lower rate, or a velocity that carries them off helps."
            )
    return found


def draw(scene: Any, index: int, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Radii of discs [m] and angles of the grains `first`, first + 1, … (count,) of source `index`: always the same, whoever asks when.

    They are spread evenly, by the golden ratio and the root of two from a random start: of any so many in a row, mean and quartiles are
    those of the distribution to about one grain.
    """
    source = scene.sources[index]
    start = np.random.default_rng([scene.seed, index]).uniform(0, 1, 2)
    size, turn = (start[:, None] + np.array([GOLDEN, math.sqrt(2)])[:, None] * np.arange(first, first + count)) % 1.0
    low, high = source.radius
    angle = np.pi * (2 * turn - 1) if source.angle == "random" else np.full(count, float(source.angle))
    return low + (high - low) * size, angle


def pour(scene: Any, world: World, first_id: int, time: float) -> int:
    """Makes the grains that are due at `time` [s], in their order: where one finds no room, it and those after it stay due. So what has
    been made has the sizes that were asked for, also where small grains would find more room. Returns how many it made.
    """
    count = 0
    there = places_of(world) if any(number > 0 for number in waiting(scene, world, time)) else None
    for index, number in enumerate(waiting(scene, world, time)):
        if number <= 0 or there is None:
            continue
        room = census.room(world)
        if room <= 0:
            raise_flag(world, SOURCE_FULL, index)
            continue
        made = int(world.flow.made[index])
        radius, angle = draw(scene, index, made, min(number, room))
        reach = scene.form(scene.sources[index].shape).reach * radius
        position = settle(scene, world, index, reach, *there)
        if len(position):
            found = len(position)
            census.add(world, grains_of(scene, index, position, radius[:found], angle[:found]), first_id + count)
            count += found
            world.flow.made[index] = made + found
            there = np.concatenate([there[0], position]), np.concatenate([there[1], reach[:found]])
    return count


def places_of(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 2) and radii (n,) of the grains there are [m], with the images that a periodic box has of them."""
    numbers, _ = census.places(world)
    position, radius = numbers[:, :2], numbers[:, 2]
    for shift in images(world):
        position, radius = np.concatenate([position, numbers[:, :2] + shift]), np.concatenate([radius, numbers[:, 2]])
    return position, radius


def images(world: World) -> list[np.ndarray]:
    """Ways to the neighbours of a periodic box [m], without itself."""
    size = world.box[None].size
    steps = [(-size[k], 0.0, size[k]) if world.periodic[k] else (0.0,) for k in (0, 1)]
    return [np.array([x, y]) for x in steps[0] for y in steps[1] if x or y]


def settle(scene: Any, world: World, index: int, reach: np.ndarray, position: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Places (n, 2) for as many of the grains of these radii `reach` of source `index` as find room one after the other [m]."""
    rng = np.random.default_rng([scene.seed, index, world.pace[None].done])  # a resumed run draws the same
    corners = standing_walls(world, scene)
    walls = segments([line + shift for line in corners for shift in (np.zeros(2), *images(world))])
    source = scene.sources[index]
    room = Room(source.region, scene.form(source.shape).reach * source.radius[1], walls, position, radius, rng)
    found: list[np.ndarray] = []
    for size in reach:
        place = room.find(size)
        if place is None:
            break
        room.add(place, size)
        found.append(place)
    return np.array(found).reshape(-1, 2)
