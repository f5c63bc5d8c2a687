"""How contacts are resolved: `md` and `rigid`, one module each; only the one that a scene names is imported.

A module declares MEMORY, the columns that follow a pair which it needs itself;
numbers(scene, bed), what the tolerance makes of the scene; build(...), the solver as kernels see it, with its ti.func `step`; and, if
its contacts must be told, follow(world, solver, before, after), after these numbers have changed.
"""

import importlib
from types import ModuleType


def choose(kind: str) -> ModuleType:
    """The module of solver `kind`, imported."""
    return importlib.import_module(f"{__name__}.{kind}")
