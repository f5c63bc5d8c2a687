"""The discs of grains, on the host, and what all grains of a kind have in common."""

from typing import Any, NamedTuple

import numpy as np

from taichi_sand.scene.shapes import mass


class Kinds:
    """The kinds of grains of a scene, a table of grains or sources each."""

    def __init__(self, scene: Any) -> None:
        tables = (*scene.grains, *scene.sources)
        forms = [scene.form_of(table) for table in tables]
        self.many = np.array([len(form.discs) for form in forms] or [1])  # discs
        self.start = np.cumsum(self.many) - self.many
        self.discs = np.concatenate([form.discs for form in forms] or [[[0.0, 0.0, 1.0]]])  # x, y, radius over that of the grain
        self.clumps = bool((self.many > 1).any())
        self.dense = np.array([mass(form, np.ones(1), table.density)[0] for form, table in zip(forms, tables)] or [1.0])  # mass / radius²


class Discs(NamedTuple):
    """Discs, a row each; those of a grain follow one another."""

    owner: np.ndarray  # (n,) row of the grain
    place: np.ndarray  # (n, 2) [m]
    radius: np.ndarray  # (n,) [m]
    first: np.ndarray  # (n,) row of the first disc of the grain


def discs_of(kinds: Kinds, kind: np.ndarray, position: np.ndarray, angle: np.ndarray, radius: np.ndarray) -> Discs:
    """The discs of grains of these kinds at `position` (n, 2) [m], of `radius` (n,) [m] around them, turned by `angle` (n,)."""
    radius = radius.astype(float)
    if not kinds.clumps:
        rows = np.arange(len(radius))
        return Discs(rows, position, radius, rows)
    many = kinds.many[kind]
    owner, first = np.repeat(np.arange(len(kind)), many), np.repeat(np.cumsum(many) - many, many)
    own = kinds.discs[kinds.start[kind[owner]] + np.arange(len(owner)) - first] * radius[owner, None]
    cos, sin = np.cos(angle)[owner], np.sin(angle)[owner]
    arm = np.stack([cos * own[:, 0] - sin * own[:, 1], sin * own[:, 0] + cos * own[:, 1]], axis=1)
    return Discs(owner, position[owner] + arm, own[:, 2], first)
