"""From one structure to another: the same grains under another solver, or with other effects."""

from dataclasses import replace
from typing import Any

import numpy as np

from taichi_sand import effects
from taichi_sand.play.snapshot import Snapshot, tables_of
from taichi_sand.run import live
from taichi_sand.run.growing import rooms_of, write_field
from taichi_sand.run.simulation import Simulation
from taichi_sand.scene.checks import foreign
from taichi_sand.scene.schema import Scene
from taichi_sand.solvers import choose
from taichi_sand.world.checkpoint import read_field
from taichi_sand.world.edit import link_lines
from taichi_sand.world.sleep.state import start_awake
from taichi_sand.world.tables import World
from taichi_sand.world.walls.build import change_walls

OVER = ("grains", "carried", "links", "count", "flags", "movers", "flow")
"""Tables that go over; the others are made for the structure they belong to."""
SNAP = 0.1
"""Bonds switched on on the way hold what is as far apart as at the start, to this share."""
ROWS = ("pairs", "blocks")
"""Taken over as well where both structures list pairs in tables of the same sizes."""


def with_solver(scene: Scene, kind: str, home: Scene) -> Scene:
    """`scene` for the other solver: with the expert keys of `home` if it is the one that it was written for, else without any."""
    expert = {name: getattr(home.solver, name) for name in home.solver.model_fields_set} if home.solver.kind == kind else {}
    kept = {"tolerance": scene.solver.tolerance, "restitution": scene.solver.restitution, "precision": scene.solver.precision}
    keys: dict[str, Any] = {name: value for name, value in expert.items() if name not in foreign(kind)} | kept | {"kind": kind}
    solver = type(scene.solver)(**keys)
    return scene.model_copy(update={"solver": solver})


def columns_of(sim: Simulation) -> list[str]:
    """Name of every column of the neighbour list that follows a pair, in their order."""
    kind = sim.scene.solver.kind
    names = ["force"] + [f"{kind} {k}" for k in range(choose(kind).MEMORY)]
    for name, values in sim.effects.items():
        names += [f"{kind} {name} {k}" for k in range(effects.columns(name, values, kind))]
    return names


def hand_over(old: Simulation, new: Simulation, moment: Snapshot, scene: Scene) -> None:
    """Gives `new` the grains, walls and pairs of `old`, whose moment this is; pairs keep their force, and what both solvers know. It goes
    on with the numbers of `scene`, which is of its structure.

    Nobody may sleep in `old`: what moves sleepers is stored elsewhere.
    """
    new.take_room(rooms_of(old.world))
    change_walls(new.world, new.scene, old.scene)
    targets = tables_of(new)
    tables = {name: table for name, table in tables_of(old).items() if name.split(".")[2:3] and name.startswith(".0.")}
    rows = [name for name in tables if name.split(".")[2] in ROWS and "memory" not in name]
    sizes = old.sizes_with(rooms_of(old.world))
    same = all(name in targets and targets[name].shape == tables[name].shape for name in rows)
    for name, table in tables.items():
        part = name.split(".")[2]
        known = name in targets or part not in ("carried", "links")  # by effects that only one of the two has
        if known and (part in OVER or (same and name in rows)):
            write_field(targets[name], read_field(table), name, sizes, sizes)
    if same:
        kept = dict(zip(columns_of(old), old.world.pairs.memory, strict=True))
        for name, column in zip(columns_of(new), new.world.pairs.memory, strict=True):
            column.from_numpy(kept[name].to_numpy() if name in kept else np.zeros_like(column.to_numpy()))
    else:
        for counts in (new.world.pairs.row_count, new.world.pairs.wall_row_count):
            counts.fill(0)  # no pair is remembered
    if new.world.linked and not old.world.linked:
        let_go(new.world)
    if new.world.sleeps:
        start_awake(new.world.sleep, int(new.world.count[None]))
    pace = read_field(old.world.pace)
    new.world.pace.from_numpy({key[1:]: value for key, value in pace.items()})
    new.world.grains.wrench.fill(0.0)
    host = moment.host
    due = {name: host.due.get(name, host.steps + max(1, at - new.steps)) for name, at in new.due.items()}  # of what only it has, as it says
    replace(host, scene=scene, due=due, over=live.kept(host.over, old.scene, scene)).give(new)
    new.retune(scene)


def let_go(world: World) -> None:
    """Breaks the links that would come into being much longer or shorter than they are at rest."""
    rows, lines = link_lines(world)
    whole, rest = world.links.whole.to_numpy(), world.links.rest.to_numpy()[rows]
    length = np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1])
    whole[:] = 0
    whole[rows[np.abs(length - rest) < SNAP * rest]] = 1
    world.links.whole.from_numpy(whole)
