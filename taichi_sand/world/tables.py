"""The state of a simulation: Taichi fields in a few tables, a field a column.

Conventions, everywhere: +x right, +y up, angles counter-clockwise [rad], SI units with areal density (so that masses are kg and
forces N), the normal of a pair points from its first to its second member, overlap > 0 (gap < 0) in contact.

A position is kept in three parts, so that neither a large box nor a small step is lost to 32 bits: the lattice site (two integers),
the offset from the centre of that site at the last list build, and the shift since then:
position = (site + 1/2) * spacing + offset + shift.
The grains lie sorted by grid cell (column by column, upwards); `id` tells which grain of the scene a slot holds.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.taichi_support import field_pool
from taichi_sand.world.extras.grain_rows import Grains

STRIPS = 64
"""Most strips of columns that one sweep is cut into, when it is cut into strips at all; even."""
CHUNK = 512
"""Taichi gives a CPU thread at least so many indices of a parallel loop: a loop over blocks takes steps of CHUNK to be dealt out at all."""
PAIRS_PER_GRAIN, WALL_PAIRS_PER_GRAIN = 6, 3
"""Room in the neighbour list per disc to start with: equal discs have 3 pairs each (a pair is listed once), the rest is for the skin and
small grains; a third of the discs at most lie at walls, and have six. Tables that turn out too small grow (world.search.growth)."""
SPARE = 16
"""A block has room for the pairs of so many grains more than it holds: what one grain has may be far from the mean."""
LANES = {
    ("one", "md"): 4,
    ("one", "rigid"): 4,
    ("strips", "md"): 2,
    ("strips", "rigid"): 4,
    ("cells", "md"): 1,
    ("cells", "rigid"): 1,
}
"""A block's grains are dealt into this many runs, and its pairs are stored one of each run in turn: consecutive rows then share no
grain, and a processor works on several at once instead of waiting for the last one's result. Four are twice as fast as one; more gain
nothing, and cost where the world no longer fits the caches, as a processor fetches only some dozens of streams ahead (ns a grain with
2, 4 and 8: md 27.8, 26.8, 26.8 for 1000, 32.1, 33.3, 38.3 for 20000 grains; for 100000 in strips md 36, 40, 49, rigid 65, 61, 68)."""
ABREAST = 16
"""Grains that are looked at together: a vector of the widest processors."""
FEW_ABREAST = 4
"""Grains looked at side by side in the layout "cells": about what three cells hold."""
FAR = 1e15
MOST_STEPS = 2**31 - 1
"""That a simulation counts."""


class Pairs(NamedTuple):
    """One row a pair. Shape (2 * half,): one half is in use, the other keeps the pairs of the list build before, so that memory can
    follow a pair. Within a half, rows from `wall_base` on are pairs of a disc and a wall; wall-only columns have their own halves.
    A row that is not needed holds the last slot twice, FAR apart.
    """

    first: Any  # slot of the first grain, i32
    second: Any  # slot of the second grain; of a wall pair the number of the wall part, i32
    reach: Any  # from the first grain's centre to the second's (to a point of the wall) at the last list build [m], 2-vector
    contact_distance: Any  # sum of the radii; less by what a pair that was found deep in one another has yet to grow [m]
    normal: Any  # unit 2-vector from first to second, of the last step in which the pair was looked at
    gap: Any  # distance of the surfaces [m], < 0 in contact, of the same moment
    mass: Any  # effective mass along the normal [kg]
    root_mass: Any  # its square root, which damping coefficients go with
    mass_t: Any  # effective mass along the tangent, levers included [kg]
    force: Any  # [N] of the last step: x the normal force, pushing > 0; y the tangential one on the second along (-n_y, n_x)
    memory: tuple  # the columns, of the solver and the effects, that follow the pair from list build to list build
    row_start: Any  # pairs whose first grain is in a slot: first row, the others follow `lanes` apart; shape (2 * capacity,), i32
    row_count: Any  # and how many
    wall_row_start: Any  # its pairs with walls, one after the other
    wall_row_count: Any
    along: Any  # wall pairs: direction of the wall; of a wall's end the first direction that leads off the wall
    bounds: Any  # wall pairs: how far the foot point may slide along the wall; of an end the second direction that leads off
    slopes: Any  # wall pairs: by how much both bounds shift for every metre that the grain is to the left of the line
    side: Any  # wall pairs: side of the wall the grain is on, +1 left of `along`, -1 right; 0 = an end of a wall
    hinge: Any  # wall pairs, if walls move: from the grain's centre to the pivot of the wall at the last list build [m]
    driven: Any  # wall pairs, if walls have a force: the next row of such a wall, -1 = this was the last; i32
    over: Any  # if images slide: how many boxes above itself the second grain is seen, -1, 0 or 1
    discs: Any  # clumps only, as all that follow: number of the first grain's disc times clumps.MOST, plus that of the second's, i32
    arms: Any  # of the two discs, each in the frame of its grain [m], 4-vector
    rims: Any  # their radii [m], 2-vector
    levers: Any  # world.clumps.levers, with the rims for the distances to the contact [m], 4-vector


class Blocks(NamedTuple):
    """The blocks of the sweep: the rows that belong to each. Shape (blocks,)."""

    grain_start: Any
    grain_end: Any
    pair_start: Any
    pair_end: Any
    wall_start: Any
    wall_end: Any
    lane_end: Any  # scratch, one a lane


@dataclass(frozen=True, eq=False)
class World:
    """All fields of one simulation, and the few structural numbers that kernels bake in."""

    grains: Grains
    pairs: Pairs
    blocks: Blocks
    grid: Any  # world.grid.Grid
    walls: Any  # world.walls.Walls
    movers: Any  # world.movers.Movers, or None if no wall moves
    moves: bool  # whether a wall does
    flow: Any  # world.extras.sinks.Flow, or None if grains neither come nor go
    flows: bool  # whether they do
    pace: Any  # 0-D world.tables.Pace: what the list build allows the march
    lacks: Any  # by how much larger the tables would have to be for what the last list build found (world.search.growth); shape (KINDS,)
    flags: Any  # world.flags: what went wrong
    count: Any  # 0-D i32: grains present, slots 0 .. count-1
    box: Any  # 0-D struct of box_type: sizes, gravity
    periodic: tuple[bool, bool]
    open_edges: tuple[bool, bool, bool, bool]  # left, right, bottom, top
    sheared: bool  # whether images beyond the lower and upper edge slide
    shear: Any  # 0-D struct of world.search.images.shear_type, or None if they do not
    capacity: int  # grain slots; the last stays empty
    half: int  # rows of one half of the neighbour list
    wall_base: int  # row within a half where wall pairs begin
    wall_half: int  # rows of one half of the wall-only columns
    turns: bool  # whether anything can turn a grain
    sleeps: bool  # whether grains may sleep
    sleep: Any  # world.sleep.SleepState, or None if they may not
    yields: bool  # whether pairs found deep in one another are parted gently by the world (md; rigid does it itself)
    clumps: bool  # whether a grain may be anything but a disc
    shapes: Any  # world.clumps.Shapes, or None without clumps
    carried: tuple  # columns of numbers that grains carry for effects, by name: world.carried
    materials: Any  # world.extras.materials.Materials, or None if the scene has none
    mixed: bool  # whether it has
    linked: bool  # whether an effect ties grains together
    links: Any  # world.links.Links, or None if none does
    boulders: int  # rows for the pairs of boulders, the last of those before `wall_base`; 0 = there are none
    boulder_walls: int  # and for those with walls, the last of a half
    discs: int  # of the grain that has most
    rows: int  # of the neighbour list, a grain
    wall_rows: int  # and of its part for walls
    layout: str  # of the sweep: "one", "strips" or "cells"
    lanes: int  # runs that a block's pairs are dealt from
    colour_cells: int  # cells of one colour there may be, in the layout "cells"
    real: Any  # ti.f32 or ti.f64

    @property
    def serial(self) -> bool:
        """Whether loops that are not over blocks run on one thread: only a GPU gains by more."""
        return self.layout != "cells"


def pace_type(real: Any) -> Any:
    """Struct of what lets the march go on until the next list build."""
    return ti.types.struct(
        skin=real,  # pairs closer than this on their foreseen paths are listed [m]
        horizon=real,  # time for which the list build has foreseen the paths [s]
        since=ti.i32,  # steps since the list build
        strayed=ti.i32,  # 1 = a grain, or a wall that moves, is off its foreseen path by half the skin
        spent=ti.i32,  # 1 = list build before the next step
        impacts=ti.i32,  # rigid: 1 = some pair may collide in this step
        warm_start=ti.i32,  # rigid: 1 = the impulses carried over are yet to be applied in this step
        hit=ti.i32,  # rigid: 1 = some pair did, in the last round
        moved=ti.i32,  # rigid: 1 = impacts of this step have moved grains ahead
        round=ti.i32,  # rigid: the round of impacts in this step, from 1 on
        done=ti.i32,  # steps since the start
        noted=ti.i32,  # 1 = in this step, the last of a march, pairs note all that they pass on; rigid
        on_step=ti.i32,  # steps between two looks of the effects that watch the grains; 0 = none does
        half=ti.i32,  # which half of the neighbour list is in use, 0 or 1
        list_builds=ti.i32,  # neighbour-list builds since the start
        lacking=ti.i32,  # 1 = the last list build found more than a table has room for, 2 = after a few were woken (world.search.growth)
        sight=real,  # how far from the centres of grains moving walls are looked for [m]
        step=real,  # h [s]
        speed_cap=real,  # [m/s]
        alert=real,  # the march stops for contacts and step to follow where a grain is faster than this [m/s]
        hasty=ti.i32,  # 1 = some grain is
        deep=real,  # md: a pair found at a larger overlap has not come there by itself [m] (world.memory.yield_deep)
        growth=real,  # md: how fast the surfaces of such a pair grow to where they are [m/s]
        grown=real,  # md: how far they have since the list build before [m]
        settling=real,  # md: how fast pairs whose stiffness has changed go back to the sum of their radii [m/s]
        settled=real,  # md: how far they have since the list build before [m]
        spare=real,  # md: by so many times their overlap they may stay less: contacts are that much stiffer than the bed at rest needs
        short=ti.i32,  # md: 2 = some pair has not grown so far yet, 1 = has not settled yet
    )


def box_type(real: Any) -> Any:
    """Struct of the numbers that describe the box."""
    pair = ti.types.vector(2, real)
    return ti.types.struct(
        size=pair,  # [m]
        spacing=pair,  # distance of lattice sites [m]
        sites=ti.types.vector(2, ti.i32),  # lattice sites in the box
        gravity=pair,  # [m/s2]
        diameter=real,  # mean diameter d of the grains [m]
        largest=real,  # largest diameter [m]
        least=real,  # smallest diameter [m]
        listed=real,  # largest diameter of the grains that are no boulders, and go into cells [m]
        bridge=real,  # how far apart grains still act on one another [m]
        weight=real,  # of a mean grain, on earth if there is no gravity [N]
        least_cell=real,  # smallest width of a cell for which the grid has room [m]
    )


def steps_within(seconds: float, step: float) -> int:
    """Whole steps of `step` [s] in so long, as the kernels count them: 1 at least, MOST_STEPS at most."""
    return max(1, math.floor(min(seconds / step, MOST_STEPS)))


LEAST_ROOM = 4096
"""Least room for cells, and for lattice sites and what is felt from them: so all small boxes are alike to kernels."""


def round_up(count: int, least: int = 64) -> int:
    """Next power of two, at least `least`: sizes are part of the key of the compile cache, and fields of one size can be taken over."""
    return max(least, 1 << math.ceil(math.log2(max(count, 1))))


def site_rows(sites: tuple[int, int]) -> int:
    """Rows of a table of so many lattice sites along x and y, with one or two behind."""
    return round_up(sites[0] * sites[1] + 2, LEAST_ROOM)


def write_rows(field: Any, values: np.ndarray) -> None:
    """The first rows of a field; zeros behind."""
    whole = np.zeros_like(field.to_numpy())
    if len(values):
        whole[: len(values)] = values
    field.from_numpy(whole)


def allocate_pairs(
    real: Any, capacity: int, half: int, wall_half: int, extra: int, parts: int, clumps: bool, moves: bool, driven: bool, sheared: bool
) -> Pairs:
    """Empty neighbour list of two halves, or with sleepers three parts, for `capacity` grains, with `extra` columns that follow a pair from
    list build to list build, as its force does: what is read between a list build and the next step is then still what the pair carries.
    """
    rows = parts * half
    force = field_pool.vectors(2, real, rows)
    columns = tuple(field_pool.scalars(real, rows) for _ in range(extra))
    return Pairs(
        first=field_pool.scalars(ti.i32, rows),
        second=field_pool.scalars(ti.i32, rows),
        reach=field_pool.vectors(2, real, rows),
        contact_distance=field_pool.scalars(real, rows),
        normal=field_pool.vectors(2, real, rows),
        gap=field_pool.scalars(real, rows),
        mass=field_pool.scalars(real, rows),
        root_mass=field_pool.scalars(real, rows),
        mass_t=field_pool.scalars(real, rows),
        force=force,
        memory=(force, *columns),
        **{name: field_pool.scalars(ti.i32, 2 * capacity) for name in ("row_start", "row_count", "wall_row_start", "wall_row_count")},
        along=field_pool.vectors(2, real, parts * wall_half),
        bounds=field_pool.vectors(2, real, parts * wall_half),
        slopes=field_pool.vectors(2, real, parts * wall_half),
        side=field_pool.scalars(real, parts * wall_half),
        hinge=field_pool.vectors(2, real, parts * wall_half) if moves else None,
        driven=field_pool.scalars(ti.i32, parts * wall_half) if driven else None,
        over=field_pool.scalars(real, rows) if sheared else None,
        discs=field_pool.scalars(ti.i32, rows) if clumps else None,
        arms=field_pool.vectors(4, real, rows) if clumps else None,
        rims=field_pool.vectors(2, real, rows) if clumps else None,
        levers=field_pool.vectors(4, real, rows) if clumps else None,
    )


def allocate_blocks(count: int, lanes: int) -> Blocks:
    """Empty table of `count` blocks of `lanes` runs."""
    return Blocks(*(field_pool.scalars(ti.i32, count * (lanes if name == "lane_end" else 1)) for name in Blocks._fields))


def fill_struct(struct: Any, values: dict[str, Any]) -> Any:
    """A 0-D field of type `struct` with those of `values` that it has members for."""
    field = field_pool.record(struct)
    field[None] = {key: value for key, value in values.items() if key in struct.members}
    return field
