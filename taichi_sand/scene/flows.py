"""The tables [[sources]], [[sinks]] and [[water]]: what comes and goes while a scene is simulated."""

from typing import Self

from pydantic import model_validator

from taichi_sand.scene import checks
from taichi_sand.scene.kinds import Angle, Box, Name, Number, Table, Vector, key
from taichi_sand.scene.sizes import Radius


class Source(Table):
    """Makes grains while the simulation runs, in random free places of its region; each waits for the one before it."""

    name: Name = key("", "what [[events]] call it that start or end it; one that an event starts makes nothing until then")
    shape: str = key("disc", "disc, 2x1, 3x1, triangle, square, or the name of one of [[shapes]]")
    radius: Radius = key(
        ..., "radius of a disc, of which a shape has several: a number, [low, high] to draw from uniformly, or a distribution", "m"
    )
    density: Number = key(2650.0, "mass / area", "kg/m2", ge=1e-6)
    material: str = key("", "name of one of [[materials]] that they are made of")
    rate: Number = key(..., "grains made in a second, where there is room for them", "1/s", gt=0, le=1e6)
    region: Box = key(..., "[x0, y0, x1, y1] that they are made in, as a whole", "m")
    velocity: Vector = key((0.0, 0.0), "[vx, vy] that they start with", "m/s")
    angle: Angle = key("random", 'a number, or "random"', "rad")
    until: Number | None = key(None, "when it ends; never if not given", "s", ge=0)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        checks.source(self)
        return self


class Sink(Table):
    """Takes out the grains whose centres are in its region."""

    region: Box = key(..., "[x0, y0, x1, y1]", "m")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        checks.region(self.region)
        return self


class Water(Table):
    """Where water is at the start, or with a `rate` where it wells up or drains off; it needs a table [effects.water]."""

    region: Box = key(..., "[x0, y0, x1, y1] that it fills, but for the grains that are there", "m")
    rate: Number | None = key(
        None, "how much wells up in the region, spread over it; below 0 drains off; none is there at the start", "m2/s"
    )
    velocity: Vector = key((0.0, 0.0), "[vx, vy] of water that wells up in the air", "m/s")
    since: Number = key(0.0, "when the `rate` begins", "s", ge=0)
    until: Number | None = key(None, "when the `rate` ends; never if not given", "s", ge=0)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        checks.water(self)
        return self
