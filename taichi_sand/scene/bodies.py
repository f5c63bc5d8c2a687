"""Bodies that bonds hold together: shapes taken apart into discs, and which discs of a body are neighbours."""

from dataclasses import replace

import numpy as np

from taichi_sand.scene.grains import Pack
from taichi_sand.scene.nearby import close_pairs
from taichi_sand.scene.shapes import Form, inertia, mass

TOUCH = 1e-6
"""Neighbours that are farther apart than a bond reaches by this share of their distance are neighbours still: rounding."""


def taken_apart(part: Pack, form: Form, disc: Form, density: np.ndarray) -> Pack:
    """The grains of one table, all of this form and each of its density (n,), as the discs that they are made of, which move as the rigid
    grain would.
    """
    count, parts = len(part), len(form.discs)
    if parts == 1:
        return replace(part, body=np.zeros(count, np.int32))
    owner = np.repeat(np.arange(count), parts)
    rows = np.tile(form.discs, (count, 1)) * part.radius[owner, None]
    c, s = np.cos(part.angle[owner]), np.sin(part.angle[owner])
    arm = np.stack([c * rows[:, 0] - s * rows[:, 1], s * rows[:, 0] + c * rows[:, 1]], axis=1)
    turning = part.spin[owner, None] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    return replace(
        part,
        position=part.position[owner] + arm,
        velocity=part.velocity[owner] + turning,
        angle=part.angle[owner],
        spin=part.spin[owner],
        radius=rows[:, 2],
        mass=mass(disc, rows[:, 2], density[owner]),
        inertia=inertia(disc, rows[:, 2], density[owner]),
        kind=part.kind[owner],
        fixed=part.fixed[owner],
        body=owner.astype(np.int32),
    )


def neighbours(grains: Pack, reach: float) -> np.ndarray:
    """Pairs (n, 2) of grains of one body whose surfaces are at most `reach` of their mean diameter apart, in order."""
    bonded = np.flatnonzero(grains.body >= 0)
    if not len(bonded):
        return np.empty((0, 2), np.int64)
    place, radius = grains.position[bonded], grains.radius[bonded]
    first, second = close_pairs(place, place, (1 + reach) * 2 * float(radius.max()))
    way = place[second] - place[first]
    near = np.hypot(way[:, 0], way[:, 1]) <= (1 + reach) * (1 + TOUCH) * (radius[first] + radius[second])
    first, second = bonded[first], bonded[second]
    near &= (first < second) & (grains.kind[first] == grains.kind[second]) & (grains.body[first] == grains.body[second])
    pairs = np.stack([first[near], second[near]], axis=1)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
