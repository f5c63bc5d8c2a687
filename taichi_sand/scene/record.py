"""The table [record]: what `taichi-sand run` writes while a scene is simulated."""

from typing import Self

from pydantic import model_validator

from taichi_sand.errors import Wrong, show
from taichi_sand.scene.kinds import Number, Table, key

LEAST = 1e-6
"""Nobody wants frames closer than this [s]; most solvers have no shorter step."""


class Record(Table):
    """What `taichi-sand run` writes beside its report."""

    every: Number = key(0.01, "time between two frames", "s", ge=LEAST)
    trajectory: str | None = key(None, "name of the trajectory, ending in .gsd; it is written to the folder in which `run` is called")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        name = self.trajectory
        if name is not None and (not name.endswith(".gsd") or name.startswith(".") or set(name) & set("/\\:\0")):
            raise Wrong("trajectory", f" = {show(name)} must be the name of a file that ends in .gsd, without a folder")
        return self
