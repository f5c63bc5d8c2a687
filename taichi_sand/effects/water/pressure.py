"""The forces on the water, and the pressure that makes the mixture of water and grains divergence-free.

With ε the porosity and s = 1 - ε, u the water's velocity, v the grains', β the drag and a = Δt β / (ε ρ): ∇·(ε u + s v) = 0, and
ε ρ Du/Dt = -ε ∇p + ε ρ g - β (u - v), drag implicit: it stands in the coefficient ε / (1 + a) of the pressure. So does how grains answer
to the pressure themselves, s ρ/ρ_s, if they can move: without that light ones explode.
"""

import taichi as ti

from taichi_sand.effects.water.grid import AIR, FLOWS, WALL, WET, close_ring
from taichi_sand.effects.water.multigrid import solve
from taichi_sand.effects.water.surface import LEAST_PORES, find_surface
from taichi_sand.effects.water.transfer import extrapolate
from taichi_sand.effects.water.wells import welling
from taichi_sand.world.geometry import at_least, at_most, within

BAND = 0.1
"""Where the number of markers is off by more than this, over the squared porosity, the flow makes up for it (grid.RATE): the fewer the
pores hold, the more their number scatters, and what is made up for feeds drag (at a gradient of 0.1 it took 0.13 without the porosity)."""
ACCURACY = 1e-3
"""The divergence left is what a speed of so many g Δt makes across a cell."""
LEAST_GRAVITY = 0.1
LAYERS = 2


@ti.func
def push(f: ti.template(), c: ti.template(), density, gravity, time):
    """Gravity, drag and what grains owe act on component c; coefficients of the pressure."""
    now = f.now[None]
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
                faces.speed[row] = 0.0


@ti.func
def flux(faces: ti.template(), row):
    """Of water and grains through a face [m/s]; none through a wall."""
    solid = faces.solid[row]
    return ti.select(faces.known[row] < 0, 0.0, at_least(LEAST_PORES, 1.0 - solid[0]) * faces.speed[row] + solid[1])


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


@ti.func
def build_matrix(f: ti.template(), scale):
    """Matrix and right-hand side; the pressure of the step before, times `scale`, is the first guess. Whether there is a free surface."""
    now = f.now[None]
    cells = ti.static(f.cells)
    stride = now.rows + 2
    across, up = 1.0 / (now.width * now.width), 1.0 / (now.height * now.height)
    free = False
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
                free = free or cells.kind[row - stride] == AIR or cells.kind[right] == AIR
                free = free or cells.kind[row - 1] == AIR or cells.kind[above] == AIR
                out = (flux(f.u, right) - flux(f.u, row)) / now.width
                out += (flux(f.v, above) - flux(f.v, row)) / now.height
                cells.rest[row] = crowding(f, row, stride) + welling(f, i, j) - out
    return free


@ti.func
def balance(f: ti.template()):
    """Without a free surface nothing can flow off: what all cells lack is taken from each alike."""
    now = f.now[None]
    cells = ti.static(f.cells)
    total, found = 0.0, 0
    for row in range((now.columns + 2) * (now.rows + 2)):
        if cells.middle[row] > 0.0:
            total += cells.rest[row]
            found += 1
    for row in range((now.columns + 2) * (now.rows + 2)):
        if cells.middle[row] > 0.0:
            cells.rest[row] -= total / found


@ti.func
def press(f: ti.template(), c: ti.template(), scale):
    """The pressure acts on component c; its gradient is `scale` times that of the unknowns."""
    now = f.now[None]
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


@ti.kernel
def project(f: ti.template()):
    """A step of the grid's velocities."""
    ti.loop_config(serialize=True)
    for _run in range(1):
        now = f.now[None]
        find_surface(f)
        for c in ti.static(range(2)):
            push(f, c, now.density, now.gravity[c], now.next)
        free = build_matrix(f, now.next / now.step if now.step > 0.0 else 1.0)
        f.now[None].free = ti.cast(free or now.markers == 0, ti.i32)
        if not free:
            balance(f)
        pull = ti.max(LEAST_GRAVITY, now.gravity.norm())
        solve(f, ACCURACY * pull * now.next / ti.min(now.width, now.height))
        for c in ti.static(range(2)):
            press(f, c, now.density / now.next)
        f.now[None].step = now.next
