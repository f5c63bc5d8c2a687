"""Sleep: grains that rest cost nothing until something disturbs them.

A grain falls asleep when it and all around it, within a lattice site (about two grains) each way, have been slower than `speed` for
`time`. Sleepers stand still; no step and no list build touches them, and the contacts at their border keep their force. They wake, with
the sites around theirs, when a grain is about to hit them, when the forces on them no longer balance (a neighbour pushes harder, or
has gone), when a wall that moves comes near, when grains come or go by hand, when their liquid bridges dry or drown, and with any
change of gravity or of a parameter. Grains of several discs sleep as discs do. Speeds are in sqrt(g d), d the mean diameter.
"""

from dataclasses import dataclass
from typing import ClassVar

from taichi_sand.effects.base import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.sleep import state


@dataclass(frozen=True)
class Sleeping(Effect):
    """The effect: it looks who is still and who is out of balance; the march then rearranges the grains."""

    parameters = (
        Parameter("speed", 1e-3, "below it a grain is still", "sqrt(g d)", low=0.0, high=0.1),
        Parameter("time", 0.5, "how long a grain and all around it must be still", "s", low=0.0, high=1e3),
        Parameter("share", 0.3, "imbalance of the forces on a sleeper that wakes it, over weight and contact forces", low=0.0, high=10.0),
        Parameter("impact", 0.3, "approach of a grain that wakes a sleeper before it is hit", "sqrt(g d)", low=0.0, high=1e3),
    )
    neutral: ClassVar = {"speed": 0.0}
    sleeps = True
    interval = 1 / 60

    on_step = staticmethod(state.on_step)  # type: ignore[assignment]
