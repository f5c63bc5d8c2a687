"""taichi_sand: a real-time 2D granular simulator that shows what accuracy costs in time.

    import taichi_sand as sand
    scene = sand.load("hourglass")
    sim = sand.Simulation(scene)
    sim.advance(2.0)
    print(sim.report()["overlap_mean"])

Taichi is imported with `Simulation`, not before.
"""

import os
import tempfile
from collections.abc import Sequence
from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING, Any

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # its banner would stand in front of `run --json`
if os.name == "posix" and "HOME" not in os.environ:  # Taichi ends the process where there is none
    HOME = os.path.expanduser("~")
    os.environ["HOME"] = HOME if HOME != "~" else tempfile.gettempdir()

if TYPE_CHECKING:
    from taichi_sand.errors import PhysicsError, SandError
    from taichi_sand.run.simulation import Simulation
    from taichi_sand.scene.schema import Scene
    from taichi_sand.study.sweep.engine import sweep

__all__ = ["PhysicsError", "SandError", "Scene", "Simulation", "__version__", "load", "sweep"]
__version__ = "0.1.0"

_HOMES = {
    "Scene": "taichi_sand.scene.schema",
    "SandError": "taichi_sand.errors",
    "PhysicsError": "taichi_sand.errors",
    "Simulation": "taichi_sand.run.simulation",
    "sweep": "taichi_sand.study.sweep.engine",
}


def load(name_or_path: str | PathLike[str], overrides: Sequence[str] = (), effects: Sequence[str | PathLike[str]] = ()) -> "Scene":
    """Reads a scene from a file, or a bundled one by name, and checks it, effects included.

    Args:
        name_or_path: a path, or a name that `taichi-sand scenes` lists.
        overrides: `KEY=VALUE` each, as with `--set` on the command line.
        effects: Python files with effects of your own, as with `--effect`; each is on, with its defaults unless the scene names it.

    Raises:
        SandError: something is wrong with it, told in one sentence.
    """
    from taichi_sand import effects as effect_modules
    from taichi_sand.scene import loading

    own = [effect_modules.add(path) for path in effects]
    scene = loading.load(name_or_path, overrides, own)
    effect_modules.check(scene)
    return scene


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'taichi_sand' has no attribute {name!r}")
