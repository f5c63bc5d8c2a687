"""[[sources]]: grains made while the simulation runs, between launches, wherever there is room for them in the region of the source."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_sand.scene.nearby import segments
from taichi_sand.scene.packing import Pack
from taichi_sand.scene.scatter import Taken
from taichi_sand.scene.shapes import inertia, mass
from taichi_sand.world import census
from taichi_sand.world.flags import SOURCE_FULL, raise_flag
from taichi_sand.world.tables import World
from taichi_sand.world.wall_scene import standing_walls

INTERVAL = 1 / 60
"""Simulated time between two looks at what is due [s]."""
DARTS = 8
"""Places tried for a grain that is due."""


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


def pour(scene: Any, world: World, first_id: int, time: float) -> int:
    """Makes the grains that are due at `time` [s]; those that find no room stay due. Returns how many it made."""
    count = 0
    for index, source in enumerate(scene.sources):
        end = time if source.until is None else min(time, source.until)
        made = world.flow.made[index]
        due = math.floor(source.rate * end + 1e-6) - made
        if due <= 0:
            continue
        room = census.room(world)
        if room <= 0:
            raise_flag(world, SOURCE_FULL, index)
            continue
        rng = np.random.default_rng([scene.seed, index, world.pace[None].done])  # a resumed run draws the same
        grains = grains_of(scene, index, *draw(scene, world, source, min(due, room), rng))
        if len(grains["radius"]):
            census.add(world, grains, first_id + count)
            count += len(grains["radius"])
            world.flow.made[index] = made + len(grains["radius"])
    return count


def draw(scene: Any, world: World, source: Any, due: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n, 2), radii (n,) of discs [m] and angles (n,) for at most `due` grains that overlap nothing."""
    tries = DARTS * due
    radius = rng.uniform(*source.radius, tries)
    angle = rng.uniform(-np.pi, np.pi, tries) if source.angle == "random" else np.full(tries, float(source.angle))
    reach = scene.form(source.shape).reach * radius
    low, high = np.array(source.region[:2]) + reach[:, None], np.array(source.region[2:]) - reach[:, None]
    position = low + rng.uniform(0, 1, (tries, 2)) * (high - low)
    places, _ = census.places(world)
    widest = reach.max(initial=0.0)
    near = ((places[:, :2] > low.min(0) - widest - places[:, 2:3]) & (places[:, :2] < high.max(0) + widest + places[:, 2:3])).all(axis=1)
    taken = Taken(segments(standing_walls(world, scene)), places[near, :2], places[near, 2])
    chosen: list[int] = []
    for k in np.flatnonzero(taken.free(position, reach)):
        others = position[chosen]
        if (np.hypot(*(others - position[k]).T) >= reach[chosen] + reach[k]).all():
            chosen.append(int(k))
        if len(chosen) == due:
            break
    return position[chosen], radius[chosen], angle[chosen]
