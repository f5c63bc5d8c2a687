"""The part of the list build that is about walls: lists the discs of a grain with the parts of walls that they may meet."""

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.clumps import MOST, disc_count, disc_of, turned
from taichi_sand.world.geometry import (
    at_least,
    at_most,
    distance_to_second,
    point_velocity,
    spin,
    velocity,
    wall_row,
    weigh_clumps,
)
from taichi_sand.world.search.pair_history import remember_wall, yield_deep


@ti.func
def list_walls(w: ti.template(), i, q, last, listing: ti.template()):
    """Lists the discs of grain i with the parts of walls that they may meet, or, not `listing`, counts them. Returns the next row."""
    g = ti.static(w.grains)
    walls = ti.static(w.walls)
    row = q
    sites = w.box[None].sites
    place = ti.min(ti.max(g.site[i], 0), sites - 1)
    if g.mobility[i].x > 0.0:
        site = place.x * sites.y + place.y
        for e in range(walls.start[site], walls.start[site + 1]):
            row = list_entry(w, i, e, row, last, listing)
        if ti.static(w.moves):
            k = w.movers.head[site]
            while k >= 0:
                row = list_entry(w, i, walls.room + k, row, last, listing)
                k = w.movers.next[k]
    return row


@noinline
def list_entry(w: ti.template(), i: ti.i32, e: ti.i32, q: ti.i32, last: ti.i32, listing: ti.template()) -> ti.i32:
    """Lists the discs of grain i with entry e of the walls. Returns the next row."""
    row = q
    site = w.grains.site[i]
    over = ti.cast(site - ti.min(ti.max(site, 0), w.box[None].sites - 1), w.real) * w.box[None].spacing + w.grains.offset[i]
    if ti.static(w.clumps):
        for a in range(disc_count(w, i)):
            row = list_wall(w, i, a, e, w.walls.point[e] - over, row, last, listing)
    else:
        row = list_wall(w, i, 0, e, w.walls.point[e] - over, row, last, listing)
    return row


@ti.func
def list_wall(w: ti.template(), i, a, e, way, row, last, listing: ti.template()):
    """Lists disc a of grain i with entry e of the walls, `way` from the grain's centre, if they may meet. Returns the next row."""
    g = ti.static(w.grains)
    walls = ti.static(w.walls)
    pace = w.pace[None]
    near, flight = g.radius[i] + w.box[None].bridge + pace.skin, velocity(w, i) * pace.horizon
    along, bounds, slopes, side = walls.along[e], walls.bounds[e], walls.slopes[e], walls.side[e]
    reach, arm = way, ti.Vector([0.0, 0.0])
    if ti.static(w.clumps):
        disc = disc_of(w, i, a)
        arm = turned(w, i, disc.xy)
        reach -= arm
        near += disc.z - g.radius[i] + at_most(ti.abs(spin(w, i)) * pace.horizon, 2.0) * arm.norm()
    beyond = 0.0
    if side >= 0:
        slid = -along.dot(reach)
        reach += slid * along
        bounds -= slid
        beyond = ti.max(bounds.x, -bounds.y, 0.0)
    hinge = ti.Vector([0.0, 0.0])
    if ti.static(w.moves):
        m = w.movers.wall[walls.part[e]]
        if m >= 0:  # a wall that turns also comes closer where the grain slides along it
            motion = w.movers.start[m]
            hinge = way - walls.point[e] + w.movers.arm[e - walls.room]
            flight -= point_velocity(motion.xy, motion.z, arm + reach - hinge) * pace.horizon
            near += ti.abs(motion.z) * pace.horizon * flight.norm()
    toward = flight.norm()
    if side >= 0:
        toward = at_least(0.0, flight.dot(reach) / (reach.norm() + 1e-30))
        beyond = at_least(0.0, beyond - ti.max(ti.abs(slopes.x), ti.abs(slopes.y)) * (near + toward))
    next_row = row
    distance = reach.norm()
    meets = distance < near + toward and distance * distance + beyond * beyond < (near + flight.norm()) ** 2
    if meets or (side == 1 and along.cross(reach) > 0.0):
        next_row += 1
        if ti.static(listing):
            if row < last:  # what finds no room is counted all the same (world.search.growth)
                pairs = ti.static(w.pairs)
                pairs.slopes[wall_row(w, row)] = slopes
                if ti.static(w.moves):
                    pairs.hinge[wall_row(w, row)] = hinge
                write_wall_row(w, row, i, a, walls.part[e], reach, arm, along, bounds, side)
    return next_row


@ti.func
def write_wall_row(w: ti.template(), row, i, a, part, reach, arm, along, bounds, kind):
    """One row of the neighbour list for disc a of grain i and a wall part, `reach` from the disc, which is at `arm` from the grain."""
    g = ti.static(w.grains)
    pairs = ti.static(w.pairs)
    k = wall_row(w, row)
    pairs.first[row], pairs.second[row] = i, part
    pairs.reach[row] = reach
    if ti.static(w.clumps):
        disc = disc_of(w, i, a)
        pairs.reach[row] = reach + arm
        pairs.contact_distance[row] = disc.z
        pairs.discs[row] = a * MOST
        pairs.arms[row] = ti.Vector([disc.x, disc.y, 0.0, 0.0])
        pairs.rims[row] = ti.Vector([disc.z, 0.0])
        bounds += 0.0 if kind == -1 else along.dot(arm)
    else:
        pairs.contact_distance[row] = g.radius[i]
        pairs.mass[row] = 1.0 / g.mobility[i].x
        pairs.root_mass[row] = ti.sqrt(pairs.mass[row])
        pairs.mass_t[row] = 1.0 / (g.mobility[i].x + g.mobility[i].z * g.radius[i] ** 2)
    pairs.along[k], pairs.bounds[k] = along, bounds
    side = 0.0
    if kind == 1:
        side = 1.0
    elif kind == 0:
        side = -1.0 if along.cross(reach) > 0.0 else 1.0
    pairs.side[k] = side
    old = remember_wall(w, row, i, part, kind == 0)
    distance, normal = distance_to_second(w, row, i, True)
    pairs.normal[row], pairs.gap[row] = normal, distance - pairs.contact_distance[row]
    if ti.static(w.clumps):
        weigh_clumps(w, row, i, i, True)
    yield_deep(w, row, old, pairs.gap[row])
