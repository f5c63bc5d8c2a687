"""The views of stress: fringes of photoelastic discs against the closed solution, and the numbers of each grain."""

import numpy as np
import pytest
from helpers import G, R, simulate

from taichi_sand.measure import structure
from taichi_sand.view import fringes, palette
from taichi_sand.view.paint import Painter

RADIUS = 0.05
PRESS = 1e-5
"""By so much the box is lower than the disc [m]."""


def textbook(x: np.ndarray, y: np.ndarray, force: float, radius: float) -> np.ndarray:
    """Difference of the principal stresses in a disc that two forces press along y (M. M. Frocht, Photoelasticity II, 1948) [N/m]."""
    up, down = x**2 + (radius - y) ** 2, x**2 + (radius + y) ** 2
    sx = (radius - y) * x**2 / up**2 + (radius + y) * x**2 / down**2 - 1 / (2 * radius)
    sy = (radius - y) ** 3 / up**2 + (radius + y) ** 3 / down**2 - 1 / (2 * radius)
    shear = (radius - y) ** 2 * x / up**2 - (radius + y) ** 2 * x / down**2
    return 2 * force / np.pi * np.hypot(sx - sy, 2 * shear)


def test_a_pressed_disc_shows_the_fringes_of_the_textbook() -> None:
    """At 20 points and all over: as bright as sin² of the closed solution, within 2 %."""
    height = 2 * RADIUS - PRESS
    sim = simulate([{"positions": [[0.06, height / 2, RADIUS]]}], (0.12, height), {"kind": "md", "k_r": 1e5})
    sim.advance_steps(1)
    rows = sim.contacts()
    assert rows["force_n"] == pytest.approx([0.5 * PRESS * 1e5] * 2, rel=1e-6)
    painter = Painter(sim.world, sim.scene.size, 720, color="photoelastic")
    picture = painter.paint(0.0).reshape(painter.height, painter.width)
    bright = {int(colour): k / 255 for k, colour in enumerate(palette.colour_map(palette.FRINGES))}
    fringe, force = painter.legend.top, float(rows["force_n"][0])
    assert fringe == pytest.approx(4 * force / (np.pi * RADIUS) / fringes.ORDERS, rel=1e-6)  # 4 F / πR at the centre
    column, row = np.meshgrid(np.arange(painter.width), np.arange(painter.height))
    x, y = (column + 0.5) / painter.scale - 0.06, (painter.height - row - 0.5) / painter.scale - height / 2
    order = textbook(x, y, force, RADIUS) / fringe
    near = np.minimum(np.hypot(x, y - RADIUS), np.hypot(x, y + RADIUS))
    shown = (np.hypot(x, y) < 0.95 * RADIUS) & (near > 0.3 * RADIUS)
    found = np.array([bright[int(colour)] for colour in picture[shown]])
    assert np.abs(found - np.sin(np.pi * order[shown]) ** 2).max() < 0.02
    points = np.random.default_rng(3).uniform(-0.6, 0.6, (20, 2))
    strength = 2 / np.pi * painter.scale / fringe
    loads = np.array([[0, -RADIUS * painter.scale, 0, force], [0, RADIUS * painter.scale, 0, -force]], np.float32)
    orders = np.zeros((20, 1), np.float32)
    fringes.orders((points * RADIUS * painter.scale).astype(np.float32), loads, strength, orders)
    assert orders[:, 0] == pytest.approx(textbook(*(points * RADIUS).T, force, RADIUS) / fringe, rel=1e-4)


@pytest.mark.parametrize("shape", ["disc", "square"])
def test_views_of_stress_show_the_stresses(shape: str) -> None:
    """Half the trace, and half the difference of the principal values, of the Love-Weber stress; unloaded grains are dark."""
    grains = [{"radius": [0.8 * R, R], "count": 40, "region": [0.01, 0.01, 0.14, 0.28], "shape": shape}, {"positions": [[0.02, 0.29, R]]}]
    sim = simulate(grains, (0.15, 0.3), {"kind": "md"}, gravity=(0, -G), mu=0.3)
    sim.advance(0.2)
    slot = sim.world.grains.id.to_numpy()[: sim.count]
    tensors = sim.stresses()[slot]
    if shape == "square":  # theirs are over the area of the grain, the view's over that of the circle about it
        size = sim.sizes[sim.world.grains.kind.to_numpy()[: sim.count]]
        tensors *= (size**2)[:, None, None]
    mean, half = 0.5 * (tensors[:, 0, 0] + tensors[:, 1, 1]), 0.5 * (tensors[:, 0, 0] - tensors[:, 1, 1])
    shear = 0.5 * (tensors[:, 0, 1] + tensors[:, 1, 0])
    for measure, expected in ((structure.stress, mean), (structure.deviator, np.hypot(half, shear))):
        out = np.zeros(sim.world.capacity, np.float32)
        measure(sim.world, out)
        assert out[: sim.count] == pytest.approx(expected, rel=0.01, abs=2e-3 * np.abs(mean).max()) and mean.max() > 0
    painter = Painter(sim.world, sim.scene.size, 300, color="photoelastic")
    picture = painter.paint(0.0).reshape(painter.height, painter.width)
    assert len(np.unique(picture)) > 100
