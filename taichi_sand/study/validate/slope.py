"""A slope down which discs flow for ever: what accuracy costs where nothing comes to rest.

A layer of LAYERS discs, sizes +-5 %, mu 0.5, e 0.3, flows down a box that is periodic along it, over a base of fixed discs that touch
and are raised by random 0 to 0.5 d. In a steady flow the inertial number I = (shear rate) d / sqrt(P / rho) follows from the angle:
tan(angle) = 0.25 + 1.1 I (da Cruz et al. 2005, doi 10.1103/PhysRevE.72.021309; physics.md B12), here at mid-depth. Larger spreads of
size flow more slowly than that (+-20 %: by a fifth, the same at tolerances 0.02 and 0.005 and with either solver).

`python -m taichi_sand.study.validate.slope` prints speeds and costs over a ladder of tolerances; `--plot FILE.png` draws I against the law.
"""

import argparse
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import taichi_sand as sand
from taichi_sand.study.laboratory import D, G, R, fresh_taichi

ANGLES, SEEDS = (19, 21, 23), (1, 2, 3)
LAYERS, WIDTH, SPREAD = 22, 25, 0.05
WARM, LONG, EVERY = 6.0, 8.0, 0.1
"""The flow is given so long to become steady, and looked at for so long, so often [s]."""
LADDER = {"rigid": (0.1, 0.05, 0.02, 0.005), "md": (0.05, 0.02, 0.01, 0.003)}


@dataclass(frozen=True)
class Flow:
    """What a slope did."""

    speed: float  # mean, down the slope, over sqrt(g d)
    inertial: float  # I at mid-depth
    softness: float  # as the report gives it
    overlap: float  # 99 % below, in d
    cost: float  # CPU time [s] a simulated second
    warned: bool  # by the report


def scene(kind: str, degrees: float, seed: int, layers: int = LAYERS, width: int = WIDTH, **solver: Any) -> Any:
    """The slope; `solver` are further keys of [solver]."""
    raised = R + D * np.random.default_rng(seed).uniform(0.0, 0.5, width)
    base = [[(k + 0.5) * D, float(y), R] for k, y in enumerate(raised)]
    lean, top = math.radians(degrees), (2 * layers + 6) * D
    loose = {"fill": "lattice", "pitch": 1.22, "jitter": 0.1, "region": [0.0, 2 * D, width * D, top]}
    return sand.Scene(
        size=[width * D, top],
        gravity=[G * math.sin(lean), -G * math.cos(lean)],
        seed=seed,
        grains=[
            {"positions": base, "fixed": True},
            {"radius": [(1 - SPREAD) * R, (1 + SPREAD) * R], "count": width * layers, **loose},
        ],
        edges={"left": "periodic", "right": "periodic", "bottom": "wall", "top": "open"},
        solver={"kind": kind, "restitution": 0.3, **solver},
        effects={"friction": {"mu": 0.5}},
    )


def law(degrees: float) -> float:
    """I on a slope of so many degrees (da Cruz et al. 2005)."""
    return (math.tan(math.radians(degrees)) - 0.25) / 1.1


def flow(kind: str, degrees: float, seed: int, warm: float = WARM, seconds: float = LONG, **keys: Any) -> Flow:
    """Runs a slope for `warm` seconds and looks at it for `seconds` more; `keys` as of `scene`."""
    fresh_taichi()
    sim = sand.Simulation(scene(kind, degrees, seed, **keys), threads=1)
    start = time.process_time()
    sim.advance(warm)
    first = keys.get("width", WIDTH)  # the base comes before those that flow
    speeds, heights, overlaps, soft = [], [], [], []
    for _ in range(round(seconds / EVERY)):
        sim.advance(EVERY)
        report = sim.report()
        speeds.append(sim.velocities[first:, 0])
        heights.append(sim.positions[first:, 1])
        overlaps.append(report["overlap_p99"])
        soft.append(report["flow_softness"])
    spent = time.process_time() - start
    speed = float(np.mean(speeds)) / math.sqrt(G * D)
    inertial = inertial_number(np.concatenate(heights), np.concatenate(speeds), sim, degrees, len(heights))
    return Flow(speed, inertial, float(np.median(soft)), float(np.mean(overlaps)), spent / (warm + seconds), bool(sim.warnings()))


def inertial_number(y: np.ndarray, v: np.ndarray, sim: Any, degrees: float, looks: int) -> float:
    """I at mid-depth, from heights [m] and speeds [m/s] of all grains at `looks` moments: the slope of the speed in the middle third, and
    the weight of what lies above.
    """
    bottom, top = 1.25 * D, np.percentile(y, 99)
    inside = np.abs(y - 0.5 * (bottom + top)) < 0.15 * (top - bottom)
    rate = np.polyfit(y[inside], v[inside], 1)[0]
    above = math.pi * R**2 * np.count_nonzero(y > 0.5 * (bottom + top)) / looks
    pressure = G * math.cos(math.radians(degrees)) * above / sim.scene.size[0]  # over the density
    return float(rate * D / math.sqrt(pressure))


def means(kind: str, degrees: float, seeds: tuple[int, ...] = SEEDS, **keys: Any) -> Flow:
    """The mean over seeds of what slopes do; warned if one was."""
    found = [flow(kind, degrees, seed, **keys) for seed in seeds]
    numbers = {name: float(np.mean([getattr(f, name) for f in found])) for name in ("speed", "inertial", "softness", "overlap", "cost")}
    return Flow(**numbers, warned=any(f.warned for f in found))


def plot(points: dict[tuple[str, float], dict[int, Flow]], path: Path) -> None:
    """I against the tangent of the angle, by solver and tolerance, over the law, in one PNG, complete or not at all."""
    from taichi_sand.study.cost.plot import ACCENT, DIM, GROUND, LINE, PANEL, STYLES, TEXT, pyplot

    plt = pyplot()
    figure, panel = plt.subplots(figsize=(6, 4.2), facecolor=GROUND)
    panel.set_facecolor(PANEL)
    ends = (ANGLES[0] - 1, ANGLES[-1] + 1)
    slopes = [math.tan(math.radians(a)) for a in ends]
    panel.plot(slopes, [law(a) for a in ends], color=ACCENT, lw=2, label="da Cruz et al. 2005")
    for (marker, colour), ((kind, tolerance), found) in zip(STYLES, points.items(), strict=False):
        x = [math.tan(math.radians(a)) for a in found]
        panel.plot(x, [f.inertial for f in found.values()], marker, color=colour, label=f"{kind}, tolerance {tolerance:g}")
    panel.set_xlabel("tangent of the slope", color=DIM)
    panel.set_ylabel("I at mid-depth", color=DIM)
    panel.set_title("Flow down a rough slope", color=TEXT, loc="left")
    panel.legend(frameon=False, labelcolor=TEXT)
    for spine in panel.spines.values():
        spine.set_color(LINE)
    figure.tight_layout()
    part = path.with_name(f".{path.stem}.part.png")
    figure.savefig(part, dpi=90, facecolor=GROUND)
    plt.close(figure)
    part.replace(path)


def main() -> None:
    """Prints the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="slopes of each, for the means")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draws I against the law")
    given = parser.parse_args()
    points: dict[tuple[str, float], dict[int, Flow]] = {}
    table = Table("solver", "tolerance", "slope", "speed / √(g d)", "I", "law", "softness", "overlap p99 / d", "CPU s per s", box=None)
    for kind, ladder in LADDER.items():
        for tolerance in ladder:
            for degrees in ANGLES:
                f = means(kind, degrees, tuple(range(1, given.seeds + 1)), tolerance=tolerance)
                points.setdefault((kind, tolerance), {})[degrees] = f
                numbers = [f"{x:.3g}" for x in (f.speed, f.inertial, law(degrees), f.softness, f.overlap, f.cost)]
                table.add_row(kind, f"{tolerance:g}", f"{degrees}°", *numbers)
    Console().print(table)
    if given.plot:
        plot(points, given.plot)


if __name__ == "__main__":
    main()
