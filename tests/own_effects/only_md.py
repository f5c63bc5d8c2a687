"""An effect that fits one solver only."""

from taichi_sand.effects import Effect


class OnlyMd(Effect):
    """Never built."""

    solvers = ("md",)
