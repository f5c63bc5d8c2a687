"""What the numbers of the tables may be: a checkpoint or a recording may come from anybody, and kernels look at no index twice.

INDICES has every table of whole numbers, and a test that it has; what belongs together stands in `relations`. What is not a whole number
is finite, and where places and cells follow from it no larger than it can be.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.scene.materials import MOST as MOST_MATERIALS
from taichi_sand.scene.schema import Scene
from taichi_sand.world.clumps import MOST
from taichi_sand.world.tables import World
from taichi_sand.world.walls.build import tables_of

LARGEST = 2**31 - 1
LATEST = 2**30  # steps
FARTHEST = 2**24  # lattice sites
HUGE = 1e31
"""Numbers stand for what is endless up to 1e30."""
FAST, AWAY = 10.0, 100.0
"""Grains are no faster than so many times what is followed or what they start with, and no farther off than so many boxes."""
SAME = "same"
"""As in a simulation of the scene that has just been made."""
ANY = (-LARGEST - 1, LARGEST)
FLAG = (0, 1)
Bound = int | str
"""A number, or one of `Sizes`."""


@dataclass(frozen=True)
class Sizes:
    """How far indices may go: last valid ones, and ends of runs."""

    capacity: int
    last_slot: int
    last_grain: int  # the last slot stays empty
    rows: int  # of the neighbour list, all its parts
    last_row: int
    last_part: int  # of walls
    last_wall: int  # of those that move
    last_entry: int  # of walls that move
    room_moving: int
    entries: int  # of walls that stand still
    last_site: int
    last_cell: int
    last_kind: int
    links: int
    last_end: int  # of links
    ends: int
    last_id: int  # of grains that links know
    least_pause: int  # steps between two looks of the effects that watch the grains; 0 if none does
    most_pause: int


def sizes_of(world: World, kinds: int) -> Sizes:
    """Those of a world with grains of so many kinds."""
    rows, movers, links = world.pairs.first.shape[0], world.movers, world.links
    watched = world.pace[None].on_step > 0  # as many steps as the step, which changes, makes of an interval
    parts = [field.shape[0] for field in (movers and movers.wall, world.walls.friction) if field is not None]
    return Sizes(
        capacity=world.capacity,
        last_slot=world.capacity - 1,
        last_grain=world.capacity - 1,
        rows=rows,
        last_row=rows - 1,
        last_part=min(parts, default=world.walls.part.shape[0]) - 1,
        last_wall=movers.twist.shape[0] - 1 if movers else -1,
        last_entry=movers.next.shape[0] - 1 if movers else 0,
        room_moving=movers.next.shape[0] if movers else 0,
        entries=world.walls.room,
        last_site=movers.head.shape[0] - 1 if movers else 0,
        last_cell=world.grid.start.shape[0] - 1,
        last_kind=kinds - 1,
        links=links.whole.shape[0] if links else 0,
        last_end=links.of.shape[0] - 1 if links else 0,
        ends=links.of.shape[0] if links else 0,
        last_id=links.slot.shape[0] - 1 if links else 0,
        least_pause=int(watched),
        most_pause=LATEST * watched,
    )


INDICES: dict[str, tuple[Bound, Bound] | str] = {
    "grains.site": (-FARTHEST, FARTHEST),
    "grains.id": (-1, LARGEST),
    "grains.kind": (0, "last_kind"),
    "count": (0, "last_grain"),
    "pairs.first": (0, "last_slot"),
    "pairs.second": (-1, LARGEST),  # of what, tells the row: see `relations`
    **{
        f"{table}.{name}": (0, "rows")
        for table in ("pairs", "sleep")
        for name in ("row_start", "row_count", "wall_row_start", "wall_row_count")
    },
    "pairs.discs": (0, MOST * MOST - 1),
    **{f"blocks.grain_{end}": (0, "capacity") for end in ("start", "end")},
    **{f"blocks.{kind}_{end}": (0, "rows") for kind in ("pair", "wall") for end in ("start", "end")},
    "blocks.lane_end": (0, "rows"),
    "grid.start": (0, "capacity"),
    "grid.cell": (0, "last_cell"),
    "grid.source": (0, "last_slot"),
    "grid.columns": (1, "last_cell"),
    "grid.rows": (1, "last_cell"),
    "box:sites": SAME,
    "shapes.start": SAME,
    "flags": ANY,
    "flow.made": (0, LARGEST),
    "flow.sunk": (0, LARGEST),
    "walls.start": (0, "entries"),
    "walls.part": (0, "last_part"),
    "walls.side": (-1, 1),
    "walls.material": (0, MOST_MATERIALS),
    "materials.of": SAME,
    "movers.wall": (-1, "last_wall"),
    "movers.part": (0, "last_part"),
    "movers.side": (-1, 1),
    "movers.beside": (-1, "last_wall"),
    "movers.parts": ANY,  # as all that follows from the walls of the scene: see `_walls`
    "movers.walls": ANY,
    "movers.count": (0, "room_moving"),
    "movers.site": (0, "last_site"),
    "movers.head": (-1, "last_entry"),
    "movers.next": (-1, "last_entry"),
    "movers.first": (-1, "last_row"),
    "pairs.driven": (-1, "last_row"),
    "links.ends": (0, "last_id"),
    "links.slots": (-1, "last_slot"),
    "links.slot": (-1, "last_slot"),
    "links.whole": FLAG,
    "links.last": FLAG,
    "links.start": (0, "ends"),
    "links.of": (0, "last_end"),
    "links.count": (0, "links"),
    "sleep.origin": (0, "last_slot"),
    "sleep.slot": (-1, "last_slot"),
    "sleep.start": (0, "capacity"),
    "sleep.restless": FLAG,
    "sleep.woken": FLAG,
    "sleep.state:awake": (0, "last_grain"),
    "sleep.state:asleep": (0, "last_grain"),
    "sleep.state:moved": FLAG,
    "sleep.state:due": FLAG,
    "sleep.state:seen": (0, LATEST),
    **{f"pace:{name}": FLAG for name in ("strayed", "spent", "impacts", "warm_start", "hit", "half", "short", "hasty", "moved", "noted")},
    **{f"pace:{name}": (0, LATEST) for name in ("since", "done", "list_builds", "round")},
    "pace:lacking": SAME,
    "pace:on_step": ("least_pause", "most_pause"),
    "struck": (0, LATEST),  # marks of a round
    "near": (0, LATEST),
    "effects.now:work": (0, 3),
    "effects.now:grain": (-1, LARGEST),
    **{f"effects.fluid.{name}": SAME for name in ("levels", "now:columns", "now:rows", "now:levels", "now:law", "now:wells")},
    **{f"effects.fluid.now:{name}": (0, LARGEST) for name in ("top", "rounds", "gone", "full")},
    "effects.fluid.now:markers": (0, LARGEST),  # kernels take no more than there is room for
    "effects.fluid.now:free": FLAG,
    "effects.fluid.now:fenced": FLAG,
    "effects.fluid.wells.made": (0, LARGEST),
    "effects.fluid.cells.kind": (-1, 1),
    **{f"effects.fluid.cells.{name}": ANY for name in ("label", "met")},  # scratch
    **{f"effects.fluid.{name}.block": (0, 2) for name in "uv"},
    **{f"effects.fluid.{name}.known": (-2, 4) for name in "uv"},
}
"""Least and largest value of every table of whole numbers."""
MADE_FOR = {f"box:{name}" for name in ("size", "spacing", "diameter", "largest", "least", "listed", "bridge", "least_cell")}
"""What tables are made for; of what the box holds besides, weight and gravity may change while it runs."""
EQUAL = 1e-4
"""How nearly a number is the same that another machine has worked out."""


def short(name: str) -> str:
    """How tables are called here: `.0.pairs.first` is pairs.first, `.1.effects.3.now:work` effects.now:work."""
    return re.sub(r"^\.0\.|^\.1\.|(?<=effects)\.\d+(?=\.)", "", name)


def check(world: World, scene: Scene, kinds: int, fresh: dict[str, np.ndarray], stored: dict[str, np.ndarray]) -> None:
    """Looks at the tables of a checkpoint before they go into a world.

    Args:
        world: that they are for.
        scene: that they are of; its walls may be others than those of the world.
        kinds: of grains that there are.
        fresh: its tables as they are, before the first step.
        stored: those of the checkpoint, of the same names, shapes and types.

    Raises:
        SandError: a number cannot be what it is; the text says which, and names no file.
    """
    sizes = sizes_of(world, kinds)
    for name, values in stored.items():
        key = short(name)
        if values.dtype.kind == "i":
            _check_whole(key, values, fresh[name], sizes)
        elif not (np.abs(values) <= HUGE).all():
            raise SandError(f"{key} holds {values[~(np.abs(values) <= HUGE)].flat[0]:g}, which is no number of a simulation")
        elif key in MADE_FOR and not np.allclose(values, fresh[name], rtol=EQUAL, atol=1e-12):
            raise SandError(f"{key} is {values.tolist()}, but {fresh[name].tolist()} for its scene")
    named = {short(name): values for name, values in stored.items()}
    started = {short(name): values for name, values in fresh.items()}
    for wrong in (*_walls(world, scene, named), *relations(world, sizes, named), *_flights(world, named, started)):
        if wrong:
            raise SandError(wrong)


def _check_whole(key: str, values: np.ndarray, fresh: np.ndarray, sizes: Sizes) -> None:
    rule = INDICES[key]
    if isinstance(rule, str):
        if not np.array_equal(values, fresh):
            raise SandError(f"{key} does not fit its scene")
        return
    low, high = (getattr(sizes, bound) if isinstance(bound, str) else bound for bound in rule)
    wrong = values[(values < low) | (values > high)]
    if len(wrong):
        raise SandError(f"{key} holds {wrong.flat[0]}, which must lie in {low} … {high}")


def _walls(world: World, scene: Scene, of: dict[str, np.ndarray]) -> Iterator[str]:
    """What is wrong with the tables that follow from the walls of the scene: kernels find entries and sites by them."""
    try:
        tables = tables_of(world, scene)
    except SandError as error:
        yield str(error)
        return
    slack = EQUAL * float(of["box:least"])
    for name, values in tables.items():
        rows = of[name][: len(values)] if values.ndim else of[name]
        if values.size and (rows.shape != values.shape or not np.allclose(rows, values, EQUAL, slack if rows.dtype.kind == "f" else 0)):
            yield f"{name} does not fit the walls of its scene"


def relations(world: World, sizes: Sizes, of: dict[str, np.ndarray]) -> Iterator[str]:
    """What is wrong between tables whose numbers are each within their ranges."""
    row = np.arange(sizes.rows) % world.half
    second, most = of["pairs.second"], np.where(row < world.wall_base, sizes.last_slot, sizes.last_part)
    if (second > most).any() or (second < np.where(row < world.wall_base, 0, -1)).any():
        yield f"pairs.second holds {second[(second > most) | (second < 0)][0]}, which is no grain or wall"
    for kind in ("pair", "wall"):
        start, end = (of[f"blocks.{kind}_{side}"][: _blocks_used(world, of)] for side in ("start", "end"))
        yield _beyond(world, f"blocks.{kind}", kind, start, end)
    for table in ("pairs", "sleep"):
        for kind, head in (("pair", ""), ("wall", "wall_")):
            if f"{table}.{head}row_start" in of:
                start, count = of[f"{table}.{head}row_start"].astype(np.int64), of[f"{table}.{head}row_count"]
                apart = np.where((kind == "wall") | (start >= 2 * world.half) | _of_boulders(world, start), 1, world.lanes)
                yield _beyond(world, f"{table}.{head}row", kind, start, np.where(count > 0, start + (count - 1) * apart + 1, start))
    for axis, wraps in enumerate(world.periodic):
        site = of["grains.site"][:, axis]
        if wraps and ((site < 0) | (site >= int(of["box:sites"][axis]))).any():
            yield "grains.site lies outside of a periodic box"
    cells, boulder = int(of["grid.columns"]) * int(of["grid.rows"]), int(world.boulders > 0)
    least = np.maximum(1, np.floor(of["box:size"] / of["box:least_cell"])).prod()
    if max(cells, least) + boulder > sizes.last_cell - 1:
        yield f"the grid has {max(cells, int(least))} cells, more than there is room for"
    if "pairs.driven" in of:
        yield _driven(world, of["pairs.driven"], int(of["movers.first"]))
    if "movers.next" in of:
        yield _entries(of["movers.site"][: int(of["movers.count"])], of["movers.head"], of["movers.next"])
    if "links.whole" in of and (((of["links.whole"] | of["links.last"]) == 1)[:, None] & (of["links.slots"] < 0)).any():
        yield "links.slots has lost a grain of a link that holds"
    if "sleep.state:awake" in of and of["sleep.state:awake"] + of["sleep.state:asleep"] > of["count"]:
        yield "sleep.state counts more grains than there are"


def _blocks_used(world: World, of: dict[str, np.ndarray]) -> int | None:
    """How many blocks are in use, the first of them: in "cells" those of the grid as it is, of others all (None)."""
    cells = int(of["grid.columns"]) * int(of["grid.rows"])
    return cells + int(world.sleeps or world.boulders > 0) if world.layout == "cells" else None


def _of_boulders(world: World, start: np.ndarray) -> np.ndarray:
    """Which pairs stand one after the other as those of boulders do."""
    return (start % world.half >= world.wall_base - world.boulders) & (world.boulders > 0)


def _beyond(world: World, name: str, kind: str, start: np.ndarray, end: np.ndarray) -> str:
    """Whether runs of rows leave the part of the neighbour list that they are in, in words, or ""."""
    part = start // world.half * world.half
    low, high = (part, part + world.wall_base) if kind == "pair" else (part + world.wall_base, part + world.half)
    wrong = (end > start) & ((start < low) | (end > high))
    return f"{name}s run from {start[wrong][0]} to {end[wrong][0]}, beyond their part of the table" if wrong.any() else ""


def _entries(site: np.ndarray, head: np.ndarray, following: np.ndarray) -> str:
    """Whether the moving walls listed at each lattice site are those that lie there, from the last to the first, in words, or ""."""
    order = np.argsort(site, kind="stable")
    first = np.diff(site[order], prepend=-1) != 0
    wanted, last = np.empty(len(site), np.int64), np.full(len(head), -1)
    wanted[order] = np.where(first, -1, np.roll(order, 1))
    last[site[order]] = order  # of several the last
    if (following[: len(site)] != wanted).any() or (head != last).any():
        return "movers.head and movers.next do not list what movers.site holds"
    return ""


def _driven(world: World, following: np.ndarray, row: int) -> str:
    """Whether the rows of walls with force, linked from the last one to the first, leave those of walls or run in a circle, or ""."""
    last = int(world.pairs.first.shape[0])
    while row >= 0:
        part, place = divmod(row, world.half)
        if row >= last:
            return "pairs.driven runs in a circle"
        if place < world.wall_base:
            return "pairs.driven leads to a row that is about no wall"
        last, row = row, int(following[part * world.wall_half + place - world.wall_base])
    return ""


def _flights(world: World, of: dict[str, np.ndarray], fresh: dict[str, np.ndarray]) -> Iterator[str]:
    """What is wrong with places and speeds: cells and sites are found from them."""
    count, side = int(of["count"]), float(of["box:size"].max())
    for name in ("offset", "shift"):
        if (np.abs(of[f"grains.{name}"][:count]) > AWAY * side).any():
            yield f"grains.{name} lies far outside of the box"
    if (of["grains.radius"][:count] <= 0).any():
        yield "grains.radius is not above 0"
    most = FAST * max(float(fresh["pace:speed_cap"]), float(np.abs(fresh["grains.twist"][:, :2]).max()))
    for name in ("twist", "start_velocity"):
        if (np.abs(of[f"grains.{name}"][:count, :2]) > most).any():
            yield f"grains.{name} is faster than {most:.3g} m/s"
