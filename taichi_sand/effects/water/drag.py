"""What grains and water do to each other: porosity, drag, and the pressure gradient that buoyancy comes from.

A disc stands for a sphere in a slab one grain thick, which fills two thirds (KAPPA) of what the disc does: beds of discs then have the
porosity of beds of spheres, 0.39 to 0.48, and laws of drag hold as they are. Grains are dealt to the faces around them by a quadratic
spline, at walls folded back into the box, and feel the faces by the same weights; what water gives a grain and what it loses are so one.
"""

import math

import taichi as ti

from taichi_sand.effects.water.boulders import deal_wide, depth_for, gather_wide, mean_speed, width_of
from taichi_sand.effects.water.dealing import around, deal_to, reach_of
from taichi_sand.effects.water.grid import FLOWS, KAPPA, WALL, close_ring, corners, lerp
from taichi_sand.effects.water.laws import LEAST_PORES, drag_of
from taichi_sand.effects.water.soaking import row_of, soak
from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.geometry import at_least, at_most, mobility, position, velocity
from taichi_sand.world.sleep.state import call

DENSEST = 0.605
"""Solid fraction of a dense bed of discs, times KAPPA: there a grain crowds itself as much as all others do."""
WAKING = 0.05
"""Sleepers are woken when the force of the water on them has changed by so many of their weights."""


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


@noinline
def deal_solids(w: ti.template(), f: ti.template()):
    """Deals all grains to the faces: solid fraction, motion to come, mobility, and what they owe."""
    density, time = f.now[None].density, f.now[None].next
    for i in range(w.count[None]):
        if w.grains.id[i] >= 0:
            share, p = share_of(w, f, i), middle_of(w, f, i)
            debt, gain = owed(w, f, i)
            diameter, area = body_of(w, f, i)
            light = density * area * w.grains.mobility[i].x
            for c in ti.static(range(2)):
                table = ti.static((f.u, f.v)[c].solid)
                solid = share * ti.Vector([1.0, velocity(w, i)[c] + time * gain[c], light, debt[c]])
                if is_boulder(f, diameter):
                    if ti.static(f.boulders):
                        deal_wide(f, c, table, p, width_of(f, diameter), solid)
                else:
                    deal_to(f, c, table, reach_of(f, c, p), solid)


@ti.func
def is_boulder(f: ti.template(), diameter):
    """Whether a grain is dealt over its own width."""
    found = False
    if ti.static(f.boulders):
        found = width_of(f, diameter) > f.now[None].spread
    return found


@noinline
def deal_drag(w: ti.template(), f: ti.template()):
    """Finds the drag on every grain, and deals it to the faces."""
    for i in range(w.count[None]):
        if w.grains.id[i] >= 0:
            share, p, v = share_of(w, f, i), middle_of(w, f, i), velocity(w, i)
            diameter, _area = body_of(w, f, i)
            if is_boulder(f, diameter):
                if ti.static(f.boulders):
                    width, speed, crowd, squares = width_of(f, diameter), ti.Vector([0.0, 0.0]), 0.0, 0.0
                    for c in ti.static(range(2)):
                        faces = ti.static((f.u, f.v)[c])
                        speed[c] = mean_speed(f, c, faces.speed, p, width)
                        solid, square = gather_wide(f, c, faces.solid, p, width)
                        crowd, squares = crowd + 0.5 * solid[0], squares + 0.5 * square
                    drag = drag_on(w, f, i, speed, crowd, share * squares)
                    for c in ti.static(range(2)):
                        deal_wide(f, c, ti.static((f.u, f.v)[c]).drag, p, width, share * drag * ti.Vector([1.0, v[c]]))
            else:
                reach_u, reach_v = reach_of(f, 0, p), reach_of(f, 1, p)
                speed_u, crowd_u, own_u = around(f, f.u, reach_u, share)
                speed_v, crowd_v, own_v = around(f, f.v, reach_v, share)
                drag = drag_on(w, f, i, ti.Vector([speed_u, speed_v]), 0.5 * (crowd_u + crowd_v), 0.5 * (own_u + own_v))
                deal_to(f, 0, f.u.drag, reach_u, share * drag * ti.Vector([1.0, v.x]))
                deal_to(f, 1, f.v.drag, reach_v, share * drag * ti.Vector([1.0, v.y]))


@ti.func
def drag_on(w: ti.template(), f: ti.template(), i, speed, crowd, own):
    """Drag on grain i in water of this speed, where grains fill `crowd` and it itself `own` of it; as far as it is under water."""
    diameter, _area = body_of(w, f, i)
    slip = (speed - velocity(w, i)).norm()
    pores = at_least(LEAST_PORES, 1.0 - at_least(0.0, crowd - own) / (1.0 - own / DENSEST))
    drag = drag_of(f, slip, pores, diameter)
    w.carried.water_drag[i] = drag
    if w.carried.water_wet[i] >= 0.0:
        drag *= w.carried.water_wet[i]
    return drag


@ti.func
def deal(w: ti.template(), f: ti.template()):
    """Grains to grid."""
    now = f.now[None]
    for row in range((now.columns + 2) * (now.rows + 2)):
        for faces in ti.static((f.u, f.v)):
            faces.solid[row], faces.drag[row] = ti.Vector([0.0, 0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0])
    deal_solids(w, f)
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
def felt_of(f: ti.template(), faces: ti.template()):
    """What grains are to feel of the faces: a face at the surface counts by its wet share, one in a wall before water as the next one."""
    now = f.now[None]
    for row in range((now.columns + 2) * (now.rows + 2)):
        part = ti.select(faces.known[row] == FLOWS or faces.known[row] == WALL, faces.depth[row], 0.0)
        faces.felt[row] = part * ti.Vector([faces.pull[row], faces.speed[row], 1.0, 0.0])


@ti.func
def mean_of(f: ti.template(), c: ti.template(), p):
    """Pressure gradient and speed of component c around p, over the wet faces there; 0 if there are none."""
    faces = ti.static((f.u, f.v)[c])
    columns, rows, across, up, _dealt = reach_of(f, c, p)
    total = ti.Vector([0.0, 0.0, 0.0, 0.0])
    for k in ti.static(range(2 * f.reach + 1)):
        for q in ti.static(range(2 * f.reach + 1)):
            total += across[k] * up[q] * faces.felt[columns[k] + rows[q]]
    return total.xy / ti.max(total.z, 1e-6)


@noinline
def feel(w: ti.template(), f: ti.template()):
    """Grid to grains: what acts on them until the water acts next. Sleepers are woken where that has changed."""
    g = ti.static(w.carried)
    felt_of(f, f.u)
    felt_of(f, f.v)
    for i in range(w.count[None]):
        p, v = middle_of(w, f, i), velocity(w, i)
        diameter, _area = body_of(w, f, i)
        across, up, depth, wet = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0]), 0.0, 0.0
        if is_boulder(f, diameter):
            if ti.static(f.boulders):
                width = width_of(f, diameter)
                one, _squares = gather_wide(f, 0, f.u.felt, p, width)
                two, _squares_too = gather_wide(f, 1, f.v.felt, p, width)
                across, up = one.xy / ti.max(one.z, 1e-6), two.xy / ti.max(two.z, 1e-6)
                wet = at_most(1.0, 0.5 * (one.z + two.z))
                depth = depth_for(diameter, wet)
        else:
            across, up, depth = mean_of(f, 0, p), mean_of(f, 1, p), depth_at(f, p)
            wet = under(diameter, depth)
        g.water_pull_x[i], g.water_pull_y[i] = across[0], up[0]
        g.water_stream_x[i], g.water_stream_y[i] = across[1], up[1]
        g.water_wet[i], g.water_depth[i] = wet, depth
        g.water_start_x[i], g.water_start_y[i] = v.x, v.y
        g.water_given_x[i], g.water_given_y[i] = 0.0, 0.0
        if ti.static(f.soaks):
            soak(w, f, i, row_of(f, p), share_of(w, f, i), wet)
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
