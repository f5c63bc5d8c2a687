"""What grains do in silos, drums and shaken boxes: minutes of computing, so only with `-m slow` (physics.md B1, B10, B11, B7)."""

import math
from itertools import pairwise

import numpy as np
import pytest
from helpers import G, fresh_taichi
from scipy.optimize import curve_fit

import taichi_sand as sand

pytestmark = pytest.mark.slow

RADII = (0.0024, 0.0036)
DISC = math.pi * (RADII[0] ** 2 + RADII[0] * RADII[1] + RADII[1] ** 2) / 3  # mean area
WIDTH = 31 * 0.006


def silo_load(fill: float, mu: float, seed: int = 3) -> tuple[float, float]:
    """Force on the floor of a silo, filled to so many of its widths, and the weight of the grains [N].

    The floor is lowered slowly, by 5 d before the load is measured: a deep bed gives way by a d or two, and its grains have to slide along
    the walls as far as that to bear on them.
    """
    fresh_taichi()
    speed, wait = 0.008, 4.0
    low = 0.03 + speed * (wait + 1.0)
    height = low + 1.3 * fill * WIDTH + 0.02
    grains = {"radius": RADII, "count": int(0.82 * fill * WIDTH**2 / DISC), "region": [0.0, low, WIDTH, height]}
    floor = {"points": [[0.0, low], [WIDTH, low]], "velocity": [0.0, -speed]}
    scene = sand.Scene(size=[WIDTH, height], grains=[grains], walls=[floor], seed=seed, effects={"friction": {"mu": mu}})
    sim = sand.Simulation(scene, threads=1)
    sim.advance(wait)
    loads = []
    for _ in range(20):
        sim.advance(0.05)
        loads.append(sim.report()["floor_force_N"])
    return float(np.mean(loads)), sim.report()["mass_kg"] * G


def test_silo_load_saturates() -> None:
    """B1, Janssen: the load follows (1 - exp(-z / L)) within 5 %, over four silos, with L = W / (2 mu K), 1.67 widths for K = 0.6."""
    fills = [0.5, 1.0, 1.75, 2.75, 4.0]
    found = np.mean([[silo_load(fill, 0.5, seed) for fill in fills] for seed in range(3, 7)], 0)
    law = lambda z, most, length: most * (1 - np.exp(-z / length))
    (most, length), _ = curve_fit(law, fills, found[:, 0], p0=(found[-1, 0], 1.5))
    residual = np.abs(law(np.array(fills), most, length) - found[:, 0]).max() / found[-1, 0]
    print(f"loads {found[:, 0].round()} of weights {found[:, 1].round()}, limit {most:.0f} N, L = {length:.2f} W, residual {residual:.3f}")
    assert residual < 0.05 and found[-1, 0] < 0.55 * found[-1, 1]
    assert 1.2 < length < 2.4


def test_smooth_silo_bears_its_weight() -> None:
    """B1: without friction the load on the floor is the weight, within 1 %."""
    load, weight = silo_load(1.75, 0.0)
    print(f"load {load:.1f} of {weight:.1f} N")
    assert load == pytest.approx(weight, rel=0.01)


def turning_drum(froude: float) -> sand.Simulation:
    """The scene `drum` at this Froude number w^2 D / (2 g)."""
    fresh_taichi()
    return sand.Simulation(sand.load("drum", [f"walls.0.spin={-math.sqrt(2 * G * froude / 0.473):.6f}"]), threads=1)


def surface_angle(sim: sand.Simulation) -> float:
    """Slope of the surface [degrees], from the highest grains of the middle columns."""
    x = sim.positions
    columns = np.linspace(0.15, 0.35, 21)
    tops = [x[(x[:, 0] >= low) & (x[:, 0] < high), 1].max() for low, high in pairwise(columns)]
    return -math.degrees(math.atan(np.polyfit((columns[:-1] + columns[1:]) / 2, tops, 1)[0]))


def test_drum_rolls_slowly() -> None:
    """B10: at Fr = 0.005 the surface stays at one angle, within 2 degrees."""
    sim = turning_drum(0.005)
    sim.advance(6.0)
    angles = []
    for _ in range(60):
        sim.advance(0.1)
        angles.append(surface_angle(sim))
    second = np.array(angles).reshape(6, 10).mean(1)  # single avalanches come and go
    print(f"angle {np.mean(angles):.1f} degrees, means of a second {second.min():.1f} .. {second.max():.1f}")
    assert 12 < np.mean(angles) < 35 and np.abs(second - second.mean()).max() < 2.0


def going_round(froude: float, grains: int) -> tuple[np.ndarray, np.ndarray]:
    """How fast each grain goes round after 3 s, over the drum, and its distance from the axis over the drum's radius."""
    fresh_taichi()
    spin = -math.sqrt(2 * G * froude / 0.473)
    scene = sand.load("drum", [f"walls.0.spin={spin}", *(f"grains.{k}.count={grains // 2}" for k in (0, 1))])
    sim = sand.Simulation(scene, threads=1)
    sim.advance(3.0)
    assert sim.lost == 0
    return turning(sim, spin, 0.2365)


def turning(sim: sand.Simulation, spin: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """How fast each grain goes round, over the spin of the drum, and its distance from the axis over the drum's radius."""
    way, v = sim.positions - 0.25, sim.velocities
    return (way[:, 0] * v[:, 1] - way[:, 1] * v[:, 0]) / (way**2).sum(1) / spin, np.hypot(*way.T) / radius


def test_drum_centrifuges_fast() -> None:
    """B10: a layer goes round with the drum at Fr = 6, at 1.3 hardly a grain does.

    What is carried round needs friction of tan = 1 / sqrt(Fr^2 - 1) at most: 0.17 at 6, but 1.2 at 1.3, where it presses on the drum
    with 0.3 of its weight at the top. Rolling discs at mu = 0.5 bear 0.3 (mu(I) at rest, B12), so Fr = 1.3 is not enough for them. Nor
    for the inner grains of a drum that is half full, whatever the friction: theirs is Fr = 0.92, and they fall.
    """
    share, radius = going_round(6.0, 600)
    print(f"Fr = 6: turning / that of the drum {share.min():.2f} .. {share.max():.2f}, inmost at {radius.min():.2f} of the radius")
    assert np.abs(share - 1).max() < 0.05 and radius.min() > 0.8
    share, radius = going_round(1.3, 600)
    print(f"Fr = 1.3: {np.mean(np.abs(share - 1) < 0.1):.2f} go round, inmost at {radius.min():.2f} of the radius")
    assert np.mean(np.abs(share - 1) < 0.1) < 0.2 and radius.min() < 0.5


@pytest.mark.parametrize("kind", ["rigid", "md"])
@pytest.mark.parametrize(("froude", "all_round"), [(1.3, True), (0.8, False)])
def test_grooved_drum_carries_all_round_above_one(froude: float, all_round: bool, kind: str) -> None:
    """B10: grooves as wide as a grain hold steeper than 1.2. A hundred grains in 166 of them all go round with the drum at Fr = 1.3, and
    go on to; at 0.8 those at the top fall.
    """
    fresh_taichi()
    angles, radius = np.pi * np.arange(332) / 166, 0.24
    rim = np.where(np.arange(332) % 2, radius - 0.0056, radius)
    points = 0.25 + rim[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
    spin = -math.sqrt(froude * G / radius)
    drum = {"closed": True, "points": points.tolist(), "spin": spin, "pivot": [0.25, 0.25]}
    grains = {"radius": [0.003, 0.004], "count": 100, "region": [0.15, 0.05, 0.35, 0.2]}
    keys = {"solver": {"kind": kind, "tolerance": 0.01}, "effects": {"friction": {"mu": 0.5}}}
    sim = sand.Simulation(sand.Scene(size=[0.5, 0.5], seed=2, grains=[grains], walls=[drum], **keys), threads=1)
    sim.advance(20.0)
    slowest = []
    for _ in range(10):
        sim.advance(0.2)
        share, _ = turning(sim, spin, radius)
        slowest.append(float(share.min()))
    print(f"Fr = {froude}, {kind}: the slowest grain at {min(slowest):.3f} .. {max(slowest):.3f} of the drum's spin")
    assert sim.flags() == [] and sim.count == 100
    assert (min(slowest) > 0.99) if all_round else (max(slowest) < 0.9)


@pytest.mark.parametrize("seed", [6, 7])
def test_brazil_nut_rises(seed: int) -> None:
    """B11: at 3 g the large disc is in the upper third within 500 cycles."""
    fresh_taichi()
    sim = sand.Simulation(sand.load("brazil_nut", [f"seed={seed}"]), threads=1)
    cycles = 0
    while cycles < 500:
        sim.advance(12 / 12.0)
        cycles += 12
        y = sim.positions[:, 1]
        if y[0] > np.percentile(y[1:], 67):
            break
    print(f"in the upper third after {cycles} cycles")
    assert cycles < 500


@pytest.mark.xfail(reason="grains creep on: at tolerance 0.02 by a median of 0.3 d in six cycles, at 0.005 by 0.04 d, with either solver")
def test_bed_shaken_below_one_g_stays() -> None:
    """B11, C25: at 0.8 g nobody goes anywhere."""
    fresh_taichi()
    weak = f"walls.0.shake.amplitude=[0.0, {0.8 * G / (24 * math.pi) ** 2}]"
    still = sand.Simulation(sand.load("brazil_nut", [weak, "solver.tolerance=0.02"]), threads=1)
    still.advance(3.0)
    before = still.positions
    still.advance(5.0)  # whole cycles
    assert np.abs(still.positions - before).max() < 0.1 * 0.0066


def drain(seed: int) -> list[float]:
    """Rates [1/s] at which a bin over a steep funnel drains, as its fill falls from 3 widths to 1.2 in six steps."""
    fresh_taichi()
    width, out, top = 0.2, 0.018, 1.8
    shoulder = 0.2 + 2.9 * (width / 2 - out)
    funnel = [{"points": [[x, top], [x, shoulder], [x + way * (width / 2 - out), 0.2]]} for x, way in ((0.1, 1), (0.1 + width, -1))]
    grains = {"radius": [0.0026, 0.0034], "count": 6600, "region": [0.1, shoulder, 0.1 + width, top]}
    sinks = [{"region": [0, 0, 0.4, 0.1]}]
    scene = sand.Scene(size=[0.4, top], grains=[grains], walls=funnel, sinks=sinks, seed=seed, effects={"friction": {"mu": 0.5}})
    sim = sand.Simulation(scene, threads=1)
    times, passed, fill = [], [], [math.inf]
    while fill[-1] > 1.2:
        sim.advance(0.1)
        inside = sim.positions[sim.positions[:, 1] > 0.19]
        times.append(sim.time)
        passed.append(6600 - len(inside))
        fill.append((np.percentile(inside[:, 1], 98) - shoulder) / width)
        assert sim.time < 20
    step = np.digitize(fill[1:], np.linspace(3.0, 1.2, 7))
    return [float(np.polyfit(np.array(times)[step == k], np.array(passed)[step == k], 1)[0]) for k in range(1, 7)]


@pytest.fixture(scope="module")
def rates() -> np.ndarray:
    """Of eight bins (rows), as their fill falls from 3 widths to 1.2 (columns)."""
    found = np.array([drain(seed) for seed in range(1, 9)])
    print(f"{found.mean(0).round()} ± {(found.std(0) / math.sqrt(8)).round()} grains a second")
    return found


def test_hopper_drains_at_one_rate(rates: np.ndarray) -> None:
    """The rate does not depend on the fill: it is within 5 % of its mean from 3 widths to 1.2, and so are those of single bins.

    The fill is that of the bin above its funnel, which is 71 degrees steep: nothing stays behind on it.
    """
    mean, bins = rates.mean(0), rates.mean(1)
    assert np.abs(mean / mean.mean() - 1).max() < 0.05 and bins.std() < 0.05 * bins.mean()


@pytest.mark.xfail(reason="it falls by 5.2 ± 1.5 % (rigid; md, at 60 degrees, by 7): the load at the outlet still grows with the fill (B1)")
def test_hopper_drains_no_slower_in_the_end(rates: np.ndarray) -> None:
    """A line through the rate drifts by less than 5 % from 3 widths to 1.2."""
    mean = rates.mean(0)
    change = np.polyfit(np.arange(6), mean, 1)[0] * 5 / mean.mean()
    print(f"changes by {change:.3f}")
    assert abs(change) < 0.05
