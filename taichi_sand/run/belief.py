"""Whether the state that a checkpoint or a recording brings can be one: what its host's record says, as `world.trust` does for tables."""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from taichi_sand.errors import SandError, show
from taichi_sand.run import live, trust
from taichi_sand.run.host import Host
from taichi_sand.scene.events import After, names
from taichi_sand.solvers import choose
from taichi_sand.solvers.bed import PAUSE, Bed
from taichi_sand.world.flags import SENTENCES

EQUAL = 1e-5
"""How nearly numbers are the same that are kept with 32 bits, or were worked out on another machine."""
COUNTS = ("steps", "made", "removed")
PACE = ("step", "speed_cap")
MOST_OWED = 1e6
"""Steps: half a step before the step became so much shorter."""


def check(sim: Any, record: Host, fresh: Mapping[str, np.ndarray], stored: Mapping[str, np.ndarray]) -> None:
    """Looks at all of a state before it goes into a simulation.

    Args:
        sim: of the same structure.
        record: what its host is to keep.
        fresh: the tables of `sim` by name, as they are.
        stored: those of the state.

    Raises:
        SandError: the state cannot be that of such a simulation; the text says why, and names no file.
    """
    for name in COUNTS:
        number(name, getattr(record, name), whole=True)
    steps, time = record.epoch
    number("epoch", steps, whole=True)
    number("epoch", time)
    check_bed(record.bed)
    check_numbers(record, stored)
    number("owed", abs(record.owed) / record.numbers["step"], most=MOST_OWED)
    for key, value in record.over.items():
        number(f"over {key}", abs(value))
        if not live.beyond(record.scene, key, value):
            raise SandError(f"{key} = {value:g} is not beyond what a scene may have")
    check_stages(record)
    for kind, moments in record.flagged.items():
        if kind not in map(str, SENTENCES) or not isinstance(moments, list) or len(moments) != 2:
            raise SandError(f"flagged {show(kind)} = {show(moments)} is no flag")
        for value in moments:
            number(f"flagged {kind}", value)
    if set(record.due) != set(sim.due):
        raise SandError("it says of other effects when they act")
    for name, due in record.due.items():
        number(f"due {name}", due, whole=True)
        if not record.steps <= due <= record.steps + trust.LATEST:
            raise SandError(f"due {name} = {due} does not fit its {record.steps} steps")
    trust.check(sim.world, record.scene, len(sim.sizes), dict(fresh), dict(stored))
    if steps > record.steps or record.steps != int(stored[".0.pace:done"]):
        raise SandError(f"steps = {record.steps} does not fit its tables")
    if len(sim.scene.grains) and int(stored[".0.grains.id"].max()) >= record.made:
        raise SandError(f"made = {record.made}, but there is a grain {stored['.0.grains.id'].max()}")


def check_stages(record: Host) -> None:
    """SandError unless what has come of events fits the scene, and is of the past."""
    scene, stages = record.scene, record.stages
    if len(stages.times) != len(scene.events) or len(stages.flows) != len(scene.sources):
        raise SandError("it says of other events or sources what has come of them")
    for time in (stages.began, stages.slow, *stages.times, *(since for since, _ in stages.flows)):
        if time is not None:
            number("time of a stage", time)
    for count in (stages.looks, *(before for _, before in stages.flows)):
        number("count of a stage", count, whole=True)
    for event in scene.events:
        if isinstance(event.at, After) and event.at.after not in names(scene.events):
            raise SandError(f"{event.at.after} is no event of it")


def number(name: str, value: Any, whole: bool = False, most: float = trust.HUGE) -> None:
    """SandError unless a value is a number, 0 or more, at most `most`, and small enough for a table of whole ones if it is to be whole."""
    kinds, most = (int, trust.LARGEST) if whole else ((int, float), most)
    if isinstance(value, bool) or not isinstance(value, kinds) or not 0 <= value <= most:
        raise SandError(f"{name} = {show(value)} is no number that it can be")


def check_bed(bed: Bed) -> None:
    """SandError unless all of a bed is of its kind."""
    for field in fields(bed):
        value = getattr(bed, field.name)
        if field.type is bool or isinstance(field.default, bool):
            if not isinstance(value, bool):
                raise SandError(f"bed.{field.name} = {show(value)} must be true or false")
        elif isinstance(field.default, tuple):
            if len(value) > PAUSE:
                raise SandError(f"bed.{field.name} holds {len(value)} numbers, at most {PAUSE} are kept")
            for one in value:
                number(f"bed.{field.name}", one)
        else:
            number(f"bed.{field.name}", value, whole=field.type is int, most=math.inf if field.default == math.inf else trust.HUGE)


def check_numbers(record: Host, stored: Mapping[str, np.ndarray]) -> None:
    """SandError unless the numbers of the solver are those that follow from the scene and the bed, and tables go by them."""
    asked = choose(record.scene.solver.kind).numbers(record.scene, record.bed)
    if set(asked) != set(record.numbers):
        raise SandError("numbers of the solver are missing, or others are there")
    for name, value in record.numbers.items():
        number(f"numbers.{name}", value, most=math.inf)
        if not math.isclose(value, asked[name], rel_tol=EQUAL, abs_tol=1e-30):
            raise SandError(f"numbers.{name} = {value:g}, but {asked[name]:g} follows from its scene")
    for name in PACE:
        kept = float(stored[f".0.pace:{name}"])
        if not math.isclose(kept, record.numbers[name], rel_tol=EQUAL, abs_tol=1e-30):
            raise SandError(f"pace:{name} is {kept:g}, but {record.numbers[name]:g} follows from its scene")
