"""Makes the World of a scene."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.scene import moving
from taichi_sand.scene.grains import Pack
from taichi_sand.scene.packing import parted
from taichi_sand.taichi_support import field_pool
from taichi_sand.world import flags
from taichi_sand.world.clumps import build_shapes
from taichi_sand.world.extras.grain_rows import allocate_carried, allocate_grains, new_rows
from taichi_sand.world.extras.links import build_links
from taichi_sand.world.extras.materials import lay_materials
from taichi_sand.world.extras.sinks import build_flow
from taichi_sand.world.search.cell_list import allocate_grid
from taichi_sand.world.search.growth import KINDS, NO_ROOMS, Rooms, Sizes, foreseen, sizes_of
from taichi_sand.world.search.images import lay_images
from taichi_sand.world.search.large_grains import part_boulders
from taichi_sand.world.search.neighbour_list import LEAST_SKIN, LEAST_SLACK, MOST_REACH, MOST_SKIN, MOST_SLACK
from taichi_sand.world.sleep.state import allocate_sleep_state, start_awake
from taichi_sand.world.tables import (
    LANES,
    LEAST_ROOM,
    SPARE,
    STRIPS,
    World,
    allocate_blocks,
    allocate_pairs,
    box_type,
    pace_type,
    round_up,
    site_rows,
)
from taichi_sand.world.walls.build import SIDES, lay_walls, wall_parts
from taichi_sand.world.walls.segments import cast_parts, moving_entries

STRIPS_FROM = 30_000
"""Grains from which a sweep pays for being cut into strips: handing out a parallel loop costs as much as some thousand pairs."""
EARTH = 9.81  # m/s2
CELLS_PER_GRAIN = 4
SITES_PER_GRAIN = 4


def lay_lattice(size: tuple[float, float], diameter: float, count: int) -> tuple[tuple[float, float], tuple[int, int]]:
    """Spacing [m] and number of lattice sites: about two grains wide, fewer in a large box."""
    width = max(2 * diameter, math.sqrt(size[0] * size[1] / (SITES_PER_GRAIN * count + 65536)))
    sites = max(1, math.floor(size[0] / width)), max(1, math.floor(size[1] / width))
    return (size[0] / sites[0], size[1] / sites[1]), sites


def check_periodic(scene: Any, pack: Pack, reach: float, gpu: bool) -> None:
    """SandError if a periodic axis has room for less than three of the widest cells: a list build could then pair two grains twice. Columns
    of cells that are swept in colours come in twos, so there must be four.
    """
    if not len(pack):
        return
    if scene.edges.shear_rate:
        check_sheared(scene, pack, gpu)
    widest = 2 * float(pack.radius.max()) + (MOST_SKIN + MOST_SLACK + reach) * 2 * float(pack.size.mean())
    for axis, side, length in (("x", "left", scene.size[0]), ("y", "bottom", scene.size[1])):
        fours = layout_of(gpu, len(pack)) == "cells" or scene.edges.shear_rate
        least = (4.001 if axis == "x" and fours else 3.001) * widest
        if getattr(scene.edges, side) == "periodic" and length < least:
            text = f"{length:g} m is too short for a box periodic along {axis}; these grains need at least {least:.3g} m"
            raise scene.error("size", text)


def check_sheared(scene: Any, pack: Pack, gpu: bool) -> None:
    """SandError if the images of these grains cannot slide: that is made for one block of cells, all of whose grains are alike."""
    if layout_of(gpu, len(pack)) != "one":
        where = "on a GPU" if gpu else f"of {STRIPS_FROM} grains or more"
        raise scene.error("edges.shear_rate", f"{scene.edges.shear_rate:g} 1/s cannot be had {where}")
    if part_boulders(pack.radius, most_discs(pack))[1]:
        raise scene.error("edges.shear_rate", f"{scene.edges.shear_rate:g} 1/s cannot be had with grains that much larger than the others")


def plan_cells(size: tuple[float, float], largest: float, capacity: int) -> tuple[float, int]:
    """Smallest width of a cell [m], and how many cells that makes at most."""
    width = largest * (1 + LEAST_SKIN + LEAST_SLACK)
    cells = math.floor(size[0] / width + 1) * math.floor(size[1] / width + 1)
    most = CELLS_PER_GRAIN * capacity + 4096
    return (width * 1.01 * math.sqrt(cells / most), most) if cells > most else (width, cells)


def layout_of(gpu: bool, grains: int) -> str:
    """Layout of the sweep: see world.sweep. Tests put another function in the place of this one to have "cells" on a CPU."""
    return "cells" if gpu else "strips" if grains >= STRIPS_FROM else "one"


def most_of_a_colour(size: tuple[float, float], width: float) -> int:
    """Most cells of one colour of world.sweep.sweep_cells, where cells are no smaller than `width` [m]."""
    columns, rows = (math.floor(side / width) + 1 for side in size)
    return round_up(math.ceil(columns / 2) * (rows // 3 + 1))


def most_summed(layout: str, sleeps: bool, cells: int, capacity: int, sites: tuple[int, int]) -> int:
    """Rows of the longest column that a prefix sum is made of: of cells if they sort in parallel, of grains and sites if grains sleep."""
    return max([1] + [cells + 2] * (layout == "cells") + [capacity, site_rows(sites)] * sleeps)


def mean_weight(scene: Any, pack: Pack) -> float:
    """Mean weight of the grains that can move [N]; on earth where there is no gravity."""
    free = pack.mass[~pack.fixed]
    return (math.hypot(*scene.gravity) or EARTH) * (float(free.mean()) if len(free) else 0.0)


def lengths_of(scene: Any, pack: Pack, reach: float, sleeps: bool) -> tuple[dict[str, float], int]:
    """Lengths that tables are made for [m], by their names in world.tables.box_type, and rows for the pairs of boulders.

    Where grains may sleep, boulders go into cells like all others: sleepers lie where boulders would.
    """
    radius, size = (pack.radius, pack.size) if len(pack) else 2 * (np.array([0.01 * min(scene.size)]),)
    largest, diameter = 2 * float(radius.max()), 2 * float(size.mean())
    listed, boulders = (largest, 0) if sleeps else part_boulders(radius, most_discs(pack))
    lengths = {"diameter": diameter, "largest": largest, "least": 2 * float(radius.min()), "listed": listed, "bridge": reach * diameter}
    return lengths, boulders


def box_numbers(scene: Any, pack: Pack) -> dict[str, Any]:
    """What of the box does not depend on how it is cut up."""
    return {"size": scene.size, "gravity": scene.gravity, "weight": mean_weight(scene, pack)}


def most_discs(pack: Pack) -> int:
    """Discs of the grain that has most."""
    return max((len(form.discs) for form in pack.forms), default=1)


def edges_of(scene: Any, real: Any) -> dict[str, Any]:
    """Which axes of the box are periodic (x, y), which edges are open (left, right, bottom, top), and how images slide."""
    edges = [getattr(scene.edges, side) for side in SIDES]
    return {"periodic": scene.periodic, "open_edges": tuple(edge == "open" for edge in edges), **lay_images(scene, real)}


def kinds_of(scene: Any) -> tuple[bool, bool, bool]:
    """Whether walls move, whether some are driven, and whether images slide."""
    return bool(moving.moving_walls(scene)), any(moving.drive(wall) for wall in scene.walls), bool(scene.edges.shear_rate)


def rows_of(sizes: Sizes, rooms: Rooms) -> dict[str, Any]:
    """How the rows of the neighbour list are shared out, as members of a world."""
    return {
        "half": sizes.half,
        "wall_base": sizes.wall_base,
        "wall_half": sizes.wall_half,
        "boulders": rooms.boulders,
        "boulder_walls": rooms.boulder_walls,
        "rows": rooms.rows,
        "wall_rows": rooms.walls,
    }


def tie(links: np.ndarray | None, pack: Pack, real: Any) -> dict[str, Any]:
    """Whether grains of `pack` are tied together, and the links (n, 2) that do, as members of a world."""
    return {"linked": links is not None and len(links) > 0, "links": build_links(links, pack, real)}


def make_world(
    scene: Any,
    pack: Pack,
    extra: int,
    turns: bool,
    gpu: bool,
    room: int = 0,
    wall_room: int = 0,
    sleeps: bool = False,
    reach: float = 0.0,
    carried: Mapping[str, float] = MappingProxyType({}),
    links: np.ndarray | None = None,
    rooms: Rooms = NO_ROOMS,
) -> World:
    """World of `scene` with room for the grains of `pack` and `room` more, and for `wall_room` entries of walls.

    `extra` columns of the neighbour list follow a pair; `carried` names the columns that follow a grain, and what a grain starts with;
    effects act on grains up to `reach` [d] apart, and tie the grains `links` (n, 2) together. Tables are no smaller than `rooms`.
    """
    layout, kinds = layout_of(gpu, len(pack)), kinds_of(scene)
    real, first = ti.f64 if scene.solver.precision == 64 else ti.f32, round_up(len(pack) + room + 1)
    (lengths, boulders), capacity = lengths_of(scene, pack, reach, sleeps), max(first, rooms.grains)  # sites and cells do not grow
    diameter, sight = lengths["diameter"], lengths["largest"] / 2 + MOST_REACH * lengths["diameter"] + lengths["bridge"]
    spacing, sites = lay_lattice(scene.size, diameter, first)
    least_cell, most_cells = plan_cells(scene.size, lengths["listed"] + lengths["bridge"], first)
    cells, lanes = round_up(most_cells + 1, 64 if layout == "cells" else LEAST_ROOM), LANES[layout, scene.solver.kind]
    blocks = {"one": 1, "strips": STRIPS, "cells": cells}[layout]
    parts = wall_parts(scene, lengths["least"])
    big = (int((2 * pack.radius > lengths["listed"] * 1.00001).sum()) if boulders else 0, boulders)
    entries, shares = moving_entries(parts, spacing, sight), capacity + SPARE * min(blocks, STRIPS)
    rooms = foreseen(parts, diameter, len(pack) + room, most_discs(pack), shares, big, entries, rooms)
    sizes, still = sizes_of(rooms, capacity, blocks), cast_parts(parts, spacing, sites, sight, scene.periodic)
    world = World(
        grains=allocate_grains(real, capacity, pack.clumps),
        pairs=allocate_pairs(real, capacity, sizes.half, sizes.wall_half, extra, 3 if sleeps else 2, pack.clumps, *kinds),
        blocks=allocate_blocks(blocks + (sleeps or boulders > 0), lanes),
        grid=allocate_grid(real, layout, capacity, cells, most_summed(layout, sleeps, cells, capacity, sites)),
        **lay_walls(scene, parts, still, sites, wall_room, rooms.entries, gpu, real),
        **build_flow(scene, real),
        pace=field_pool.record(pace_type(real)),
        lacks=field_pool.scalars(real, KINDS),
        flags=flags.allocate(),
        count=field_pool.scalars(ti.i32, ()),
        box=field_pool.record(box_type(real)),
        **edges_of(scene, real),
        capacity=capacity,
        **rows_of(sizes, rooms),
        sleeps=sleeps,
        yields=scene.solver.kind == "md",
        sleep=allocate_sleep_state(real, capacity, sites) if sleeps else None,
        turns=turns or pack.clumps,
        clumps=pack.clumps,
        shapes=build_shapes(pack.forms, real) if pack.clumps else None,
        carried=allocate_carried(real, capacity, carried),
        **lay_materials(scene, real),
        **tie(links, pack, real),
        discs=most_discs(pack),
        layout=layout,
        lanes=lanes,
        colour_cells=most_of_a_colour(scene.size, least_cell) if layout == "cells" else 0,
        real=real,
    )
    world.box[None] = {"spacing": spacing, "sites": sites, "least_cell": least_cell, **lengths, **box_numbers(scene, pack)}
    return world


def fill(world: World, pack: Pack) -> None:
    """Puts the grains of `pack` into slots 0, 1, …"""
    count, g = len(pack.radius), world.grains
    spacing = np.array(world.box[None].spacing.to_list())
    position = parted(pack, np.array(world.box[None].size.to_list()))
    for name, values in new_rows({**vars(pack), "position": position}, 0, spacing).items():
        field = getattr(g, name)
        kind = {ti.i32: np.int32, ti.f32: np.float32, ti.f64: np.float64}[field.dtype]
        whole = np.zeros((world.capacity, *values.shape[1:]), kind)
        whole[:count] = values
        field.from_numpy(whole)
    world.count[None] = count
    if world.sleeps:
        start_awake(world.sleep, count)
