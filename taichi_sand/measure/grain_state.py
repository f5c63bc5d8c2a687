"""What contacts make of each grain: its mean stress, its neighbours and their order, the energies that it holds; forces on walls.

All of NumPy, from the rows of `contacts`; grains are in the order of their ids.
"""

from typing import Any

import numpy as np

from taichi_sand.effects.friction import SPRING
from taichi_sand.measure.wall_numbers import names
from taichi_sand.scene import moving
from taichi_sand.scene.loaded import loaded_length
from taichi_sand.world.reading import read_columns
from taichi_sand.world.search.images import nearest
from taichi_sand.world.walls.build import SIDES
from taichi_sand.world.walls.motion import hours

WALL = np.dtype([("name", "U40"), ("force", np.float64, (2,)), ("torque", np.float64), ("contacts", np.int64)])
"""A row of `wall_forces`."""


def state_of(sim: Any) -> dict[str, np.ndarray]:
    """Of the grains present, by id: id, position, velocity, spin, mass and inertia (0 of fixed ones), area; SI."""
    table = read_columns(sim.world, ("id", "position", "velocity", "spin", "radius", "kind", "mobility"))
    mass, inertia = masses(table["mobility"]).T
    area = np.pi * (table["radius"].astype(float) * sim.sizes[table["kind"]]) ** 2
    return {**{name: table[name] for name in ("id", "position", "velocity", "spin")}, "mass": mass, "inertia": inertia, "area": area}


def masses(mobility: np.ndarray) -> np.ndarray:
    """Mass [kg] and moment of inertia [kg m2], (n, 2), by the column `mobility`; 0 of fixed ones."""
    inverse = mobility[:, [0, 2]].astype(float)
    return np.divide(1.0, inverse, out=np.zeros(inverse.shape), where=inverse > 0)


def forces(rows: np.ndarray) -> np.ndarray:
    """Force on the second of each contact [N], (n, 2)."""
    normal = rows["normal"]
    return rows["force_n"][:, None] * normal + rows["force_t"][:, None] * np.stack([-normal[:, 1], normal[:, 0]], axis=1)


def ends(state: dict[str, np.ndarray], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every contact from each of its grains: numbers of contacts, and of grains."""
    grains = np.flatnonzero(rows["id2"] >= 0)
    ids = np.concatenate([rows["id1"], rows["id2"][grains]])
    return np.concatenate([np.arange(len(rows)), grains]), np.searchsorted(state["id"], ids)


def unwrapped(way: np.ndarray, sim: Any) -> np.ndarray:
    """Ways (n, 2) by the shortest image."""
    return nearest(way, sim.world, sim.scene.size)


def stresses(sim: Any, state: dict[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Love-Weber stress of every grain: - sum of force along i times branch along j, over the grain's area [N/m]; (n, 2, 2)."""
    contact, grain = ends(state, rows)
    sign = np.where(np.arange(len(contact)) < len(rows), -1.0, 1.0)[:, None]
    push = sign * forces(rows)[contact]
    branch = unwrapped(rows["point"][contact] - state["position"][grain], sim)
    total = np.zeros((len(state["id"]), 2, 2))
    for i in range(2):
        for j in range(2):
            total[:, i, j] = np.bincount(grain, -push[:, i] * branch[:, j], len(total))
    return total / state["area"][:, None, None]


def coordination(state: dict[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Contacts of every grain that push or pull, walls included, (n,)."""
    rows = rows[(rows["force_n"] != 0) | (rows["force_t"] != 0)]
    return np.bincount(ends(state, rows)[1], minlength=len(state["id"]))


def hexatic(sim: Any, state: dict[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Mean of exp(6 i theta) over the grains that each touches, 0 without any; complex, (n,)."""
    rows = rows[(rows["id2"] >= 0) & (rows["overlap"] > 0)]
    pairs = np.unique(np.stack([rows["id1"], rows["id2"]], axis=1), axis=0)
    one, two = np.searchsorted(state["id"], pairs).T
    way = unwrapped(state["position"][two] - state["position"][one], sim)
    sixth = np.exp(6j * np.arctan2(way[:, 1], way[:, 0]))  # the same from both ends
    grain, both, count = np.concatenate([one, two]), np.concatenate([sixth, sixth]), len(state["id"])
    total = np.bincount(grain, np.real(both), count) + 1j * np.bincount(grain, np.imag(both), count)
    return total / np.maximum(np.bincount(grain, minlength=count), 1)


def energies(sim: Any, state: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    """Kinetic, rotational and potential energy of every grain [J], (n,); with md the elastic one of its contacts, shared by both grains."""
    mass, velocity = state["mass"], state["velocity"]
    found = {
        "kinetic": 0.5 * mass * (velocity**2).sum(axis=1),
        "rotational": 0.5 * state["inertia"] * state["spin"] ** 2,
        "potential": -mass * (state["position"] @ np.array(sim.scene.gravity)),
    }
    if sim.scene.solver.kind == "md":
        constants = sim.solver.constants[None]
        overlap = np.maximum(rows["overlap"], 0.0)
        normal = constants.stiffness * overlap ** (constants.beta + 1) / (constants.beta + 1)
        along = 0.5 * SPRING * constants.stiffness * overlap ** (constants.beta - 1) * rows["history"] ** 2 if len(rows) else 0.0
        contact, grain = ends(state, rows)
        share = np.where(rows["id2"] >= 0, 0.5, 1.0) * (normal + along)
        found["elastic"] = np.bincount(grain, share[contact], len(mass))
    return found


def pivots(sim: Any) -> np.ndarray:
    """What torques on each wall are about [m], by number: where its pivot is now; the middle of an edge."""
    w, h = sim.scene.size
    times = iter(hours(sim.world.movers)) if sim.world.moves else iter(())
    found = []
    for wall in sim.scene.walls:
        found.append(moving.pivot_at(wall, next(times)) if moving.moves(wall) else moving.pivot(wall))
    return np.array([*found, (0, h / 2), (w, h / 2), (w / 2, 0), (w / 2, h)])


def wall_forces(sim: Any, rows: np.ndarray) -> np.ndarray:
    """What grains exert on every wall and edge, of type WALL, by number."""
    rows = rows[rows["id2"] < 0]
    number, push, about = -1 - rows["id2"], forces(rows), pivots(sim)
    arm = unwrapped(rows["point"] - about[number], sim)
    torque = arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0] + rows["couple"]
    found = np.zeros(len(about), WALL)
    found["name"] = names(sim.scene)
    for k in range(2):
        found["force"][:, k] = np.bincount(number, push[:, k], len(about))
    found["torque"] = np.bincount(number, torque, len(about))
    found["contacts"] = np.bincount(number, minlength=len(about))
    return found


def there(sim: Any, rows: np.ndarray) -> np.ndarray:
    """Those of `wall_forces` that are of walls, and of edges that are walls."""
    edges = [getattr(sim.scene.edges, side) == "wall" for side in SIDES]
    return rows[[*[True] * (len(rows) - len(edges)), *edges]]


def wall_pressures(sim: Any, rows: np.ndarray) -> dict[str, float]:
    """What grains resist the course of each wall with `pressure` with, by its loaded length [N/m], by name, from `wall_forces`."""
    times = hours(sim.world.movers).tolist() if sim.world.moves else []
    found = {}
    for row, wall in zip(rows, sim.scene.walls, strict=False):
        if wall.pressure:
            length = loaded_length(sim.scene, wall, times)
            resisted = -float(row["force"] @ np.array(wall.velocity)) / float(np.hypot(*wall.velocity))
            found[str(row["name"])] = resisted / length if length > 0 else 0.0
    return found
