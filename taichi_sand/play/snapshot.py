"""A simulation at one moment, in memory: what undo, reset and session recordings go back to, bit for bit."""

import io
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_sand.files import archive
from taichi_sand.run import belief, rooms
from taichi_sand.run.growing import in_larger, once, rooms_of
from taichi_sand.run.host import Host
from taichi_sand.run.simulation import Simulation
from taichi_sand.scene.schema import Scene
from taichi_sand.world import checkpoint
from taichi_sand.world.checkpoint import read_field
from taichi_sand.world.search.growth import Rooms

Spans = list[tuple[int, int]]


@dataclass(frozen=True)
class Rows:
    """The rows of an array that hold something: from where to where, and those rows one after the other."""

    shape: tuple[int, ...]
    spans: Spans
    rows: np.ndarray

    @property
    def dtype(self) -> np.dtype:
        """Of the array."""
        return self.rows.dtype

    def whole(self) -> np.ndarray:
        """The array, zeros where nothing was kept."""
        if not self.shape:
            return self.rows
        array, start = np.zeros(self.shape, self.rows.dtype), 0
        for low, high in self.spans:
            array[low:high] = self.rows[start : start + high - low]
            start += high - low
        return array


@dataclass
class Snapshot:
    """All that the simulation goes on from, without the rows of its tables that hold nothing."""

    host: Host
    fields: dict[str, Rows]
    rooms: Rooms  # of the tables it was taken from
    walls: tuple[Any, ...]  # that these have been made for
    session: dict[str, Any] = field(default_factory=dict)  # what the session keeps with it; must be JSON
    foreign: bool = False  # whether it comes out of a file, which anybody may have made
    chapter: Any = None  # of which scene of the session; None = of the one that is played


def tables_of(sim: Simulation) -> dict[str, Any]:
    """The fields of a simulation by name, each once."""
    return once(sim._fields())


def take(sim: Simulation, before: Snapshot | None = None) -> Snapshot:
    """The moment of `sim`. Tables that are as in `before` are shared with it."""
    spans_of = used_rows(sim)
    fields = {}
    for name, table in tables_of(sim).items():
        for part, array in read_field(table).items():
            spans = spans_of(name, array) if array.ndim else []
            kept = np.concatenate([array[low:high] for low, high in spans]) if array.ndim else array
            new = Rows(array.shape, spans, kept)
            old = before.fields.get(name + part) if before else None
            same = old is not None and old.shape == new.shape and old.spans == spans and np.array_equal(old.rows, kept)
            fields[name + part] = old if same else new
    return Snapshot(Host.of(sim), fields, rooms_of(sim.world), sim.first_walls)


def restore(sim: Simulation, snapshot: Snapshot) -> None:
    """Puts `sim`, of the same structure, back to the moment of `snapshot`; SandError, and nothing has changed, if it cannot be one. If its
    tables have grown since, those of that moment are as large.
    """
    sim.take_room(snapshot.rooms)
    before, after = (sim.sizes_with(rooms) for rooms in (snapshot.rooms, rooms_of(sim.world)))
    fields = tables_of(sim)
    tables = checkpoint.tables_of(fields)
    stored = {name: rows.whole() for name, rows in snapshot.fields.items()}
    if before != after or snapshot.rooms != rooms_of(sim.world):
        stored = {name: in_larger(name, stored[name], tables[name].shape, before, after) for name in stored if name in tables}
    checkpoint.check_shapes(tables, stored)
    if snapshot.foreign:
        belief.check(sim, snapshot.host, tables, {name: stored[name] for name in tables})
    checkpoint.restore(fields, stored)
    snapshot.host.give(sim)
    sim.mix()


def used_rows(sim: Simulation) -> Callable[[str, np.ndarray], Spans]:
    """A function from the name and array of a field to the spans of its rows that are in use."""
    world = sim.world
    count, half = int(world.count[None]), int(world.pace[None].half)
    base, walls = half * world.half, half * world.half + world.wall_base
    pair_end = min(walls, max(base, int(world.blocks.pair_end.to_numpy().max())))
    wall_end = min(base + world.half, max(walls, int(world.blocks.wall_end.to_numpy().max())))
    pairs = {
        2 * world.half: [(base, pair_end), (walls, wall_end)],
        2 * world.wall_half: [(half * world.wall_half, half * world.wall_half + wall_end - walls)],
        2 * world.capacity: [(half * world.capacity, half * world.capacity + count)],
    }

    entries = int(world.walls.start.to_numpy().max())
    if world.sleeps:  # the rows of sleepers are found in either half
        del pairs[2 * world.capacity]

    def spans(name: str, array: np.ndarray) -> Spans:
        rows = len(array)
        if (name.startswith(".0.grains") or name.startswith(".0.grid")) and rows == world.capacity:
            return [(0, count)]
        if name.startswith(".0.walls") and not name.startswith(".0.walls.start") and rows == world.walls.part.shape[0]:
            return [(0, entries)]
        if name.startswith(".0.pairs") and rows in pairs:
            return pairs[rows]
        return [(0, rows)]

    return spans


def to_bytes(snapshot: Snapshot) -> bytes:
    """The snapshot as the bytes of an .npz file."""
    shapes = {name: [rows.shape, rows.spans] for name, rows in snapshot.fields.items()}
    head = {"host": snapshot.host.to_json(), "session": snapshot.session, "shapes": shapes, "rooms": snapshot.rooms}
    head["walls"] = [wall.model_dump(exclude_unset=True) for wall in snapshot.walls]
    file = io.BytesIO()
    arrays = {name: rows.rows for name, rows in snapshot.fields.items()}
    np.savez_compressed(file, **{"head": np.frombuffer(json.dumps(head).encode(), np.uint8), **arrays})  # type: ignore[arg-type]
    return file.getvalue()


def from_bytes(data: bytes) -> Snapshot:
    """What `to_bytes` made; SandError, or one of archive.UNREADABLE, if it is something else."""
    head, arrays = archive.read(io.BytesIO(data), "head", misfit)
    host, session = Host.from_json(head["host"]), head["session"]
    if "rng" in session:
        np.random.default_rng().bit_generator.state = session["rng"]  # whether it can be one
    spans = {name: (tuple(shape), [tuple(span) for span in spans]) for name, (shape, spans) in head["shapes"].items()}
    rows = {name: Rows(*spans[name], rows) for name, rows in arrays.items()}
    walls = host.scene.with_walls(head["walls"]).walls
    return Snapshot(host, rows, Rooms(*head["rooms"]), walls, session, foreign=True)


def misfit(head: dict[str, Any], announced: dict[str, archive.Announced]) -> str:
    """What is wrong with the rows that a snapshot announces, or ""."""
    shapes = {name: tuple(shape) for name, (shape, _) in head["shapes"].items()}
    for name, (_, spans) in head["shapes"].items():
        shape, kept, ends = shapes[name], announced[name].shape, [0, *(end for span in spans for end in span)]
        if any(not isinstance(rows, int) or rows < 0 for rows in (*shape, *ends)):
            return f"{name} has no shape"
        if shape and (ends != sorted(ends) or ends[-1] > shape[0] or kept != (sum(high - low for low, high in spans), *shape[1:])):
            return f"the rows of {name} do not fit its shape"
    scene = Scene.from_json(head["host"]["scene"])
    room = min(rooms.by_hand(scene), shapes[rooms.GRAINS][0])  # at most: it does not say whether there is a hand
    return rooms.misfit(scene, room, Rooms(*head["rooms"]), shapes)
