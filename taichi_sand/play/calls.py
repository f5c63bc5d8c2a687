"""Calls from Python in a session: what is done to its simulation beside the session's own actions becomes an action, too.

Who plays a session may as well call `session.sim.add(…)`, in a script or out of `every`. A recording has to do that again.
"""

import inspect
from typing import Any

import numpy as np

from taichi_sand.run.simulation import Simulation
from taichi_sand.scene.schema import Scene

CALLS = tuple(name for name in sorted(dir(Simulation)) if hasattr(getattr(Simulation, name), "changes") and name != "record")
"""Methods of a simulation that change it."""
SCENES = ("retune", "restage")
"""Those that are given a scene."""


def as_json(value: Any) -> Any:
    """An argument as JSON can hold it, every number to its last bit."""
    if isinstance(value, Scene):
        return value.to_json()
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, dict):
        return {str(name): as_json(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(part) for part in value]
    return value


def action_of(name: str, args: tuple, named: dict[str, Any]) -> list:
    """The action ["call", name, arguments] that stands for a call."""
    given = inspect.signature(getattr(Simulation, name)).bind(None, *args, **named).arguments
    return ["call", name, {key: as_json(value) for key, value in given.items() if key != "self"}]


def fits(name: Any, given: Any) -> bool:
    """Whether there is such a call: what its arguments hold is looked at by the method itself."""
    if name not in CALLS or not isinstance(given, dict):
        return False
    try:
        inspect.signature(getattr(Simulation, name)).bind(None, **given)
    except TypeError:
        return False
    return name not in SCENES or isinstance(given["scene"], str)


def call(sim: Simulation, name: str, given: dict[str, Any]) -> None:
    """Does it. SandError as the method raises it."""
    if name in SCENES:
        given = {"scene": Scene.from_json(given["scene"])}
    getattr(sim, name)(**given)
