"""Tables that grow: what a list build finds too small is made larger, in the same step, before anything has moved (world.search.growth)."""

import re
from typing import Any

import numpy as np

from taichi_sand.run import stepping
from taichi_sand.run.clock import Clock
from taichi_sand.run.events import laid_walls
from taichi_sand.scene.schema import Scene
from taichi_sand.taichi_support import field_pool, runtime
from taichi_sand.world.checkpoint import read_field
from taichi_sand.world.search.growth import NO_ROOMS, Rooms, Sizes, sizes_of
from taichi_sand.world.search.neighbour_list import list_again
from taichi_sand.world.sleep.wake import clear_stale_rows_now
from taichi_sand.world.tables import World, round_up
from taichi_sand.world.walls.build import change_walls, structure_fits
from taichi_sand.world.walls.motion import clocks_of

STARTS = ("row_start", "wall_row_start")
"""Columns that hold rows of the neighbour list."""
BY_SLOT = (*STARTS, "row_count", "wall_row_count")
"""Columns with a row a slot, in halves."""


def rooms_of(world: World) -> Rooms:
    """How much room the tables of a world have."""
    entries = world.movers.next.shape[0] if world.moves else 0
    return Rooms(world.rows, world.wall_rows, world.boulders, world.boulder_walls, entries, world.capacity)


def in_larger(name: str, values: np.ndarray, shape: tuple[int, ...], before: Sizes, after: Sizes) -> np.ndarray:
    """The values of the field `name` of a simulation with neighbour lists of size `before`, as one with size `after` has them, in `shape`;
    as they are if they are not of such a simulation.
    """
    if name.endswith(STARTS):
        values = before.moved(values, after).astype(values.dtype)
    if values.shape == shape or values.ndim != len(shape) or values.shape[1:] != shape[1:]:
        return values
    larger, rows = np.zeros(shape, values.dtype), np.arange(len(values))
    if name.startswith(".0.carried"):  # the last slot holds what a grain starts with
        larger[:] = values[-1]
    if name.endswith(BY_SLOT) and len(values) == 2 * before.capacity:
        rows = before.moved_slots(rows, after)
    elif name.startswith(".0.pairs"):
        rows = before.moved(rows, after) if len(values) % before.half == 0 else before.moved_walls(rows, after)
    if len(rows) and rows.max() >= shape[0]:
        return values
    larger[rows] = values
    return larger


def once(named: dict[str, Any]) -> dict[str, Any]:
    """These fields, each under the first of its names."""
    first = {id(field): (name, field) for name, field in reversed(named.items())}
    return dict(reversed(first.values()))


class Growing:
    """The side of `Simulation` that sees to the room of its tables."""

    world: Any
    solver: Any
    hand: Any
    rooms: Rooms
    planned: Any
    numbers: dict[str, float]
    bed: Any
    clock: Clock
    scene: Scene
    first_walls: Any
    returning: Any
    _lay: Any
    _fields: Any

    def fit_tables(self) -> None:
        """Larger tables, and all pairs listed again, if the last list build found more than there is room for."""
        lacking = self.world.pace[None].lacking
        if not lacking:
            return
        with self.clock.stage("compile"):
            while self.world.pace[None].lacking:
                self.take_room(rooms_of(self.world).larger(self.world.lacks.to_numpy()))
                self.world.lacks.fill(0)
                self.world.pace[None].lacking = 0
                list_again(self.world)
            stepping.warm(self.world, self.solver)
        if lacking == 2:
            clear_stale_rows_now(self.world)
            stepping.renew(self.world, self.solver)

    def _have_room(self, count: int) -> None:
        """Slots for `count` grains more than there are."""
        need = int(self.world.count[None]) + count + 1
        if need > self.world.capacity:
            with self.clock.stage("compile"):
                self.take_room(NO_ROOMS._replace(grains=round_up(need)))
                stepping.warm(self.world, self.solver)

    def take_room(self, rooms: Rooms) -> None:
        """Goes on with tables of at least so much room, and all there is in them; where there is as much already, with those there are."""
        rooms = rooms_of(self.world).joined(rooms)
        if rooms != rooms_of(self.world):
            self._lay_again(rooms)

    def _move_walls(self, scene: Scene) -> None:
        """Has the walls of `scene`, of other kinds or moving otherwise."""
        clocks = clocks_of(self.world.movers)
        with self.clock.stage("compile"):
            if not structure_fits(self.world, scene):
                self.first_walls = laid_walls(scene)
                self._lay_again(rooms_of(self.world), (".0.walls", ".0.movers"))
                stepping.warm(self.world, self.solver)
        change_walls(self.world, self.scene, scene, clocks)

    def _become(self, scene: Scene) -> None:
        """Goes on as `scene`, which has effects more: with tables and kernels of another structure, and all there is in them."""
        with self.clock.stage("compile"):
            self.scene = scene
            self._lay_again(rooms_of(self.world))
            stepping.warm(self.world, self.solver)

    def _lay_again(self, rooms: Rooms, new: tuple[str, ...] = ()) -> None:
        """Makes world, solver and effects anew, with this room at least; what is in tables that there were goes into those there are, but
        for those whose names begin with `new`.
        """
        kept = {name: self.__dict__[name] for name in ("bed", "numbers")}
        before, sizes = self._named_fields(), self.sizes_with(rooms_of(self.world))
        self.rooms = rooms
        give_back = self.returning
        self.returning = field_pool.borrow(self, lambda: self._lay(self.planned, self.hand is not None), keep=not runtime.on_gpu())
        self.__dict__.update(kept)
        for name, field in self._named_fields().items():
            if name in before and not name.startswith(new):
                write_field(field, read_field(before[name]), name, sizes, self.sizes_with(self.rooms))
        give_back()

    def _named_fields(self) -> dict[str, Any]:
        """Its fields, each under one name, in which effects go by their kind: others may come between."""
        kinds = [type(effect).__name__ for effect in self.solver.effects]
        fields = once(self._fields()).items()
        return {re.sub(r"(?<=effects\.)\d+", lambda found: kinds[int(found[0])], name): field for name, field in fields}

    def sizes_with(self, rooms: Rooms) -> Sizes:
        """Sizes of its neighbour lists if they had this room."""
        blocks = self.world.blocks.pair_start.shape[0]
        return sizes_of(rooms, rooms.grains, blocks - int(self.world.sleeps or self.world.boulders > 0))


def write_field(field: Any, parts: dict[str, np.ndarray], name: str, before: Sizes, after: Sizes) -> None:
    """Puts what `read_field` gave of a field `name` with tables of size `before` into one with tables of size `after`."""
    values = {part: in_larger(name + part, array, shape_of(field, part), before, after) for part, array in parts.items()}
    field.from_numpy(values[""] if "" in values else {part[1:]: array for part, array in values.items()})


def shape_of(field: Any, part: str) -> tuple[int, ...]:
    """Shape of the array that `read_field` gives for a part of a field."""
    member = field.get_member_field(part[1:]) if part else field
    return tuple(member.shape) + ((member.n,) if hasattr(member, "n") else ())
