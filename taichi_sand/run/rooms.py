"""How much room the tables of a scene can take at most: what a checkpoint or a recording announces is held against it."""

import math
from collections.abc import Mapping

from taichi_sand.scene.packing import most_grains
from taichi_sand.scene.schema import MOST_GRAINS, Scene
from taichi_sand.scene.sizes import limits
from taichi_sand.world.search.growth import Rooms
from taichi_sand.world.search.large_grains import MOST_BOULDERS
from taichi_sand.world.sources import room_for
from taichi_sand.world.tables import PAIRS_PER_GRAIN, SPARE, STRIPS, round_up

ROWS, NUMBERS = 66, 64
"""Rows of the neighbour list a disc of a grain, and numbers a row, are never more."""
FIXED = 8 * 2**20
"""Numbers that the smallest scene may have: what there is room for besides grains, such as walls and lattice sites."""
GRAINS = ".0.grains.id"
MOST_SLOTS = round_up(MOST_GRAINS + 1)
MOST_WALLS, MOST_ENTRIES = 4096, 2**22
"""A disc never meets more parts of walls at a time; and so many entries of walls that move are enough for a hundred thousand grains."""


LEAST_BY_HAND = 1000
"""Room for grains that a user adds by hand."""


def by_hand(scene: Scene) -> int:
    """Room for grains that a user may add by hand to those of a scene, at most."""
    return max(LEAST_BY_HAND, math.ceil(most_grains(scene)))


def crowded(rooms: Rooms, discs: int, most: float) -> bool:
    """Whether tables have grown beyond what so many grains, of so many discs at most, can need: all of them in one place."""
    pairs = 2 * discs * (PAIRS_PER_GRAIN + discs * most)
    highest = (pairs, MOST_WALLS * discs, max(1, MOST_BOULDERS) * 16 * pairs, MOST_BOULDERS * MOST_WALLS * discs, MOST_ENTRIES, MOST_SLOTS)
    return any(
        not isinstance(rows, int) or isinstance(rows, bool) or not 0 <= rows <= top for rows, top in zip(rooms, highest, strict=True)
    )


def misfit(scene: Scene, room: object, grown: Rooms, shapes: Mapping[str, tuple[int, ...]]) -> str:
    """What is wrong with tables of these shapes for a scene with room for so many grains more, and rows grown to `grown`, or ""."""
    most = most_grains(scene)
    rows = shapes[GRAINS][0]
    if not isinstance(room, int) or isinstance(room, bool) or not 0 <= room <= rows:
        return f"room for {room} grains more is announced, in a table of {rows}"
    if rows != grown.grains or room_for(scene) > rows:
        return f"{rows} grains are announced, in tables that have room for {grown.grains}"
    radii = [radius for table in (*scene.grains, *scene.sources) for radius in (limits(table.radius) if table.radius else ())]
    radii += [row[2] for table in scene.grains for row in table.positions or () if len(row) > 2]
    around = 16 * (max(radii, default=1.0) / min(radii, default=1.0) + 8) + MOST_BOULDERS
    discs = max([1, *(len(scene.discs(table.shape)) for table in (*scene.grains, *scene.sources))])
    if crowded(grown, discs, rows):
        return f"room for {grown} pairs is announced, more than grains can have"
    numbers = FIXED + discs * NUMBERS * (ROWS * rows + min(MOST_BOULDERS, most // 16) * around)
    numbers += 3 * NUMBERS * ((grown.rows + grown.walls) * (rows + SPARE * STRIPS) + grown.boulders + grown.boulder_walls + grown.entries)
    if sum(map(math.prod, shapes.values())) > numbers:
        return f"tables of {sum(map(math.prod, shapes.values()))} numbers are announced, for a scene that can have {numbers:.0f}"
    return ""
