"""From the markers to the grid and back (FLIP; Brackbill & Ruppel 1986, Zhu & Bridson 2005).

Markers give their velocities to the faces around them. After the forces they take over by how much the grid's velocity has changed, and
a little of that velocity itself: FLIP of them keeps what the grid cannot hold, the rest damps.
"""

import taichi as ti

from taichi_sand.effects.water.grid import FLOWS, WALL, close_ring, corners, lerp
from taichi_sand.effects.water.soaking import let_go, taken_up
from taichi_sand.effects.water.walls import RIM, kept_off, own_side, quarters
from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.geometry import add, at_most

FLIP = 0.97
"""Rests better than an affine transfer (APIC): still water 4e-4 sqrt(g h) in place of 1e-3, measured."""
LEAST = 1e-6
"""Weight of markers below which a face has no speed."""


@ti.func
def clear(f: ti.template()):
    """The grid forgets the step before."""
    now = f.now[None]
    for row in range((now.columns + 2) * (now.rows + 2)):
        f.cells.fill[row] = 0.0
        for faces in ti.static((f.u, f.v)):
            faces.speed[row], faces.weight[row] = 0.0, 0.0


@ti.func
def scatter(f: ti.template(), k):
    """Deals marker k to the nodes around it."""
    p = f.place[k]
    for c in ti.static(range(2)):
        faces = ti.static((f.u, f.v)[c])
        rows, t = corners(f, c, p)
        shares = quarters(t)
        for q in ti.static(range(4)):
            add(faces.speed, rows[q], shares[q] * f.velocity[k][c])
            add(faces.weight, rows[q], shares[q])
    rows, t = corners(f, 2, p)
    shares = quarters(t)
    if f.now[None].fenced == 1:
        shares = own_side(f, p, shares)
    for q in ti.static(range(4)):
        add(f.cells.fill, rows[q], shares[q])


@ti.func
def extrapolate(f: ti.template(), faces: ti.template(), c: ti.template(), layers):
    """Faces without a speed take the mean of their neighbours', layer by layer."""
    now = f.now[None]
    stride = now.rows + 2
    last_x, last_y = now.columns + ti.static(int(c == 0)), at_most(now.rows + ti.static(int(c == 1)), now.top + layers + 2)
    for layer in range(1, layers + 1):
        for i in range(1, last_x + 1):
            for j in range(1, last_y + 1):
                row = i * stride + j
                if faces.known[row] == 0:
                    total, found = 0.0, 0
                    for q in ti.static(range(4)):
                        a, b = i + ti.static((1, -1, 0, 0)[q]), j + ti.static((0, 0, 1, -1)[q])
                        if 1 <= a <= last_x and 1 <= b <= last_y:
                            level = faces.known[a * stride + b]
                            if 0 < level and level <= layer:
                                total += faces.speed[a * stride + b]
                                found += 1
                    if found > 0:
                        faces.speed[row], faces.known[row] = total / found, layer + 1


@ti.func
def normalise(f: ti.template(), faces: ti.template(), c: ti.template()):
    """Sums become means; walls are as fast as they are."""
    now = f.now[None]
    stride = now.rows + 2
    for i in range(1, now.columns + 1 + ti.static(int(c == 0))):
        for j in range(1, now.rows + 1 + ti.static(int(c == 1))):
            row = i * stride + j
            wet = faces.weight[row] > LEAST
            wall = faces.block[row] != 0
            faces.speed[row] = ti.select(wet and not wall, faces.speed[row] / (faces.weight[row] + 1e-30), faces.wall[row])
            faces.known[row] = ti.select(wall, WALL, ti.select(wet, FLOWS, 0))
    close_ring(f, faces, c)
    extrapolate(f, faces, c, 1)
    close_ring(f, faces, c)
    for row in range((now.columns + 2) * stride):
        faces.before[row] = faces.speed[row]


@noinline
def transfer(f: ti.template()):
    """Markers to grid."""
    clear(f)
    top = 0.0
    for k in range(ti.min(f.now[None].markers, f.place.shape[0])):
        scatter(f, k)
        top = ti.max(top, f.place[k].y)
    f.now[None].top = ti.min(f.now[None].rows, ti.cast(top + 0.5, ti.i32) + 1)
    for c in ti.static(range(2)):
        normalise(f, ti.static((f.u, f.v)[c]), c)


@ti.func
def velocity_at(f: ti.template(), p):
    """Velocity of the grid at a place [m/s]."""
    found = ti.Vector([0.0, 0.0])
    for c in ti.static(range(2)):
        faces = ti.static((f.u, f.v)[c])
        rows, t = corners(f, c, p)
        found[c] = lerp(ti.Vector([faces.speed[rows[0]], faces.speed[rows[1]], faces.speed[rows[2]], faces.speed[rows[3]]]), t)
    return found


@ti.func
def kept_inside(f: ti.template(), p):
    """A place within the box, on the other side of it where it is periodic; and whether it has left through an open edge."""
    place, gone = p, False
    for c in ti.static(range(2)):
        count = ti.cast(f.now[None].columns if ti.static(c == 0) else f.now[None].rows, f.real)
        if ti.static(f.wraps[c]):
            place[c] -= count * ti.floor((place[c] - 0.5) / count)
        else:
            if ti.static(f.opens[2 * c]):
                gone = gone or place[c] < 0.5
            if ti.static(f.opens[2 * c + 1]):
                gone = gone or place[c] > count + 0.5
            place[c] = ti.max(0.5 + RIM, ti.min(count + 0.5 - RIM, place[c]))
    return place, gone


@ti.func
def beside(f: ti.template(), p, place):
    """p, or where the box is periodic the one of its images that is nearest to `place`."""
    found = p
    for c in ti.static(range(2)):
        if ti.static(f.wraps[c]):
            count = ti.cast(f.now[None].columns if ti.static(c == 0) else f.now[None].rows, f.real)
            found[c] += count * ti.floor((place[c] - p[c]) / count + 0.5)
    return found


@ti.func
def carry(f: ti.template(), k, time):
    """Marker k takes over what the grid has become, and moves (RK2). Whether it has left the box, and the grid's velocity."""
    p = f.place[k]
    now, before = velocity_at(f, p), ti.Vector([0.0, 0.0])
    for c in ti.static(range(2)):
        faces = ti.static((f.u, f.v)[c])
        rows, t = corners(f, c, p)
        before[c] = lerp(ti.Vector([faces.before[rows[0]], faces.before[rows[1]], faces.before[rows[2]], faces.before[rows[3]]]), t)
    f.velocity[k] = now + FLIP * (f.velocity[k] - before)
    scale = ti.Vector([time / f.now[None].width, time / f.now[None].height])
    half, _gone = kept_inside(f, p + 0.5 * scale * now)
    place, gone = kept_inside(f, p + scale * velocity_at(f, half))
    if f.now[None].fenced == 1:
        place, _gone = kept_inside(f, kept_off(f, beside(f, p, place), place, time))
    f.place[k] = place
    return gone, now


@noinline
def advance(f: ti.template()):
    """Grid to markers, which then move with it for the step that has passed; those that have left the box are dropped."""
    now = f.now[None]
    fastest, kept, left = 0.0, 0, 0
    markers = ti.min(now.markers, f.place.shape[0])
    if now.step > 0.0:
        for k in range(markers):
            gone, speed = carry(f, k, now.step)
            left += ti.cast(gone, ti.i32)
            if ti.static(f.soaks):
                gone = gone or taken_up(f, k)
            if not gone:
                f.place[kept], f.velocity[kept] = f.place[k], f.velocity[k]
                kept += 1
                fastest = ti.max(fastest, ti.abs(speed.x) / now.width, ti.abs(speed.y) / now.height)
        f.now[None].gone += left
        f.now[None].markers = kept
        if ti.static(f.soaks):
            let_go(f)
    f.now[None].fastest = fastest * ti.min(now.width, now.height)
