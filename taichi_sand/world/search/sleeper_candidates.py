"""The part of the list build that is about sleepers: lists a grain that is awake with those it may meet, and wakes those it would hit."""

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.clumps import turned
from taichi_sand.world.geometry import perp, spin, velocity
from taichi_sand.world.search.candidates import list_range, may_meet
from taichi_sand.world.search.cell_list import flight_of
from taichi_sand.world.sleep.state import call, site_of


@noinline
def list_sleepers(w: ti.template(), i: ti.i32, p: ti.i32, last: ti.i32, lanes: ti.template()) -> ti.i32:
    """Lists grain i, awake, with the sleepers that it may meet; those it would hit are called before. Returns the next row."""
    sleep = ti.static(w.sleep)
    row = p
    if sleep.state[None].asleep > 0:
        box, v = w.box[None], velocity(w, i)
        rounding = 1e-6 * (box.size.x + box.size.y)
        near = w.grains.radius[i] + 0.5 * box.listed + box.bridge + w.pace[None].skin + v.norm() * w.pace[None].horizon + rounding
        low = ti.cast(ti.floor((flight_of(w, i).xy - near) / box.spacing), ti.i32)
        high = ti.min(ti.cast(ti.floor((flight_of(w, i).xy + near) / box.spacing), ti.i32), low + box.sites - 1)
        for k in ti.static(range(2)):
            if ti.static(not w.periodic[k]):
                low[k], high[k] = ti.max(low[k], 0), ti.max(high[k], 0)
                low[k], high[k] = ti.min(low[k], box.sites[k] - 1), ti.min(high[k], box.sites[k] - 1)
        for x in range(low.x, high.x + 1):
            if ti.static(w.periodic[1]):
                for y in range(low.y, high.y + 1):
                    site = site_of(w, x, y)
                    row = list_range(w, i, sleep.start[site], sleep.start[site + 1], row, last, lanes)
            else:
                top = site_of(w, x, high.y) + 1
                row = list_range(w, i, sleep.start[site_of(w, x, low.y)], sleep.start[top], row, last, lanes)
        if ti.static(lanes > 0):
            for k in range((row - p) // lanes):
                if p + k * lanes < last:
                    call_before_impact(w, i, p + k * lanes)
    return row


@ti.func
def call_before_impact(w: ti.template(), i, q):
    """Wakes the sleeper of pair q if grain i, which is awake, is about to hit it."""
    apart, motion = w.pairs.reach[q], velocity(w, i)
    if ti.static(w.clumps):
        apart = w.pairs.normal[q] * (w.pairs.gap[q] + w.pairs.contact_distance[q])
        motion += spin(w, i) * perp(turned(w, i, w.pairs.arms[q].xy))
    if motion.dot(w.pairs.normal[q]) > w.sleep.state[None].impact:
        if may_meet(apart, -motion, w.pairs.contact_distance[q], w.pace[None].horizon):
            call(w, w.pairs.second[q])
