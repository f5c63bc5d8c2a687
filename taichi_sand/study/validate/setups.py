"""Set-ups of the reference cases (physics.md A and B) that both the tests and `taichi-sand validate` look at."""

import math
from typing import Any

import numpy as np

from taichi_sand.study.laboratory import OPEN, D, Disc, G, K, M, R, perp, simulate

T_C = math.pi * math.sqrt(M / 2 / K)
"""Collision time of two standard discs of stiffness K, linear law [s]."""
MD: dict[str, Any] = {"kind": "md", "k_r": K, "restitution": 0.8, "step": T_C / 20}
HERTZ = {"kind": "md", "law": "hertz", "k_r": K / math.sqrt(7e-5), "restitution": 0.8, "step": T_C / 20}
RIGID = {"kind": "rigid", "restitution": 0.8, "step": 1e-4}
FREE = {"linear": MD, "hertz": HERTZ, "rigid": RIGID}


def implosion(count: int, seed: int = 1) -> list[Disc]:
    """Discs of random sizes on a jittered lattice in the middle of a box of 2 m, flying at its centre and spinning."""
    random = np.random.default_rng(seed)
    side = math.ceil(math.sqrt(count))
    discs = []
    for k in range(count):
        place = (np.array([k % side, k // side]) - (side - 1) / 2) * 1.6 * D + random.uniform(-0.1, 0.1, 2) * D
        velocity = -4 * place + random.uniform(-0.3, 0.3, 2)
        discs.append(Disc(*(place + 1.0), *velocity, spin=random.uniform(-80, 80), radius=R * random.uniform(0.8, 1.2)))
    return discs


def momenta(sim: Any, discs: list[Disc]) -> tuple[np.ndarray, float]:
    """Momentum, and angular momentum about the origin of the box, from the state alone."""
    mass = np.array([disc.mass for disc in discs])
    inertia = mass * np.array([disc.radius for disc in discs]) ** 2 / 2
    x, v = sim.positions, sim.velocities
    return mass @ v, float(mass @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + inertia @ sim.spins)


def gas(seed: int = 3) -> tuple[list[Disc], float]:
    """400 discs at area fraction 0.2, speeds of 1 m/s in random directions; and the side of their box."""
    random = np.random.default_rng(seed)
    side = math.sqrt(400 * math.pi * R**2 / 0.2)
    pitch = side / 20
    discs = []
    for k in range(400):
        place = (np.array([k % 20, k // 20]) + 0.5) * pitch + random.uniform(-0.2, 0.2, 2) * pitch
        angle = random.uniform(0, 2 * math.pi)
        discs.append(Disc(float(place[0]), float(place[1]), math.cos(angle), math.sin(angle)))
    return discs, side


COLLISIONS = math.sqrt(math.pi) * D / (8 * 0.2 * 1.43 * math.sqrt(0.5))
"""Mean time between two collisions of a disc of this gas (Enskog, 2D, speed 1 m/s) [s]; 1000 of them: A16's time."""


def springs(sim: Any, side: float, k_r: float, beta: float) -> float:
    """Energy in the contacts of equal discs in a periodic box [J], from the places alone."""
    x = sim.positions
    way = x[:, None] - x[None]
    way -= side * np.round(way / side)
    overlap = np.maximum(D - np.hypot(way[..., 0], way[..., 1]), 0.0)[np.triu_indices(len(x), 1)]
    return float((k_r * overlap ** (beta + 1) / (beta + 1)).sum())


def frames() -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Changes of frame: a matrix, where the experiment stands, and a velocity added to it."""
    c, s = math.cos(math.radians(37)), math.sin(math.radians(37))
    return {
        "plain": (np.eye(2), np.array([0.1, 0.1]), np.zeros(2)),
        "rotated": (np.array([[c, -s], [s, c]]), np.array([0.3, 0.1]), np.zeros(2)),
        "mirrored": (np.diag([-1.0, 1.0]), np.array([0.5, 0.1]), np.zeros(2)),
        "boosted": (np.eye(2), np.array([0.1, 0.3]), np.array([10.0, 0.0])),
        "translated": (np.eye(2), np.array([0.1 + 1000 * D, 0.1]), np.zeros(2)),
    }


def collision_in_frames(name: str, precision: int) -> dict[str, np.ndarray]:
    """One oblique frictional collision of two discs, all frames in one box: velocities and spins times R [m/s] after it, told in the
    plain frame, shape (2, 3), by frame; `name` is that of a solver of FREE.
    """
    places = np.array([[-1.1 * R, -0.3 * R], [1.1 * R, 0.3 * R]])
    velocities = np.array([[0.5, 0.3], [-0.5, 0.1]])
    spins = np.array([40.0, -10.0])
    discs = []
    for matrix, middle, boost in frames().values():
        handed = np.linalg.det(matrix)
        for x, v, spin in zip(places, velocities, spins, strict=True):
            discs.append(Disc(*(middle + matrix @ x), *(matrix @ v + boost), spin=handed * spin))
    sim = simulate(discs, (10.5, 0.5), {**FREE[name], "precision": precision}, mu=0.3, edges=OPEN)
    sim.advance(4e-3)
    states = {}
    for row, (frame, (matrix, _, boost)) in enumerate(frames().items()):
        pair = slice(2 * row, 2 * row + 2)
        turn = np.linalg.det(matrix) * sim.spins[pair] * R
        states[frame] = np.hstack([(sim.velocities[pair] - boost) @ matrix, turn[:, None]])
    return states


K_SOFT = 2e6
"""Stiff enough that the standard disc's weight dents it by 1e-4 d."""


T_SOFT = math.pi * math.sqrt(M / 2 / K_SOFT)


RESTING = {
    "linear": {"kind": "md", "law": "linear", "k_r": K_SOFT, "restitution": 0.3, "step": T_SOFT / 30},
    "hertz": {
        "kind": "md",
        "law": "hertz",
        "k_r": M * G / (1e-4 * D) ** 1.5,
        "restitution": 0.3,
        "tolerance": 1e-3,
        "step": T_SOFT / 60,
    },
    "rigid": {"kind": "rigid", "restitution": 0.0, "step": 5e-4, "tolerance": 0.001},
}


SIZE = (1.0, 1.0)


def on_surface(normal: np.ndarray) -> tuple[np.ndarray, list]:
    """A point on a surface with this normal, and the walls it takes: an edge of the box if the normal is along an axis, else a line."""
    middle = np.array(SIZE) / 2
    if min(abs(normal)) == 0:
        return np.where(normal == 0, middle, np.where(normal > 0, 0.0, SIZE)), []
    line = [(middle + s * 0.45 * perp(normal)).tolist() for s in (-1, 1)]
    return middle, [{"points": line}]


def resting(
    normal: np.ndarray, solver: dict, v0: float, spin: float, mu: float, tilt: float = 0.0, **keys: Any
) -> tuple[Any, np.ndarray, np.ndarray]:
    """A disc at rest overlap on a surface, gravity against its normal, leaning by `tilt` [degrees] to the right of one who stands there."""
    point, walls = on_surface(normal)
    right = -perp(normal)
    lean = math.radians(tilt)
    gravity = G * (-math.cos(lean) * normal + math.sin(lean) * right)
    dent = 0.0 if solver["kind"] == "rigid" else 1e-4 * D * (math.cos(lean) if solver["law"] == "linear" else math.cos(lean) ** (2 / 3))
    place = point + (R - dent) * normal - (0.3 if v0 >= 0 else -0.3) * right
    disc = Disc(*place, *(v0 * right), spin=spin)
    return simulate([disc], SIZE, solver, gravity=gravity.tolist(), walls=walls, mu=mu, **keys), right, place


FALL = 15 * math.sqrt(D / G)


def pyramid(solver: dict, mu: float, floor: float | None = None, model: str = "spring") -> tuple[float, float, float]:
    """Two discs on a line, a third on top, left alone for 15 sqrt(d/g).

    Returns how far the top sank in all and in the second half, in d, and the largest speed at the end, in sqrt(gd).
    """
    wall = {"points": [[0.02, 0.02], [0.18, 0.02]]} | ({} if floor is None else {"friction": floor})
    discs = [Disc(0.1 + x, 0.02 + R + y) for x, y in ((-R, 0), (R, 0), (0, math.sqrt(3) * R))]
    md = solver["kind"] == "md"
    sim = simulate(discs, (0.2, 0.1), solver, gravity=(0, -G), walls=[wall], edges=OPEN, mu=mu, friction={"model": model} if md else {})
    start = sim.positions[2, 1]
    sim.advance(FALL / 2)
    middle = sim.positions[2, 1]
    sim.advance(FALL / 2)
    end = sim.positions[2, 1]
    return (start - end) / D, (middle - end) / D, float(np.hypot(*sim.velocities.T).max()) / math.sqrt(G * D)


THRESHOLD = math.tan(math.radians(15))


FLOOR_THRESHOLD = THRESHOLD / 3  # friction 0.134 W under 1.5 W


NARROW = 1.5 * D
"""Width of the box of a column: what is one grain wide is as deep as it has grains (the tolerance follows from the depth)."""


def column(count: int, down: np.ndarray, dents: np.ndarray, far: float) -> list[Disc]:
    """A column hanging over the wall that `down` points to, grain 0 on top; dents[i]: overlap below grain i [m]."""
    heights = np.concatenate([[R - dents[-1]], R - dents[-1] + np.cumsum((D - dents[:-1])[::-1])])[::-1]
    foot = np.where(down == 0, NARROW / 2, np.where(down > 0, far, 0.0))
    return [Disc(*(foot - h * down)) for h in heights]
