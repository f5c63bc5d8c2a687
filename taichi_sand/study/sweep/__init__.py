"""Parameter studies: one scene over values and seeds, on this machine, by any executor or a batch system; and what comes out."""

from taichi_sand.study.sweep.engine import sweep

__all__ = ["sweep"]
