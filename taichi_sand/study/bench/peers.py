"""Other programs on the `settle` scene, for the benchmark: pymunk, and native programs that read and write the same files.

A state is an array (5, n): x, y, vx, vy [SI], spin; a scene file holds n, width, then n radii, n x, n y, all float64.
"""

import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np

from taichi_sand.scene.nearby import close_pairs

CENTIMETRES = 100.0
"""pymunk's tolerances are made for lengths of the order of 1, so it gets centimetres."""


def overlaps(position: np.ndarray, radius: np.ndarray, width: float) -> np.ndarray:
    """Overlaps of all touching pairs and of grains with floor and sides, as fractions of the mean diameter."""
    first, second = close_pairs(position, position, 2 * float(radius.max()))
    once = first < second
    first, second = first[once], second[once]
    between = radius[first] + radius[second] - np.hypot(*(position[first] - position[second]).T)
    walls = [radius - position[:, 0], radius - position[:, 1], position[:, 0] + radius - width]
    every = np.concatenate([between, *walls])
    return every[every > 0] / (2 * radius.mean())


def settle_in_pymunk(pack: Any, width: float, step: float, iterations: int, seconds: float) -> dict[str, float]:
    """The settle scene in pymunk with a spatial hash: CPU time per simulated second, and mean overlap / d."""
    import pymunk  # pyright: ignore[reportMissingImports]  (of the extra `bench`, which tests do without)

    space = pymunk.Space()
    space.gravity = (0.0, -9.81 * CENTIMETRES)
    space.iterations, space.collision_slop = iterations, 0.005
    space.use_spatial_hash(2.4 * CENTIMETRES * float(pack.radius.mean()), 10 * len(pack.radius))
    thick, tall = 10.0, 4 * width * CENTIMETRES
    right = width * CENTIMETRES
    for a, b in (
        ((-50, -thick), (right + 50, -thick)),
        ((-thick, -50), (-thick, tall)),
        ((right + thick, -50), (right + thick, tall)),
    ):
        wall = pymunk.Segment(space.static_body, a, b, thick)
        wall.friction, wall.elasticity = 0.5**0.5, 0.1**0.5  # it multiplies the values of both sides
        space.add(wall)
    bodies = []
    for (x, y), radius, mass in zip(pack.position.tolist(), pack.radius.tolist(), pack.mass.tolist(), strict=True):
        body = pymunk.Body(mass, pymunk.moment_for_circle(mass, 0, radius * CENTIMETRES))
        body.position = (x * CENTIMETRES, y * CENTIMETRES)
        disc = pymunk.Circle(body, radius * CENTIMETRES)
        disc.friction, disc.elasticity = 0.5**0.5, 0.1**0.5
        space.add(body, disc)
        bodies.append(body)
    start = time.process_time()
    for _ in range(round(seconds / step)):
        space.step(step)
    spent = time.process_time() - start
    position = np.array([body.position for body in bodies]) / CENTIMETRES
    return {"cost": spent / seconds, "overlap": float(overlaps(position, pack.radius, width).mean())}


def settle_natively(program: Path, options: list[str], pack: Any, width: float, folder: Path) -> dict[str, float]:
    """The settle scene in a native program: what it prints, and the mean overlap / d of the state that it writes."""
    count = len(pack.radius)
    scenes = folder / "scenes"
    scenes.mkdir(exist_ok=True)
    np.concatenate([[count, width], pack.radius, *pack.position.T]).tofile(scenes / f"scene_{count}.bin")
    command = [str(program.resolve()), "-n", str(count), *options]
    env = {**os.environ, "SCENES": str(scenes), "OUT": str(folder)}
    printed = subprocess.run(command, capture_output=True, text=True, check=True, env=env, cwd=folder).stdout
    values = dict(part.split("=", 1) for part in printed.split() if "=" in part)
    state = np.fromfile(values["state"]).reshape(5, count)
    Path(values["state"]).unlink()
    numbers = {key: float(value) for key, value in values.items() if key not in ("peer", "state")}
    overlap = float(overlaps(state[:2].T, pack.radius, width).mean())
    return {**numbers, "cost": numbers["wall"] / numbers["T"], "overlap": overlap}
