"""Water that grains carry, where the effect `moisture` is on: how much of its pull a liquid bridge keeps, and watering by hand.

Wetness is the share of the pores around a grain that is full of water. With the effect `water` a grain holds that much of its own, and
what flows around it fills the rest of its pores as far as it is under water: `soaked` is both. Bridges pull as they do from 0.5 % to
15 %; below they dry out, above the pores fill up, and at 30 % there is no bridge left (physics.md D7, Pakpour et al. 2012).
"""

import taichi as ti

from taichi_sand.world.geometry import at_least, at_most, position

DRY, MOIST, FLOODED = 0.005, 0.15, 0.3


@ti.func
def bond_share(wetness):
    """Share of its pull that a bridge of this wetness has, 0 .. 1."""
    rising = at_most(1.0, wetness / DRY)
    falling = at_most(1.0, (FLOODED - wetness) / (FLOODED - MOIST))
    return at_least(0.0, at_most(rising, falling))


@ti.func
def soaked(w: ti.template(), i):
    """Share of the pores around grain i that is full, of its own water and of that which flows around it."""
    own = w.carried.wetness[i]
    if ti.static(hasattr(w.carried, "water_wet")):
        own += (1.0 - own) * at_least(0.0, w.carried.water_wet[i])
    return own


@ti.func
def bridge_share(w: ti.template(), p):
    """Share of its pull that the bridge of pair p has: by the mean of its two grains, or by the grain alone on a wall."""
    wetness = soaked(w, w.pairs.first[p])
    if p % w.half < w.wall_base:
        wetness = 0.5 * (wetness + soaked(w, w.pairs.second[p]))
    return bond_share(wetness)


@ti.kernel
def pour(w: ti.template(), x: ti.f32, y: ti.f32, radius: ti.f32, amount: ti.f32) -> ti.i32:
    """Adds `amount` to the wetness of the grains whose centres lie within `radius` of (x, y) [m]; returns how many these are."""
    found = 0
    ti.loop_config(serialize=True)
    for _run in range(1):
        for i in range(w.count[None]):
            way = position(w, i) - ti.Vector([x, y])
            for k in ti.static(range(2)):
                if ti.static(w.periodic[k]):
                    way[k] -= w.box[None].size[k] * ti.floor(way[k] / w.box[None].size[k] + 0.5)
            if way.dot(way) <= radius * radius:
                w.carried.wetness[i] = at_least(0.0, at_most(1.0, w.carried.wetness[i] + amount))
                found += 1
    return found
