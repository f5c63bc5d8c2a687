"""Drag of the air, still or in a wind: F = 1/2 C ρ 2r |u| u for a disc of radius r in an air stream u, per metre of depth.

The force is taken where the step ends, F(u') with u' = u - h F/m linearised, so that light grains in a storm stay stable at any step.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.geometry import velocity, wrench


@dataclass(frozen=True, eq=False)
class Drag(Effect):
    """The effect."""

    parameters = (
        Parameter("density", 1.2, "density of the air", "kg/m2", low=0.0, high=1e4),
        Parameter("coefficient", 1.0, "drag coefficient: 1 for a disc, 0.5 for a smooth sphere", low=0.0, high=100.0),
        Parameter("wind_x", 0.0, "speed of the wind to the right", "m/s", low=-1e3, high=1e3),
        Parameter("wind_y", 0.0, "speed of the wind upwards", "m/s", low=-1e3, high=1e3),
    )
    neutral: ClassVar = {"density": 0.0}

    @classmethod
    def push(cls, values: dict[str, Any], world: Any) -> float:
        """Force of the wind on a mean grain at rest [N]."""
        return values["density"] * values["coefficient"] * world.box[None].diameter / 2 * (values["wind_x"] ** 2 + values["wind_y"] ** 2)

    @ti.func
    def body(self, w: ti.template(), c: ti.template(), i):
        """Force of the air on grain i."""
        stream = ti.Vector([c.drag_wind_x, c.drag_wind_y]) - velocity(w, i)
        slope = c.drag_density * c.drag_coefficient * w.grains.radius[i] * stream.norm()
        return wrench(slope / (1.0 + c.step * slope * w.grains.mobility[i].x) * stream, 0.0)
