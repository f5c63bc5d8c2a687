"""What grains and water do to each other: porosity, drag, and the pressure gradient that buoyancy comes from.

A disc stands for a sphere in a slab one grain thick, which fills two thirds (KAPPA) of what the disc does: beds of discs then have the
porosity of beds of spheres, 0.39 to 0.48, and laws of drag hold as they are. Grains are dealt to the faces around them by a quadratic
spline, at walls folded back into the box, and feel the faces by the same weights; what water gives a grain and what it loses are so one.
"""

import math

import taichi as ti

from taichi_sand.effects.water.grid import FLOWS, WALL, close_ring, corners, lerp, mirror
from taichi_sand.world.geometry import add, at_least, mobility, position, velocity
from taichi_sand.world.sleep.state import call

KAPPA = 2 / 3
"""4/3 π r³ over 2 r π r²."""
DENSEST = 0.605
"""Solid fraction of a dense bed of discs, times KAPPA: there a grain crowds itself as much as all others do."""
LOG_10 = math.log(10)
LEAST_PORES = 0.2
"""Reached only for a moment, in impacts."""
WAKING = 0.05
"""Sleepers are woken when the force of the water on them has changed by so many of their weights."""


@ti.func
def di_felice(slip, pores, diameter, density, viscosity):
    """Drag on a grain over its volume and slip [kg/(m3 s)], after Di Felice (1994): that of a sphere alone (Dallavalle 1948), times a
    power of the porosity.
    """
    reynolds = at_least(1e-6, pores * density * slip * diameter / viscosity)
    sphere = (0.63 + 4.8 / ti.sqrt(reynolds)) ** 2
    bend = 1.5 - ti.log(reynolds) / LOG_10
    power = 3.7 - 0.65 * ti.exp(-0.5 * bend * bend)
    return 0.75 * sphere * reynolds * viscosity / (pores * diameter * diameter) * pores ** (2.0 - power)


@ti.func
def gidaspow(slip, pores, diameter, density, viscosity):
    """As di_felice, after Gidaspow (1994): Ergun (1952) in a bed, Wen & Yu (1966) above a porosity of 0.8."""
    found = 150.0 * (1.0 - pores) * viscosity / (pores * diameter * diameter) + 1.75 * density * slip / diameter
    if pores >= 0.8:
        reynolds = at_least(1e-6, pores * density * slip * diameter / viscosity)
        sphere = 0.44
        if reynolds < 1000.0:
            sphere = at_least(0.44, 24.0 * (1.0 + 0.15 * reynolds**0.687) / reynolds)
        found = 0.75 * sphere * reynolds * viscosity / (diameter * diameter) * pores**-2.65
    return found


LAWS = ("di_felice", "gidaspow")


@ti.func
def drag_of(f: ti.template(), slip, pores, diameter):
    """Drag by the law that the scene asks for [kg/(m3 s)]."""
    now = f.now[None]
    found = 0.0
    if now.law == 0:
        found = di_felice(slip, pores, diameter, now.density, now.viscosity)
    else:
        found = gidaspow(slip, pores, diameter, now.density, now.viscosity)
    return found


@ti.func
def body_of(w: ti.template(), f: ti.template(), i):
    """Diameter [m] and area [m2] of the disc that grain i is to the water, of the same area."""
    radius = w.grains.radius[i] * f.sizes[w.grains.kind[i]]
    return 2.0 * radius, math.pi * radius * radius


@ti.func
def moving(w: ti.template(), i):
    """Whether grain i answers to forces: it is neither fixed nor asleep."""
    return w.grains.mobility[i].x > 0.0


@ti.func
def middle_of(w: ti.template(), f: ti.template(), i):
    """Where grain i is [cells]."""
    p = position(w, i)
    return ti.Vector([p.x / f.now[None].width + 0.5, p.y / f.now[None].height + 0.5])


@ti.func
def spline(f: ti.template(), x):
    """The first node that a grain at x reaches, and its weights on that and the next ones, which sum up to 1."""
    middle = ti.floor(x + 0.5, ti.i32)
    weights = ti.Vector([0.0 for _ in range(ti.static(2 * f.reach + 1))])
    for k in ti.static(range(2 * f.reach + 1)):
        away = ti.abs(middle + (k - f.reach) - x) / f.now[None].spread
        weights[k] = ti.select(away < 0.5, 0.75 - away * away, 0.5 * at_least(0.0, 1.5 - away) ** 2)
    return middle - f.reach, weights / weights.sum()


@ti.func
def weights_of(f: ti.template(), c: ti.template(), p):
    """The nodes of component c that a grain at p reaches: rows of the table, weights, and how much of a cell is the volume of each node
    (half of one in an edge), for all of them one after the other.
    """
    now = f.now[None]
    i, across = spline(f, p.x + ti.static(0.5 if c == 0 else 0.0))
    j, up = spline(f, p.y + ti.static(0.5 if c == 1 else 0.0))
    nodes = ti.static(2 * f.reach + 1)
    rows, weights = ti.Vector([0 for _ in range(nodes * nodes)]), ti.Vector([0.0 for _ in range(nodes * nodes)])
    halves = ti.Vector([1.0 for _ in range(nodes * nodes)])
    for k in ti.static(range(nodes)):
        a = node_inside(mirror(i + k, now.columns, ti.static(c == 0), f.wraps[0]), now.columns + ti.static(int(c == 0)))
        for q in ti.static(range(nodes)):
            b = node_inside(mirror(j + q, now.rows, ti.static(c == 1), f.wraps[1]), now.rows + ti.static(int(c == 1)))
            rows[k * nodes + q], weights[k * nodes + q] = a * (now.rows + 2) + b, across[k] * up[q]
            at, last = (a, now.columns + 1) if ti.static(c == 0) else (b, now.rows + 1)
            if ti.static(not f.wraps[c]):
                halves[k * nodes + q] = ti.select(at == 1 or at == last, 2.0, 1.0)
    return rows, weights, halves


@ti.func
def node_inside(i, last):
    """Node i, or the nearest there is: of a grain far outside."""
    return ti.max(1, ti.min(last, i))


@ti.func
def share_of(w: ti.template(), f: ti.template(), i):
    """Solid fraction that grain i would make of a cell."""
    _diameter, area = body_of(w, f, i)
    return KAPPA * area / (f.now[None].width * f.now[None].height)


@ti.func
def owed(w: ti.template(), f: ti.template(), i):
    """Of grain i: impulse that the water has given it since it was last looked at, beyond what the water was charged with
    [kg/(m2 s)], and its mean acceleration without that of the pressure [m/s2].
    """
    g = ti.static(w.carried)
    debt, gain = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
    if moving(w, i) and g.water_wet[i] >= 0.0:
        time = f.now[None].step
        _diameter, area = body_of(w, f, i)
        pull, stream, wet, start, given = felt(w, i)
        debt = given - wet * time * (g.water_drag[i] * (stream - start) - pull)
        gain = (velocity(w, i) - start) / time + wet * pull * area * w.grains.mobility[i].x
    return debt, gain


@ti.func
def felt(w: ti.template(), i):
    """What grain i carries of the water: pressure gradient [Pa/m] and velocity around it, how much of it is under water, its own velocity
    when it was looked at last, and the impulse given to it since, over its volume.
    """
    g = ti.static(w.carried)
    return (
        ti.Vector([g.water_pull_x[i], g.water_pull_y[i]]),
        ti.Vector([g.water_stream_x[i], g.water_stream_y[i]]),
        g.water_wet[i],
        ti.Vector([g.water_start_x[i], g.water_start_y[i]]),
        ti.Vector([g.water_given_x[i], g.water_given_y[i]]),
    )


@ti.func
def deal_solids(w: ti.template(), f: ti.template(), density, time):
    """Deals all grains to the faces: solid fraction, motion to come, mobility, and what they owe."""
    for i in range(w.count[None]):
        if w.grains.id[i] >= 0:
            share, p = share_of(w, f, i), middle_of(w, f, i)
            debt, gain = owed(w, f, i)
            _diameter, area = body_of(w, f, i)
            light = density * area * w.grains.mobility[i].x
            for c in ti.static(range(2)):
                faces = ti.static((f.u, f.v)[c])
                rows, weights, halves = weights_of(f, c, p)
                solid = ti.Vector([1.0, velocity(w, i)[c] + time * gain[c], light, debt[c]])
                for k in ti.static(range((2 * f.reach + 1) ** 2)):
                    add(faces.solid, rows[k], share * weights[k] * halves[k] * solid)


@ti.func
def around(f: ti.template(), faces: ti.template(), rows, weights, share):
    """Speed of the faces that a grain reaches, their solid fraction, and what of that the grain itself makes."""
    speed, crowd, own = 0.0, 0.0, 0.0
    for k in ti.static(range((2 * f.reach + 1) ** 2)):
        speed += weights[k] * faces.speed[rows[k]]
        crowd += weights[k] * faces.solid[rows[k]][0]
        own += share * weights[k] * weights[k]
    return speed, crowd, own


@ti.func
def deal_drag(w: ti.template(), f: ti.template()):
    """Finds the drag on every grain, and deals it to the faces."""
    for i in range(w.count[None]):
        if w.grains.id[i] >= 0:
            share, p, v = share_of(w, f, i), middle_of(w, f, i), velocity(w, i)
            diameter, _area = body_of(w, f, i)
            rows_u, weights_u, halves_u = weights_of(f, 0, p)
            rows_v, weights_v, halves_v = weights_of(f, 1, p)
            speed_u, crowd_u, own_u = around(f, f.u, rows_u, weights_u, share)
            speed_v, crowd_v, own_v = around(f, f.v, rows_v, weights_v, share)
            crowd, own = 0.5 * (crowd_u + crowd_v), 0.5 * (own_u + own_v)
            slip = ti.Vector([speed_u - v.x, speed_v - v.y]).norm()
            pores = at_least(LEAST_PORES, 1.0 - at_least(0.0, crowd - own) / (1.0 - own / DENSEST))
            drag = drag_of(f, slip, pores, diameter)
            w.carried.water_drag[i] = drag
            if w.carried.water_wet[i] >= 0.0:
                drag *= w.carried.water_wet[i]
            for k in ti.static(range((2 * f.reach + 1) ** 2)):
                add(f.u.drag, rows_u[k], share * weights_u[k] * halves_u[k] * drag * ti.Vector([1.0, v.x]))
                add(f.v.drag, rows_v[k], share * weights_v[k] * halves_v[k] * drag * ti.Vector([1.0, v.y]))


@ti.kernel
def deal(w: ti.template(), f: ti.template()):
    """Grains to grid."""
    ti.loop_config(serialize=True)
    for _run in range(1):
        now = f.now[None]
        for row in range((now.columns + 2) * (now.rows + 2)):
            for faces in ti.static((f.u, f.v)):
                faces.solid[row], faces.drag[row] = ti.Vector([0.0, 0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0])
        deal_solids(w, f, now.density, now.next)
        for c in ti.static(range(2)):
            close_ring(f, ti.static((f.u, f.v)[c]), c)
        deal_drag(w, f)
        for c in ti.static(range(2)):
            close_ring(f, ti.static((f.u, f.v)[c]), c)


@ti.func
def depth_at(f: ti.template(), p):
    """How far p is below the surface, as far as that is near [m]."""
    rows, t = corners(f, 2, p)
    depth = ti.static(f.cells.depth)
    cells = lerp(ti.Vector([depth[rows[0]], depth[rows[1]], depth[rows[2]], depth[rows[3]]]), t)
    return cells * ti.min(f.now[None].width, f.now[None].height)


@ti.func
def under(diameter, depth):
    """How much of a grain whose middle is so deep is under water: that part of a disc which a flat surface leaves below it."""
    x = 2.0 * depth / diameter
    part = ti.select(x > 0.0, 1.0, 0.0)
    if -1.0 < x and x < 1.0:
        part = 1.0 - (ti.acos(x) - x * ti.sqrt(1.0 - x * x)) / math.pi
    return part


@ti.func
def mean_of(f: ti.template(), c: ti.template(), p):
    """Pressure gradient and speed of component c around p, over the wet faces there; 0 if there are none."""
    faces = ti.static((f.u, f.v)[c])
    rows, weights, _halves = weights_of(f, c, p)
    pull, speed, wet = 0.0, 0.0, 0.0
    for k in ti.static(range((2 * f.reach + 1) ** 2)):
        if faces.known[rows[k]] == FLOWS or faces.known[rows[k]] == WALL:
            part = weights[k] * faces.depth[rows[k]]  # a face at the surface counts by its wet share
            pull += part * faces.pull[rows[k]]
            speed += part * faces.speed[rows[k]]
            wet += part
    return ti.Vector([pull, speed]) / ti.max(wet, 1e-6)


@ti.kernel
def feel(w: ti.template(), f: ti.template()):
    """Grid to grains: what acts on them until the water acts next. Sleepers are woken where that has changed."""
    ti.loop_config(serialize=True)
    for _run in range(1):
        g = ti.static(w.carried)
        for i in range(w.count[None]):
            p, v = middle_of(w, f, i), velocity(w, i)
            across, up, depth = mean_of(f, 0, p), mean_of(f, 1, p), depth_at(f, p)
            diameter, _area = body_of(w, f, i)
            wet = under(diameter, depth)
            g.water_pull_x[i], g.water_pull_y[i] = across[0], up[0]
            g.water_stream_x[i], g.water_stream_y[i] = across[1], up[1]
            g.water_wet[i], g.water_depth[i] = wet, depth
            g.water_start_x[i], g.water_start_y[i] = v.x, v.y
            g.water_given_x[i], g.water_given_y[i] = 0.0, 0.0
            if ti.static(hasattr(w.carried, "wetness")):
                w.carried.wetness[i] = at_least(wet, w.carried.wetness[i])  # soaked
            if ti.static(w.sleeps):
                watch(w, f, i, wet * ti.Vector([g.water_drag[i] * across[1] - across[0], g.water_drag[i] * up[1] - up[0]]))


@ti.func
def watch(w: ti.template(), f: ti.template(), i, push):
    """Wakes sleeper i if what the water pushes it with, over its volume, is another than when it was last awake."""
    g = ti.static(w.carried)
    if i < w.sleep.state[None].awake:
        g.water_borne_x[i], g.water_borne_y[i] = push.x, push.y
    else:
        _diameter, area = body_of(w, f, i)
        change = push - ti.Vector([g.water_borne_x[i], g.water_borne_y[i]])
        if area * mobility(w, i).x * change.norm() > WAKING * f.now[None].gravity.norm():
            call(w, i)
