"""Water by hand: poured, drained and swept along under a brush, between two steps."""

import taichi as ti

from taichi_sand.effects.water.grid import Fluid
from taichi_sand.effects.water.markers import FIRST, SECOND
from taichi_sand.effects.water.wells import LARGEST
from taichi_sand.world.geometry import add


def pour(fluid: Fluid, x: float, y: float, radius: float, velocity: tuple[float, float]) -> float:
    """Fills what is not full yet within `radius` of (x, y) [m], and the cell that lies there, with water of this velocity [m/s]; returns
    how much that is [m2]. Less if there is no room for more markers.
    """
    return int(fill_circle(fluid, x, y, radius, *velocity)) * marker_area(fluid)


def drain(fluid: Fluid, x: float, y: float, radius: float) -> float:
    """Takes out the water within `radius` of (x, y) [m]; returns how much that was [m2]."""
    return int(empty_circle(fluid, x, y, radius)) * marker_area(fluid)


def sweep(fluid: Fluid, x: float, y: float, radius: float, velocity: tuple[float, float]) -> None:
    """Has the water within `radius` of (x, y) [m] move with this velocity [m/s]."""
    push_circle(fluid, x, y, radius, *velocity)


def marker_area(fluid: Fluid) -> float:
    """Water that one marker is [m2]."""
    now = fluid.now[None]
    return float(now.marker) * float(now.width) * float(now.height)


@ti.func
def under(f: ti.template(), place, x, y, radius):
    """Whether a place [cells] lies in the circle [m], or one of its images where the box is periodic."""
    now = f.now[None]
    way = ti.Vector([(place.x - 0.5) * now.width - x, (place.y - 0.5) * now.height - y])
    for c in ti.static(range(2)):
        if ti.static(f.wraps[c]):
            size = now.columns * now.width if ti.static(c == 0) else now.rows * now.height
            way[c] -= size * ti.floor(way[c] / size + 0.5)
    return way.dot(way) <= radius * radius


@ti.kernel
def fill_circle(f: ti.template(), x: ti.f32, y: ti.f32, radius: ti.f32, vx: ti.f32, vy: ti.f32) -> ti.i32:
    """New markers in the cells under the brush, as many as they lack; how many."""
    made = 0
    ti.loop_config(serialize=True)
    for _run in range(1):
        now = f.now[None]
        cells = ti.static(f.cells)
        home_x, home_y = ti.floor(x / now.width, ti.i32) + 1, ti.floor(y / now.height, ti.i32) + 1
        for i in range(1, now.columns + 1):
            for j in range(1, now.rows + 1):
                row = i * (now.rows + 2) + j
                if under(f, ti.Vector([i, j]), x, y, radius) or (i == home_x and j == home_y):
                    whole = cells.pores[row] * ti.max(0.1, cells.room[row]) / now.marker
                    lacking = ti.cast((1.0 - cells.fill[row]) * whole, ti.i32)
                    for _ in range(lacking):
                        k = f.now[None].markers
                        if k < f.place.shape[0] and k < LARGEST:
                            a, b = FIRST * (k % 65536 + 1), SECOND * (k % 65536 + 1)
                            f.place[k] = ti.Vector([i - 0.48 + 0.96 * (a - ti.floor(a)), j - 0.48 + 0.96 * (b - ti.floor(b))])
                            f.velocity[k] = ti.Vector([vx, vy])
                            f.now[None].markers = k + 1
                            add(cells.fill, row, 1.0 / whole)
                            made += 1
    return made


@ti.kernel
def empty_circle(f: ti.template(), x: ti.f32, y: ti.f32, radius: ti.f32) -> ti.i32:
    """Takes out the markers under the brush; how many."""
    taken = 0
    ti.loop_config(serialize=True)
    for _run in range(1):
        kept = 0
        for k in range(ti.min(f.now[None].markers, f.place.shape[0])):
            if under(f, f.place[k], x, y, radius):
                taken += 1
            else:
                f.place[kept], f.velocity[kept] = f.place[k], f.velocity[k]
                kept += 1
        f.now[None].markers = kept
    return taken


@ti.kernel
def push_circle(f: ti.template(), x: ti.f32, y: ti.f32, radius: ti.f32, vx: ti.f32, vy: ti.f32):
    """Gives the markers under the brush a velocity."""
    ti.loop_config(serialize=True)
    for _run in range(1):
        for k in range(ti.min(f.now[None].markers, f.place.shape[0])):
            if under(f, f.place[k], x, y, radius):
                f.velocity[k] = ti.Vector([vx, vy])
