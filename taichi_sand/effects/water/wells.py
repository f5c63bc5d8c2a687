"""Water that wells up and drains off: a divergence in the regions of their tables, and markers that come and go with it.

New markers lie on the R2 sequence (Roberts 2018), which fills a rectangle evenly however many there are; those that go are taken evenly
from all that are in the region.
"""

import taichi as ti

from taichi_sand.effects.water.grid import WET
from taichi_sand.effects.water.markers import FIRST, SECOND
from taichi_sand.effects.water.transfer import velocity_at
from taichi_sand.taichi_support.noinline import noinline

LARGEST = 2**30


@ti.func
def rate_of(f: ti.template(), n):
    """Of well n at the moment [m2/s]."""
    time, span = f.now[None].time, f.wells.span[n]
    return ti.select(time >= span.x and time < span.y, f.wells.rate[n], 0.0)


@ti.func
def welling(f: ti.template(), i, j):
    """Divergence that wells and drains make in cell (i, j) [1/s]."""
    now = f.now[None]
    total = 0.0
    for n in range(now.wells):
        box = f.wells.region[n]
        width, height = ti.max(box.z - box.x, 1e-6), ti.max(box.w - box.y, 1e-6)
        across = ti.min(box.z, i + 0.5) - ti.max(box.x, i - 0.5)
        up = ti.min(box.w, j + 0.5) - ti.max(box.y, j - 0.5)
        if across > 0.0 and up > 0.0:
            total += rate_of(f, n) * across * up / (width * height * now.width * now.height)
    return total


@noinline
def flow(f: ti.template()):
    """Markers come and go for the step that has passed."""
    now = f.now[None]
    for n in range(now.wells):
        f.wells.owed[n] += rate_of(f, n) * now.step / (now.marker * now.width * now.height)
        if f.wells.owed[n] > 0.0:
            make(f, n)
        else:
            take(f, n)


@ti.func
def make(f: ti.template(), n):
    """The markers that well n owes."""
    box, stride = f.wells.region[n], f.now[None].rows + 2
    for _ in range(ti.cast(f.wells.owed[n], ti.i32)):
        k, made = f.now[None].markers, f.wells.made[n]
        if k < f.place.shape[0] and made < LARGEST and f.now[None].free == 1:
            x, y = FIRST * (made % 65536 + 1), SECOND * (made % 65536 + 1)
            place = ti.Vector([box.x + (x - ti.floor(x)) * (box.z - box.x), box.y + (y - ti.floor(y)) * (box.w - box.y)])
            f.place[k], f.velocity[k] = place, f.wells.velocity[n]
            if f.cells.kind[ti.floor(place.x + 0.5, ti.i32) * stride + ti.floor(place.y + 0.5, ti.i32)] == WET:
                f.velocity[k] = velocity_at(f, place)
            f.now[None].markers, f.wells.made[n] = k + 1, made + 1
        else:
            f.now[None].full = 1
        f.wells.owed[n] -= 1.0


@ti.func
def take(f: ti.template(), n):
    """Takes out what drain n has taken; what is not there is not owed."""
    box, found = f.wells.region[n], 0
    for k in range(f.now[None].markers):
        found += ti.cast(within_box(box, f.place[k]), ti.i32)
    due = ti.min(ti.cast(-f.wells.owed[n], ti.i32), found)
    share, kept = ti.cast(due, f.real) / ti.max(found, 1), 0
    total = 0.0
    for k in range(f.now[None].markers):
        goes = False
        if within_box(box, f.place[k]):
            total += share
            goes = total >= 0.9999
            if goes:
                total -= 1.0
                f.wells.owed[n] += 1.0
        if not goes:
            f.place[kept], f.velocity[kept] = f.place[k], f.velocity[k]
            kept += 1
    f.now[None].markers = kept
    f.wells.owed[n] = ti.max(f.wells.owed[n], -1.0)


@ti.func
def within_box(box, p):
    """Whether p is in a region."""
    return p.x >= box.x and p.x < box.z and p.y >= box.y and p.y < box.w
