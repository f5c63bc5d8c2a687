"""Water: still, with grains in it, through beds, in waves. References: hydrostatics, Di Felice, Ergun, linear waves, Martin & Moyce."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from helpers import G, fresh_taichi

import taichi_sand as sand
from taichi_sand.effects.water.grid import RATE

ROOM = 2000
"""Grains that all worlds here have room for, so that they share their kernels."""
D, RHO, RHO_S, MU = 0.006, 1000.0, 2650.0, 1e-3


def wet(size: Sequence[float], regions: Sequence[Sequence[float]], grains: Sequence[dict] = (), **keys: Any) -> sand.Simulation:
    """A simulation with water in `regions`; without grains there is one, which is fixed in a corner, of D. `cell` in D."""
    table = {"cell": 3.0, **keys.pop("water", {})}
    grains = grains or [{"positions": [[size[0] - D, size[1] - D]], "radius": D / 2, "fixed": True}]
    count = sum(len(one["positions"]) for one in grains)
    fresh_taichi()
    solver = {"kind": keys.pop("kind", "rigid")}
    scene = sand.Scene(size=size, grains=grains, solver=solver, water=[{"region": r} for r in regions], effects={"water": table}, **keys)
    return sand.Simulation(scene, threads=1, room=ROOM - count)


def fluid(sim: sand.Simulation) -> Any:
    """Tables of the water."""
    return sim.pausing["water"].fluid


def grid(sim: sand.Simulation, table: Any) -> np.ndarray:
    """A table of the grid, (columns, rows), without what lies beyond the edges."""
    now = fluid(sim).now[None]
    return table.to_numpy()[: (now.columns + 2) * (now.rows + 2)].reshape(now.columns + 2, now.rows + 2)[1:-1, 1:-1].astype(float)


def pressure(sim: sand.Simulation) -> np.ndarray:
    """In the middles of cells [Pa]."""
    now = fluid(sim).now[None]
    return grid(sim, fluid(sim).cells.pressure) * now.density / now.step


def markers(sim: sand.Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Places [m] and velocities [m/s] of the markers."""
    f, now = fluid(sim), fluid(sim).now[None]
    place = (f.place.to_numpy()[: now.markers].astype(float) - 0.5) * [now.width, now.height]
    return place, f.velocity.to_numpy()[: now.markers].astype(float)


def test_still_water() -> None:
    """W1. Pressure ρ g (h - y), and the speed and volume stay."""
    size, h = (0.5, 0.45), 0.275
    sim = wet(size, [[0, 0, size[0], h]])
    start = len(markers(sim)[0])
    sim.advance(10.0)
    now = fluid(sim).now[None]
    y = (np.arange(now.rows) + 0.5) * now.height
    inside = grid(sim, fluid(sim).cells.kind) == 1
    error = np.abs(pressure(sim) - RHO * G * (h - y))[inside].max() / (RHO * G * h)
    speed = now.fastest / math.sqrt(G * h)
    assert error < 1e-3
    assert speed < 1e-3
    assert len(markers(sim)[0]) == start and abs(grid(sim, fluid(sim).cells.fill).sum() * now.width * now.height / (size[0] * h) - 1) < 0.01


@pytest.mark.parametrize("kind", ["rigid", "md"])
def test_grains_in_still_water(kind: str) -> None:
    """W2, W3. On the floor a grain weighs ρ_s - ρ; as heavy as water it hovers; lighter it floats where its weight is displaced."""
    size, depth = (1.0, 1.0), 0.9
    places = {2650.0: [[0.1, D / 2]], 1000.0: [[0.3, 0.4]], 500.0: [[0.5, 0.89]], 800.0: [[0.7, 0.88]]}
    grains = [{"positions": place, "radius": D / 2, "density": density} for density, place in places.items()]
    sim = wet(size, [[0, 0, size[0], depth]], grains, kind=kind)
    start = sim.positions
    sim.advance(4.0)
    force, moved = sim.report()["floor_force_N"], np.hypot(*(sim.positions - start).T)
    assert force == pytest.approx((RHO_S - RHO) * math.pi * D**2 / 4 * G, rel=0.01)
    assert moved[1] < 1e-4
    for k, share in ((2, 0.5), (3, 0.8)):
        assert abs((depth - sim.positions[k, 1]) - afloat(share) * D / 2) < 0.1 * D


def afloat(share: float) -> float:
    """How deep the middle of a disc lies of which `share` is under water, over its radius."""
    x = np.linspace(-1, 1, 20001)
    return float(np.interp(share, 1 - (np.arccos(x) - x * np.sqrt(1 - x * x)) / np.pi, x))


TERMINAL = {0.004: 0.391, 0.006: 0.502, 0.010: 0.675}
"""Speed at which a sphere of this diameter and 2650 kg/m3 sinks in water, by the drag of Dallavalle [m/s]."""


@pytest.mark.parametrize("kind", ["rigid", "md"])
def test_terminal_speed(kind: str) -> None:
    """W3. All three sink side by side, each in its own water: 2 % for what the grid smears."""
    grains = [{"positions": [[0.2 + 0.3 * k, 1.1]], "radius": d / 2, "density": RHO_S} for k, d in enumerate(TERMINAL)]
    sim = wet((1.0, 1.25), [[0, 0, 1.0, 1.15]], grains, kind=kind, water={"cell": 4.0})
    sim.advance(0.6)
    before, time = sim.positions, sim.time
    sim.advance(0.6)
    speed = -(sim.positions - before)[:, 1] / (sim.time - time)
    assert speed == pytest.approx(list(TERMINAL.values()), rel=0.02)


def test_waves() -> None:
    """W10. ω² = g k tanh(k h) for the lowest wave in a tank."""
    for width, height, period in ((0.5, 0.25, 0.836), (1.0, 0.5, 1.182)):
        sim = wet((width, 2 * height), [[0, 0, width, height]], water={"cell": 3.0 * width / 0.5})
        push(sim, 0.02 * math.sqrt(G * height))
        lean, times = [], []
        while sim.time < 2.3 * period:
            sim.advance(period / 25)
            place, _ = markers(sim)
            lean.append((place[:, 0] - width / 2).mean())
            times.append(sim.time)
        found = crossings(np.array(times), np.array(lean))
        assert np.mean(np.diff(found)) * 2 == pytest.approx(period, rel=0.02)


def push(sim: sand.Simulation, speed: float) -> None:
    """Gives the water the motion of the lowest wave as it passes through level, at most so fast at the surface [m/s]."""
    f, now = fluid(sim), fluid(sim).now[None]
    place, _ = markers(sim)
    k = math.pi / (now.columns * now.width)
    x, y, top = k * place[:, 0], k * place[:, 1], math.cosh(k * place[:, 1].max())
    whole = f.velocity.to_numpy()
    whole[: len(place)] = speed / top * np.stack([np.cosh(y) * np.sin(x), -np.sinh(y) * np.cos(x)], axis=1)
    f.velocity.from_numpy(whole)
    f.u.speed.copy_from(f.u.before)
    f.v.speed.copy_from(f.v.before)


def crossings(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Times at which values change sign, by straight lines between them."""
    k = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
    return times[k] - values[k] * (times[k + 1] - times[k]) / (values[k + 1] - values[k])


MARTIN_MOYCE = ((2.0, 2.29), (3.35, 4.13), (4.42, 5.88), (5.69, 7.95), (7.44, 10.96), (9.24, 13.97))
"""Front of a column twice as high as wide on a dry floor: T = t sqrt(2 g / a), Z = x / a (Martin & Moyce 1952)."""


def test_dam_break() -> None:
    """W9. The front runs as in the experiment, to 10 % for T > 2."""
    a = 0.05715
    size = (15 * a, 3 * a)
    sim = wet(
        size, [[0, 0, a, 2 * a]], [{"positions": [[size[0] - D, size[1] - D]], "radius": D / 2, "fixed": True}], water={"cell": a / 5 / D}
    )
    found = []
    for t, z in MARTIN_MOYCE[1:]:
        sim.advance_to(t / math.sqrt(2 * G / a))
        found.append(np.sort(markers(sim)[0][:, 0])[-3] / a / z)
    assert np.abs(np.array(found) - 1).max() < 0.1


def test_a_block_settles() -> None:
    """W7. Grains that sink in a box full of water push as much of it up: ε u + s v = 0 through every level."""
    size = (0.3, 0.4)
    x, y = np.meshgrid(np.arange(0.02, 0.281, 0.009), np.arange(0.2, 0.33, 0.009), indexing="ij")
    grains = [{"positions": np.stack([x.ravel(), y.ravel()], axis=1).tolist(), "radius": D / 2, "density": RHO_S}]
    sim = wet(size, [[0, 0, *size]], grains)
    fluid(sim).now[None].rate = 0.0  # a source of its own
    flux = []
    for _ in range(6):
        sim.advance(0.05)
        flux.append(level_flux(sim))
    assert max(flux) < 1e-3


def level_flux(sim: sand.Simulation) -> float:
    """Largest flux through a level, over that of the grains."""
    f, now = fluid(sim), fluid(sim).now[None]
    shape = (now.columns + 2, now.rows + 2)
    solid = f.v.solid.to_numpy()[: shape[0] * shape[1]].reshape(*shape, 4)[1:-1, 1:-1].astype(float)
    speed, pull = (x.to_numpy()[: shape[0] * shape[1]].reshape(shape)[1:-1, 1:-1].astype(float) for x in (f.v.speed, f.v.pull))
    grains = solid[..., 1] - solid[..., 2] * pull * now.step / now.density
    total = ((1 - solid[..., 0]) * speed + grains).sum(axis=0)
    return float(np.abs(total[2:]).max() / np.abs(grains.sum(axis=0)).max())


def ergun(gradient: float, pores: float, viscosity: float = MU) -> float:
    """Speed of water through a bed of spheres of D under a hydraulic gradient, over all of the cross-section [m/s] (Ergun 1952)."""
    viscous = 150 * viscosity * (1 - pores) ** 2 / (pores**3 * D**2)
    inert = 1.75 * RHO * (1 - pores) / (pores**3 * D)
    return (math.sqrt(viscous**2 + 4 * inert * RHO * G * gradient) - viscous) / (2 * inert)


def excess(sim: sand.Simulation, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights of the middles of cells [m], and the mean pressure there over that of still water, for so long [Pa]."""
    now = fluid(sim).now[None]
    y, found, end = (np.arange(now.rows) + 0.5) * now.height, [], sim.time + time
    while sim.time < end:
        sim.advance_steps(sim.due["water"] - sim.steps)
        found.append(pressure(sim).mean(axis=0))
    return y, np.mean(found, axis=0) + RHO * G * y


def well(sim: sand.Simulation, speed: float) -> None:
    """Has the water rise with this mean speed [m/s], from below to a drain under its surface."""
    now, rate = fluid(sim).now[None], fluid(sim).wells.rate
    rate[0], rate[1] = speed * now.columns * now.width, -speed * now.columns * now.width


def upwards(width: float, depth: float, grains: list[dict], height: float) -> sand.Simulation:
    """Water `depth` deep with a well at the bottom and a drain under the surface, not flowing yet."""
    fresh_taichi()
    tables = [{"region": [0, 0, width, depth]}, {"region": [0, 0, width, 0.03], "rate": 1e-9}]
    tables.append({"region": [0, depth - 0.06, width, depth - 0.02], "rate": -1e-9})
    effects = {"water": {"drag": "gidaspow"}, "friction": {"mu": 0.5}}
    scene = sand.Scene(size=[width, height], grains=grains, water=tables, effects=effects, seed=2, duration=0.1)
    return sand.Simulation(scene, threads=1, room=ROOM)


def lattice(width: float, low: float, high: float, pores: float) -> tuple[list[list[float]], float]:
    """A hexagonal bed of about this porosity, and the one that it has."""
    pitch = D * math.sqrt(math.pi / (2 * math.sqrt(3)) / (1.5 * (1 - pores)))
    columns, rows = round(width / pitch), round((high - low) / pitch / math.sqrt(0.75))
    x, y = width / columns, (high - low) / rows
    places = [[(k + 0.25 + 0.5 * (r % 2)) * x, low + (r + 0.5) * y] for r in range(rows) for k in range(columns)]
    return places, 1 - 2 / 3 * math.pi * D**2 / 4 / (x * y)


def test_seepage() -> None:
    """W4, W5. Through a bed that is held water flows as Ergun measured; viscous water as Darcy did; twice as easily if asked for."""
    width, low, high = 0.126, 0.108, 0.36
    places, pores = lattice(width, low, high, 0.453)
    sim = upwards(width, 0.45, [{"positions": places, "radius": D / 2, "fixed": True}], 0.54)
    for viscosity, gradient, ease in ((MU, 0.5, 1.0), (0.1, 0.5, 1.0), (0.1, 0.5, 2.0)):
        sim.set("effects.water.viscosity", viscosity)
        sim.set("effects.water.permeability", ease)
        fluid(sim).now[None].rate = RATE if viscosity == MU else 0.0  # bringing markers back makes flows as slow as this one
        speed = ergun(gradient, pores, viscosity)
        well(sim, speed)
        sim.advance(0.4)
        y, p = excess(sim, 1.2)
        inside = (y > low + 0.06) & (y < high - 0.06)
        found = -np.polyfit(y[inside], p[inside], 1)[0] / (RHO * G)
        assert ergun(ease * found, pores, viscosity) == pytest.approx(speed, rel=0.03)


def test_quicksand() -> None:
    """W6. Below the speed of fluidisation the bed rests; above it it swells, and the water bears its weight."""
    width = 0.18
    grains = [{"radius": [0.00285, 0.00315], "fill": "hexagonal", "region": [0, 0, width, 0.16], "jitter": 0.05, "pitch": 1.03}]
    sim = upwards(width, 0.35, grains, 0.45)
    sim.advance(1.0)
    top = np.sort(sim.positions[:, 1])[-8]
    weight = sim.count * 2 / 3 * math.pi * D**2 / 4 * (RHO_S - RHO) * G / width
    pores = 1 - weight / ((RHO_S - RHO) * G * (top + D / 2))
    onset = ergun((1 - pores) * (RHO_S / RHO - 1), pores)
    well(sim, 0.85 * onset)
    sim.advance(1.0)
    assert np.sort(sim.positions[:, 1])[-8] < top + 0.1 * D
    well(sim, 1.3 * onset)
    sim.advance(1.0)
    above, drops = [], []
    for _ in range(10):
        y, p = excess(sim, 0.1)
        above.append((sim.positions[:, 1] > y[2]).mean() * weight)  # below, water wells up
        drops.append(p[2] - p[(y > top + 0.05) & (y < 0.28)].mean())
    assert np.sort(sim.positions[:, 1])[-8] > top + 1.5 * D
    assert np.mean(drops) == pytest.approx(np.mean(above), rel=0.05)


def test_a_column_collapses_under_water() -> None:
    """W12. Slower than in air, and no farther."""
    grains = [{"radius": [0.0028, 0.0032], "fill": "hexagonal", "region": [0.0, 0.0, 0.06, 0.12], "jitter": 0.02}]
    fronts = []
    for depth in (None, 0.16):
        fresh_taichi()
        water = [] if depth is None else [{"region": [0.0, 0.0, 0.4, depth]}]
        effects = {"water": {}, "friction": {"mu": 0.5}}
        sim = sand.Simulation(sand.Scene(size=[0.4, 0.2], grains=grains, water=water, effects=effects, seed=2), threads=1, room=100)
        found = []
        for seconds in (0.15, 1.35):
            sim.advance(seconds)
            found.append(np.sort(sim.positions[:, 0])[-10])
        fronts.append(found)
        sim.close()
    dry, under = fronts
    assert under[0] - 0.06 < 0.6 * (dry[0] - 0.06)
    assert under[1] < dry[1]
