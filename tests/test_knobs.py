"""Sliders: where they begin and end, and what may be set beyond."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sand import Scene, effects
from taichi_sand.play.knobs import Knob, knobs_of, nice, reach
from taichi_sand.scene import loading
from taichi_sand.scene.parameters import Parameter

SIDE = {"size": [0.4, 0.4], "grains": [{"radius": 0.01, "count": 4, "fill": "lattice"}]}


def knob(key: str, **scene: object) -> Knob:
    """A slider of a scene."""
    made = Scene(**SIDE, **scene)
    return next(one for one in knobs_of(made, made) if one.key == key)


@pytest.mark.parametrize(
    ("key", "table", "ends"),
    [
        ("drag.wind_x", {"wind_x": 11.0}, (-20, 20)),
        ("drag.wind_x", {}, (-10, 10)),
        ("bonds.strength", {"strength": 30.0}, (0, 150)),
        ("bonds.stiffness", {"stiffness": 2e5}, (2e3, 1e7)),
        ("friction.mu", {"mu": 0.4}, (0, 2.5)),
        ("rolling.mu", {}, (0, 1)),
    ],
)
def test_ranges_follow_from_the_value_of_the_scene(key: str, table: dict, ends: tuple[float, float]) -> None:
    found = knob(f"effects.{key}", effects={key.partition(".")[0]: table})
    assert (found.low, found.high) == pytest.approx(ends)
    assert found.log == (key == "bonds.stiffness")


def test_every_slider_of_every_scene_has_its_value_inside() -> None:
    """And goes back to it; where decades matter it lies in the middle of them."""
    for path in loading.bundled().values():
        scene = loading.load(path)
        for one in knobs_of(scene, scene):
            assert one.home is not None and one.low <= one.home <= one.high and one.physical(one.home), (path, one)
            assert one.low < one.high and (one.low > 0 or not one.log)
            assert one.high == one.limits()[1] or one.share(one.home, False) < 0.96, (path, one)


@given(st.floats(1e-6, 1e6), st.sampled_from([(None, None), (0.0, None), (0.0, 1e9), (-1e9, 1e9), (1e-9, 1e9)]), st.booleans())
def test_a_value_is_well_inside_its_slider(value: float, limits: tuple, decades: bool) -> None:
    least, most = limits
    decades = decades and bool(least and least > 0)
    low, high = reach(Parameter("some", 1.0, "thing", low=least, high=most, decades=decades), value)
    assert low < value < high and 1.5 * value <= high <= 200 * max(value, 1.0)
    if least is not None:
        assert low >= least


@given(st.floats(1e-12, 1e12))
def test_nice_numbers(value: float) -> None:
    found = nice(value)
    assert value * (1 - 1e-8) <= found <= 2.6 * value
    assert float(f"{found / 10 ** math.floor(math.log10(found) + 1e-9):.6g}") in (1, 2, 5, 10)


def test_unphysical_is_what_lies_beyond_its_declared_range_and_says_why() -> None:
    mu = knob("effects.friction.mu", effects={"friction": {}})
    assert mu.physical(9.9) and not mu.why(9.9)  # beyond the end of the slider, but no nonsense
    assert not mu.physical(-0.1) and "energy" in mu.why(-0.1)
    assert mu.bounded(9.0, False) == 9.0 and mu.bounded(-0.3, False) == 0 and mu.bounded(-0.3, True) == -0.3
    assert mu.bounded(-9.0, True) == -0.5
    assert "at least" in Knob("x.y", "y", "world", "", "", 0.0, 1.0).why(-1)


def test_all_live_numbers_have_a_slider() -> None:
    """Of every effect, in a scene that says nothing of it."""
    for name in effects.names():
        kind = effects.find(name).solvers[0]
        if effects.find(name).misfit(Scene(**SIDE, solver={"kind": kind}, effects={name: {}})):
            continue
        scene = Scene(**SIDE, solver={"kind": kind}, effects={name: {}})
        keys = {one.key for one in knobs_of(scene, scene)}
        for p in effects.find(name).parameters:
            if p.live and isinstance(p.default, float):
                assert f"effects.{name}.{p.name}" in keys
