"""The table of walls: their straight lines and ends (world.walls.joints), listed for every lattice site they can be felt from."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.taichi_support import field_pool
from taichi_sand.world.tables import LEAST_ROOM, round_up, write_rows
from taichi_sand.world.walls.joints import FAR, Part

SAME = 1e-5
"""Parts that lie nowhere farther from one another than this, in diameters of the smallest grain, are one after a change."""
ENTRIES_PER_PART = 8
"""Fewest lattice sites that a part is felt from, about."""


class Walls(NamedTuple):
    """Parts near each lattice site, in the coordinates of the site (its centre is the origin)."""

    start: Any  # of site sx * sites_y + sy: first row of its entries; shape (more than sites,)
    part: Any  # number of the part, i32
    point: Any  # a point of the line, or the end itself [m]
    along: Any  # direction of the line; of an end the first direction that leads off
    bounds: Any  # line: from where to where it runs, from `point` [m]; end: second direction that leads off
    slopes: Any  # line: by how much its bounds shift for every metre to its left
    side: Any  # 1 = grains are always on its left (an edge of the box), 0 = a line with two sides, -1 = an end
    friction: Any  # its own coefficient, < 0 = none: shape (parts,), or None if no wall has one
    rough: bool  # whether a wall has one
    surface: Any  # velocity of its surface as it stands, 2-vector [m/s]: shape (parts,), or None if no wall is a belt
    belts: bool  # whether one is
    material: Any  # number of its material, i32: shape (parts,), or None if the scene has none
    room: int  # entries of still walls that there may be; behind them are those of walls that move


COLUMNS = ("start", "part", "side", "point", "along", "bounds", "slopes")
"""Of the table, as `cast_parts` gives them."""


def edge_parts(size: tuple[float, float], walled: Sequence[bool], material: int, speeds: Sequence[float]) -> list[Part]:
    """The edges of the box that are walls, in the order left, right, bottom, top; `along` has the inside on its left. Their surfaces move
    at these speeds [m/s], upwards and to the right.
    """
    w, h = size
    corners = [((0, 0), (0, -1)), ((w, 0), (0, 1)), ((0, 0), (1, 0)), ((0, h), (-1, 0))]
    endless = np.array([-FAR, FAR])
    return [
        Part(np.array(point, float), np.array(along, float), endless, 1, -1.0, tuple(speed * np.abs(along)), material=material)
        for (point, along), wall, speed in zip(corners, walled, speeds, strict=True)
        if wall
    ]


def near_sites(
    part: Part, spacing: np.ndarray, sites: tuple[int, int], reach: float, wraps: tuple[bool, bool]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sites from which `part` can be felt: their x and y numbers, and the part's point as seen from each centre, (n, 2) [m].

    For a line that is its foot point, or the point of its carrier nearest to the centre, so that it is small and exact. In periodic
    directions sites beyond the edge stand for those that they are images of.
    """
    ends = part.point[None] if part.side == -1 else part.point + np.clip(part.bounds, -1e6, 1e6)[:, None] * part.along
    span = np.vstack([ends.min(0), ends.max(0)]) / spacing
    pad = reach / spacing + 1
    low, high = np.floor(span[0] - pad).astype(int), np.floor(span[1] + pad).astype(int)
    turns = np.array(wraps) & (part.side != 1)  # an edge of the box, which has no end, is seen once from everywhere
    low, high = (np.where(turns, limit, np.clip(limit, 0, np.array(sites) - 1)) for limit in (low, high))
    x, y = (a.ravel() for a in np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)), indexing="ij"))
    centre = np.stack([x + 0.5, y + 0.5], axis=1) * spacing
    gone = np.zeros(len(x)) if part.side == -1 else (centre - part.point) @ part.along
    nearest = part.point + np.clip(gone, *part.bounds)[:, None] * part.along if part.side != -1 else part.point
    distance = np.hypot(*(nearest - centre).T)
    felt = distance <= reach + 0.5 * np.hypot(*spacing)
    carrier = part.point + gone[:, None] * part.along - centre
    return np.stack([x % sites[0], y % sites[1]], 1)[felt], carrier[felt], gone[felt]


def cast_parts(
    parts: list[Part], spacing: tuple[float, float], sites: tuple[int, int], reach: float, wraps: tuple[bool, bool]
) -> list[np.ndarray]:
    """The entries of the parts that stand still, by lattice site, as COLUMNS: the start of each site, and what else an entry has."""
    columns: list[list[np.ndarray]] = [[] for _ in range(7)]
    step = np.array(spacing)
    for number, part in enumerate(parts):
        if part.mover >= 0:
            continue
        site, seen, gone = near_sites(part, step, sites, reach, wraps)
        rows = len(site)
        bounds = np.tile(part.bounds, (rows, 1)) - (gone[:, None] if part.side != -1 else 0.0)
        whole = [site[:, 0] * sites[1] + site[:, 1], np.full(rows, number), np.full(rows, part.side)]
        same = [np.tile(part.along, (rows, 1)), bounds, np.tile(part.slopes, (rows, 1))]
        for column, values in zip(columns, [*whole, seen, *same], strict=True):
            column.append(values)
    empty = [np.zeros((0, 2) if k > 2 else 0) for k in range(7)]
    site, *entries = (np.concatenate(c) if c else none for c, none in zip(columns, empty, strict=True))
    order = np.argsort(site, kind="stable")
    start = np.searchsorted(site[order], np.arange(sites[0] * sites[1] + 1))
    return [start, *(values[order] for values in entries)]


def moving_entries(parts: list[Part], spacing: tuple[float, float], reach: float) -> int:
    """How many lattice sites the moving parts can be felt from, about: those in the rounded strips around them."""
    wide = reach + np.hypot(*spacing)
    lengths = [part.length for part in parts if part.mover >= 0]
    return round_up(int(sum(2 * wide * length + np.pi * wide**2 for length in lengths) / np.prod(spacing)), LEAST_ROOM) if lengths else 0


def build_walls(parts: list[Part], entries: list[np.ndarray], real: Any, room: int, moving: int, mixed: bool) -> Walls:
    """Wall table with room for at least `room` entries of parts that stand still, and for `moving` of those that move; with materials if
    they are `mixed`.
    """
    room = round_up(max(room, len(entries[1])), LEAST_ROOM)
    rows, sites = room + moving, round_up(len(entries[0]) + 1, LEAST_ROOM)
    rough, belts = any(part.friction >= 0 for part in parts), any(any(part.surface) for part in parts)
    table = Walls(
        start=field_pool.scalars(ti.i32, sites),
        part=field_pool.scalars(ti.i32, rows),
        **{name: field_pool.vectors(2, real, rows) for name in ("point", "along", "bounds", "slopes")},
        side=field_pool.scalars(ti.i32, rows),
        friction=field_pool.scalars(real, part_room(room, parts)) if rough else None,
        rough=rough,
        surface=field_pool.vectors(2, real, part_room(room, parts)) if belts else None,
        belts=belts,
        material=field_pool.scalars(ti.i32, part_room(room, parts)) if mixed else None,
        room=room,
    )
    write_walls(table, parts, entries)
    return table


def part_room(room: int, parts: list[Part]) -> int:
    """Room for parts in a table with room for so many entries."""
    return round_up(max(room // ENTRIES_PER_PART, len(parts)))


def fits(table: Walls, parts: list[Part], entries: list[np.ndarray]) -> bool:
    """Whether there is room for these parts and entries in the table."""
    rough, belts = any(part.friction >= 0 for part in parts), any(any(part.surface) for part in parts)
    room = len(entries[1]) <= table.room and len(parts) <= part_room(table.room, [])
    return room and (table.rough or not rough) and (table.belts or not belts)


def write_walls(table: Walls, parts: list[Part], entries: list[np.ndarray]) -> None:
    """Puts parts and their entries into the table."""
    for name, values in zip(COLUMNS, entries, strict=True):
        write_rows(getattr(table, name), values)
    if table.rough:
        write_rows(table.friction, np.array([part.friction for part in parts]))
    if table.belts:
        write_rows(table.surface, np.array([part.surface for part in parts]))
    if table.material is not None:
        write_rows(table.material, np.array([part.material for part in parts]))


def renumber(before: list[Part], after: list[Part], here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Number that each part of `before` has in `after`, -1 if it is not there; shape (parts,), i32.

    What has become of a part that is none of `after` as it was, such as of a wall that sets out, stops or changes its surface, is found by
    where it lies now: `here` and `there` say that of both, (parts, 6), in diameters of the smallest grain.
    """
    places: dict[bytes, list[int]] = {}
    for number, part in enumerate(after):
        places.setdefault(part.key(), []).insert(0, number)
    found = [places.get(part.key(), []) for part in before]
    numbers = np.array([those.pop() if those else -1 for those in found], np.int32)
    left = np.setdiff1d(np.arange(len(after)), numbers)
    for number in np.flatnonzero(numbers < 0):
        same = np.flatnonzero((np.abs(there[left] - here[number]) < SAME).all(axis=1))
        if len(same):
            numbers[number] = left[same[0]]
            left = np.delete(left, same[0])
    return numbers
