"""Where grains and forces lie on the canvas: discs and lines in pixels, y down, as lists for the kernels that paint them.

On a CPU a short serial pass.
"""

import taichi as ti

from taichi_sand.view.kernels import NO_ROW, NO_SPOKE, NOBODY, Integers, Numbers, Rows, Spans, band_of
from taichi_sand.view.palette import SHOWN_RADIUS
from taichi_sand.world.blocks import block_count
from taichi_sand.world.clumps import disc_around, discs_around, turned
from taichi_sand.world.geometry import mobility, position
from taichi_sand.world.search.images import fold


@ti.func
def list_disc(
    k, i, part, x, y, r, angle, width, height, discs: ti.template(), owner: ti.template(), bands: ti.template(), parts: ti.template()
):
    """Writes row k if the disc can be seen. Returns the next row."""
    row = k
    if x + r > -1.0 and x - r < width + 1.0 and y + r > -1.0 and y - r < height + 1.0:
        discs[row, 0], discs[row, 1], discs[row, 2], discs[row, 3] = x, y, r, angle
        owner[row], parts[row] = i, part
        low = band_of(ti.cast(ti.floor(x - r), ti.i32) - 1, width, bands.shape[0])
        high = band_of(ti.cast(ti.floor(x + r), ti.i32) + 1, width, bands.shape[0])
        for s in range(low, high + 1):
            ti.atomic_min(bands[s, 0], row)
            ti.atomic_max(bands[s, 1], row + 1)
        row += 1
    return row


@ti.kernel
def place_discs(
    w: ti.template(),
    scale: ti.f32,
    left: ti.f32,
    low: ti.f32,
    width: ti.i32,
    height: ti.i32,
    discs: Rows,
    owner: Integers,
    bands: Spans,
    parts: Integers,
):
    """Lists the discs that can be seen in a picture whose lower left corner is (left, low) [px] from that of the box: x, y, radius, angle;
    which grain each shows, and which disc of it; for each band of columns the first one and the one after the last. A grain that reaches
    over a periodic edge is listed on both sides; one of several discs has no spoke. In the layout "cells" every grain has rows of its own,
    and those that it does not need show nobody.
    """
    ti.loop_config(serialize=True)
    for s in range(bands.shape[0]):
        bands[s, 0], bands[s, 1] = NO_ROW, 0
    if ti.static(w.layout == "cells"):
        for k in range(owner.shape[0]):
            owner[k] = NOBODY
        for i in range(w.count[None]):
            place_grain(w, i, i * (owner.shape[0] // w.capacity), scale, left, low, width, height, discs, owner, bands, parts)
    else:
        ti.loop_config(serialize=True)
        for _ in range(1):
            row = 0
            for i in range(w.count[None]):
                row = place_grain(w, i, row, scale, left, low, width, height, discs, owner, bands, parts)


@ti.func
def place_grain(
    w: ti.template(),
    i,
    row,
    scale,
    left,
    low,
    width,
    height,
    discs: ti.template(),
    owner: ti.template(),
    bands: ti.template(),
    parts: ti.template(),
):
    """Lists the discs of grain i that can be seen. Returns the next row."""
    place, size = position(w, i), w.box[None].size
    if ti.static(w.sheared):
        place = fold(w, place, size)
    next_row = row
    angle = NO_SPOKE
    if ti.static(w.turns):
        if mobility(w, i).z > 0.0 and discs_around(w, i) == 1:
            angle = ti.cast(w.grains.angle[i] + w.grains.turn[i], ti.f32)
    for across in ti.static((-1, 0, 1) if w.periodic[0] else (0,)):
        for up in ti.static((-1, 0, 1) if w.periodic[1] else (0,)):
            for k in range(discs_around(w, i)):
                one = disc_around(w, i, k)
                r = ti.cast(one.z, ti.f32) * scale * SHOWN_RADIUS
                ahead = ti.cast(0.0, w.real)
                if ti.static(w.sheared):
                    ahead = up * (w.shear[None].offset + w.shear[None].slid)
                    ahead -= ti.floor((place.x + ahead) / size.x) * size.x
                x = ti.cast(place.x + one.x + ahead + across * size.x, ti.f32) * scale - left
                y = ti.cast(height, ti.f32) + low - ti.cast(place.y + one.y + up * size.y, ti.f32) * scale
                next_row = list_disc(next_row, i, k, x, y, r, angle, width, height, discs, owner, bands, parts)
    return next_row


@ti.func
def list_line(k, x, y, way, force, lines: ti.template(), forces: ti.template()):
    """Writes a line from (x, y) along `way` (y up) as row k, if there is room. Returns the next row."""
    row = k
    if row < forces.shape[0]:
        lines[row, 0], lines[row, 1], lines[row, 2], lines[row, 3] = x, y, x + way.x, y - way.y
        forces[row] = force
        row += 1
    return row


@ti.kernel
def place_forces(w: ti.template(), scale: ti.f32, left: ti.f32, low: ti.f32, height: ti.i32, lines: Rows, forces: Numbers) -> ti.i32:
    """Lists the contacts that push, as lines from centre to centre, or to the wall, and their normal forces. Their number."""
    placed = 0
    ti.loop_config(serialize=True)
    for _ in range(1):
        corner = ti.Vector([left, ti.cast(height, ti.f32) + low])
        for b in range(block_count(w)):
            for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
                if w.pairs.force[p].x > 0.0:
                    placed = list_force(w, p, scale, corner, lines, forces, placed, False)
            for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
                if w.pairs.force[p].x > 0.0:
                    placed = list_force(w, p, scale, corner, lines, forces, placed, True)
    return placed


@ti.func
def centre(w: ti.template(), p, i, second: ti.template()):
    """Centre of the disc of grain i that pair p is about [m]."""
    place = position(w, i)
    if ti.static(w.clumps):
        place += turned(w, i, w.pairs.arms[p].zw if ti.static(second) else w.pairs.arms[p].xy)
    return place


@ti.func
def list_force(w: ti.template(), p, scale, corner, lines: ti.template(), forces: ti.template(), k, wall: ti.template()):
    """Lists pair p, twice if it reaches over a periodic edge. Returns the next row. `corner`: x of the left edge of the picture [px], and y
    of the floor of the box.
    """
    force = ti.cast(w.pairs.force[p].x, ti.f32)
    length = ti.cast(w.pairs.contact_distance[p] + w.pairs.gap[p], ti.f32) * scale
    way = length * ti.cast(w.pairs.normal[p], ti.f32)
    start = ti.cast(centre(w, p, w.pairs.first[p], False), ti.f32) * scale
    row = list_line(k, start.x - corner.x, corner.y - start.y, way, force, lines, forces)
    if ti.static(not wall and (w.periodic[0] or w.periodic[1])):
        end = ti.cast(centre(w, p, w.pairs.second[p], True), ti.f32) * scale
        if (end - start - way).norm() > 0.5 * length + 1.0:
            row = list_line(row, end.x - corner.x, corner.y - end.y, -way, force, lines, forces)
    return row
