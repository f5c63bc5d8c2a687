"""The forces on the water, and the pressure that makes the mixture of water and grains divergence-free.

With ε the porosity and s = 1 - ε, u the water's velocity, v the grains', β the drag and a = Δt β / (ε ρ): ∇·(ε u + s v) = 0, and
ε ρ Du/Dt = -ε ∇p + ε ρ g - β (u - v), drag implicit: it stands in the coefficient ε / (1 + a) of the pressure. So does how grains answer
to the pressure themselves, s ρ/ρ_s, if they can move: without that light ones explode.
"""

import taichi as ti

from taichi_sand.effects.water.grid import AIR, FLOWS, WALL, WET, close_ring, node
from taichi_sand.effects.water.multigrid import solve
from taichi_sand.effects.water.surface import LEAST_PORES, find_surface
from taichi_sand.effects.water.transfer import extrapolate
from taichi_sand.effects.water.wells import welling
from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.geometry import add, at_least, at_most, within

BAND = 0.1
"""Where the number of markers is off by more than this, over the squared porosity, the flow makes up for it (grid.RATE): the fewer the
pores hold, the more their number scatters, and what is made up for feeds drag (at a gradient of 0.1 it took 0.13 without the porosity)."""
ACCURACY = 1e-3
"""The divergence left is what a speed of so many g Δt makes across a cell."""
LEAST_GRAVITY = 0.1
LAYERS = 2


@noinline
def push(f: ti.template(), c: ti.template()):
    """Gravity, drag and what grains owe act on component c; coefficients of the pressure."""
    now = f.now[None]
    density, gravity, time = now.density, now.gravity[c], now.next
    faces = ti.static((f.u, f.v)[c])
    stride = now.rows + 2
    for i in range(1, now.columns + 2):
        for j in range(1, now.rows + 2):
            row = i * stride + j
            faces.gain[row], faces.share[row] = 0.0, 0.0
            solid, drag = faces.solid[row], faces.drag[row]
            if faces.known[row] == FLOWS:
                pores = at_least(LEAST_PORES, 1.0 - solid[0])
                heavy = pores * density
                wet = faces.depth[row]
                gain = 1.0 / (1.0 + time * wet * drag.x / heavy)
                faces.speed[row] = gain * (faces.speed[row] + time * (gravity + wet * drag.y / heavy) - solid[3] / heavy)
                faces.gain[row], faces.share[row] = gain, pores * gain + solid[2]
            else:
                faces.speed[row] += time * gravity
            if faces.known[row] < 0:
                faces.speed[row] = faces.wall[row]


@ti.func
def flux(faces: ti.template(), row):
    """Of water and grains through a face, or a wall with it [m/s]."""
    solid = faces.solid[row]
    return ti.select(faces.known[row] < 0, faces.wall[row], at_least(LEAST_PORES, 1.0 - solid[0]) * faces.speed[row] + solid[1])


@ti.func
def crowding(f: ti.template(), row, stride):
    """Divergence that brings the markers of a cell back to their number [1/s]. Only inside of the water may a lack of them pull."""
    cells = ti.static(f.cells)
    surplus = cells.fill[row] - 1.0
    band = BAND / cells.pores[row] ** 2
    surplus = at_least(0.0, surplus - band) + at_most(0.0, surplus + band)
    if surplus < 0.0:
        for a in ti.static(range(-1, 2)):
            for b in ti.static(range(-1, 2)):
                if cells.kind[row + a * stride + b] == AIR:
                    surplus = 0.0
    return f.now[None].rate * cells.pores[row] * within(0.5, surplus)


@noinline
def build_matrix(f: ti.template()):
    """Matrix and right-hand side; the pressure of the step before is the first guess. Finds whether there is a free surface."""
    now = f.now[None]
    scale = now.next / now.step if now.step > 0.0 else 1.0
    cells = ti.static(f.cells)
    stride = now.rows + 2
    across, up = 1.0 / (now.width * now.width), 1.0 / (now.height * now.height)
    free, wet = False, False
    for row in range((now.columns + 2) * stride):
        cells.middle[row], cells.left[row], cells.below[row], cells.rest[row] = 0.0, 0.0, 0.0, 0.0
        cells.pressure[row] = ti.select(cells.kind[row] == WET, scale * cells.pressure[row], 0.0)
    for i in range(1, now.columns + 1):
        for j in range(1, now.rows + 1):
            row = i * stride + j
            if cells.kind[row] == WET:
                right, above = row + stride, row + 1
                sides = f.u.share[row] / f.u.depth[row] + f.u.share[right] / f.u.depth[right]
                cells.middle[row] = across * sides + up * (f.v.share[row] / f.v.depth[row] + f.v.share[above] / f.v.depth[above])
                if cells.kind[row - stride] == WET:
                    cells.left[row] = across * f.u.share[row]
                if cells.kind[row - 1] == WET:
                    cells.below[row] = up * f.v.share[row]
                free, wet = free or open_to_air(f, row, stride), True
                out = (flux(f.u, right) - flux(f.u, row)) / now.width
                out += (flux(f.v, above) - flux(f.v, row)) / now.height
                cells.rest[row] = crowding(f, row, stride) + welling(f, i, j) - out
    f.now[None].free = ti.cast(free or not wet, ti.i32)


@noinline
def balance(f: ti.template()):
    """Water that has no free surface can flow nowhere: what all cells of it lack is taken from each alike."""
    now = f.now[None]
    cells = ti.static(f.cells)
    stride = now.rows + 2
    for row in range((now.columns + 2) * stride):
        cells.label[row], cells.way[row], cells.image[row], cells.answer[row] = row, 0.0, 0.0, 0.0
    going = True
    while going:
        going = spread_labels(f, 1)
        going = spread_labels(f, -1) or going
    for i in range(1, now.columns + 1):
        for j in range(1, now.rows + 1):
            row = i * stride + j
            if cells.middle[row] > 0.0:
                own = cells.label[row]
                add(cells.way, own, cells.rest[row])
                add(cells.image, own, 1.0)
                if open_to_air(f, row, stride):
                    cells.answer[own] = 1.0
    for i in range(1, now.columns + 1):
        for j in range(1, now.rows + 1):
            row = i * stride + j
            own = cells.label[row]
            if cells.middle[row] > 0.0 and cells.answer[own] == 0.0:
                cells.rest[row] -= cells.way[own] / cells.image[own]


@ti.func
def spread_labels(f: ti.template(), way):
    """Hands the lowest label on between cells that water flows between, one sweep there or back; whether any has changed."""
    now, changed = f.now[None], False
    cells = ti.static(f.cells)
    stride = now.rows + 2
    for a in range(1, now.columns + 1):
        for b in range(1, now.rows + 1):
            i, j = ti.select(way > 0, a, now.columns + 1 - a), ti.select(way > 0, b, now.rows + 1 - b)
            row = i * stride + j
            left = node(i - 1, now.columns, now.columns, f.wraps[0]) * stride + j
            below = i * stride + node(j - 1, now.rows, now.rows, f.wraps[1])
            if cells.left[row] > 0.0 and cells.label[row] != cells.label[left]:
                least = ti.min(cells.label[row], cells.label[left])
                cells.label[row], cells.label[left], changed = least, least, True
            if cells.below[row] > 0.0 and cells.label[row] != cells.label[below]:
                least = ti.min(cells.label[row], cells.label[below])
                cells.label[row], cells.label[below], changed = least, least, True
    return changed


@ti.func
def open_to_air(f: ti.template(), row, stride):
    """Whether there is air beside a cell, and no wall between."""
    kind, u, v = ti.static(f.cells.kind, f.u.known, f.v.known)
    beside = (kind[row - stride] == AIR and u[row] == FLOWS) or (kind[row + stride] == AIR and u[row + stride] == FLOWS)
    return beside or (kind[row - 1] == AIR and v[row] == FLOWS) or (kind[row + 1] == AIR and v[row + 1] == FLOWS)


@noinline
def press(f: ti.template(), c: ti.template()):
    """The pressure acts on component c."""
    now = f.now[None]
    scale = now.density / now.next
    faces = ti.static((f.u, f.v)[c])
    stride = now.rows + 2
    hop, length = (stride, now.width) if ti.static(c == 0) else (1, now.height)
    for i in range(1, now.columns + 2):
        for j in range(1, now.rows + 2):
            row = i * stride + j
            slope = 0.0
            if faces.known[row] == FLOWS:
                slope = (f.cells.pressure[row] - f.cells.pressure[row - hop]) / (length * faces.depth[row])
                faces.speed[row] -= faces.gain[row] * slope
            faces.pull[row] = scale * slope
    if ti.static(not f.wraps[c]):
        for k in range(1, (now.rows if ti.static(c == 0) else now.columns) + 1):
            first, last = (stride + k, (now.columns + 1) * stride + k) if ti.static(c == 0) else (k * stride + 1, k * stride + now.rows + 1)
            continue_to_wall(faces, first, first + hop)
            continue_to_wall(faces, last, last - hop)
    close_ring(f, faces, c)
    extrapolate(f, faces, c, LAYERS)
    close_ring(f, faces, c)


@ti.func
def continue_to_wall(faces: ti.template(), row, inner):
    """In a wall the pressure gradient is that of the next face."""
    if faces.known[row] == WALL:
        faces.pull[row] = faces.pull[inner]


@ti.func
def project(f: ti.template()):
    """A step of the grid's velocities."""
    now = f.now[None]
    find_surface(f)
    for c in ti.static(range(2)):
        push(f, c)
    build_matrix(f)
    if now.fenced == 1 or f.now[None].free == 0:
        balance(f)
    pull = ti.max(LEAST_GRAVITY, now.gravity.norm())
    solve(f, ACCURACY * pull * now.next / ti.min(now.width, now.height))
    for c in ti.static(range(2)):
        press(f, c)
    f.now[None].step = now.next
