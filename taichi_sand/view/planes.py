"""States of a simulation in a few bytes a disc, for what draws them somewhere else: a page in a browser.

Places are whole numbers 0 … 65535 across the box and a margin, angles and the numbers that colours show are bytes. Discs are listed by the
ids of their grains, so that a row is the same disc from state to state.
"""

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_sand.files.jsons import finite
from taichi_sand.measure.contacts import contacts
from taichi_sand.view import kernels, palette
from taichi_sand.view.paint import sand_tones
from taichi_sand.view.picture import SIDES, wall_lines, water_of
from taichi_sand.view.scales import Scales
from taichi_sand.view.views import KIND, PHOTOELASTIC, views_of
from taichi_sand.view.wet import WETTEST
from taichi_sand.world.edit import link_lines
from taichi_sand.world.reading import column_of, rows_of

LAST = 65535
"""The highest of the whole numbers that places are."""
MARGIN = 2.0
"""Places reach so many largest radii over the edges of the box."""
WET = "wet"
"""Besides the views, among what colours show: how much darker wet grains are."""
ASLEEP, ABSENT = 1, 2
"""Bits of the flags of a disc."""
LEVELS = (-0.5, 1.5)
"""Depths [cells] between which the surface of water is drawn."""
UP = 2
"""The water's raster is sent with every node but these left out between."""


@dataclass(frozen=True)
class Roster:
    """The discs there are: what of them stays from state to state; arrays of a row a disc."""

    grain: np.ndarray  # id of the grain, i32
    disc: np.ndarray  # which of its discs, u8
    kind: np.ndarray  # which table of the scene it is of, u8
    fixed: np.ndarray  # 1 if it does not move, u8
    radius: np.ndarray  # [m], f32
    tone: np.ndarray  # colour by kind, (n, 3) u8

    def planes(self) -> list[tuple[str, np.ndarray]]:
        """Its columns by name."""
        return [(name, getattr(self, name)) for name in ("grain", "disc", "kind", "fixed", "radius", "tone")]

    def keys(self) -> np.ndarray:
        """A number for every disc that no other has, ascending."""
        return self.grain.astype(np.int64) * 256 + self.disc


@dataclass(frozen=True)
class State:
    """One moment; arrays of a row a disc of the roster."""

    time: float
    roster: Roster
    x: np.ndarray  # u16
    y: np.ndarray  # u16
    angle: np.ndarray  # of its grain, in 256ths of a turn, u8
    flags: np.ndarray  # u8
    walls: np.ndarray  # straight parts (n, 4): x, y of one end, x, y of the other [m], f32
    shades: dict[str, np.ndarray] = field(default_factory=dict)  # by view: 0 … 255 over its range, u8
    tops: dict[str, float] = field(default_factory=dict)  # upper ends of those ranges, and of chains
    chains: dict[str, np.ndarray] | None = None  # contacts that push: rows of both discs (-1: a wall), level, way to the wall (256ths)
    bonds: np.ndarray | None = None  # ids of the grains that each holds together, (n, 2) i32
    water: dict[str, Any] | None = None  # columns, rows; level, foam and shade, u8 from the bottom up


def box_of(sim: Any) -> tuple[float, float, float, float]:
    """What the whole numbers span [m]: left, bottom, right, top."""
    margin = MARGIN * float(sim.world.box[None].largest)
    width, height = sim.scene.size
    return -margin, -margin, width + margin, height + margin


def scene_of(sim: Any) -> dict[str, Any]:
    """What a page must know of the scene, for JSON."""
    scene = sim.scene
    names = views_of(sim.world)
    return {
        "title": scene.title,
        "about": scene.about,
        "size": list(scene.size),
        "box": box_of(sim),
        "edges": [getattr(scene.edges, side) == "wall" for side in SIDES],
        "periodic": list(scene.periodic),
        "kinds": [" ".join(filter(None, (table.material, table.shape))) for table in (*scene.grains, *scene.sources)],
        "facts": f"{scene.solver.kind}, tolerance {scene.solver.tolerance:g} d",
        "diameter": float(sim.world.box[None].diameter),
        "views": [name for name in names if name != PHOTOELASTIC],
        "colours": [scene.view.cold, scene.view.hot],
        "window": scene.view.window,
    }


class Planes:
    """Reads the states of one simulation, as long as it keeps its world."""

    def __init__(self, sim: Any) -> None:
        self.sim, self.world = sim, sim.world
        self.scales = Scales(sim.world)
        self.pool = self.scales.water = water_of(sim)
        self.tones = sand_tones(max(1, len(sim.scene.grains) + len(sim.scene.sources)))
        self.roster: Roster | None = None
        self._colours = np.zeros(sim.world.capacity, np.uint32)
        low_x, low_y, high_x, high_y = box_of(sim)
        self.low, self.scale = (low_x, low_y), (LAST / (high_x - low_x), LAST / (high_y - low_y))
        self._forms()

    def _forms(self) -> None:
        """Discs of each kind of grain: the first, how many; arms and radii over the radius of the grain."""
        if self.world.clumps:
            start = self.world.shapes.start.to_numpy()
            self.first, self.parts = start[:-1], np.diff(start)
            self.forms = self.world.shapes.disc.to_numpy()

    def state(self, views: tuple[str, ...] = (), chains: bool = False) -> State:
        """This moment, with the numbers of these views, and the contacts if `chains`."""
        sim, world, g = self.sim, self.world, self.world.grains
        count = int(world.count[None])
        ids = rows_of(g.id, count)
        order = np.argsort(ids, kind="stable")
        order = order[np.searchsorted(ids[order], 0) :]  # those below are about to be dropped
        roster, owner = self._listed(ids, order)
        place, angle = column_of(world, g, "position", count)[order], column_of(world, g, "angle", count)[order]
        for axis in np.flatnonzero(sim.scene.periodic):
            place[:, axis] %= sim.scene.size[axis]
        x, y = (place[owner, axis] for axis in (0, 1))
        if world.clumps:
            c, s, arm = np.cos(angle)[owner], np.sin(angle)[owner], self.arms
            x, y = x + c * arm[:, 0] - s * arm[:, 1], y + s * arm[:, 0] + c * arm[:, 1]
        flags = np.zeros(count, np.uint8)
        if world.sleeps:
            flags[count - int(world.sleep.state[None].asleep) :] = ASLEEP
        shades, tops = {}, {}
        for name in views:
            if name != KIND:
                values, tops[name] = self.scales.measure(name, sim.time)
                shades[name] = byte(values[:count][order][owner] / max(tops[name], 1e-30) * 255)
        if hasattr(world.carried, "wetness"):
            tops[WET], wetness = WETTEST, rows_of(world.carried.wetness, count)[order]
            shades[WET] = byte(wetness[owner] / WETTEST * 255)
        found = self._chains(tops) if chains else None
        turned = np.rint(angle * (128 / np.pi)).astype(np.int64).astype(np.uint8)[owner]
        walls = wall_lines(sim).astype(np.float32)
        bonds = self._bonds() if world.linked else None
        places = self._whole(x, 0), self._whole(y, 1), turned, flags[order][owner]
        return State(sim.time, roster, *places, walls, shades, tops, found, bonds, self._water())

    def _whole(self, metres: np.ndarray, axis: int) -> np.ndarray:
        return np.clip(np.rint((metres - self.low[axis]) * self.scale[axis]), 0, LAST).astype(np.uint16)

    def _listed(self, ids: np.ndarray, order: np.ndarray) -> tuple[Roster, np.ndarray]:
        """The roster, the same one as long as the discs are the same; and the grain of every disc, by its rank."""
        world, count = self.world, len(ids)
        fixed = (column_of(world, world.grains, "mobility", count)[:, 0] == 0)[order].astype(np.uint8)
        old = self.roster
        if old is not None and np.array_equal(self.known[0], ids[order]) and np.array_equal(self.known[1], fixed):
            return old, self.owner
        kind = rows_of(world.grains.kind, count)[order]
        owner, disc = np.arange(len(order)), np.zeros(len(order), np.int64)
        radius = column_of(world, world.grains, "radius", count)[order].astype(np.float32)
        if world.clumps:
            owner = np.repeat(owner, self.parts[kind])
            disc = np.arange(len(owner)) - np.repeat(np.cumsum(self.parts[kind]) - self.parts[kind], self.parts[kind])
            forms = self.forms[self.first[kind][owner] + disc]
            self.arms = forms[:, :2] * radius[owner, None]
            radius = radius[owner] * forms[:, 2]
        kernels.colour_by_kind(world, self.tones, palette.packed(palette.FIXED), self._colours)
        packed = self._colours[:count][order][owner]
        tone = np.stack([(packed >> shift).astype(np.uint8) for shift in (16, 8, 0)], axis=1)
        self.known, self.owner = (ids[order], fixed), owner
        numbers = ids[order][owner].astype(np.int32), disc.astype(np.uint8), kind[owner].astype(np.uint8), fixed[owner]
        self.roster = Roster(*numbers, radius.astype(np.float32), tone)
        return self.roster, owner

    def _chains(self, tops: dict[str, float]) -> dict[str, np.ndarray]:
        """The contacts that push, by the first of their discs."""
        rows = contacts(self.sim)
        rows = rows[rows["force_n"] > 0]
        assert self.roster
        keys = self.roster.keys()
        first = np.searchsorted(keys, rows["id1"] * 256 + rows["disc1"])
        second = np.searchsorted(keys, rows["id2"] * 256 + np.maximum(rows["disc2"], 0))
        level, tops["chains"] = self.scales.levels(rows["force_n"].astype(np.float32), self.sim.time)
        way = np.arctan2(rows["normal"][:, 1], rows["normal"][:, 0]) * (128 / np.pi)
        second = np.where(rows["id2"] < 0, -1, second).astype(np.int32)
        numbers = {"first": first.astype(np.int32), "second": second, "level": byte(level * 255)}
        return numbers | {"way": np.rint(way).astype(np.int64).astype(np.uint8)}

    def _bonds(self) -> np.ndarray:
        """Ids of the two grains of every bond that holds."""
        return self.world.links.ends.to_numpy()[link_lines(self.world)[0]].astype(np.int32)

    def _water(self) -> dict[str, Any] | None:
        if self.pool is None:
            return None
        pool = self.pool
        pool.look()
        low, high = LEVELS
        level = (pool.level - low) / (high - low)
        planes = {"level": level, "foam": pool.foam, "shade": pool.shade}
        thin = {name: byte(255 * plane.reshape(pool.shape)[::UP, ::UP].T).ravel() for name, plane in planes.items()}
        columns, rows = ((side - 1) // UP + 1 for side in pool.shape)
        return {"columns": columns, "rows": rows, **thin}


def message(head: dict[str, Any], planes: list[tuple[str, np.ndarray]]) -> bytes:
    """Planes as a page takes them: the length of a head, the head in JSON, the planes one after the other, lowest bytes first."""
    about = {**head, "planes": [(name, array.dtype.str[1:], array.size) for name, array in planes]}
    text = json.dumps(finite(about), separators=(",", ":")).encode()
    ordered = (np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes() for _, array in planes)
    return b"".join([struct.pack("<I", len(text)), text, *ordered])


def byte(values: np.ndarray) -> np.ndarray:
    """Rounded, within 0 … 255."""
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)
