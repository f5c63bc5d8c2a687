"""Small worlds to try physics in. SI units; the standard disc has a radius of 5 mm and 2650 kg/m2."""

import gc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

import taichi_sand as sand
from taichi_sand.measure.contacts import contacts
from taichi_sand.taichi_support import runtime

R = 0.005
RHO = 2650.0
D = 2 * R
M = RHO * math.pi * R**2
G = 9.81
INERTIA = M * R**2 / 2
K = 2e7
OPEN = dict.fromkeys(("left", "right", "bottom", "top"), "open")
PERIODIC = dict.fromkeys(("left", "right", "bottom", "top"), "periodic")
ANGLES = (0.0, 17.0, 45.0, 90.0)
"""Contact angles that every law is tried at [degrees]."""


@dataclass
class Disc:
    """One grain: place and velocity in SI."""

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0
    spin: float = 0.0
    radius: float = R
    density: float = RHO
    fixed: bool = False
    angle: float = 0.0

    @property
    def row(self) -> list[float]:
        """As in `grains.positions`."""
        return [float(v) for v in (self.x, self.y, self.radius, self.vx, self.vy, self.angle, self.spin)]

    @property
    def mass(self) -> float:
        """[kg]"""
        return self.density * math.pi * self.radius**2


def tables(discs: Sequence[Disc]) -> list[dict[str, Any]]:
    """`grains` tables that make exactly these discs, in this order."""
    runs = groupby(discs, key=lambda disc: (disc.density, disc.fixed))
    return [{"positions": [disc.row for disc in run], "density": rho, "fixed": fixed} for (rho, fixed), run in runs]


def fresh_taichi() -> None:
    """Has the next simulation start Taichi afresh, unless all before it are gone and leave it their fields and kernels.

    Simulations that somebody still holds are dead from then on: a test uses one at a time. (A failed one lives on in its traceback.)
    """
    if runtime.alive:
        gc.collect()
    if runtime.alive:
        runtime.abandon()


def simulate(discs: Sequence[Disc] | list[dict[str, Any]], size: Sequence[float], solver: dict[str, Any], **keys: Any) -> Any:
    """A Simulation of `discs` (or of grains tables) in a box of `size`; without gravity unless `keys` names it. f64 by default.

    `mu` and `friction` are short for effects.friction.mu and further keys of that table; `threads` is 1 unless given; with `hand`
    there is a hand to reach in.
    """
    grains: Any = tables(discs) if discs and isinstance(discs[0], Disc) else list(discs)  # type: ignore[arg-type]
    mu, friction, threads = keys.pop("mu", None), keys.pop("friction", {}), keys.pop("threads", 1)
    hand = keys.pop("hand", False)
    effects = {"friction": {"mu": mu, **friction}} if mu is not None else {}
    settings = {"precision": 64, **solver}
    fresh_taichi()
    scene = sand.Scene(size=list(size), grains=grains, solver=settings, **{"gravity": (0.0, 0.0), "effects": effects, **keys})
    return sand.Simulation(scene, arch="cpu", threads=threads, hand=hand)


def unit(degrees: float) -> np.ndarray:
    """Unit vector at this angle; exact at right angles."""
    return (
        np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][int(degrees // 90) % 4], float)
        if degrees % 90 == 0
        else np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    )


def perp(a: np.ndarray) -> np.ndarray:
    """a turned by +90 degrees."""
    return np.array([-a[1], a[0]])


@dataclass
class Face:
    """A surface that a disc may hit: a point of it and its normal out of it. With `target`, that of a disc about to be hit."""

    name: str
    point: np.ndarray
    normal: np.ndarray
    target: Disc | None = None

    @property
    def tangent(self) -> np.ndarray:
        """To the right for one who stands on the surface: +x on a floor."""
        return -perp(self.normal)


class Gallery:
    """A box with surfaces of every kind well apart: its four edges, both sides of lines at 17 and 45 degrees, discs at four angles.

    `shots` discs can be thrown at each surface without meeting one another, all in one simulation.
    """

    def __init__(self, shots: int = 1, target_density: float = RHO, pitch: float = 0.08) -> None:
        columns = math.ceil(math.sqrt(8 * shots))
        self.side = (max(columns, shots) + 3) * pitch
        self.walls: list[dict[str, Any]] = []
        self.faces: list[Face] = []
        for name, angle in (("left", 0.0), ("bottom", 90.0), ("right", 180.0), ("top", 270.0)):
            normal = unit(angle)
            foot, along = np.maximum(-normal, 0) * self.side, abs(perp(normal))
            self.faces += [Face(name, foot + (k + 1.5) * pitch * along, normal) for k in range(shots)]
        spots = iter([pitch * np.array([k % columns + 1.5, k // columns + 1.5]) for k in range(8 * shots)])
        for angle in (17.0, 45.0, 197.0, 225.0):
            for _ in range(shots):
                face = Face(f"line {angle:g}", next(spots), unit(angle))
                ends = [face.point - 0.3 * pitch * face.tangent, face.point + 0.3 * pitch * face.tangent]
                self.walls.append({"points": [end.tolist() for end in ends]})
                self.faces.append(face)
        for angle in ANGLES:
            for _ in range(shots):
                point, normal = next(spots), unit(angle)
                self.faces.append(Face(f"disc {angle:g}", point, normal, Disc(*(point - R * normal), density=target_density)))

    def simulate(self, shots: Sequence[Sequence[float]], delay: float, solver: dict[str, Any], **keys: Any) -> Any:
        """Throws at every face the shots (v_n towards it, v_t along its tangent, spin) so that all arrive after `delay` seconds."""
        self.shots = [shots[k % len(shots)] for k in range(len(self.faces))]
        strikers = []
        for face, (v_n, v_t, spin) in zip(self.faces, self.shots, strict=True):
            velocity = -v_n * face.normal + v_t * face.tangent
            strikers.append(Disc(*(face.point + R * face.normal - velocity * delay), *velocity, spin=spin))
        targets = [face.target for face in self.faces if face.target]
        self.sim = simulate(strikers + targets, (self.side, self.side), solver, walls=self.walls, **keys)
        return self.sim

    def outcome(self) -> list[tuple[Face, Sequence[float], np.ndarray, np.ndarray]]:
        """For every shot: face, what was thrown, and (v_n away from it, v_t, spin) of the striker and of the target (or zeros)."""
        velocities, spins = self.sim.velocities, self.sim.spins
        rows, target = [], len(self.faces)
        for k, face in enumerate(self.faces):
            other = np.zeros(3)
            if face.target:
                other = self._local(face, velocities[target], spins[target])
                target += 1
            rows.append((face, self.shots[k], self._local(face, velocities[k], spins[k]), other))
        return rows

    @staticmethod
    def _local(face: Face, velocity: np.ndarray, spin: float) -> np.ndarray:
        return np.array([velocity @ face.normal, velocity @ face.tangent, spin])


def kinetic(sim: Any, discs: Sequence[Disc]) -> float:
    """Kinetic energy with spin [J], from the state alone."""
    mass = np.array([disc.mass for disc in discs])
    inertia = mass * np.array([disc.radius for disc in discs]) ** 2 / 2
    return float(0.5 * (mass * (sim.velocities**2).sum(1)).sum() + 0.5 * (inertia * sim.spins**2).sum())


@dataclass
class Contact:
    """A pair of the neighbour list: ids of the two grains (second: the number of the wall if `wall`), normal, and force [N]."""

    first: int
    second: int
    wall: bool
    normal: np.ndarray
    force: np.ndarray


def listed(sim: Any) -> list[Contact]:
    """All pairs that the last list build listed, by ids."""
    rows = contacts(sim, every=True)
    forces = np.stack([rows["force_n"], rows["force_t"]], 1)
    ids = zip(rows["id1"].tolist(), rows["id2"].tolist(), rows["normal"], forces, strict=True)
    return [Contact(one, two if two >= 0 else -1 - two, two < 0, normal, force) for one, two, normal, force in ids]


def chain_forces(sim: Any, count: int) -> np.ndarray:
    """Normal forces [N] along a chain of grains 0, 1, …: between k and k + 1, and last that on the wall behind the last one."""
    forces = np.zeros(count)
    for contact in listed(sim):
        if contact.wall and contact.first == count - 1:
            forces[count - 1] += contact.force[0]
        elif not contact.wall and abs(contact.first - contact.second) == 1:
            forces[min(contact.first, contact.second)] += contact.force[0]
    return forces
