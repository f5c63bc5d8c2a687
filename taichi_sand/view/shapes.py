"""Anti-aliased shapes on a canvas of packed pixels.

A canvas is a flat array of u32, 0x00RRGGBB, row by row, row 0 at the top: what `ti.GUI(fast_gui=True).img` holds, so a window can
be painted without a copy. Every function paints only columns x0 <= x < x1: bands of columns can be painted side by side, and the
picture does not depend on how many threads do it. Lengths are in pixels; pixel (x, y) has its centre at (x + 1/2, y + 1/2).
"""

import taichi as ti

SMALLEST_RADIUS = 1.0
"""A smaller disc is painted this large, and fainter, so that its light stays right."""


@ti.func
def mix(below, above, share):
    """`above` laid over `below` with weight share / 256; two channels at a time."""
    keep = ti.u32(256) - share
    red_blue = (below & ti.u32(0xFF00FF)) * keep + (above & ti.u32(0xFF00FF)) * share + ti.u32(0x800080)
    green = (below & ti.u32(0x00FF00)) * keep + (above & ti.u32(0x00FF00)) * share + ti.u32(0x008000)
    return ((red_blue >> ti.u32(8)) & ti.u32(0xFF00FF)) | ((green >> ti.u32(8)) & ti.u32(0x00FF00))


@ti.func
def weight(share):
    """0 .. 256 as `mix` wants it, rounded."""
    return ti.cast(ti.cast(ti.max(share, 0.0) + 0.5, ti.i32), ti.u32)


@ti.func
def lighter(colour, factor):
    """Colour with every channel times `factor`, at most 255."""
    lit = ti.u32(0)
    for shift in ti.static((16, 8, 0)):
        channel = ti.cast((colour >> ti.u32(shift)) & ti.u32(255), ti.f32) * factor + 0.5
        lit |= ti.cast(ti.min(255.0, channel), ti.u32) << ti.u32(shift)
    return lit


@ti.func
def sleepy(colour):
    """Colour at 60 % of its saturation and 80 % of its lightness."""
    red, green, blue = (colour >> ti.u32(16)) & ti.u32(255), (colour >> ti.u32(8)) & ti.u32(255), colour & ti.u32(255)
    grey = ti.cast(77 * red + 150 * green + 29 * blue, ti.f32) / 256.0  # as bright, without colour
    faint = ti.u32(0)
    for shift in ti.static((16, 8, 0)):
        channel = ti.cast((colour >> ti.u32(shift)) & ti.u32(255), ti.f32)
        faint |= ti.cast(0.8 * (grey + 0.6 * (channel - grey)) + 0.5, ti.u32) << ti.u32(shift)
    return faint


@ti.func
def disc(canvas: ti.template(), width, height, x0, x1, cx, cy, radius, colour):
    """A filled disc. Its rim is a ramp about a pixel wide, straight in the squared distance: so the covered area is pi r^2."""
    shown = ti.max(radius, SMALLEST_RADIUS)
    strength = (radius / shown) ** 2
    slope = 128.0 / shown * strength
    inner, outer = shown * shown - shown, shown * shown + shown
    top = ti.max(0, ti.cast(ti.floor(cy - shown), ti.i32))
    bottom = ti.min(height, ti.cast(ti.floor(cy + shown), ti.i32) + 1)
    for y in range(top, bottom):
        dy = ti.cast(y, ti.f32) + 0.5 - cy
        reach = ti.sqrt(ti.max(0.0, outer - dy * dy))
        first = ti.max(x0, ti.cast(ti.floor(cx - reach + 0.5), ti.i32))
        last = ti.min(x1, ti.cast(ti.floor(cx + reach + 0.5), ti.i32))
        row = y * width
        for x in range(first, last):
            dx = ti.cast(x, ti.f32) + 0.5 - cx
            square = dx * dx + dy * dy
            painted = colour
            if square > inner:
                painted = mix(canvas[row + x], colour, weight(slope * (outer - square)))
            canvas[row + x] = painted


@ti.func
def line(canvas: ti.template(), width, height, x0, x1, ax, ay, bx, by, thickness, colour):
    """A line from a to b with round ends. One thinner than a pixel is painted a pixel wide, and fainter."""
    pad = 0.5 * ti.max(thickness, 1.0) + 0.5
    strength = 256.0 * ti.min(thickness, 1.0)
    dx, dy = bx - ax, by - ay
    inverse_square = 1.0 / ti.max(dx * dx + dy * dy, 1e-12)
    inverse_rise = 1.0 / (dy if ti.abs(dy) > 1e-6 else 1e-6)
    spread = pad * ti.abs(inverse_rise)
    top = ti.max(0, ti.cast(ti.floor(ti.min(ay, by) - pad), ti.i32))
    bottom = ti.min(height, ti.cast(ti.floor(ti.max(ay, by) + pad), ti.i32) + 1)
    for y in range(top, bottom):
        py = ti.cast(y, ti.f32) + 0.5 - ay
        middle = py * inverse_rise
        low = dx * ti.min(1.0, ti.max(0.0, middle - spread))
        high = dx * ti.min(1.0, ti.max(0.0, middle + spread))
        first = ti.max(x0, ti.cast(ti.floor(ax + ti.min(low, high) - pad), ti.i32))
        last = ti.min(x1, ti.cast(ti.floor(ax + ti.max(low, high) + pad), ti.i32) + 1)
        row = y * width
        for x in range(first, last):
            px = ti.cast(x, ti.f32) + 0.5 - ax
            along = ti.min(1.0, ti.max(0.0, (px * dx + py * dy) * inverse_square))
            away_x, away_y = px - along * dx, py - along * dy
            square = away_x * away_x + away_y * away_y
            if square < pad * pad:
                share = ti.min(1.0, pad - ti.sqrt(square)) * strength
                canvas[row + x] = mix(canvas[row + x], colour, weight(share))
