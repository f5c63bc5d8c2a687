"""Hard cases of `taichi-sand stress`: grains and water (physics.md C). Discs of 1 cm, cells of 2 to 3 cm."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from taichi_sand.study.laboratory import G, R, simulate
from taichi_sand.study.stress.gates import DOWN, Gate, case, sound

KAPPA, RHO_S, RHO = 2 / 3, 2650.0, 1000.0
"""Grains are spheres to the water, in a slab one grain thick: what they give it counts so much."""
SIZE = (0.4, 0.5)
LOOSE = {"radius": [0.8 * R, 1.2 * R], "count": 200, "fill": "lattice", "pitch": 1.2, "jitter": 0.1}


def flooded(solver: dict[str, Any], regions: list, grains: list, size: tuple = SIZE, **keys: Any) -> Any:
    """Grains, and water in these regions."""
    tables = [{"region": region} for region in regions] + keys.pop("wells", [])
    effects = {"water": {"cell": 2.5}, "friction": {"mu": 0.5}}
    return simulate(grains, size, solver, gravity=DOWN, water=tables, effects=effects, duration=keys.pop("duration", 1.0), **keys)


def markers(sim: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Places [m] and velocities [m/s] of the markers, and the water that one is [m2]."""
    f = sim.pausing["water"].fluid
    now = f.now[None]
    place, velocity = (x.to_numpy()[: now.markers].astype(float) for x in (f.place, f.velocity))
    return (place - 0.5) * [now.width, now.height], velocity, float(now.marker * now.width * now.height)


def energy(sim: Any) -> float:
    """Of motion and height, of the water and of what the grains are to it [J]; those that can move."""
    place, velocity, area = markers(sim)
    water = RHO * area * (0.5 * (velocity**2).sum() + G * place[:, 1].sum())
    mass = RHO_S * math.pi * sim.radii**2
    return float(water + KAPPA * (mass * (0.5 * (sim.velocities**2).sum(axis=1) + G * sim.positions[:, 1])).sum())


def weight(sim: Any) -> float:
    """What all of it is worth, from top to bottom of the box [J]."""
    place, _, area = markers(sim)
    return G * sim.scene.size[1] * (RHO * area * len(place) + KAPPA * float((RHO_S * math.pi * sim.radii**2).sum()))


def wet(sim: Any, grains: int, water: float) -> Iterator[Gate]:
    """Sound, and as much water as there was, none of it squeezed into less room than it needs."""
    yield from sound(sim, grains)
    place, velocity, area = markers(sim)
    finite = bool(np.isfinite(place).all() and np.isfinite(velocity).all())
    yield Gate("markers that are not finite", float(not finite), 0.0)
    yield Gate("water lost or gained, over what there was", abs(len(place) * area / water - 1.0), 1e-6)


def squeezed(sim: Any) -> Gate:
    """How much less or more room than its volume the water takes: mean fill of the cells that have water all around them. In pores markers
    may stay too near to one another, see pressure.BAND: a bed that water was poured on holds a tenth too much, 2.6 % of all of it.
    """
    f = sim.pausing["water"].fluid
    now = f.now[None]
    shape = (now.columns + 2, now.rows + 2)
    fill, pores, kind = (
        x.to_numpy()[: shape[0] * shape[1]].reshape(shape)[1:-1, 1:-1] for x in (f.cells.fill, f.cells.pores, f.cells.kind)
    )
    wet = np.pad(kind == 1, 1, constant_values=True)
    inner = np.lib.stride_tricks.sliding_window_view(wet, (3, 3)).all(axis=(2, 3))
    mean = (fill * pores)[inner].sum() / pores[inner].sum() if inner.any() else 1.0
    return Gate("volume of the water, off by", abs(float(mean) - 1.0), 0.03)


def watched(sim: Any, seconds: float, grains: int, gain: float = 0.0) -> Iterator[Gate]:
    """So long, with an eye on the energy, which may only rise by `gain` [J]."""
    start, whole, most = energy(sim), weight(sim), -math.inf
    water = sim.report()["water_m2"]
    for _ in range(max(1, round(30 * seconds))):
        sim.advance(1 / 30)
        most = max(most, energy(sim) - start)
    yield Gate("energy out of nothing / m g H", (most - gain) / whole, 0.01)
    yield from wet(sim, grains, water)


@case("bed-thrown-in", "200 grains are thrown into water at 3 m/s (C27)")
def bed_thrown_in(solver: dict[str, Any]) -> Iterator[Gate]:
    """C27."""
    grains = [{**LOOSE, "region": [0.05, 0.25, 0.35, 0.49], "velocity": [0.0, -3.0]}]
    sim = flooded(solver, [[0.0, 0.0, 0.4, 0.2]], grains)
    yield from watched(sim, 2.0, sim.count)
    yield squeezed(sim)


@case("poured-on", "water falls on a dry bed (C27)")
def poured_on(solver: dict[str, Any]) -> Iterator[Gate]:
    """C27."""
    sim = flooded(solver, [[0.05, 0.3, 0.35, 0.48]], [{**LOOSE, "pitch": 1.02, "region": [0.0, 0.0, 0.4, 0.15]}])
    yield from watched(sim, 2.0, sim.count)
    yield squeezed(sim)


@case("brimful", "a box full of grains and water, and a spring that finds no room (C27)")
def brimful(solver: dict[str, Any]) -> Iterator[Gate]:
    """C27."""
    wells = [{"region": [0.1, 0.1, 0.3, 0.2], "rate": 0.05, "since": 0.3}]
    sim = flooded(solver, [[0.0, 0.0, *SIZE]], [{**LOOSE, "pitch": 1.3, "region": [0.0, 0.0, *SIZE]}], wells=wells)
    water = sim.report()["water_m2"]
    sim.advance(1.0)
    yield from wet(sim, sim.count, water)
    yield Gate("spring not told", float(not any("well up" in flag for flag in sim.flags())), 0.0)
    yield Gate("speed of the water / sqrt(g h)", sim.report()["water_speed_max_m_s"] / math.sqrt(G * SIZE[1]), 0.5)


@case("wet-piston", "a piston drives water through a bed that is held (C27)")
def wet_piston(solver: dict[str, Any]) -> Iterator[Gate]:
    """C27."""
    walls = [{"points": [[0.031, -0.02], [0.031, 0.52]], "velocity": [0.05, 0.0]}]
    x, y = np.meshgrid(np.arange(0.2, 0.3, 0.0105), np.arange(0.005, 0.2, 0.0105), indexing="ij")
    bed = [{"positions": np.stack([x.ravel(), y.ravel()], axis=1).tolist(), "radius": R, "fixed": True}]
    sim = flooded(solver, [[0.032, 0.0, 0.4, 0.15]], bed, walls=walls)
    water = sim.report()["water_m2"]
    sim.advance(2.0)
    yield from wet(sim, sim.count, water)
    place, _, _ = markers(sim)
    edge = 0.031 + 0.05 * sim.time
    yield Gate("water that has got behind it, over all of it", float((place[:, 0] < edge).mean()), 0.01)
    yield squeezed(sim)


@case("wet-drum", "a drum that turns, half full of grains and water (C27)")
def wet_drum(solver: dict[str, Any]) -> Iterator[Gate]:
    """C27."""
    angle = np.linspace(0.0, 2 * np.pi, 49)[:-1]
    points = 0.25 + 0.23 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    walls = [{"points": points.tolist(), "closed": True, "spin": 1.5, "pivot": [0.25, 0.25]}]
    grains = [{**LOOSE, "count": 150, "region": [0.1, 0.1, 0.4, 0.3]}]
    sim = flooded(solver, [[0.12, 0.07, 0.38, 0.22]], grains, size=(0.5, 0.5), walls=walls)
    water = sim.report()["water_m2"]
    sim.advance(2.0)
    yield from wet(sim, sim.count, water)
    place, _, _ = markers(sim)
    yield Gate("water that has got out, over all of it", float((np.hypot(*(place - 0.25).T) > 0.23).mean()), 0.01)


@case("bullet-in-water", "a grain hits water at 100 m/s (C27)")
def bullet_in_water(solver: dict[str, Any]) -> Iterator[Gate]:
    """C27."""
    sim = flooded(solver, [[0.0, 0.0, 0.4, 0.25]], [{"positions": [[0.2, 0.45]], "radius": R, "velocity": [0.0, -100.0]}])
    yield from watched(sim, 1.0, 1)
    yield squeezed(sim)


@case("water-flips", "gravity is turned and reversed above water and grains (C27)")
def water_flips(solver: dict[str, Any]) -> Iterator[Gate]:
    """C27."""
    sim = flooded(solver, [[0.0, 0.0, 0.4, 0.2]], [{**LOOSE, "region": [0.0, 0.0, 0.4, 0.3]}])
    water = sim.report()["water_m2"]
    for k in range(6):
        angle = 2.4 * k
        sim.set("gravity", [G * math.sin(angle), -G * math.cos(angle)])
        sim.advance(0.25)
    yield from wet(sim, sim.count, water)
    sim.set("gravity", list(DOWN))
    sim.advance(1.5)
    yield from wet(sim, sim.count, water)
    yield squeezed(sim)
