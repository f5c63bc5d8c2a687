"""Golden pictures: what three scenes look like, within what another processor's rounding may change.

`python tests/test_golden.py` paints them anew, to be looked at before they are kept.
"""

import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

import taichi_sand as sand

GOLDEN = Path(__file__).with_name("golden")
PICTURES = {
    "shapes": ("shapes", ["view.width=360"]),
    "pressure": ("settle", ["view.width=360", 'view.color="pressure"', "scale=0.2"]),
    "force_chains": ("force_chains", ["view.width=360"]),
}
MOMENT = 0.02
"""When they are painted [s]: before what a processor rounds otherwise has grown to other force chains (0.05 s)."""
MEAN, SHARE, STRONG = 1.0, 0.01, 48
"""Mean difference of a channel, of 255; and share of pixels that may differ by more than STRONG: a grain elsewhere has more."""


def paint(name: str, weight: float = 1.0) -> np.ndarray:
    """The picture, with gravity times `weight`."""
    name, overrides = PICTURES[name]
    scene = sand.load(name, overrides)
    sim = sand.Simulation(scene.model_copy(update={"gravity": tuple(weight * g for g in scene.gravity)}), threads=1)
    sim.advance(MOMENT)
    return sim.image()


@pytest.mark.parametrize("name", PICTURES)
def test_looks_as_ever(name: str) -> None:
    kept, found = iio.imread(GOLDEN / f"{name}.png"), paint(name)
    assert found.shape == kept.shape
    off = np.abs(found.astype(int) - kept.astype(int))
    assert off.mean() < MEAN and (off.max(axis=2) > STRONG).mean() < SHARE


@pytest.mark.parametrize("name", PICTURES)
def test_what_a_processor_rounds_is_not_seen(name: str) -> None:
    assert np.abs(paint(name).astype(int) - paint(name, 1 + 3e-7)).mean() < 0.1 * MEAN


def test_a_grain_elsewhere_is_seen() -> None:
    """Moved by half its radius in the smallest of them, and so are colours that are a little off."""
    kept = iio.imread(GOLDEN / "shapes.png").astype(int)
    assert np.abs(np.roll(kept, 2, axis=1) - kept).mean() > MEAN
    assert np.abs(np.clip(kept + 6, 0, 255) - kept).mean() > MEAN


if __name__ == "__main__":
    for one in sys.argv[1:] or PICTURES:
        iio.imwrite(GOLDEN / f"{one}.png", paint(one))
