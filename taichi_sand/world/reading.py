"""Reads the grains of a world, in the order in which the scene made them: of a table only the columns that are asked for."""

from functools import lru_cache
from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.taichi_support.host_access import PLAIN, members_of, plain, reader
from taichi_sand.world.tables import World

PARTS = {"velocity": (0, 2), "spin": (2, 1)}
"""Which numbers of the column `twist` these are: the first, and how many."""
Pairs = ti.types.ndarray(dtype=ti.types.vector(2, None), ndim=1)
Table = ti.types.ndarray(ndim=2)
Ranks = ti.types.ndarray(ndim=1)


def rows_of(field: Any, count: int) -> np.ndarray:
    """The first rows of a column, (count,) or (count, components): the numbers themselves where they lie in memory, not a copy."""
    kept = vars(field)
    if "read" not in kept:  # to find them takes as long as to copy 10000
        kept["read"] = reader(field)
    return kept["read"]()[:count]


@ti.kernel
def lay_places(site: Pairs, offset: Pairs, shift: Pairs, rank: Ranks, spacing: ti.types.ndarray(dtype=ti.f64, ndim=1), places: Pairs):
    """Centres of grains, by rank."""
    ti.loop_config(serialize=True)
    for i in range(rank.shape[0]):
        x = (ti.cast(site[i], ti.f64) + 0.5) * ti.Vector([spacing[0], spacing[1]])
        places[rank[i]] = x + offset[i] + shift[i]


@ti.kernel
def lay_part(column: Table, start: ti.i32, rank: Ranks, part: Table):
    """Some numbers of every row, from `start` on, by rank."""
    ti.loop_config(serialize=True)
    for i in range(rank.shape[0]):
        for k in range(part.shape[1]):
            part[rank[i], k] = column[i, start + k]


@lru_cache(maxsize=1)
def scratch(count: int) -> np.ndarray:
    """Room for the places of so many grains, the same every time: to get it from the system takes as long as to fill it."""
    return np.empty((count, 2))


def ranks(world: World) -> np.ndarray:
    """Of the grain in every slot: how many grains have a lower id, (count,)."""
    ids = rows_of(world.grains.id, world.count[None])
    if not len(ids):
        return np.zeros(0, np.int64)
    if ids.min() < 0:  # some are about to be dropped
        found = np.empty(len(ids), np.int64)
        found[np.argsort(ids, kind="stable")] = np.arange(len(ids))
        return found
    last = int(ids.max())
    if last == len(ids) - 1:
        return ids
    present = np.zeros(last + 1, np.int64)
    present[ids] = 1
    return (np.cumsum(present) - 1)[ids]


def read_columns(world: World, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Columns of the grains present, by id: those of the table by their names, `position`, `velocity`, `spin`; SI. `angle` is the present
    one. Numbers of f64, but `radius` and `mobility` as they are stored.
    """
    g, count, rank = world.grains, world.count[None], ranks(world)
    quick = count > 0 and not PLAIN and plain(members_of(g.site)[0])
    found: dict[str, np.ndarray] = {}
    for name in names:
        if quick and name == "position":
            spacing = np.array([*world.box[None].spacing], float)
            found[name] = np.empty((count, 2))
            lay_places(*(rows_of(column, count) for column in (g.site, g.offset, g.shift)), rank, spacing, found[name])
        elif quick and name in PARTS:
            start, width = PARTS[name]
            found[name] = np.empty((count, width))
            lay_part(rows_of(g.twist, count), start, rank, found[name])
            found[name] = found[name] if width > 1 else found[name][:, 0]
        else:
            found[name] = in_order(column_of(world, g, name, count), rank)
    return found


def in_order(rows: np.ndarray, rank: np.ndarray) -> np.ndarray:
    """These rows of the grains by slot as rows by id."""
    found = np.empty(rows.shape, rows.dtype)
    if rows.ndim == 2 and rows.dtype == np.float64 and rows.shape[1] == 2:  # as one number a row: four times as fast
        found.view(complex)[rank] = rows.view(complex)
    else:
        found[rank] = rows
    return found


def column_of(world: World, g: Any, name: str, count: int) -> np.ndarray:
    """A column, by slot."""
    if name == "position":
        place = scratch(count)
        np.add(rows_of(g.site, count), 0.5, out=place)
        for k, spacing in enumerate(world.box[None].spacing):
            place[:, k] *= spacing  # both at once take ten times as long: NumPy goes through rows of two numbers
        place += rows_of(g.offset, count)
        place += rows_of(g.shift, count)
        return place
    if name == "velocity":
        return rows_of(g.twist, count)[:, :2].astype(np.float64)
    if name == "spin":
        return rows_of(g.twist, count)[:, 2].astype(np.float64)
    if name == "angle":
        return rows_of(g.angle, count).astype(np.float64) + rows_of(g.turn, count)
    rows = rows_of(getattr(g, name), count)
    if name == "mobility" and world.sleeps:  # sleepers have theirs kept for them
        awake = world.sleep.state[None].awake
        rows = np.concatenate([rows[:awake], rows_of(world.sleep.mobility, count)[awake:]])
    return rows
