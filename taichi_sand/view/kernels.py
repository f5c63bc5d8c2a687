"""The kernels of the painter: in which colours grains are, and the painting itself.

Grains are first placed (view/placing.py), then painted in bands of columns, in parallel, each in the order of the slots.
All lists are NumPy arrays of the painter: the painter needs no room on the device. Coordinates are pixels, y down.
"""

import taichi as ti

from taichi_sand.taichi_support.runtime import on_gpu
from taichi_sand.view.palette import LIGHTNESS_SPREAD
from taichi_sand.view.shapes import disc, lighter, line, mix, sleepy
from taichi_sand.world.geometry import movable
from taichi_sand.world.tables import CHUNK

CPU_BANDS, GPU_BANDS = 16, 512
"""Columns of the picture are painted in so many bands. A constant: a run-time range as short as this would run on one thread."""
SPOKE_LIGHTNESS, SPOKE_LENGTH, SPOKE_WIDTH = 0.62, 0.86, 0.28
SPOKE_RADII = (3.0, 5.0)
"""Discs smaller than the first [px] get no spoke, those larger than the second a full one, the rest a fainter one."""
TONES = 4
"""Tones of sand for each kind of grain; a grain's id chooses one."""
NO_SPOKE = 1e9
"""Angle of a disc without a spoke."""
NO_ROW = 2**30
NOBODY = -1
"""Owner of a row that holds no disc."""

Packed = ti.types.ndarray(dtype=ti.u32, ndim=1)
Integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
Numbers = ti.types.ndarray(dtype=ti.f32, ndim=1)
Rows = ti.types.ndarray(dtype=ti.f32, ndim=2)
Spans = ti.types.ndarray(dtype=ti.i32, ndim=2)
Bytes = ti.types.ndarray(dtype=ti.u8, ndim=1)


def band_count() -> int:
    """Bands on the backend that Taichi runs on."""
    return GPU_BANDS if on_gpu() else CPU_BANDS


@ti.func
def band_of(column, width, bands):
    """The band that paints this column; the nearest one beyond the picture."""
    return ((ti.min(ti.max(column, 0), width - 1) + 1) * bands - 1) // width


@ti.func
def id_hash(number):
    """Scrambled bits of a grain's id."""
    h = ti.cast(number, ti.u32) * ti.u32(2654435761)
    h = (h ^ (h >> ti.u32(15))) * ti.u32(2246822519)
    return h ^ (h >> ti.u32(13))


@ti.func
def grain_tone(w: ti.template(), i, tones: ti.template()):
    """Colour by kind, with the lightness that is the grain's own."""
    bits = id_hash(w.grains.id[i])
    kind = w.grains.kind[i] % (tones.shape[0] // TONES)
    spread = ti.cast((bits >> ti.u32(8)) & ti.u32(0xFFFF), ti.f32) / 32767.5 - 1.0
    return lighter(tones[kind * TONES + ti.cast(bits & ti.u32(3), ti.i32)], 1.0 + LIGHTNESS_SPREAD * spread)


@ti.kernel
def colour_by_kind(w: ti.template(), tones: Packed, fixed: ti.u32, colours: Packed):
    """Colour of every grain from the tones of its kind; fixed grains have one of their own."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        colours[i] = grain_tone(w, i, tones) if movable(w, i) > 0.0 else fixed


@ti.kernel
def colour_by_value(w: ti.template(), values: Numbers, top: ti.f32, colour_map: Packed, fixed: ti.u32, colours: Packed):
    """Colour of every grain from a map, 0 .. top; fixed grains have one of their own."""
    last = colour_map.shape[0] - 1
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        entry = ti.cast(values[i] / top * ti.cast(last, ti.f32) + 0.5, ti.i32)
        colours[i] = colour_map[ti.min(last, ti.max(0, entry))] if movable(w, i) > 0.0 else fixed


@ti.kernel
def fade_sleepers(w: ti.template(), colours: Packed):
    """Colours of those who sleep, who lie behind all others."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None] - w.sleep.state[None].asleep, w.count[None]):
        if movable(w, i) > 0.0:
            colours[i] = sleepy(colours[i])


@ti.kernel
def moving_values(w: ti.template(), values: Numbers, out: Numbers) -> ti.i32:
    """Values of the grains that are not fixed, gathered at the front of `out`, in any order; their number."""
    found = 0
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        if movable(w, i) > 0.0:
            out[ti.atomic_add(found, 1)] = values[i]
    return found


@ti.kernel
def paint_discs(canvas: Packed, width: ti.i32, height: ti.i32, discs: Rows, owner: Integers, bands: Spans, colours: Packed, spokes: ti.i32):
    """Paints the discs listed, those with an angle with a spoke, if `spokes` is 1."""
    count = ti.static(band_count())
    for task in range(count * CHUNK):
        if task % CHUNK == 0:
            s = task // CHUNK
            x0, x1 = s * width // count, (s + 1) * width // count
            for k in range(bands[s, 0], bands[s, 1]):
                x, y, r, angle = discs[k, 0], discs[k, 1], discs[k, 2], discs[k, 3]
                if x + r + 1.0 > x0 and x - r - 1.0 < x1 and owner[k] != NOBODY:
                    colour = colours[owner[k]]
                    disc(canvas, width, height, x0, x1, x, y, r, colour)
                    if spokes == 1 and angle < NO_SPOKE and r > SPOKE_RADII[0]:
                        shown = ti.min(1.0, (r - SPOKE_RADII[0]) / (SPOKE_RADII[1] - SPOKE_RADII[0]))
                        dark = lighter(colour, 1.0 - (1.0 - SPOKE_LIGHTNESS) * shown)
                        tip = (SPOKE_LENGTH - 0.5 * SPOKE_WIDTH) * r
                        tip_x, tip_y = x + tip * ti.cos(angle), y - tip * ti.sin(angle)
                        line(canvas, width, height, x0, x1, x, y, tip_x, tip_y, SPOKE_WIDTH * r, dark)


@ti.kernel
def paint_lines(canvas: Packed, width: ti.i32, height: ti.i32, lines: Rows, thickness: Numbers, colours: Packed):
    """Paints lines (x, y, x, y), the last on top."""
    count = ti.static(band_count())
    for task in range(count * CHUNK):
        if task % CHUNK == 0:
            s = task // CHUNK
            x0, x1 = s * width // count, (s + 1) * width // count
            for k in range(colours.shape[0]):
                ax, ay, bx, by = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3]
                pad = 0.5 * thickness[k] + 1.0
                if ti.max(ax, bx) + pad > x0 and ti.min(ax, bx) - pad < x1:
                    line(canvas, width, height, x0, x1, ax, ay, bx, by, thickness[k], colours[k])


@ti.kernel
def paint_tiles(canvas: Packed, width: ti.i32, height: ti.i32, tiles: Spans, pixels: Packed):
    """Lays small pictures over the canvas, one after the other; what sticks out is cut off.

    A row of `tiles` is left, top, width, height; their pixels follow one another in `pixels`, 0xAARRGGBB, alpha 0 .. 255.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        start = 0
        for k in range(tiles.shape[0]):
            left, top, wide, high = tiles[k, 0], tiles[k, 1], tiles[k, 2], tiles[k, 3]
            for v in range(ti.max(0, -top), ti.min(high, height - top)):
                for u in range(ti.max(0, -left), ti.min(wide, width - left)):
                    pixel = pixels[start + v * wide + u]
                    share = pixel >> ti.u32(24)
                    at = (top + v) * width + left + u
                    canvas[at] = mix(canvas[at], pixel, share + (share >> ti.u32(7)))
            start += wide * high


@ti.kernel
def unpack(canvas: Packed, image: Bytes):
    """The canvas as bytes red, green, blue."""
    count = ti.static(band_count())
    for task in range(count * CHUNK):
        if task % CHUNK == 0:
            s = task // CHUNK
            pixels = canvas.shape[0]
            for k in range(s * (pixels // count), (s + 1) * (pixels // count) if s < count - 1 else pixels):
                image[3 * k] = ti.cast(canvas[k] >> ti.u32(16), ti.u8)
                image[3 * k + 1] = ti.cast(canvas[k] >> ti.u32(8), ti.u8)
                image[3 * k + 2] = ti.cast(canvas[k], ti.u8)
