"""Water in the picture: one soft surface, behind the grains and thinly over them, with drops where single markers fly.

The surface is where the water's grid has it (`depth` of its cells is 0), smoothed by a quadratic spline: in the markers themselves a flow
that stretches leaves gaps. Water is light at its surface, darker with what stands above it, and white where it is fast.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.effects.water.drag import middle_of
from taichi_sand.effects.water.grid import corners, lerp
from taichi_sand.effects.water.transfer import velocity_at
from taichi_sand.view import palette
from taichi_sand.view.kernels import Numbers, Packed, band_count
from taichi_sand.view.shapes import mix, weight
from taichi_sand.world.tables import CHUNK

QUANTITIES = ("water pressure", "water speed")
"""Views of the water itself."""
FINER = 4
"""Nodes of the raster along a cell."""
WIDTH = 4.0
"""Of what a marker says of the speed around it, from its middle to its end, in nodes of the raster."""
DROP, ALONE = 1.3, -0.4
"""Radius of a drop in nodes, and depth of markers that are one [cells]."""
EDGE, RIM = 0.10, 0.55
"""The surface is so soft, and its light so deep [cells]."""
FOAM = (0.7, 2.4)
"""Speeds at which foam begins, and covers all, over that of a fall through a tenth of the box's height."""
DEEP = 0.6
"""Part of the box's height in which water becomes as dark as it can."""
SMOOTH = 2
"""Shades are means over so many cells along the surface, either way."""


@ti.func
def spline(x):
    """The three weights of a quadratic spline at x, and the node of the first."""
    middle = ti.cast(ti.floor(x + 0.5), ti.i32)
    d = x - middle
    return middle - 1, ti.Vector([0.5 * (0.5 - d) ** 2, 0.75 - d * d, 0.5 * (0.5 + d) ** 2])


@ti.kernel
def deal_depth(f: ti.template(), columns: ti.i32, rows: ti.i32, level: Numbers):
    """How deep the nodes of the raster lie [cells]."""
    ti.loop_config(serialize=True)
    for k in range(columns * rows):
        now = f.now[None]
        i, across = spline(ti.cast(k // rows, ti.f32) / FINER + 0.5)
        j, up = spline(ti.cast(k % rows, ti.f32) / FINER + 0.5)
        total = 0.0
        for a in ti.static(range(3)):
            for b in ti.static(range(3)):
                x, y = ti.max(1, ti.min(now.columns, i + a)), ti.max(1, ti.min(now.rows, j + b))
                total += across[a] * up[b] * ti.cast(f.cells.depth[x * (now.rows + 2) + y], ti.f32)
        level[k] = total


@ti.kernel
def deal_markers(f: ti.template(), columns: ti.i32, rows: ti.i32, level: Numbers, share: Numbers, speed: Numbers):
    """Speed on the raster, and drops where markers are by themselves."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        for k in range(columns * rows):
            share[k], speed[k] = 1e-6, 0.0
        for k in range(ti.min(f.now[None].markers, f.place.shape[0])):
            place = f.place[k]
            x, y = ti.cast(place.x - 0.5, ti.f32) * FINER, ti.cast(place.y - 0.5, ti.f32) * FINER
            i, j = ti.cast(ti.floor(x + 0.5), ti.i32), ti.cast(ti.floor(y + 0.5), ti.i32)
            reach = ti.static(int(WIDTH))
            inside = 0 <= i and i < columns and 0 <= j and j < rows
            alone = False
            if inside:
                alone = level[i * rows + j] < ALONE
            for a in range(ti.max(0, i - reach), ti.min(columns, i + reach + 1)):
                for b in range(ti.max(0, j - reach), ti.min(rows, j + reach + 1)):
                    square = (a - x) ** 2 + (b - y) ** 2
                    near = 1.0 - square / (WIDTH * WIDTH)
                    at = a * rows + b
                    if near > 0.0:
                        share[at] += near * near
                        speed[at] += near * near * ti.cast(f.velocity[k].norm(), ti.f32)
                    if alone:
                        level[at] = ti.max(level[at], (DROP - ti.sqrt(square)) / FINER)


@ti.func
def quantity(f: ti.template(), p, which):
    """Of QUANTITIES the one with this number, at a place."""
    now = f.now[None]
    found = velocity_at(f, p).norm()
    if which == 0:
        rows, t = corners(f, 2, p)
        pressure = ti.static(f.cells.pressure)
        values = ti.Vector([pressure[rows[0]], pressure[rows[1]], pressure[rows[2]], pressure[rows[3]]])
        found = ti.max(0.0, lerp(values, t)) * now.density / ti.max(now.step, 1e-12)
    return ti.cast(found, ti.f32)


@ti.kernel
def deal_values(f: ti.template(), columns: ti.i32, rows: ti.i32, which: ti.i32, values: Numbers):
    """A quantity at the nodes of the raster."""
    ti.loop_config(serialize=True)
    for k in range(columns * rows):
        place = ti.Vector([ti.cast(k // rows, f.real), ti.cast(k % rows, f.real)]) / FINER + 0.5
        values[k] = quantity(f, place, which)


@ti.kernel
def values_at_grains(w: ti.template(), f: ti.template(), which: ti.i32, values: Numbers):
    """A quantity of the water where the grains are; 0 of those that are dry."""
    ti.loop_config(serialize=True)
    for i in range(w.count[None]):
        values[i] = 0.0
        if w.carried.water_wet[i] > 0.0:
            values[i] = quantity(f, middle_of(w, f, i), which)


@ti.func
def smoothstep(low, high, x):
    """0 up to `low`, 1 from `high` on, smooth between."""
    t = ti.max(0.0, ti.min(1.0, (x - low) / (high - low)))
    return t * t * (3.0 - 2.0 * t)


@ti.func
def sample(values: ti.template(), rows, at, s, t):
    """The raster, bilinear between row `at` and the next ones."""
    low, high = (1.0 - s) * values[at] + s * values[at + rows], (1.0 - s) * values[at + 1] + s * values[at + rows + 1]
    return (1.0 - t) * low + t * high


@ti.kernel
def paint_water(
    canvas: Packed,
    width: ti.i32,
    height: ti.i32,
    columns: ti.i32,
    rows: ti.i32,
    level: Numbers,
    foam: Numbers,
    shade: Numbers,
    strength: ti.f32,
    colours: Packed,
    left: ti.f32,
    low: ti.f32,
    wide: ti.f32,
    high: ti.f32,
):
    """Lays the water over the canvas; `colours` from its surface to its depth, then that of foam. The box is so wide and high, and its
    lower left corner so far beyond that of the picture [px].
    """
    count = ti.static(band_count())
    last = colours.shape[0] - 2
    for task in range(count * CHUNK):
        if task % CHUNK == 0:
            band = task // CHUNK
            for row in range(height):
                y = (ti.cast(height - row, ti.f32) - 0.5 + low) / high * (rows - 1)
                j = ti.max(0, ti.min(rows - 2, ti.cast(y, ti.i32)))
                for column in range(band * width // count, (band + 1) * width // count):
                    x = (ti.cast(column, ti.f32) + 0.5 + left) / wide * (columns - 1)
                    i = ti.max(0, ti.min(columns - 2, ti.cast(x, ti.i32)))
                    at = i * rows + j
                    deep = sample(level, rows, at, x - i, y - j)
                    if deep > -EDGE:
                        dark = ti.min(1.0, sample(shade, rows, at, x - i, y - j))
                        light = 0.45 * (1.0 - smoothstep(EDGE, RIM, deep))
                        white = ti.max(light, 0.75 * sample(foam, rows, at, x - i, y - j))
                        colour = mix(colours[ti.cast(dark * last + 0.5, ti.i32)], colours[last + 1], weight(256.0 * white))
                        pixel = row * width + column
                        canvas[pixel] = mix(canvas[pixel], colour, weight(256.0 * strength * smoothstep(-EDGE, EDGE, deep)))


class Pool:
    """Paints the water of one simulation: `fluid` are its tables; the box is so high, gravity so strong [m, m/s2]."""

    def __init__(self, fluid: Any, height: float, gravity: float) -> None:
        self.fluid = fluid
        now = fluid.now[None]
        self.shape = (FINER * now.columns + 1, FINER * now.rows + 1)
        self.level, self.share, self.speed = (np.zeros(self.shape[0] * self.shape[1], np.float32) for _ in range(3))
        self.foam, self.shade, self.shown, self.depth = (np.zeros_like(self.level) for _ in range(4))
        self.colours = np.append(palette.colour_map(palette.WATER), palette.packed(palette.FOAM)).astype(np.uint32)
        self.used = self.colours
        self.fast = float(np.sqrt(2 * max(gravity, 1e-3) * height / 10))

    def look(self) -> None:
        """Where the water is now, and what it looks like by itself."""
        self.used = self.colours
        deal_depth(self.fluid, *self.shape, self.level)
        deal_markers(self.fluid, *self.shape, self.level, self.share, self.speed)
        speed = self.speed / self.share / self.fast
        part = np.clip((speed - FOAM[0]) / (FOAM[1] - FOAM[0]), 0.0, 1.0)
        self.foam[:] = part * part * (3 - 2 * part)
        self.shade[:] = shades(self.level.reshape(self.shape)).ravel()

    def show(self, name: str) -> np.ndarray:
        """Pressure [Pa] or speed [m/s] of the water, wherever there is some: of the view `name`."""
        deal_depth(self.fluid, *self.shape, self.depth)
        deal_values(self.fluid, *self.shape, QUANTITIES.index(name), self.shown)
        return self.shown[self.depth > 0]

    def colour(self, top: float, table: np.ndarray) -> None:
        """Paints what `show` has found in the colours of this map, the last of them at `top`; no foam."""
        self.shade[:] = self.shown / max(top, 1e-30)
        self.foam[:] = 0.0
        self.used = np.append(table, palette.packed(palette.FOAM)).astype(np.uint32)

    def at_grains(self, world: Any, name: str, out: np.ndarray) -> None:
        """The same where the grains are, a row a slot."""
        values_at_grains(world, self.fluid, QUANTITIES.index(name), out)

    def paint(self, canvas: np.ndarray, width: int, height: int, strength: float, box: tuple[float, float, float, float]) -> None:
        """Lays it over a canvas, with this strength, 0 … 1. `box`: how far its lower left corner lies beyond that of the canvas, to the
        left and below, and how wide and high it is [px].
        """
        paint_water(canvas, width, height, *self.shape, self.level, self.foam, self.shade, strength, self.used, *box)


def shades(level: np.ndarray) -> np.ndarray:
    """How dark the water is at the nodes of a raster (columns, rows): by how much of it stands above."""
    above = np.cumsum((level > 0)[:, ::-1], axis=1)[:, ::-1] / (DEEP * level.shape[1])
    width = 2 * SMOOTH * FINER + 1
    padded = np.pad(above, ((width // 2 + 1, width // 2), (0, 0)), mode="edge")
    total = np.cumsum(padded, axis=0)
    return (total[width:] - total[:-width]) / width


def pool_of(sim: Any) -> Pool | None:
    """What paints the water of a simulation, if it has any."""
    fluid = next((effect.fluid for effect in sim.solver.effects if hasattr(effect, "fluid")), None)
    return Pool(fluid, sim.scene.size[1], float(np.hypot(*sim.scene.gravity))) if fluid else None
