"""Where moving walls are felt from: their parts are listed anew, by lattice site, in every list build."""

import taichi as ti

from taichi_sand.world.search.growth import ENTRIES, lack
from taichi_sand.world.walls.motion import pivot_at, turn_at


@ti.func
def cast_walls(w: ti.template()):
    """In a list build: lists the moving parts at every lattice site from whose cell a grain may meet them. What lies farther
    outside the box, in a direction that is not periodic, meets nobody.
    """
    movers = ti.static(w.movers)
    box = w.box[None]
    for e in range(movers.count[None]):
        movers.head[movers.site[e]] = -1
    movers.count[None] = 0
    far = w.pace[None].sight + 0.5 * box.spacing.norm()
    for k in range(movers.parts[None]):
        m = movers.wall[movers.part[k]]
        if m >= 0:
            angle = turn_at(movers, m, movers.age[m])
            cos, sin = ti.cos(angle), ti.sin(angle)
            home, bounds = movers.home[k], movers.bounds[k]
            pivot = pivot_at(movers, m, movers.age[m], movers.omega[m] * movers.age[m])
            point = pivot + ti.Vector([cos * home.x - sin * home.y, sin * home.x + cos * home.y])
            along = ti.Vector([cos * home.z - sin * home.w, sin * home.z + cos * home.w])
            span = bounds
            if movers.side[k] == -1:
                bounds = ti.Vector([cos * bounds.x - sin * bounds.y, sin * bounds.x + cos * bounds.y])
                span *= 0.0
            cast_part(w, k, point, along, bounds, span, pivot, far)
    if movers.count[None] > movers.next.shape[0]:
        lack(w, ENTRIES, movers.count[None], movers.next.shape[0])
        movers.count[None] = movers.next.shape[0]


@ti.func
def cast_part(w: ti.template(), k, point, along, bounds, span, pivot, far):
    """Lists moving part k, which lies within `span` along `along` from `point`, at the sites at most `far` from it."""
    movers, walls = ti.static(w.movers, w.walls)
    box = w.box[None]
    line = movers.side[k] != -1
    one, other = point + span.x * along, point + span.y * along
    first = ti.cast(ti.floor((ti.min(one, other) - far) / box.spacing), ti.i32)
    last = ti.cast(ti.floor((ti.max(one, other) + far) / box.spacing), ti.i32)
    for a in ti.static(range(2)):
        if ti.static(not w.periodic[a]):
            first[a], last[a] = ti.max(first[a], 0), ti.min(last[a], box.sites[a] - 1)
    for x in range(first.x, last.x + 1):
        for y in range(first.y, last.y + 1):
            centre = (ti.Vector([x, y]) + 0.5) * box.spacing
            way = point - centre
            gone = -way.dot(along)
            to = way + ti.max(span.x, ti.min(span.y, gone)) * along
            if to.dot(to) <= far * far:
                k_e = movers.count[None]
                movers.count[None] = k_e + 1
                if k_e < movers.next.shape[0]:
                    e = walls.room + k_e
                    site = (x % box.sites.x + box.sites.x) % box.sites.x * box.sites.y + (y % box.sites.y + box.sites.y) % box.sites.y
                    movers.next[k_e], movers.site[k_e] = movers.head[site], site
                    movers.head[site] = k_e
                    movers.arm[k_e] = ti.cast(pivot - centre, w.real)
                    walls.part[e], walls.side[e], walls.slopes[e] = movers.part[k], movers.side[k], movers.slopes[k]
                    walls.along[e] = ti.cast(along, w.real)
                    walls.point[e] = ti.cast(way + gone * along if line else way, w.real)
                    walls.bounds[e] = ti.cast(bounds - gone if line else bounds, w.real)
