"""The view `photoelastic`: grains as discs of a photoelastic material between crossed circular polarisers, as in experiments.

A disc under point loads F_k at its rim that are in equilibrium has the stress sum of -2 (F_k . r_k) r_k r_k / (π |r_k|⁴), r_k from the
load to the point (Flamant), and a uniform one of sum F_k cos β_k / (2πR) that frees the rim of what those leave there (Michell 1900). The
uniform one is isotropic: it does not show. Light of intensity sin²(π N) passes where the principal stresses differ by N times the
`fringe` [N/m] (the material's constant over the thickness). Of a clump every disc shows the forces that act on that disc itself, its
neighbours in the clump not among them. Where fringes are closer than pixels they fade to their mean.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.measure.pairs import gap_now
from taichi_sand.view import palette
from taichi_sand.view.kernels import Integers, Packed, Rows, Spans, band_count
from taichi_sand.view.shapes import mix, weight
from taichi_sand.world.blocks import block_count
from taichi_sand.world.clumps import MOST
from taichi_sand.world.geometry import perp
from taichi_sand.world.search.pair_history import discs_of
from taichi_sand.world.tables import CHUNK, World

ORDERS = 2.0
"""Fringes at the centre of a mean disc that is pressed from two sides with the force that 97 % of the contacts stay below."""
PERCENTILE = 0.97
CYCLE = 256
"""Shades from one fringe to the next."""
FADE = (0.2, 0.5)
"""Fringes a pixel at which fringes begin to fade, and are gone."""


@ti.func
def forces_apart(force):
    """Whether a pair passes anything on."""
    return force.x != 0.0 or force.y != 0.0


@ti.func
def row_of(w: ti.template(), i, disc):
    """Row of a disc of the grain in slot i."""
    return i * w.discs + disc


@ti.func
def put_load(w: ti.template(), row, way, push, scale, start: ti.template(), loads: ti.template()):
    """Writes a load: where it is from the centre of the disc, and the force on the disc; px, y down."""
    at = ti.atomic_add(start[row], 1)
    loads[at, 0], loads[at, 1] = ti.cast(way.x, ti.f32) * scale, -ti.cast(way.y, ti.f32) * scale
    loads[at, 2], loads[at, 3] = ti.cast(push.x, ti.f32), -ti.cast(push.y, ti.f32)


@ti.func
def load_pair(w: ti.template(), p, wall: ti.template(), put: ti.template(), scale, start: ti.template(), loads: ti.template()):
    """Counts the loads of pair p on its discs, or puts them into the list."""
    force = w.pairs.force[p]
    if forces_apart(force):
        i, discs = w.pairs.first[p], discs_of(w, p)
        one = row_of(w, i, discs // MOST)
        two = 0
        if ti.static(not wall):
            two = row_of(w, w.pairs.second[p], discs % MOST)
        if ti.static(put):
            _gap, normal = gap_now(w, p, wall)
            push = force.x * normal + force.y * perp(normal)
            rims = ti.Vector([w.grains.radius[i], 0.0])
            if ti.static(not wall):
                rims.y = w.grains.radius[w.pairs.second[p]]
            if ti.static(w.clumps):
                rims = w.pairs.rims[p]
            put_load(w, one, rims.x * normal, -push, scale, start, loads)
            if ti.static(not wall):
                put_load(w, two, -rims.y * normal, push, scale, start, loads)
        else:
            start[one + 1] += 1
            if ti.static(not wall):
                start[two + 1] += 1


@ti.kernel
def place_loads(w: ti.template(), scale: ti.f32, start: Integers, loads: Rows):
    """Lists the loads of every disc, in the end those of row r at start[r - 1] … start[r] - 1: x, y from the centre [px], force [N]."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        for r in range(start.shape[0]):
            start[r] = 0
        for put in ti.static((False, True)):
            for b in range(block_count(w)):
                for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
                    load_pair(w, p, False, put, scale, start, loads)
                for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
                    load_pair(w, p, True, put, scale, start, loads)
            if ti.static(not put):
                for r in range(1, start.shape[0]):
                    start[r] += start[r - 1]


@ti.func
def order_at(x, y, low, high, loads: ti.template(), strength):
    """Fringe order at (x, y) from the centre of a disc [px] under loads low … high - 1, and the square of how fast it changes [1/px]."""
    even, odd, change = 0.0, 0.0, 0.0
    for k in range(low, high):
        dx, dy = x - loads[k, 0], y - loads[k, 1]
        inverse = 1.0 / (dx * dx + dy * dy + 1e-6)
        radial = (loads[k, 2] * dx + loads[k, 3] * dy) * inverse
        share = radial * inverse
        even += share * (dx * dx - dy * dy)
        odd += share * (dx * dy)
        change += radial * share
    return strength * ti.sqrt(even * even + 4.0 * odd * odd), strength * strength * ti.abs(change)


@ti.func
def light(cycle: ti.template(), colours: ti.template(), order, change):
    """Colour at this fringe order: of the `cycle` from one to the next where they are wide, else nearer to their mean."""
    colour = cycle[ti.cast(order * CYCLE, ti.i32) & ti.static(CYCLE - 1)]
    if change > ti.static(FADE[0] ** 2):
        share = ti.max(0.0, (FADE[1] - ti.sqrt(change)) / (FADE[1] - FADE[0]))
        bright = 0.5 - 0.5 * share * ti.cos(2.0 * ti.math.pi * order)
        colour = colours[ti.cast(bright * 255.0 + 0.5, ti.i32)]
    return colour


@ti.kernel
def paint_fringes(
    canvas: Packed,
    width: ti.i32,
    height: ti.i32,
    discs: Rows,
    owner: Integers,
    bands: Spans,
    part: Integers,
    most: ti.i32,
    start: Integers,
    loads: Rows,
    strength: ti.f32,
    cycle: Packed,
    colours: Packed,
):
    """Paints the discs listed with their fringes. `strength`: fringes that 1 N makes at a distance of 1 px, straight ahead."""
    count = ti.static(band_count())
    for task in range(count * CHUNK):
        if task % CHUNK == 0:
            s = task // CHUNK
            x0, x1 = s * width // count, (s + 1) * width // count
            for k in range(bands[s, 0], bands[s, 1]):
                cx, cy, r = discs[k, 0], discs[k, 1], ti.max(discs[k, 2], 1.0)
                if cx + r + 1.0 > x0 and cx - r - 1.0 < x1 and owner[k] >= 0:
                    row = owner[k] * most + part[k]
                    low, high = (start[row - 1] if row > 0 else 0), start[row]
                    inner, outer = r * r - r, r * r + r
                    for y in range(ti.max(0, ti.cast(ti.floor(cy - r), ti.i32)), ti.min(height, ti.cast(ti.floor(cy + r), ti.i32) + 1)):
                        dy = ti.cast(y, ti.f32) + 0.5 - cy
                        reach = ti.sqrt(ti.max(0.0, outer - dy * dy))
                        first = ti.max(x0, ti.cast(ti.floor(cx - reach + 0.5), ti.i32))
                        last = ti.min(x1, ti.cast(ti.floor(cx + reach + 0.5), ti.i32))
                        for x in range(first, last):
                            dx = ti.cast(x, ti.f32) + 0.5 - cx
                            colour, square = cycle[0], dx * dx + dy * dy
                            if high > low:
                                order, change = order_at(dx, dy, low, high, loads, strength)
                                colour = light(cycle, colours, order, change)
                            if square > inner:
                                colour = mix(canvas[y * width + x], colour, weight(128.0 / r * (outer - square)))
                            canvas[y * width + x] = colour


@ti.kernel
def orders(x: Rows, loads: Rows, strength: ti.f32, found: Rows):
    """Fringe order at points x (n, 2) from the centre of a disc under `loads`: column 0 of `found`."""
    ti.loop_config(serialize=True)
    for n in range(x.shape[0]):
        order, _change = order_at(x[n, 0], x[n, 1], 0, loads.shape[0], loads, strength)
        found[n, 0] = order


class Fringes:
    """Paints the fringes of one world."""

    def __init__(self, world: World) -> None:
        rows = world.half * (1 + world.sleeps)
        self.world = world
        self.start = np.zeros(world.capacity * world.discs + 1, np.int32)
        self.loads = np.zeros((2 * rows, 4), np.float32)
        self.colours = palette.colour_map(palette.FRINGES)
        bright = np.sin(np.pi * (np.arange(CYCLE) + 0.5) / CYCLE) ** 2
        self.cycle = self.colours[np.rint(bright * (palette.ENTRIES - 1)).astype(int)]

    def place(self, scale: float) -> np.ndarray:
        """Lists all loads, at `scale` [px/m]; returns the forces [N], one or two a contact."""
        place_loads(self.world, scale, self.start, self.loads)
        found = self.loads[: self.start[-1]]
        return np.hypot(found[:, 2], found[:, 3])

    def paint(self, canvas: np.ndarray, size: tuple[int, int], listed: tuple[Any, ...], scale: float, fringe: float) -> None:
        """Paints the discs `listed` (rows, owners, bands, numbers of the discs), with a fringe every `fringe` [N/m]."""
        discs, owner, bands, part = listed
        strength = 2.0 / np.pi * scale / max(fringe, 1e-30)
        paint_fringes(
            canvas, *size, discs, owner, bands, part, self.world.discs, self.start, self.loads, strength, self.cycle, self.colours
        )
