"""A world for the tests of the painter: grains and forces just where a test wants them, no engine."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_sand.scene.grains import Pack
from taichi_sand.scene.schema import Scene
from taichi_sand.taichi_support import runtime
from taichi_sand.world.build import fill, make_world
from taichi_sand.world.tables import World


class Keeper:
    """Stands for the simulation that a world would belong to."""


keeper = Keeper()


def start_taichi() -> None:
    """Taichi as a simulation starts it; it keeps running."""
    runtime.start(keeper, "cpu", None, 32)


def world_of(
    places: Sequence,
    radius: float | Sequence[float],
    size: tuple[float, float] = (1.0, 1.0),
    *,
    velocity: Sequence | None = None,
    angle: Sequence | None = None,
    spin: Sequence | None = None,
    fixed: Sequence[int] = (),
    kind: Sequence | None = None,
    pairs: Sequence = (),
    wall_pairs: Sequence = (),
    periodic: tuple[bool, bool] = (False, False),
) -> World:
    """Grains of mass 2 kg and inertia 4 kg m2.

    pairs: (first, second, normal force); wall_pairs: (grain, normal, gap, normal force).
    """
    places = np.array(places, float).reshape(-1, 2)
    n = len(places)
    zeros = np.zeros(n)
    pack = Pack(
        position=places,
        velocity=np.zeros((n, 2)) if velocity is None else np.array(velocity, float),
        angle=zeros if angle is None else np.array(angle, float),
        spin=zeros if spin is None else np.array(spin, float),
        radius=np.broadcast_to(np.array(radius, float), n).copy(),
        mass=zeros + 2.0,
        inertia=zeros + 4.0,
        kind=np.zeros(n, np.int32) if kind is None else np.array(kind, np.int32),
        fixed=np.isin(np.arange(n), fixed),
        body=np.full(n, -1, np.int32),
    )
    edge = ["periodic" if around else "wall" for around in periodic]
    edges = {"left": edge[0], "right": edge[0], "bottom": edge[1], "top": edge[1]}
    world = make_world(Scene(size=size, edges=edges), pack, 0, angle is not None or spin is not None, False)
    fill(world, pack)
    put_pairs(world, pack, sorted(pairs), sorted(wall_pairs, key=lambda row: row[0]), np.array(size), np.where(periodic, size, 0.0))
    return world


def put_pairs(world: World, pack: Pack, pairs: Sequence, wall_pairs: Sequence, size: np.ndarray, period: np.ndarray) -> None:
    """Writes pairs of discs, then pairs of a disc and a wall, into the first rows, as the only block."""
    rows: list[dict[str, Any]] = []
    for i, j, force in pairs:
        way = pack.position[j] - pack.position[i]
        way = way - period * np.round(way / size)
        length, reach = np.hypot(*way), pack.radius[i] + pack.radius[j]
        rows.append(
            {
                "first": i,
                "second": j,
                "normal": way / length,
                "contact_distance": reach,
                "gap": length - reach,
                "force": (force, 0),
            }
        )
    for i, normal, gap, force in wall_pairs:
        rows.append({"first": i, "second": 0, "normal": normal, "contact_distance": pack.radius[i], "gap": gap, "force": (force, 0)})
    for row, values in enumerate(rows):
        for name, value in values.items():
            getattr(world.pairs, name)[row] = value
    blocks = {"pair_start": 0, "pair_end": len(pairs), "wall_start": len(pairs), "wall_end": len(rows)}
    for name, row in blocks.items():
        getattr(world.blocks, name)[0] = row


def shift(world: World, slot: int, by: Sequence[float]) -> None:
    """Moves a grain as an integrator would."""
    world.grains.shift[slot] = by
