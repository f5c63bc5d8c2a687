"""Grain shapes: discs, rigidly joined; the mass and inertia of their union, to the last digit.

A shape is given in units of `radius`, the key of a [[grains]] table, which is the radius of a disc in all the shapes that come with
the package. It is kept with the centre of mass as its origin, in units of the reach: the radius of the circle about it that holds it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

SLANT = 2 / np.sqrt(3)
BUILT_IN = {
    "disc": ((0.0, 0.0, 1.0),),
    "2x1": ((-1.0, 0.0, 1.0), (1.0, 0.0, 1.0)),
    "3x1": ((-2.0, 0.0, 1.0), (0.0, 0.0, 1.0), (2.0, 0.0, 1.0)),
    "triangle": tuple((SLANT * np.cos(a), SLANT * np.sin(a), 1.0) for a in np.radians((90, 210, 330))),
    "square": ((-1.0, -1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)),
}
"""x, y and radius of the discs of each shape, in units of the key `radius`; the discs touch."""


@dataclass(frozen=True)
class Form:
    """Discs about their common centre of mass; lengths in units of `reach`."""

    name: str
    reach: float  # radius of the circle about the centre of mass that holds all discs, over the key `radius`
    discs: np.ndarray  # (n, 3) x, y, radius, in units of the reach
    area: float  # of the union, over reach squared
    inertia: float  # moment of inertia about the centre of mass, over mass and reach squared

    @property
    def size(self) -> float:
        """Radius of the disc of the same area, over the reach; 1 of a disc."""
        return 1.0 if len(self.discs) == 1 else float(np.sqrt(self.area / np.pi))

    @property
    def span(self) -> float:
        """Longest arm, from the centre of mass to the centre of a disc, over the reach; 0 of a disc."""
        return float(np.hypot(self.discs[:, 0], self.discs[:, 1]).max())

    @property
    def lightness(self) -> float:
        """Mass over the least that a push at the rim has to move, 1 + m arm^2 / I; 1 of a disc."""
        return 1.0 + self.span**2 / self.inertia


@cache
def form(name: str, discs: tuple[tuple[float, float, float], ...]) -> Form:
    """The shape made of these discs, (x, y, radius) each."""
    if len(discs) == 1:
        return Form(name, discs[0][2], np.array([[0.0, 0.0, 1.0]]), np.pi, 0.5)
    rows = np.array(discs, float)
    area, first, _ = union_moments(rows)
    rows[:, :2] -= first / area
    reach = float((np.hypot(rows[:, 0], rows[:, 1]) + rows[:, 2]).max())
    rows /= reach
    area, _, second = union_moments(rows)
    return Form(name, reach, rows, area, second / area)


def union_moments(discs: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Area, first moment (2,) and second moment about the origin of the union of discs (n, 3): x, y, radius.

    By Green's theorem, from the arcs of the rims that no other disc covers: the area is half the integral of x dy - y dx along them.
    """
    area, first, second = 0.0, np.zeros(2), 0.0
    for index, (x, y, radius) in enumerate(discs):
        for start, end in bare_arcs(discs, index):
            parts = int(np.ceil((end - start) / (np.pi / 2)))
            edges = np.linspace(start, end, parts + 1)
            middle, half = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
            angle, weight = (middle[:, None] + half[:, None] * NODES).ravel(), (half[:, None] * WEIGHTS).ravel()
            px, py = x + radius * np.cos(angle), y + radius * np.sin(angle)
            dx, dy = -radius * np.sin(angle) * weight, radius * np.cos(angle) * weight
            area += 0.5 * (px * dy - py * dx).sum()
            first += 0.5 * np.array([(px**2 * dy).sum(), -(py**2 * dx).sum()])
            second += (px**3 * dy - py**3 * dx).sum() / 3
    return area, first, second


NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)
"""Exact to rounding for the products of four sines and cosines over a quarter of a turn."""


def bare_arcs(discs: np.ndarray, index: int) -> list[tuple[float, float]]:
    """Parts of the rim of disc `index`, from angle to angle, that lie in no other disc; of equal discs the first keeps its rim."""
    x, y, radius = discs[index]
    covered: list[tuple[float, float]] = []
    for other, (ox, oy, size) in enumerate(discs):
        distance = np.hypot(ox - x, oy - y)
        same = distance == 0 and size == radius
        if other == index or distance >= radius + size or (same and other > index):
            continue
        if distance <= size - radius:
            return []
        if distance > radius - size:  # else it lies within this one
            share = np.clip((distance**2 + radius**2 - size**2) / (2 * distance * radius), -1, 1)
            middle, half = np.arctan2(oy - y, ox - x) % (2 * np.pi), np.arccos(share)
            covered += [(middle - half + turn, middle + half + turn) for turn in (-2 * np.pi, 0, 2 * np.pi)]
    arcs, at = [], 0.0
    for start, end in sorted(covered):
        if end <= 0 or start >= 2 * np.pi:
            continue
        if start > at:
            arcs.append((at, start))
        at = max(at, end)
    return arcs + ([(at, 2 * np.pi)] if at < 2 * np.pi else [])


def mass(form: Form, reach: np.ndarray, density: float | np.ndarray) -> np.ndarray:
    """Mass [kg] of grains of a shape, from their reach [m] and areal density [kg/m2]."""
    return density * form.area * reach**2


def inertia(form: Form, reach: np.ndarray, density: float | np.ndarray) -> np.ndarray:
    """Moment of inertia [kg m2] about the centre of mass."""
    return mass(form, reach, density) * reach**2 * form.inertia


def overlapping(discs: Sequence[Sequence[float]]) -> bool:
    """Whether any two of the discs overlap by more than rounding does."""
    rows = np.array(discs, float)
    first, second = np.triu_indices(len(rows), 1)
    distance = np.hypot(*(rows[first, :2] - rows[second, :2]).T)
    return bool((distance < (rows[first, 2] + rows[second, 2]) * (1 - 1e-3)).any())


def joined(discs: Sequence[Sequence[float]]) -> bool:
    """Whether the discs hang together: each touches or overlaps another, and all are linked."""
    rows = np.array(discs, float)
    way = rows[:, None, :2] - rows[None, :, :2]
    near = np.hypot(way[..., 0], way[..., 1]) <= (rows[:, None, 2] + rows[None, :, 2]) * (1 + 1e-6)
    found = np.zeros(len(rows), bool)
    found[0] = True
    for _ in range(len(rows)):
        found |= near[found].any(axis=0)
    return bool(found.all())
