"""Room in the tables: as much as what a list build finds is likely to need, and more when it finds more; and slots for grains.

A list build that runs out of rows goes on counting, and writes nothing beyond the end. The march then stops before anything has moved; the
simulation takes larger tables, to which all that there is is copied, and only the listing is made again (growing.Growing). So a contact
is never missed, and what pairs carry is kept.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.world.tables import LEAST_ROOM, PAIRS_PER_GRAIN, SPARE, STRIPS, WALL_PAIRS_PER_GRAIN, round_up

PAIRS, WALLS, BOULDERS, BOULDER_WALLS, ENTRIES = range(5)
KINDS = 5
NEAR = (4.0, 12.0)
"""Discs that are near a line of length L: 4 L / d + 12, of those two diameters or less away."""


class Rooms(NamedTuple):
    """How much room tables have, by what may be lacking."""

    rows: int = 0  # for pairs of grains, a grain
    walls: int = 0  # for pairs with walls, a grain
    boulders: int = 0  # for pairs of boulders, in all
    boulder_walls: int = 0  # for their pairs with walls, in all
    entries: int = 0  # of walls that move, in all
    grains: int = 0  # slots for grains, the last of which stays empty

    def larger(self, lacks: np.ndarray) -> "Rooms":
        """Room for what was found: `lacks` (KINDS,) says how many times as much it was."""
        found = (room if lack <= 1 else room * round_up(int(np.ceil(lack)), 2) for room, lack in zip(self[:KINDS], lacks, strict=True))
        return Rooms(*found, self.grains)

    def joined(self, other: "Rooms") -> "Rooms":
        """The larger of both, kind by kind."""
        return Rooms(*map(max, self, other))


NO_ROOMS = Rooms()


class Sizes(NamedTuple):
    """How the rows of a neighbour list are shared out."""

    wall_base: int  # row within a half where pairs with walls begin
    wall_half: int  # rows of one half of the wall-only columns
    boulders: int
    boulder_walls: int
    capacity: int  # slots for grains

    @property
    def half(self) -> int:
        """Rows of one half."""
        return self.wall_base + self.wall_half

    def moved(self, rows: np.ndarray, to: "Sizes") -> np.ndarray:
        """Where these rows are in a table of other sizes."""
        part, row = np.divmod(rows, self.half)
        new = np.where(row >= self.wall_base - self.boulders, row + to.wall_base - self.wall_base, row)
        new = np.where((row >= self.wall_base - self.boulders) & (row < self.wall_base), new + self.boulders - to.boulders, new)
        new = np.where(row >= self.half - self.boulder_walls, row - self.half + self.boulder_walls + to.half - to.boulder_walls, new)
        return part * to.half + new

    def moved_walls(self, rows: np.ndarray, to: "Sizes") -> np.ndarray:
        """Rows of the wall-only columns, (n,), where they are in tables of size `to`."""
        part, row = np.divmod(rows, self.wall_half)
        last = self.wall_half - self.boulder_walls
        return part * to.wall_half + np.where(row >= last, row - last + to.wall_half - to.boulder_walls, row)

    def moved_slots(self, rows: np.ndarray, to: "Sizes") -> np.ndarray:
        """Rows of the columns that say where the pairs of a slot begin, in two halves, where they are in tables of size `to`."""
        part, slot = np.divmod(rows, self.capacity)
        return part * to.capacity + slot


def sizes_of(rooms: Rooms, capacity: int, blocks: int) -> Sizes:
    """Sizes of a neighbour list for so many grains, and blocks of the sweep."""
    shares = capacity + SPARE * min(blocks, STRIPS)
    base, walls = rooms.rows * shares + rooms.boulders, rooms.walls * shares + rooms.boulder_walls
    return Sizes(base, walls, rooms.boulders, rooms.boulder_walls, capacity)


def foreseen(
    parts: list[Any], diameter: float, grains: int, discs: int, shares: int, boulders: tuple[int, int], entries: int, least: Rooms
) -> Rooms:
    """Rooms for `grains` of mean diameter `diameter` [m] and up to so many `discs` among the `parts` of walls, shared out among `shares`
    grains; of boulders the number, and rows for their pairs; for `entries` of walls that move. No room is smaller than in `least`.
    """
    near = sum(min(grains, NEAR[0] * part.length / diameter + NEAR[1]) for part in parts if part.side != 1)
    walls = WALL_PAIRS_PER_GRAIN * discs * round_up(int(np.ceil(discs * near / (WALL_PAIRS_PER_GRAIN * discs * shares))), 1)
    boulder_walls = round_up(boulders[0] * discs * len(parts)) if boulders[0] else 0
    return Rooms(PAIRS_PER_GRAIN * discs, walls, boulders[1], min(boulder_walls, LEAST_ROOM), entries).joined(least)


@ti.func
def lack(w: ti.template(), kind: ti.template(), need, room):
    """A list build needs `need` rows where there is room for `room`."""
    ti.atomic_max(w.lacks[kind], ti.cast(need, w.real) / ti.max(room, 1))
    w.pace[None].lacking = 1
