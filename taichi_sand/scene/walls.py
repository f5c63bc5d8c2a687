"""The tables [[walls]]: line obstacles, and how they move."""

from typing import Self

from pydantic import model_validator

from taichi_sand.scene import checks
from taichi_sand.scene.kinds import Name, Number, Switch, Table, Vector, key


class Shake(Table):
    """How a wall is shaken: its displacement is amplitude (sin(2 π frequency t + phase) - sin(phase)), along x and y each."""

    amplitude: Vector = key(..., "[ax, ay]", "m")
    frequency: Number = key(..., "of the shaking", "Hz", gt=0, le=1e5)
    phase: Vector = key((0.0, 0.0), "[px, py] that it begins with: [0, π/2] goes around an ellipse", "rad")


class Rock(Table):
    """How a wall rocks about its pivot: it is turned by angle sin(2 π frequency t)."""

    angle: Number = key(..., "largest, to either side", "rad", ge=-6.3, le=6.3)
    frequency: Number = key(..., "of the rocking", "Hz", gt=0, le=1e5)


class Wall(Table):
    """A line obstacle: a polyline, solid from both sides, still or moved as its keys say."""

    points: tuple[Vector, ...] = key(..., "corners [[x, y], …], at least two", "m", min_length=2)
    name: Name = key("", "what [[events]] and the report call it; walls of one name are changed together")
    closed: Switch = key(False, "joins the last point to the first")
    material: str = key("", "name of one of [[materials]] that it is made of")
    friction: Number | None = key(None, "coefficient of friction; that of its material, or of [effects.friction], if none", ge=0, le=10)
    surface_velocity: Number = key(0.0, "of its surface along the line, from its first point to its last: a conveyor belt", "m/s")
    velocity: Vector = key((0.0, 0.0), "[vx, vy] that it moves with", "m/s")
    spin: Number = key(0.0, "that it turns with, counter-clockwise", "rad/s")
    pivot: Vector | None = key(None, "[x, y] at time 0 of what it turns about; the mean of its points if not given", "m")
    shake: Shake | None = key(None, "{ amplitude = [ax, ay], frequency = Hz, phase = [px, py] } that it is shaken with")
    rock: Rock | None = key(None, "{ angle = rad, frequency = Hz } that it rocks with, about its pivot")
    force: Number | None = key(None, "that it is pushed along its `velocity` with, which then is the fastest that it moves", "N", gt=0)
    pressure: Number = key(
        0.0, "instead of `force`: force for every metre of its length that can be loaded, from side to side; 0 = none", "N/m", ge=0
    )
    mass: Number | None = key(None, "of a wall with `force` or `pressure`; it has no inertia if not given", "kg", gt=0)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        checks.wall(self)
        return self
