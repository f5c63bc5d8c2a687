"""The same kernels with bounds checks, and in 64 bits: each in a process of its own, as Taichi knows one setting at a time."""

import json
import os
import subprocess
import sys
from pathlib import Path

RUN = """
import json, sys
import numpy as np
import taichi as ti
import taichi_sand as sand

precision = int(sys.argv[1])
found = {}
for kind in ("rigid", "md"):
    grains = [
        {"radius": [0.008, 0.012], "count": 60, "fill": "lattice", "pitch": 1.3, "jitter": 0.1, "region": [0, 0, 0.4, 0.3]},
        {"shape": "square", "radius": 0.006, "count": 8, "region": [0.0, 0.35, 0.4, 0.6], "angle": "random"},
    ]
    scene = sand.Scene(
        size=[0.4, 0.6], grains=grains, walls=[{"points": [[0.0, 0.25], [0.12, 0.2]]}], effects={"friction": {"mu": 0.5}},
        solver={"kind": kind, "tolerance": 0.1, "precision": precision}, edges={"right": "open"},
    )
    sim = sand.Simulation(scene, arch="cpu", threads=2)
    first = sim.report()
    sim.advance(0.3)
    report = sim.report()
    finite = all(bool(np.isfinite(values).all()) for values in (sim.positions, sim.velocities, sim.angles, sim.spins))
    found[kind] = {
        "debug": bool(ti.lang.impl.current_cfg().debug), "finite": finite, "flags": report["flags"],
        "grains": report["grains"] + report["grains_lost"], "overlap": report["overlap_max"],
        "energy": [r["kinetic_energy_J"] + r["potential_energy_J"] for r in (first, report)],
        "height": report["bed_height_m"],
    }
    del sim
print(json.dumps(found))
"""


def run(precision: int, **environment: str) -> dict[str, dict]:
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(precision)],
        cwd=Path(__file__).parents[1],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **environment},
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


def check(found: dict[str, dict]) -> None:
    """68 grains fall, touch and stay what they are; energy does not rise."""
    for kind, result in found.items():
        assert result["finite"] and result["grains"] == 68 and result["flags"] == [], (kind, result)
        before, after = result["energy"]
        assert after < before and result["overlap"] < 0.25 and result["height"] < 0.3, (kind, result)


def test_bounds_checks() -> None:
    """Taichi's debug mode raises on any index out of its table."""
    found = run(32, TI_DEBUG="1")
    assert all(result["debug"] for result in found.values())
    check(found)


def test_double_precision() -> None:
    """f64."""
    check(run(64))
