"""Wet grains are darker, as wet sand is."""

import taichi as ti

from taichi_sand.view.shapes import lighter
from taichi_sand.world.geometry import movable

WETTEST, DARKNESS = 0.3, 0.4
"""A grain of this wetness is as dark as wet grains get: by this share."""


@ti.kernel
def darken(w: ti.template(), colours: ti.types.ndarray(dtype=ti.u32, ndim=1)):
    """Colours of wet grains, the darker the wetter."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        if movable(w, i) > 0.0:
            wet = ti.min(1.0, ti.max(0.0, ti.cast(w.carried.wetness[i], ti.f32)) / WETTEST)
            colours[i] = lighter(colours[i], 1.0 - DARKNESS * wet)
