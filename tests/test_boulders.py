"""Boulders: grains much larger than the rest are listed apart, no contact is missed, and a scene without them has nothing of it (C23)."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import G, listed, simulate

import taichi_sand as sand
from taichi_sand.world import build

SIZE = (1.0, 0.6)
SIDES = {"left": "periodic", "right": "periodic"}
SMALL = {"radius": [0.004, 0.006], "count": 1500, "region": [0.0, 0.0, 1.0, 0.3], "fill": "lattice", "jitter": 0.1, "pitch": 1.2}
LARGE = [{"positions": [[0.11 + 0.19 * k, 0.45, 0.05 + 0.01 * k, 0.3 * (k - 2), -1.5]]} for k in range(5)]
"""Five boulders of 10 to 18 mean radii."""


def pour(kind: str, grains: list[dict[str, Any]], **keys: Any) -> sand.Simulation:
    return simulate(grains, SIZE, {"kind": kind}, mu=0.4, gravity=(0, -G), **keys)


def overlapping(sim: sand.Simulation, periodic: bool) -> set[tuple[int, int]]:
    """Brute force: all pairs of discs that overlap."""
    x, r = sim.positions, sim.radii
    way = x[:, None] - x[None]
    if periodic:
        way[..., 0] -= SIZE[0] * np.round(way[..., 0] / SIZE[0])
    gap = np.hypot(way[..., 0], way[..., 1]) - r[:, None] - r[None]
    return {(int(i), int(j)) for i, j in np.argwhere(np.triu(gap < 0, 1))}


@pytest.mark.parametrize(("kind", "case"), [("md", "one"), pytest.param("rigid", "periodic", marks=pytest.mark.slow), ("rigid", "cells")])
def test_no_contact_is_missed(kind: str, case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """C23: five boulders fall into 1500 grains: every overlap that O(n^2) finds is listed, once, also across edges, and in cells as on
    a GPU; the cells are those of the small grains; nothing is lost or flagged.
    """
    if case == "cells":
        monkeypatch.setattr(build, "layout_of", lambda gpu, grains: "cells")
    sim = pour(kind, [SMALL, *LARGE], edges=SIDES if case == "periodic" else {})
    assert sim.world.boulders > 0 and sim.world.box[None].listed < 0.0121 and sim.world.layout == ("cells" if case == "cells" else "one")
    met = 0
    for _ in range(8):
        sim.advance(0.025)
        pairs = [(min(c.first, c.second), max(c.first, c.second)) for c in listed(sim) if not c.wall]
        found = overlapping(sim, case == "periodic")
        assert len(pairs) == len(set(pairs)) and not found - set(pairs)
        met += sum(j >= 1500 for _, j in found)
    assert met > 50 and sim.flags() == [] and sim.count == 1505


SHAKES = pytest.mark.xfail(
    reason="it often rolls on for seconds, at 0.05 m/s: by the time the slow reference lifts what a grain bears, the boulder is past it"
)


@pytest.mark.parametrize("kind", [pytest.param("rigid", marks=SHAKES), "md"])
def test_a_boulder_is_pushed_as_any_grain(kind: str) -> None:
    """A boulder at rest on a bed bears on the floor with its weight, through the grains below it."""
    bed = {"radius": 0.005, "count": 300, "fill": "hexagonal", "region": [0.2, 0.0, 0.8, 0.1]}
    sides = [{"points": [[x, 0.0], [x, 0.5]]} for x in (0.2, 0.8)]
    sim = pour(kind, [bed, {"positions": [[0.5, 0.16, 0.1]], "density": 500.0}], walls=sides)
    assert sim.world.boulders > 0
    sim.advance(1.0)
    weight = (300 * 2650 * math.pi * 0.005**2 + 500 * math.pi * 0.1**2) * G
    assert sim.report()["kinetic_energy_J"] < 1e-4 * weight * 0.005
    up = -sum(c.force[0] * c.normal[1] + c.force[1] * c.normal[0] for c in listed(sim) if c.wall)
    assert up == pytest.approx(weight, rel=0.01)


def test_only_few_are_boulders() -> None:
    """Sizes that only spread go into cells together, and a world without boulders has no room for them."""
    sim = pour("rigid", [SMALL])
    assert sim.world.boulders == 0 and sim.world.blocks.pair_start.shape == (1,)
    del sim
    half = {"radius": 0.016, "count": 150, "region": [0.0, 0.32, 1.0, 0.6], "fill": "lattice"}
    sim = pour("rigid", [{**SMALL, "count": 1000}, half])
    assert sim.world.boulders == 0 and sim.world.box[None].listed == pytest.approx(0.032, rel=1e-6)
