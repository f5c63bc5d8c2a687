"""Sizes of grains: a number, [low, high], or a distribution, and how they are drawn from it.

A distribution is kept as its quantiles by number: u, uniform in 0 … 1, becomes the radius below which the share u of the grains lies.
What is given by mass is turned into that: of grains of one density and shape the mass goes with the radius squared.
"""

from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Discriminator, Tag, model_validator

from taichi_sand.errors import Wrong, show
from taichi_sand.scene.kinds import Number, Range, Table, Vector, key

POINTS = 4096
"""Quantiles that a distribution is kept by: what lies between two is off by less than 1e-6 of the range."""
WIDE = 3.0
"""A normal or log-normal distribution is cut off so many sigma from its middle, unless it says where."""
NEEDS = {"uniform": ("low", "high"), "normal": ("sigma",), "lognormal": ("median", "sigma")}


class Sizes(Table):
    """A distribution of radii of discs: of a law, or a sieve curve."""

    distribution: Literal["uniform", "normal", "lognormal"] | None = key(None, "law; or `sieve`")
    median: Number | None = key(None, "lognormal: the middle of it; normal: as `mean`", "m", gt=0)
    mean: Number | None = key(None, "normal: the middle of it", "m", gt=0)
    sigma: Number | None = key(None, "standard deviation: normal in m, lognormal of the logarithm", "m or 1", gt=0)
    low: Number | None = key(None, "smallest radius; 3 sigma below the middle if not given", "m", gt=0)
    high: Number | None = key(None, "largest radius; 3 sigma above the middle if not given", "m", gt=0)
    by: Literal["number", "mass"] = key("number", "what the law is about: how many grains, or how much they weigh")
    sieve: tuple[Vector, ...] | None = key(
        None, "[[diameter, share of the mass that passes], …] from 0.0 to 1.0, straight in between", "m", min_length=2
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        given = {name for name in self.model_fields_set if getattr(self, name) is not None}
        if (self.distribution is None) == (self.sieve is None):
            raise Wrong("", " needs `distribution` or `sieve`, and not both")
        if self.sieve is not None:
            if other := sorted(given - {"sieve"}):
                raise Wrong(other[0], " does not go with a `sieve`")
            self._check_sieve(self.sieve)
            return self
        for name in NEEDS[str(self.distribution)]:
            if name not in given:
                raise Wrong(name, f' is missing: distribution = "{self.distribution}" needs it')
        if self.distribution == "normal" and ("mean" in given) == ("median" in given):
            raise Wrong("mean", ' is missing, or given twice: distribution = "normal" needs `mean`, or `median`, which is the same')
        allowed = {"uniform": {"low", "high"}, "normal": {"mean", "median", "sigma"}, "lognormal": {"median", "sigma"}}
        for name in sorted(given - allowed[str(self.distribution)] - {"distribution", "low", "high", "by"}):
            raise Wrong(name, f' does not go with distribution = "{self.distribution}"')
        low, high = self.limits
        if not 0 < low < high:
            raise Wrong("low", f" = {show(low)} must be above 0 and below high = {show(high)}")
        return self

    def __hash__(self) -> int:
        return hash(tuple(self.__dict__.values()))  # a table does not change

    @staticmethod
    def _check_sieve(curve: tuple[tuple[float, float], ...]) -> None:
        if curve[0][0] <= 0 or any(b[0] <= a[0] or b[1] < a[1] for a, b in pairwise(curve)):
            raise Wrong("sieve", f" = {show(curve)} must have diameters above 0 that grow, and shares that do not fall")
        if (curve[0][1], curve[-1][1]) != (0.0, 1.0):
            raise Wrong("sieve", f" = {show(curve)} must begin with the share 0.0 and end with 1.0")

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        if self.sieve is not None:
            return self.sieve[0][0] / 2, self.sieve[-1][0] / 2
        middle, sigma = self.mean or self.median or 0.0, self.sigma or 0.0
        ends = (middle - WIDE * sigma, middle + WIDE * sigma)
        if self.distribution == "lognormal":
            ends = (middle * np.exp(-WIDE * sigma), middle * np.exp(WIDE * sigma))
        return float(self.low or ends[0]), float(self.high or ends[1])

    def density(self, radius: np.ndarray) -> np.ndarray:
        """Of the law, by what it is about, at radii (n,) [m], but for a factor."""
        if self.distribution == "uniform":
            return np.ones_like(radius)
        middle, sigma = float(self.mean or self.median or 0.0), float(self.sigma or 0.0)
        if self.distribution == "normal":
            return np.exp(-0.5 * ((radius - middle) / sigma) ** 2)
        return np.exp(-0.5 * (np.log(radius / middle) / sigma) ** 2) / radius


Radius = Annotated[
    Annotated[Range, Tag("[range]")] | Annotated[Sizes, Tag("[sizes]")],
    Discriminator(lambda value: "[sizes]" if isinstance(value, dict | Sizes) else "[range]"),
]
"""A number, [low, high], or a table."""


@lru_cache(maxsize=64)
def quantiles(sizes: Sizes) -> tuple[np.ndarray, np.ndarray]:
    """Radii [m], and the share of the grains, by number, below each."""
    if sizes.sieve is not None:
        curve = np.array(sizes.sieve) * [0.5, 1.0]
        radius = np.unique(np.concatenate([np.linspace(a, b, POINTS) for a, b in pairwise(curve[:, 0])]))
        mass = np.diff(np.interp(radius, *curve.T))
        below = np.concatenate([[0.0], np.cumsum(mass / (radius[1:] * radius[:-1]))])  # dN goes with dM / r²; the mean of 1 / r² there
    else:
        radius = np.linspace(*sizes.limits, POINTS)
        density = sizes.density(radius) / (radius**2 if sizes.by == "mass" else 1.0)
        below = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    return radius, below / below[-1]


def limits(radius: Any) -> tuple[float, float]:
    """Smallest and largest radius [m] of a Radius."""
    return radius.limits if isinstance(radius, Sizes) else radius


def spread(radius: Any, share: np.ndarray) -> np.ndarray:
    """Radii [m] that stand for the shares (n,) of the grains, uniform in 0 … 1."""
    if isinstance(radius, Sizes):
        values, below = quantiles(radius)  # type: ignore[arg-type]  # frozen, so it has a hash
        return np.interp(share, below, values)
    return radius[0] + (radius[1] - radius[0]) * share


def drawn(radius: Any, count: int, rng: np.random.Generator, reach: float = 1.0) -> np.ndarray:
    """Radii (count,) [m], `reach` times those of a Radius."""
    if isinstance(radius, Sizes):
        return reach * spread(radius, rng.random(count))
    return rng.uniform(reach * radius[0], reach * radius[1], count)


def mean_area(radius: Any, reach: float) -> float:
    """Mean area of circles of `reach` times a Radius [m2]."""
    if isinstance(radius, Sizes):
        return float(np.pi * reach**2 * (spread(radius, (np.arange(POINTS) + 0.5) / POINTS) ** 2).mean())
    low, high = reach * radius[0], reach * radius[1]
    return np.pi * (low**2 + low * high + high**2) / 3
