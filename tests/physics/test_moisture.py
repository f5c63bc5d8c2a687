"""Moisture: water is neither made nor lost, runs down, evaporates by its law, and decides whether a bridge holds."""

import math

import numpy as np
import pytest
from helpers import D, Disc, G, R, simulate

import taichi_sand as sand

RIGID = {"kind": "rigid", "restitution": 0.0, "step": 1e-3, "tolerance": 0.01}
STILL = {"drain": 0.0, "spread": 0.0}


def wetness(sim) -> np.ndarray:
    """Of the grains, in the order of the scene."""
    count = sim.count
    return sim.world.carried.wetness.to_numpy()[:count][np.argsort(sim.world.grains.id.to_numpy()[:count])]


def test_water_runs_down_and_none_is_lost() -> None:
    """A column of discs of two sizes, half its pores full: in the end the top holds 15 %, the bottom is full, the sum is what it was."""
    radii = [R if k % 2 else 0.8 * R for k in range(9)]
    heights = np.cumsum([2 * r for r in radii]) - radii
    discs = [Disc(0.05, y - 1e-6 * k, radius=r) for k, (y, r) in enumerate(zip(heights, radii, strict=True))]
    effects = {"moisture": {"wetness": 0.5, "drain": 20.0, "spread": 0.0}}
    sim = simulate(discs, (0.1, 0.2), RIGID, gravity=(0, -G), effects=effects)
    room = np.array(radii) ** 2
    sim.advance(4.0)
    found = wetness(sim)
    assert (found * room).sum() == pytest.approx(0.5 * room.sum(), rel=1e-12)
    assert found[0] == pytest.approx(1.0, abs=1e-3) and found[-1] == pytest.approx(0.15, abs=1e-3)
    assert (np.diff(found) < 1e-3).all()
    assert sim.report()["wetness_mean"] == pytest.approx(0.5, rel=1e-6)


def test_free_grains_dry_and_grains_poured_are_wet() -> None:
    """A free grain follows s = s0 exp(-rate t); what is wetted by hand is, within the radius, and nobody else; at most 1."""
    discs = [Disc(0.05, 0.05), Disc(0.15, 0.05)]
    sim = simulate(discs, (0.2, 0.1), RIGID, effects={"moisture": {"wetness": 0.1, "evaporation": 2.0, **STILL}})
    assert sim.wet(0.05, 0.05, D, 0.3) == 1
    assert wetness(sim) == pytest.approx([0.4, 0.1])
    sim.advance(0.99)  # whole pauses
    assert wetness(sim) == pytest.approx(np.array([0.4, 0.1]) * math.exp(-2.0 * 0.99), rel=1e-6)
    assert sim.wet(0.1, 0.05, 1.0, 5.0) == 2
    assert wetness(sim) == pytest.approx([1.0, 1.0])
    sim = simulate(discs, (0.2, 0.1), RIGID)
    with pytest.raises(sand.SandError, match=r"no table \[effects.moisture\]"):
        sim.wet(0.0, 0.0, 1.0, 0.1)


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_bridges_hold_as_they_are_wet(kind: str) -> None:
    """Discs hang on fixed ones by bridges of Bo = 1.25: from 0.4 % to 18 % they pull with more than the weight, beyond with less."""
    shares = {0.0: 0, 0.0039: 0, 0.0041: 1, 0.1: 1, 0.178: 1, 0.182: 0, 0.5: 0}
    discs = [Disc(0.03 + 0.05 * k, 0.08, fixed=True) for k in range(len(shares))]
    discs += [Disc(disc.x, disc.y - D + 1e-7) for disc in discs]
    solver = RIGID if kind == "rigid" else {"kind": "md", "k_r": 2e6, "restitution": 0.3, "step": 5e-5}
    effects = {"cohesion": {"bond_number": 1.25}, "moisture": {"wetness": 0.0, **STILL}}
    sim = simulate(discs, (0.4, 0.1), solver, gravity=(0, -G), effects=effects)
    for disc, share in zip(discs, shares, strict=False):
        sim.wet(disc.x, disc.y - R, D, share)
    sim.advance(0.3)
    hang = sim.positions[len(shares) :, 1] > 0.08 - 1.1 * D
    assert list(hang) == [bool(holds) for holds in shares.values()]


def test_sleepers_wake_when_their_bridges_dry() -> None:
    """A disc hangs asleep; as it dries its bridge lets go, and it wakes and falls. Another, wetted through by hand, wakes at once."""
    for rate in (3.0, 0.0):
        discs = [Disc(0.05, 0.08, fixed=True), Disc(0.05, 0.08 - D + 1e-7)]
        sleep = {"speed": 0.05, "time": 0.05}
        effects = {"cohesion": {"bond_number": 2.0}, "moisture": {"wetness": 0.1, "evaporation": rate, **STILL}, "sleeping": sleep}
        sim = simulate(discs, (0.1, 0.1), RIGID, gravity=(0, -G), effects=effects)
        sim.advance(0.5)
        assert sim.report()["grains_asleep"] == 2 and sim.positions[1, 1] > 0.08 - 1.1 * D
        if rate == 0.0:
            sim.wet(0.05, 0.08, 2 * D, 0.9)
            assert sim.report()["grains_asleep"] == 0
        sim.advance(1.5)
        assert sim.positions[1, 1] < 0.08 - 2 * D
        del sim
