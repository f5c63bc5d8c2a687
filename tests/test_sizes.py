"""Distributions of sizes: what is drawn is held to them by Kolmogorov and Smirnov's test, packed in a box and from sources."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

import taichi_sand as sand
from taichi_sand.errors import SandError
from taichi_sand.scene.packing import pack
from taichi_sand.world.sources import draw

LEVEL = 1.63
"""Distance of Kolmogorov and Smirnov, times the root of the number of grains, that one sample in a hundred exceeds."""
LOW, HIGH = 0.002, 0.008
CURVE = [[0.004, 0.0], [0.008, 0.35], [0.010, 0.9], [0.016, 1.0]]
Cdf = Callable[[np.ndarray], np.ndarray]


def cut(law: Any) -> Cdf:
    """Its distribution function, between LOW and HIGH."""
    return lambda r: (law.cdf(r) - law.cdf(LOW)) / (law.cdf(HIGH) - law.cdf(LOW))


LAWS: dict[str, tuple[Any, Cdf, bool]] = {
    "range": ([LOW, HIGH], stats.uniform(LOW, HIGH - LOW).cdf, False),
    **{
        f"{name}, by {by}": ({**keys, "low": LOW, "high": HIGH, "by": by}, cut(law), by == "mass")
        for by in ("number", "mass")
        for name, keys, law in (
            ("uniform", {"distribution": "uniform"}, stats.uniform(LOW, HIGH - LOW)),
            ("normal", {"distribution": "normal", "mean": 0.005, "sigma": 0.001}, stats.norm(0.005, 0.001)),
            ("lognormal", {"distribution": "lognormal", "median": 0.004, "sigma": 0.3}, stats.lognorm(0.3, scale=0.004)),
        )
    },
    "sieve": ({"sieve": CURVE}, lambda r: np.interp(2 * r, *np.array(CURVE).T), True),
}
"""As a scene has them, with their distribution functions, by number or by mass."""


def distance(radius: np.ndarray, cdf: Cdf, by_mass: bool) -> float:
    """Largest distance of what was drawn from its law, times the root of the number of grains that so uneven weights are worth."""
    radius = np.sort(radius)
    weight = radius**2 if by_mass else np.ones(len(radius))
    above = np.cumsum(weight) / weight.sum()
    below = above - weight / weight.sum()
    wanted = cdf(radius)
    worth = weight.sum() ** 2 / (weight**2).sum()
    return float(np.maximum(np.abs(above - wanted), np.abs(below - wanted)).max() * math.sqrt(worth))


@pytest.mark.parametrize("name", LAWS)
def test_packed_grains_have_their_distribution(name: str) -> None:
    """Discs and clumps, in random places and on a lattice: none is left out because of its size."""
    radius, cdf, by_mass = LAWS[name]
    for table in ({"count": 3000}, {"fill": "lattice", "count": 3000}, {"shape": "2x1", "count": 1500}):
        scene = sand.Scene(size=[1.2, 1.2], seed=4, grains=[{"radius": radius, **table}])
        grains = pack(scene)
        reach = scene.form_of(scene.grains[0]).reach
        assert (LOW - 1e-12 <= grains.radius / reach).all() and (grains.radius / reach <= HIGH + 1e-12).all()
        assert distance(grains.radius / reach, cdf, by_mass) < LEVEL


@pytest.mark.parametrize("name", LAWS)
def test_sources_make_their_distribution_in_any_stretch(name: str) -> None:
    """What a source makes fills its law evenly: far closer than by chance, from whichever grain on it is asked."""
    radius, cdf, by_mass = LAWS[name]
    scene = sand.Scene(size=[1.0, 1.0], sources=[{"radius": radius, "rate": 1.0, "region": [0.0, 0.0, 1.0, 1.0]}])
    for first in (0, 777):
        sizes, _ = draw(scene, 0, first, 3000)
        assert distance(sizes, cdf, by_mass) < 0.3 * LEVEL


def test_what_is_not_said_of_the_ends() -> None:
    """Three sigma either way; and such a table survives JSON."""
    scene = sand.Scene(size=[1.0, 1.0], grains=[{"count": 1, "radius": {"distribution": "lognormal", "median": 0.004, "sigma": 0.2}}])
    assert scene.grains[0].radius.limits == pytest.approx((0.004 * math.exp(-0.6), 0.004 * math.exp(0.6)))
    assert sand.Scene.from_json(scene.to_json()) == scene


NORMAL = {"distribution": "normal", "mean": 0.005, "sigma": 0.001}
WRONG: dict[str, tuple[Any, str]] = {
    "no law": ({"low": 0.1}, "grains[0].radius needs `distribution` or `sieve`"),
    "another law": ({"distribution": "gauss"}, 'grains[0].radius.distribution = "gauss" must be one of uniform, normal, lognormal'),
    "both": ({"sieve": CURVE, "low": 0.1}, "grains[0].radius.low does not go with a `sieve`"),
    "no median": ({"distribution": "lognormal", "sigma": 0.1}, "grains[0].radius.median is missing"),
    "no middle": ({"distribution": "normal", "sigma": 0.1}, "grains[0].radius.mean is missing"),
    "a foreign key": ({"distribution": "uniform", "low": 0.1, "high": 0.2, "sigma": 1.0}, "radius.sigma does not go with"),
    "an unknown key": ({**NORMAL, "sigmma": 1.0}, "grains[0].radius.sigmma is not a known key; did you mean `sigma`?"),
    "below 0": ({**NORMAL, "sigma": 0.01}, "radius.low = -0.025 must be above 0"),
    "upside down": ({**NORMAL, "low": 0.006, "high": 0.004}, "radius.low = 0.006 must be above 0 and below high = 0.004"),
    "a curve that falls": ({"sieve": [[0.1, 0.0], [0.2, 0.5], [0.3, 0.4], [0.4, 1.0]]}, "must have diameters above 0 that grow"),
    "half a curve": ({"sieve": [[0.1, 0.0], [0.2, 0.5]]}, "must begin with the share 0.0 and end with 1.0"),
    "too small": ({"sieve": [[1e-7, 0.0], [0.2, 1.0]]}, "must be at least 1e-06 m"),
    "a word": ("large", 'grains[0].radius = "large" must be a number, or [low, high]'),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_sizes(case: str) -> None:
    radius, said = WRONG[case]
    with pytest.raises(SandError) as error:
        sand.Scene(size=[1.0, 1.0], grains=[{"count": 1, "radius": radius}])
    assert said in str(error.value) and "\n" not in str(error.value)
