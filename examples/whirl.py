"""Discs are driven about the middle of the box: an effect of one's own, in one file.

`taichi-sand render billiards --effect whirl.py --set effects.whirl.strength=3 -o whirl.mp4` films it.
"""

import taichi as ti

from taichi_sand.effects import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.geometry import perp, position, wrench


class Whirl(Effect):
    """The effect."""

    parameters = (Parameter("strength", 1.0, "acceleration about the middle", "m/s2", low=0, high=100),)

    @ti.func
    def body(self, w: ti.template(), c: ti.template(), i):
        """Force and torque on grain i."""
        way = position(w, i) - 0.5 * w.box[None].size
        mass = 1 / ti.max(w.grains.mobility[i].x, 1e-9)
        return wrench(mass * c.whirl_strength * perp(way) / way.norm(), 0.0)
