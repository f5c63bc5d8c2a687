"""Reads the grains of a world, in the order in which the scene made them: of a table only the columns that are asked for."""

from functools import lru_cache
from typing import Any

import numpy as np

from taichi_sand.taichi_support.host_access import PLAIN, members_of, plain, view
from taichi_sand.world.tables import World


def rows_of(field: Any, count: int) -> np.ndarray:
    """The first rows of a column, (count,) or (count, components): the numbers themselves where they lie in memory, not a copy."""
    members = members_of(field)
    if PLAIN or not plain(members[0]):
        return field.to_numpy()[:count]
    views = [view(member)[:count] for member in members]
    first, size = views[0], views[0].itemsize
    starts = [one.__array_interface__["data"][0] for one in views]
    if len(views) == 1:
        return first
    if starts != [starts[0] + k * size for k in range(len(views))]:
        return np.stack(views, axis=1)
    return np.lib.stride_tricks.as_strided(first, (count, len(views)), (first.strides[0], size))


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
        return ids.astype(np.intp)
    present = np.zeros(last + 1, np.int64)
    present[ids] = 1
    return (np.cumsum(present) - 1)[ids]


def read_columns(world: World, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Columns of the grains present, by id: those of the table by their names, `position`, `velocity`, `spin`; SI. `angle` is the present
    one. Numbers of f64, but `radius` and `mobility` as they are stored.
    """
    g, count, rank = world.grains, world.count[None], ranks(world)
    return {name: in_order(values, rank) for name, values in ((name, column_of(world, g, name, count)) for name in names)}


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
        for k, spacing in enumerate(world.box.get_member_field("spacing")[None]):
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
