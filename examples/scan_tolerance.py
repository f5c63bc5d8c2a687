"""What accuracy costs, by hand: a bed comes to rest at several tolerances, with both solvers.

    python scan_tolerance.py                       # 1000 grains, two seconds each
    python scan_tolerance.py --scale 0.2 --csv scan.csv

The overlap that 99 % of the contacts stay below is at most what was asked for; the price is CPU time. `taichi-sand cost` does the same
with nine errors, several seeds and a plot.
"""

import argparse
import csv

import taichi_sand as sand

KEYS = ("overlap_mean", "overlap_p99", "overlap_max", "step_s", "wall_time_s", "packing_fraction", "coordination")


def measure(kind: str, tolerance: float, scale: float, seconds: float) -> dict[str, float | str]:
    """One run; when it returns, the next may take over its memory and compiled kernels."""
    scene = sand.load("settle", [f"solver.kind={kind}", f"solver.tolerance={tolerance}", f"scale={scale}"])
    sim = sand.Simulation(scene, threads=1)
    sim.advance(seconds)
    report = sim.report()
    return {"solver": kind, "tolerance": tolerance, **{key: report[key] for key in KEYS}}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scale", type=float, default=1.0, help="thousands of grains")
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--tolerances", type=float, nargs="+", default=[0.1, 0.05, 0.02, 0.01, 0.005])
    parser.add_argument("--csv", help="file for the numbers")
    given = parser.parse_args()
    rows = []
    print("solver tolerance   p99 / d  mean / d  step [s]  wall time [s]")
    for kind in ("rigid", "md"):
        for tolerance in given.tolerances:
            row = measure(kind, tolerance, given.scale, given.seconds)
            rows.append(row)
            numbers = f"{row['overlap_p99']:9.5f} {row['overlap_mean']:9.5f} {row['step_s']:9.2e} {row['wall_time_s']:14.3f}"
            print(f"{kind:6} {tolerance:9g} {numbers}")
    if given.csv:
        with open(given.csv, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)
