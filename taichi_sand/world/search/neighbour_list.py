"""The neighbour-list build: sorts the grains into cells and lists the pairs that may touch before it is built again.

A grain is foreseen to fly straight on; a pair is listed if on these paths it comes closer than the skin within the horizon. The list
holds until the horizon is reached or a grain has left its foreseen path by half the skin. So grains that fall together cost no list build.
"""

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.extras.links import find_links
from taichi_sand.world.geometry import present, velocity
from taichi_sand.world.search.candidates import list_found, scan_range
from taichi_sand.world.search.cell_list import ROOM, anchor, cell_count, cell_of, cut_blocks, lay_cells, outside, permute, sort
from taichi_sand.world.search.growth import PAIRS, WALLS, lack
from taichi_sand.world.search.images import column_over, start_images
from taichi_sand.world.search.large_grains import is_boulder, list_boulders
from taichi_sand.world.search.pair_history import carry
from taichi_sand.world.search.prefix_sum import prefix_sum
from taichi_sand.world.search.sleeper_candidates import list_sleepers
from taichi_sand.world.search.wall_candidates import list_walls
from taichi_sand.world.sleep.state import call_by_walls, settle, translate
from taichi_sand.world.tables import CHUNK, FAR, SPARE, STRIPS
from taichi_sand.world.walls.casting import cast_walls
from taichi_sand.world.walls.motion import start_walls
from taichi_sand.world.walls.servo import drives, link_driven

LEAST_SKIN, MOST_SKIN = 0.04, 0.5
LEAST_SLACK, GOOD_SLACK, MOST_SLACK = 0.10, 1.0, 2.0
"""Skin, and how much two grains may approach one another within the horizon, in mean diameters: more than GOOD_SLACK only where they do
so in one step, as cells grow with it and a list build of large cells costs more than several of small ones."""
SKIN = 10.0
"""Skin / d = sqrt(SKIN u), u the spread of velocities times h / d. Every listed pair costs in every step, a list build once in skin / u
steps: their sum is least for a skin that goes with the root of u (measured: a list build costs as much as some 30 looks at a pair)."""
SHARES = 16384
"""Threads that look for the extremes of the velocities on a GPU: each of them has to wait for the others once."""
STEPS_AHEAD = 16
"""Steps the list build tries to foresee; more cost larger cells."""
MOST_REACH = 2 * MOST_SLACK + MOST_SKIN
"""How far from its surface a grain may have to know of a wall, in mean diameters: it flies at most 2 MOST_SLACK in the horizon."""


@ti.func
def anchor_all(w: ti.template()):
    """Anchors the grains; returns their least and their largest velocity along both axes [m/s]."""
    left, down, right, up = 1e30, 1e30, -1e30, -1e30
    if ti.static(w.sleeps):
        if w.sleep.state[None].asleep > 0:
            left, down, right, up = 0.0, 0.0, 0.0, 0.0
    many = ti.static(SHARES if w.layout == "cells" else 1)
    ti.loop_config(serialize=w.serial)
    for share in range(many):
        low, high = ti.Vector([1e30, 1e30]), ti.Vector([-1e30, -1e30])
        for k in range((present(w) - share + many - 1) // many):
            i = share + k * many
            anchor(w, i)
            low, high = ti.min(low, velocity(w, i)), ti.max(high, velocity(w, i))
        ti.atomic_min(left, low.x)
        ti.atomic_min(down, low.y)
        ti.atomic_max(right, high.x)
        ti.atomic_max(up, high.y)
    if present(w) == 0:
        left, down, right, up = 0.0, 0.0, 0.0, 0.0
    return ti.Vector([left, down]), ti.Vector([right, up])


@ti.func
def foresee(w: ti.template()):
    """Chooses skin, horizon and cells from how much the velocities differ."""
    box = w.box[None]
    start_images(w)
    low, high = anchor_all(w)
    pace = w.pace[None]
    approach = (high - low).norm() * pace.step
    if ti.static(w.sheared):
        approach += ti.abs(w.shear[None].speed) * pace.step
    d = box.diameter
    skin = ti.min(ti.max(ti.sqrt(SKIN * approach / d), LEAST_SKIN), MOST_SKIN) * d
    ahead = ti.min(STEPS_AHEAD * approach, ti.max(GOOD_SLACK * d, approach))
    slack = ti.min(ti.max(ahead, LEAST_SLACK * d), MOST_SLACK * d)
    pace.skin = skin
    fastest = ti.max(ti.abs(low), ti.abs(high)).norm() * pace.step
    pushing = ti.Vector([0.0, 0.0])
    if ti.static(w.moves):
        ti.loop_config(serialize=True)
        for _run in range(1):
            pushing = start_walls(w)
            fastest += pushing.x * pace.step
    pace.horizon = ti.min(slack / (approach + 1e-20), 2.0 * MOST_SLACK * d / (fastest + 1e-20)) * pace.step
    pace.grown = ti.cast(pace.since, w.real) * pace.step * pace.growth
    pace.settled = ti.cast(pace.since, w.real) * pace.step * pace.settling
    pace.since, pace.strayed, pace.spent, pace.short = 0, 0, 0, 0
    pace.list_builds += 1
    pace.impacts = 1
    pace.half = 1 - pace.half
    w.pace[None] = pace
    lay_cells(w, box.listed + box.bridge + skin + slack)
    if ti.static(w.moves):
        flight = fastest / pace.step * pace.horizon
        sight = box.largest * ti.static(1.5 if w.clumps else 0.5) + box.bridge + skin + (1.0 + pushing.y * pace.horizon) * flight
        w.pace[None].sight = sight


@ti.func
def assign_cells(w: ti.template()):
    """Cell of every grain; the one behind the last for those that left."""
    ti.loop_config(serialize=w.serial)
    for i in range(present(w)):
        gone = outside(w, i)
        cell = cell_of(w, i)
        if ti.static(w.boulders > 0):
            if is_boulder(w, i):
                cell = cell_count(w) - 1
        w.grid.cell[i] = cell_count(w) if gone else cell


@noinline
def list_block(w: ti.template(), b: ti.i32):
    """Lists the pairs whose first grain belongs to block b, in the block's own part of the table."""
    pairs = ti.static(w.pairs)
    blocks = ti.static(w.blocks)
    lanes = ti.static(w.lanes)
    half = w.pace[None].half
    start = blocks.grain_start[b]
    count = blocks.grain_end[b] - start
    run = (count + lanes - 1) // lanes
    first, first_q = half * w.half, half * w.half + w.wall_base
    last, last_q = first_q - w.boulders, first + w.half - w.boulder_walls
    top, q = first, first_q
    if ti.static(w.layout == "strips"):
        top, q = first + w.rows * (start + SPARE * b), first_q + w.wall_rows * (start + SPARE * b)
        first, last, first_q, last_q = top, top + w.rows * (count + SPARE), q, q + w.wall_rows * (count + SPARE)
    elif ti.static(w.layout == "cells"):  # too small for a fixed room: they have been counted
        top, q = first + blocks.pair_end[b], first_q + blocks.wall_end[b]
    blocks.pair_start[b], blocks.wall_start[b] = top, q
    end = top
    for k in range(count):
        scan_neighbours(w, start + k, 0)
    for lane in range(lanes):
        p = top + lane
        for k in range(lane * run, ti.min((lane + 1) * run, count)):
            i = start + k
            row = half * w.capacity + i
            pairs.row_start[row], pairs.wall_row_start[row] = p, q
            next_p = list_neighbours(w, i, p, last, lanes)
            if ti.static(w.sleeps):
                next_p = list_sleepers(w, i, next_p, last, lanes)
            next_q = list_walls(w, i, q, last_q, True)
            pairs.row_count[row], pairs.wall_row_count[row] = (next_p - p) // lanes, next_q - q
            p, q = next_p, next_q
        blocks.lane_end[b * lanes + lane] = p
        end = ti.max(end, p - lane)
    blocks.pair_end[b], blocks.wall_end[b] = end, q
    if end > last:
        lack(w, PAIRS, end - first, last - first)
    else:
        for lane in range(lanes):
            clear_rows(w, blocks.lane_end[b * lanes + lane], end, lanes)
    if q > last_q:
        lack(w, WALLS, q - first_q, last_q - first_q)


@ti.func
def share_out(w: ti.template()):
    """In cells: counts the pairs of every block; `pair_end` and `wall_end` then say how many come before its own."""
    blocks = ti.static(w.blocks)
    for b in range(blocks.pair_end.shape[0]):
        pairs, walls = 0, 0
        if b < w.grid.columns[None] * w.grid.rows[None]:
            for i in range(blocks.grain_start[b], blocks.grain_end[b]):
                scan_neighbours(w, i, 0)
                pairs = list_neighbours(w, i, pairs, 0, 0)
                if ti.static(w.sleeps):
                    pairs = list_sleepers(w, i, pairs, 0, 0)
                walls = list_walls(w, i, walls, 0, False)
        blocks.pair_end[b], blocks.wall_end[b] = pairs, walls
    prefix_sum(blocks.pair_end, w.grid.scratch.sums, True)
    prefix_sum(blocks.wall_end, w.grid.scratch.sums, True)


@ti.func
def clear_rows(w: ti.template(), start, end, lanes: ti.template()):
    """Rows that only fill up a lane: two of nothing, far apart."""
    pairs = ti.static(w.pairs)
    for k in range((end - start + lanes - 1) // lanes):
        row = start + k * lanes
        pairs.first[row], pairs.second[row] = w.capacity - 1, w.capacity - 1
        pairs.reach[row] = ti.Vector([FAR, 0.0])
        pairs.contact_distance[row], pairs.gap[row] = 0.0, FAR
        pairs.mass[row], pairs.mass_t[row] = 0.0, 0.0
        pairs.normal[row] = ti.Vector([1.0, 0.0])
        if ti.static(w.sheared):
            pairs.over[row] = 0.0
        carry(w, row, -1)


@noinline
def scan_neighbours(w: ti.template(), i: ti.i32, since: ti.i32):
    """Finds whom grain i may meet of those behind it in its own cell and of those of the N, SE, E and NE cells. See `scan_range`."""
    grid = ti.static(w.grid)
    columns, rows = grid.columns[None], grid.rows[None]
    column, row = grid.cell[i] // rows, grid.cell[i] % rows
    found = 0
    if ti.static(w.periodic[0] or w.periodic[1]):
        for k in range(5 + ti.select(ti.static(w.sheared) and row == rows - 1, 4, 0)):
            x, y = column + ti.cast(k > 1, ti.i32), row + ti.select(k > 1, k - 3, k)
            if ti.static(w.sheared):
                if k > 4:  # what is beyond has slid
                    x, y = column_over(w, column, k - 5), 0
            if ti.static(w.periodic[0]):
                x = (x % columns + columns) % columns
            if ti.static(w.periodic[1] and not w.sheared):
                y = (y + rows) % rows
            if x < columns and y >= 0 and y < rows:
                start = grid.start[x * rows + y]
                if k == 0:
                    start = i + 1
                found = scan_range(w, i, start, grid.start[x * rows + y + 1], since, found)
    else:
        above = ti.min(row + 1, rows - 1)
        for k in range(ti.select(column + 1 < columns, 2, 1)):  # a loop, so that this is compiled once
            start, top = i + 1, column * rows + above + 1
            if k == 1:
                start, top = grid.start[(column + 1) * rows + ti.max(row - 1, 0)], top + rows
            found = scan_range(w, i, start, grid.start[top], since, found)
    grid.scratch.found[i] = found


@ti.func
def list_neighbours(w: ti.template(), i, p, last, lanes: ti.template()):
    """Lists grain i with those that `scan_neighbours` has found. Returns the next row."""
    row, since = p, 0
    while since < w.grid.scratch.found[i]:
        if since > 0:  # more than there was room for
            scan_neighbours(w, i, since)
        row = list_found(w, i, w.grid.scratch.found[i] - since, row, last, lanes)
        since += ROOM
    return row


@ti.func
def build_neighbour_list(w: ti.template()):
    """The whole list build, to be called at the top level of a kernel or, for the layout "one", inside a serial loop."""
    count = present(w)
    foresee(w)
    assign_cells(w)
    sort(w)
    permute(w, count)
    if ti.static(w.sleeps):
        translate(w)
    if ti.static(w.linked):
        find_links(w)
    cut_blocks(w)
    list_all(w)


@ti.func
def list_all(w: ti.template()):
    """The part of a list build that may be made again: lists all pairs of the grains as they are sorted now."""
    if ti.static(w.moves):
        ti.loop_config(serialize=True)
        for _run in range(1):
            cast_walls(w)
            if ti.static(w.sleeps):
                call_by_walls(w)
    if ti.static(w.layout == "cells"):
        share_out(w)
    if ti.static(w.boulders > 0):
        ti.loop_config(serialize=True)
        for _run in range(1):
            list_boulders(w)
    if ti.static(w.layout == "one"):
        list_block(w, 0)
    elif ti.static(w.layout == "strips"):
        for k in range(STRIPS * CHUNK):
            if k % CHUNK == 0:
                list_block(w, k // CHUNK)
    else:
        for b in range(w.grid.columns[None] * w.grid.rows[None]):
            list_block(w, b)
    if ti.static(drives(w)):
        link_driven(w)
    if ti.static(w.sleeps):
        settle(w)


@ti.kernel
def build_neighbour_list_now(w: ti.template()):
    """One list build, its loops over blocks in parallel."""
    build_neighbour_list(w)


@ti.kernel
def list_again(w: ti.template()):
    """Lists all pairs once more, in larger tables."""
    list_all(w)


@ti.kernel
def progress(w: ti.template()) -> ti.types.vector(3, ti.i32):
    """Whether a list build is due, how many steps are done, and whether a grain is too fast for them: together, as a GPU is waited for
    at every look.
    """
    return ti.Vector([w.pace[None].spent, w.pace[None].done, w.pace[None].hasty])
