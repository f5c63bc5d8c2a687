"""The benchmark: `python -m taichi_sand.study.bench.bench` prints how fast the simulator is, beside its peers.

Every run is a process of its own, pinned to one core (to two where it says so), timed without compiling; the runs of a table take
turns, and medians are shown. Rigid solvers are compared at equal mean overlap: the cost of ours is interpolated between two of our
tolerances. `--native DIR` adds the native programs `floor_rigid` and `floor_md` if DIR holds them; pymunk is the extra `bench`.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from taichi_sand.study.bench.window_cost import real_time, showing

SECONDS = 2.0
BED_DEPTH = 30
"""Layers of the bed at rest that shows what a step costs: as deep for any number of grains, so that step and state are the same."""
ADDED = {
    "triangles": "triangles of the same discs, a third as many",
    "boulder": "a boulder of 20 d, that falls onto them",
    "wall": "a wall of 500 segments that none reaches",
}
FRONTS = {
    5000: ((0.2, 0.1, 0.04, 0.02, 0.01, 0.005), (480, 960, 1920), ("-f 240 -it 8 -pit 4", "-f 480 -it 8 -pit 4", "-f 960 -it 8 -pit 4")),
    20000: ((0.3, 0.08, 0.04, 0.02), (240,), ("-f 240 -it 10 -pit 5", "-f 480 -it 8 -pit 4")),
}
"""By number of grains: our tolerances, steps a second of pymunk (10 iterations), settings of the native rigid program."""


def settle(count: int, overrides: list[str]) -> Any:
    """The settle scene with `count` grains."""
    from taichi_sand import load

    return load("settle", [f"scale={count / 1000}", *overrides])


def settling(count: int, overrides: list[str]) -> dict[str, float]:
    """Cost (CPU seconds per simulated second), mean overlap / d after SECONDS, ns per grain and step in the second half."""
    from taichi_sand import Simulation
    from taichi_sand.study.bench.peers import overlaps

    sim = Simulation(settle(count, overrides), threads=1)
    start = time.process_time()
    sim.advance(SECONDS / 2)
    half, steps = time.process_time(), sim.steps
    sim.advance(SECONDS / 2)
    end = time.process_time()
    overlap = overlaps(sim.positions, sim.radii, sim.scene.size[0]).mean()
    return {"cost": (end - start) / SECONDS, "overlap": float(overlap), "ns": 1e9 * (end - half) / (sim.steps - steps) / count}


def with_more(scene: Any, more: str) -> Any:
    """`scene` with a boulder of 20 d above its grains, with a wall of 500 segments up there that none reaches, or with triangles of three
    of its discs, a third as many.
    """
    keys = scene.model_dump(exclude_unset=True)
    (width, height), grains = scene.size, keys["grains"][0]
    if more == "boulder":
        keys["grains"] = [grains, {"positions": [[width / 2, height - 0.21, 0.2]], "density": grains["density"]}]
    elif more == "wall":
        keys["walls"] = [{"points": [[width * k / 500, height - 0.1 - 0.05 * (k % 2)] for k in range(501)]}]
    elif more == "triangles":
        keys["grains"] = [grains | {"shape": "triangle", "count": grains["count"] // 3, "pitch": 1.1, "jitter": 0.05}]
    return type(scene)(**keys)


def adding(count: int, kind: str, more: str) -> dict[str, float]:
    """Cost (CPU seconds per simulated second) of settling with what `with_more` adds, and µs a step in the second half."""
    from taichi_sand import Simulation

    sim = Simulation(with_more(settle(count, [f"solver.kind={kind}"]), more), threads=1)
    start = time.process_time()
    sim.advance(SECONDS / 2)
    half, steps = time.process_time(), sim.steps
    sim.advance(SECONDS / 2)
    end = time.process_time()
    return {"cost": (end - start) / SECONDS, "us": 1e6 * (end - half) / (sim.steps - steps)}


def stepping(count: int, kind: str, threads: int, steps: int) -> dict[str, float]:
    """Wall ns per grain and step of a bed at rest, grains of the settle scene on a hexagonal lattice."""
    from taichi_sand import Scene, Simulation

    grains = [{"radius": 0.01, "count": count, "fill": "hexagonal"}]
    size = [0.02 * count / BED_DEPTH + 0.005, 0.02 * BED_DEPTH + 0.1]
    sim = Simulation(Scene(size=size, grains=grains, solver={"kind": kind}, effects={"friction": {}}), threads=threads)
    sim.advance_steps(2 * steps)
    start = time.perf_counter()
    sim.advance_steps(steps)
    return {"ns": 1e9 * (time.perf_counter() - start) / steps / count}


def billiards() -> dict[str, float]:
    """µs a frame of 1/60 s of the ten discs of `billiards`."""
    from taichi_sand import Simulation, load

    sim = Simulation(load("billiards"), threads=1)
    sim.advance(0.5)
    start = time.perf_counter()
    for _ in range(300):
        sim.advance(1 / 60)
    return {"us": 1e6 * (time.perf_counter() - start) / 300}


def painting(count: int, width: int) -> dict[str, float]:
    """ms to paint a 16:9 box with `count` discs of 8 mm, `width` pixels wide."""
    from taichi_sand import Scene, Simulation

    side = float(np.sqrt(count * 4e-4 * 16 / 9))
    grains = [{"radius": 0.008, "count": count}]
    sim = Simulation(Scene(size=[side, side * 9 / 16], grains=grains, view={"width": width}), threads=1)
    sim.image()
    times = []
    for _ in range(20):
        start = time.perf_counter()
        sim.image()
        times.append(time.perf_counter() - start)
    return {"ms": 1e3 * statistics.median(times)}


def pymunk(count: int, step: float, iterations: int) -> dict[str, float]:
    """The settle scene in pymunk."""
    from taichi_sand.scene.packing import pack
    from taichi_sand.study.bench.peers import settle_in_pymunk

    scene = settle(count, [])
    return settle_in_pymunk(pack(scene), scene.size[0], step, iterations, SECONDS)


def native(program: str, count: int, options: list[str]) -> dict[str, float]:
    """The settle scene in a native program."""
    from taichi_sand.scene.packing import pack
    from taichi_sand.study.bench.peers import settle_natively

    scene = settle(count, [])
    with tempfile.TemporaryDirectory() as folder:
        return settle_natively(Path(program), options, pack(scene), scene.size[0], Path(folder))


JOBS: dict[str, Callable[..., dict[str, float]]] = {
    job.__name__: job for job in (settling, adding, stepping, billiards, painting, pymunk, native, showing, real_time)
}


def alone(name: str, threads: int, *arguments: Any) -> dict[str, float]:
    """Runs a job in a process of its own on `threads` cores."""
    cores = sorted(os.sched_getaffinity(0))[-threads:]
    command = [sys.executable, "-m", "taichi_sand.study.bench.bench", "--job", json.dumps([name, list(arguments)])]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=lambda: os.sched_setaffinity(0, cores))
    if done.returncode:
        raise SystemExit(done.stderr.strip() or f"{name} failed")
    return json.loads(done.stdout.splitlines()[-1])


def medians(runs: int, jobs: dict[str, tuple]) -> dict[str, dict[str, float]]:
    """Medians of `runs` interleaved runs of each job (threads, name, arguments …)."""
    results: dict[str, list[dict[str, float]]] = {key: [] for key in jobs}
    for _ in range(runs):
        for key, (threads, name, *arguments) in jobs.items():
            results[key].append(alone(name, threads, *arguments))
    return {key: {part: statistics.median(r[part] for r in rows) for part in rows[0]} for key, rows in results.items()}


def cost_at(overlap: float, ours: list[dict[str, float]]) -> float:
    """Cost of ours at a mean overlap, interpolated in logarithms; at the end of the ladder that is still as good, if beyond."""
    ladder = sorted(ours, key=lambda r: r["overlap"])
    x, y = (np.log([r[key] for r in ladder]) for key in ("overlap", "cost"))
    return float(np.exp(np.interp(np.log(overlap), x, y)))


def rigid_table(runs: int, count: int, ladder: tuple[float, ...], peers: dict[str, tuple]) -> Table:
    """Rigid solver against its peers at equal mean overlap."""
    jobs: dict[str, tuple] = {f"{x}": (1, "settling", count, [f"solver.tolerance={x}"]) for x in ladder}
    found = medians(runs, {**jobs, **peers})
    ours = [found[key] for key in jobs]
    table = Table("rigid, settle", "CPU s per s", "mean overlap / d", "ours at that overlap", "ratio", title=f"{count} grains, one thread")
    for key, row in found.items():
        cells = ["", ""] if key in jobs else [f"{cost_at(row['overlap'], ours):.3f}", f"{row['cost'] / cost_at(row['overlap'], ours):.1f}×"]
        table.add_row(f"tolerance {key}" if key in jobs else key, f"{row['cost']:.3f}", f"{row['overlap']:.4f}", *cells)
    return table


def md_table(runs: int, counts: list[int], folder: Path | None) -> Table:
    """Molecular dynamics over the settled half: M grain-steps a second."""
    table = Table(
        "md, settle",
        "viscous",
        "spring",
        "spring / viscous",
        "native, scalar",
        "viscous / native",
        title="10^6 grain-steps/s, one thread",
    )
    for count in counts:
        jobs: dict[str, Any] = {m: (1, "settling", count, ["solver.kind=md", f"effects.friction.model={m}"]) for m in ("viscous", "spring")}
        if folder:
            jobs["native"] = (1, "native", str(folder / "floor_md"), count, ["-mode", "1"])
        found = medians(runs, jobs)
        rate = {key: 1e3 / row[{"native": "ns_ps_tail"}.get(key, "ns")] for key, row in found.items()}
        other = [f"{rate['native']:.1f}", f"{rate['viscous'] / rate['native']:.2f}"] if folder else ["", ""]
        table.add_row(
            f"{count} grains",
            f"{rate['viscous']:.1f}",
            f"{rate['spring']:.1f}",
            f"{rate['viscous'] / rate['spring']:.2f}× dearer",
            *other,
        )
    return table


def scaling_table(runs: int, counts: list[int]) -> Table:
    """ns per grain and step of a bed at rest, one thread and two."""
    table = Table("solver", "grains", "one thread", "two threads", "speed-up", title="ns per grain and step, a bed at rest")
    for kind in ("rigid", "md"):
        for count in counts:
            steps = max(300, 3_000_000 // count)
            jobs = {str(n): (n, "stepping", count, kind, n, steps) for n in (1, 2)}
            one, two = (row["ns"] for row in medians(runs, jobs).values())
            table.add_row(kind, str(count), f"{one:.1f}", f"{two:.1f}", f"{one / two:.2f}×")
    return table


def more_table(runs: int, count: int) -> Table:
    """What clumps, a boulder and walls cost: settling with them, over settling without."""
    table = Table(
        "solver", "added", "per simulated second", "a step of the bed", title=f"{count} discs that settle, one thread: times as dear"
    )
    for kind in ("rigid", "md"):
        ways = ("", "triangles", "boulder", "wall")
        plain, *found = medians(runs, {more: (1, "adding", count, kind, more) for more in ways}).values()
        for more, row in zip(ways[1:], found, strict=True):
            table.add_row(kind, ADDED[more], f"{row['cost'] / plain['cost']:.2f}×", f"{row['us'] / plain['us']:.2f}×")
    return table


def window_table(runs: int) -> Table:
    """The window on the settle scene, 720 pixels wide, one CPU thread."""
    table = Table("grains", "paint and show", "… with the numbers", "frames/s", "real time", title="the window, ms of CPU time a picture")
    for count in (1000, 10000):
        found = medians(runs, {"show": (1, "showing", count, 720), "run": (1, "real_time", count, 720)})
        show, run = found["show"], found["run"]
        table.add_row(str(count), f"{show['plain']:.2f}", f"{show['numbers']:.2f}", f"{run['frames']:.1f}", f"{run['factor']:.2f}×")
    return table


def main() -> None:
    """Prints all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3, help="interleaved runs of each, for the medians")
    parser.add_argument("--native", type=Path, metavar="DIR", help="folder with floor_rigid and floor_md")
    parser.add_argument("--most", type=int, default=20000, help="most grains in the comparisons with peers")
    parser.add_argument("--window", action="store_true", help="what the window costs, and nothing else")
    parser.add_argument("--more", action="store_true", help="what clumps, a boulder and walls cost, and nothing else")
    parser.add_argument("--job", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.job:
        name, arguments = json.loads(given.job)
        print(json.dumps(JOBS[name](*arguments)))
        return
    console, runs, folder = Console(), given.runs, given.native
    if given.window:
        console.print(window_table(runs))
        return
    if given.more:
        console.print(more_table(runs, 5000))
        return
    for count, (ladder, steps, programs) in FRONTS.items():
        if count <= given.most:
            peers: dict[str, Any] = {f"pymunk 1/{n} s": (1, "pymunk", count, 1 / n, 10) for n in steps}
            for options in programs if folder else ():
                peers[f"floor_rigid {options}"] = (1, "native", str(folder / "floor_rigid"), count, options.split())
            console.print(rigid_table(runs, count, ladder, peers))
    console.print(md_table(runs, [n for n in (1000, 5000, 20000) if n <= given.most], folder))
    console.print(scaling_table(runs, [1000, 5000, 20000, 100_000]))
    small = medians(runs, {"billiards": (1, "billiards"), "painting": (1, "painting", 20000, 1280)})
    console.print(
        f"ten billiard discs: {small['billiards']['us']:.0f} µs a frame; painting 20000 discs at 1280×720: {small['painting']['ms']:.1f} ms"
    )


if __name__ == "__main__":
    main()
