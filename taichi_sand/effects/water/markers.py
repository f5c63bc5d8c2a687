"""Where the markers of the water start: four in a cell, a little out of line, and as many fewer as grains leave room for."""

from typing import Any

import numpy as np

from taichi_sand.effects.water.grid import KAPPA, Plan

FIRST, SECOND = 0.7548776662466927, 0.5698402909980532
"""1/g and 1/g², g the root of g³ = g + 1: multiples of both fill a square evenly (R2; Roberts 2018)."""
PER_CELL = 2
"""Markers of a full cell, each way."""
JITTER = 0.1
"""Of their distance, either way. With 0.25 their number in a cell is off by 10 %, and still water takes seconds to even that out."""


def start(scene: Any, grains: Any, plan: Plan) -> tuple[np.ndarray, float]:
    """Places (n, 2) [cells] of the markers that fill the [[water]] regions of `scene`, where these overlap once; and what share of a cell
    each of them fills.

    A bed keeps as many as its pores hold, by error diffusion: thinned at random there would be holes without pressure in it.
    """
    rng = np.random.default_rng([scene.seed, plan.columns, plan.rows])
    cell = np.array([plan.width, plan.height])
    regions = [np.reshape(table.region, (2, 2)) / cell for table in scene.water if table.rate is None]
    solid = np.minimum(solids(grains, len(scene.grains), plan), 1.0)
    places, total, number = [np.empty((0, 2))], 0.0, 0
    for k, (low, high) in enumerate(regions):
        place, share = lattice(low, high, rng)
        taken = [((place >= one) & (place < two)).all(axis=1) for one, two in regions[:k]]
        place = place[~np.logical_or.reduce(taken)] if taken else place
        total, number = total + share * len(place), number + len(place)
        i, j = (np.minimum(place[:, c].astype(int), last - 1) for c, last in ((0, plan.columns), (1, plan.rows)))
        pores = np.concatenate([[0.0], np.cumsum(1.0 - solid[i, j])])
        places.append(place[np.floor(pores[1:] + 0.5) > np.floor(pores[:-1] + 0.5)])
    return np.concatenate(places) + 0.5, total / max(number, 1) or 1 / PER_CELL**2


def lattice(low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Places (n, 2) that fill a rectangle evenly, column by column, and the area of each [cells]: its edges are where it says."""
    counts = np.maximum(1, np.round(PER_CELL * (high - low)).astype(int))
    i, j = np.meshgrid(np.arange(counts[0]), np.arange(counts[1]), indexing="ij")
    inner = np.stack([i.ravel(), j.ravel()], axis=1) + 0.5 + rng.uniform(-JITTER, JITTER, (counts.prod(), 2))
    pitch = (high - low) / counts
    return low + inner * pitch, float(pitch.prod())


def solids(grains: Any, kinds: int, plan: Plan) -> np.ndarray:
    """Solid fraction (columns, rows) of cells, dealt by the quadratic spline as in `drag`; of the grains of the first `kinds` kinds."""
    there = grains.kind < kinds
    area = KAPPA * np.pi * grains.size[there] ** 2 / (plan.width * plan.height)
    place = grains.position[there] / [plan.width, plan.height] - 0.5
    middle = np.floor(place + 0.5).astype(int)
    found = np.zeros((plan.columns, plan.rows))
    for across in (-1, 0, 1):
        for up in (-1, 0, 1):
            node = middle + np.array([across, up])
            away = np.abs(node - place)
            weight = np.where(away < 0.5, 0.75 - away**2, 0.5 * (1.5 - away) ** 2).prod(axis=1)
            i, j = (np.clip(node[:, k], 0, last - 1) for k, last in ((0, plan.columns), (1, plan.rows)))
            np.add.at(found, (i, j), area * weight)
    return found
