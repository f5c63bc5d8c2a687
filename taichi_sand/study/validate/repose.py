"""Angles of repose: heaps poured on a rough base, and a layer of grains that is tilted until it avalanches (physics.md B4).

`python -m taichi_sand.study.validate.repose` prints both as tables.

Heap: grains rain from a small source onto a row of fixed discs WIDTH diameters long; what rolls over its ends leaves. When all has come
to rest, straight lines are fitted to the tops of the middle 60 % of either flank; the angle is the mean of both.
Layer: LENGTH by DEPTH diameters of discs (35 by 120 in the published experiment) on fixed ones between two walls; gravity turns slowly.
It stays whenever the upper half flows, by FLOW diameters within LATENCY on average, until all has come to rest. If the surface is then
less steep by FALL that was an avalanche: the slopes of the surface against the horizontal before and after it are the angles of avalanche
and of repose. Lesser slips are forerunners, and gravity turns on.
"""

import argparse
import math
import statistics
from dataclasses import dataclass
from typing import Any

import numpy as np

import taichi_sand as sand
from taichi_sand.scene.shapes import BUILT_IN, form
from taichi_sand.study.laboratory import G, fresh_taichi

D = 0.004
"""Diameter of a disc, and of a disc with the area of any other shape [m]."""
SPREAD = 0.1
"""Sizes differ by so much either way."""
WIDTH, GRAINS, RATE = 100, 1680, 600.0
"""Of the base [d], grains poured, and how many a second."""
REST, MOST_REST, STILL = 0.5, 6.0, 0.02
"""Time in which grains come to rest, at a time and at most [s], and the speed that all must then be below [m/s]."""
SHAPES = ("disc", "triangle", "square")
SOLVERS = ("rigid", "md")
LENGTH, DEPTH = 120, 35
TURN, LATENCY = 2.0, 0.1
"""How fast gravity turns [degrees/s], and the time over which a flow is recognised [s]."""
FIRST_TILT, MOST_TILT = 10.0, 40.0
FLOW, FALL = 0.1, 2.0
"""Mean way of the upper half within LATENCY that is a flow [d], and the fall of the surface that makes it an avalanche [degrees]."""


@dataclass(frozen=True)
class Angle:
    """A measured angle [degrees], the standard error of its mean over the seeds, and their number."""

    mean: float
    error: float
    seeds: int

    @classmethod
    def of(cls, angles: list[float]) -> "Angle":
        """Mean and standard error of several measurements."""
        spread = statistics.stdev(angles) if len(angles) > 1 else math.nan
        return cls(statistics.mean(angles), spread / math.sqrt(len(angles)), len(angles))

    def __str__(self) -> str:
        return f"{self.mean:.1f} ± {self.error:.1f}"


def radius_of(shape: str) -> float:
    """The key `radius` of grains of a shape with the area of a disc of diameter D [m]."""
    one = form(shape, BUILT_IN[shape])
    return D / 2 * math.sqrt(math.pi / (one.area * one.reach**2))


def heap_scene(shape: str, kind: str, seed: int, mu: float = 0.5) -> sand.Scene:
    """Grains of a shape rain onto a row of fixed discs, whose ends are open."""
    side, radius = (WIDTH + 10) * D, radius_of(shape)
    row = [[(5.5 + k) * D, 0.02, D / 2] for k in range(WIDTH)]
    source = {"shape": shape, "radius": [(1 - SPREAD) * radius, (1 + SPREAD) * radius], "rate": RATE, "until": GRAINS / RATE}
    low = 0.02 + 0.32 * WIDTH * D
    source["region"] = [side / 2 - 0.08 * WIDTH * D, low, side / 2 + 0.08 * WIDTH * D, low + 8 * D]
    return sand.Scene(
        size=[side, low + 10 * D],
        seed=seed,
        edges={"left": "open", "right": "open", "bottom": "open", "top": "open"},
        grains=[{"positions": row, "fixed": True}],
        sources=[source],
        solver={"kind": kind},
        effects={"friction": {"mu": mu}},
    )


def surface(x: np.ndarray, top: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Highest point of each strip 1.5 D wide between `low` and `high` that holds any: where it is, and how high [m]."""
    strip = np.floor((x - low) / (1.5 * D)).astype(int)
    inside = (x >= low) & (x < high)
    highest = [np.flatnonzero(inside & (strip == k)) for k in range(math.ceil((high - low) / (1.5 * D)))]
    best = np.array([rows[np.argmax(top[rows])] for rows in highest if len(rows)])
    return x[best], top[best]


def heap_angle(sim: sand.Simulation) -> float:
    """Mean slope of the flanks [degrees]."""
    place, radius = sim.positions, sim.radii
    middle, half = (WIDTH + 10) * D / 2, WIDTH * D / 2
    slopes = []
    for way in (-1, 1):
        out = way * (place[:, 0] - middle)
        x, y = surface(out, place[:, 1] + radius, 0.2 * half, 0.8 * half)
        slopes.append(-np.polyfit(x, y, 1)[0])
    return math.degrees(math.atan(statistics.mean(slopes)))


def settle(sim: sand.Simulation) -> None:
    """Simulates until nothing moves, RuntimeError if something still does after MOST_REST."""
    for _ in range(round(MOST_REST / REST)):
        sim.advance(REST)
        if np.hypot(*sim.velocities.T).max() < STILL:
            return
    raise RuntimeError(f"{sim.scene.solver.kind}, seed {sim.scene.seed}: grains still move after {MOST_REST:g} s")


def heap(shape: str, kind: str, seed: int, mu: float = 0.5) -> float:
    """Angle of one poured heap [degrees]."""
    fresh_taichi()
    sim = sand.Simulation(heap_scene(shape, kind, seed, mu), threads=1)
    sim.advance(GRAINS / RATE)
    settle(sim)
    if flags := sim.flags():
        raise RuntimeError(f"heap of {shape}, {kind}, seed {seed}: {'; '.join(flags)}")
    return heap_angle(sim)


def layer_scene(kind: str, seed: int, length: int = LENGTH, depth: int = DEPTH, mu: float = 0.5) -> sand.Scene:
    """Discs that settle into a layer on a row of fixed ones, between walls."""
    count = round(length * depth * 0.82 / (math.pi / 4))
    return sand.Scene(
        size=[length * D, 2.0 * depth * D],
        seed=seed,
        grains=[
            {"radius": D / 2, "fill": "lattice", "region": [0.0, 0.0, length * D, D], "fixed": True},
            {
                "radius": [(1 - SPREAD) * D / 2, (1 + SPREAD) * D / 2],
                "fill": "lattice",
                "pitch": 1.25,
                "jitter": 0.1,
                "count": min(count, int((length / 1.25 - 1) * (1.5 * depth / 1.25))),
                "region": [0.0, D, length * D, 2.0 * depth * D],
            },
        ],
        solver={"kind": kind},
        effects={"friction": {"mu": mu}},
    )


def tilt(sim: sand.Simulation, degrees: float) -> None:
    """Turns gravity so that the box looks tilted down to the right."""
    angle = math.radians(degrees)
    sim.retune(sim.scene.model_copy(update={"gravity": (G * math.sin(angle), -G * math.cos(angle))}))


def layer(kind: str, seed: int, length: int = LENGTH, depth: int = DEPTH, mu: float = 0.5) -> tuple[float, float]:
    """Angles of avalanche and of repose of one layer [degrees]."""
    fresh_taichi()
    sim = sand.Simulation(layer_scene(kind, seed, length, depth, mu), threads=1)
    settle(sim)
    free = np.flatnonzero(sim.positions[:, 1] > D)
    upper = free[sim.positions[free, 1] > np.median(sim.positions[free, 1])]
    tilted = FIRST_TILT
    while tilted < MOST_TILT:
        tilt(sim, tilted)
        steep, before = tilted + surface_slope(sim, length), sim.positions[upper, 0]
        sim.advance(LATENCY)
        if (sim.positions[upper, 0] - before).mean() > FLOW * D:
            settle(sim)
            rest = tilted + surface_slope(sim, length)
            if steep - rest > FALL:
                return steep, rest
        tilted += TURN * LATENCY
    raise RuntimeError(f"layer, {kind}, seed {seed}: no avalanche below {MOST_TILT:g} degrees")


def surface_slope(sim: sand.Simulation, length: int) -> float:
    """Slope of the surface of a layer against its box, from its middle 60 % [degrees]; down to the right is positive."""
    x, y = surface(sim.positions[:, 0], sim.positions[:, 1] + sim.radii, 0.2 * length * D, 0.8 * length * D)
    return -math.degrees(math.atan(np.polyfit(x, y, 1)[0]))


def heaps(seeds: int) -> dict[tuple[str, str], Angle]:
    """The table of poured heaps, by solver and shape."""
    return {(kind, shape): Angle.of([heap(shape, kind, seed) for seed in range(seeds)]) for kind in SOLVERS for shape in SHAPES}


def main(arguments: list[str] | None = None) -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(prog="python -m taichi_sand.study.validate.repose", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="heaps and layers of each kind")
    parser.add_argument("--only", choices=("heaps", "layers"), help="one of the tables")
    options: Any = parser.parse_args(arguments)
    if options.only != "layers":
        print("heap [degrees]  " + "  ".join(f"{shape:>12}" for shape in SHAPES))
        found = heaps(options.seeds)
        for kind in SOLVERS:
            print(f"{kind:<14}  " + "  ".join(f"{found[kind, shape]!s:>12}" for shape in SHAPES), flush=True)
    if options.only != "heaps":
        print(f"{'layer [degrees]':<14} {'avalanche':>12}  {'repose':>12}")
        for kind in SOLVERS:
            both = [layer(kind, seed) for seed in range(options.seeds)]
            print(f"{kind:<14}  " + "  ".join(f"{Angle.of(list(column))!s:>12}" for column in zip(*both, strict=True)), flush=True)


if __name__ == "__main__":
    main()
