"""What went wrong on the device, counted there and told in sentences."""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.taichi_support import field_pool

NOT_FINITE, TOO_FAST, ESCAPED, WALL_WAITS, SOURCE_FULL, NOWHERE, WATER_FULL = range(7)
NONE = 2**31 - 1

SENTENCES = {
    NOT_FINITE: "{count} times the motion of a grain, or a force on it, was no longer a number; first grain {grain} at {time:.4g} s: "
    "it was stopped. "
    "Take a smaller step or a softer contact.",
    TOO_FAST: "{count} times a grain was too fast to follow and was slowed to {cap:.3g} m/s; first grain {grain} at {time:.4g} s. "
    "A smaller step or tolerance raises the cap.",
    ESCAPED: "{count} times a grain was found outside a closed edge and put back; first grain {grain} at {time:.4g} s.",
    WALL_WAITS: "{count} steps long a moving wall was held up, first at {time:.4g} s: grains were jammed in its way. Give it a `force` "
    "that it pushes with at most, or less speed.",
    SOURCE_FULL: "{count} times a source found the table of grains full, first at {time:.4g} s, and made none: there is room for what the "
    "sources make within the scene's `duration`. A longer one gives more.",
    NOWHERE: "{count} grains were taken out, as their place was no longer a number; first grain {grain} at {time:.4g} s.",
    WATER_FULL: "{count} times water that was to well up found no room, first at {time:.4g} s, and did not: the box is "
    "full, or the table, which holds what [[water]] makes within the scene's `duration` and half a minute more.",
}


def allocate() -> Any:
    """Rows: kind of flag; columns: how often, least step, least grain id."""
    flags = field_pool.scalars(ti.i32, (len(SENTENCES), 3))
    reset(flags)
    return flags


def reset(flags: Any) -> None:
    """No flag raised."""
    flags.from_numpy(np.array([[0, NONE, NONE]] * len(SENTENCES), dtype=np.int32))


@ti.func
def flag(w: ti.template(), kind: ti.template(), grain_id):
    """Counts flag `kind`; keeps the first step and the least grain, so that the order of threads does not matter."""
    ti.atomic_add(w.flags[kind, 0], 1)
    ti.atomic_min(w.flags[kind, 1], w.pace[None].done)
    ti.atomic_min(w.flags[kind, 2], grain_id)


def raise_flag(world: Any, kind: int, number: int) -> None:
    """Raises flag `kind` for grain `number` from the host, between launches."""
    rows = world.flags.to_numpy()
    rows[kind] = rows[kind, 0] + 1, min(rows[kind, 1], world.pace[None].done), min(rows[kind, 2], number)
    world.flags.from_numpy(rows)


def note(flags: Any, noted: dict[str, list[float]], time_of: Callable[[int], float], cap: float) -> None:
    """Notes of every kind of flag that has been raised since the last call when that first was [s], and the speed cap there was [m/s]:
    `time_of` turns numbers of steps into times, as long as the step is the same.
    """
    rows = flags.to_numpy()
    for kind in np.flatnonzero(rows[:, 0]):
        noted.setdefault(str(kind), [time_of(int(rows[kind, 1])), cap])


def sentences(flags: Any, noted: dict[str, list[float]]) -> list[str]:
    """One sentence for each kind of flag raised, all of which have been noted."""
    rows = flags.to_numpy()
    return [
        text.format(count=rows[kind, 0], grain=rows[kind, 2], time=noted[str(kind)][0], cap=noted[str(kind)][1])
        for kind, text in SENTENCES.items()
        if rows[kind, 0]
    ]
