"""What can be plotted while it is played: numbers over time, and profiles of this moment. Each is measured only while it is shown."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand.measure import named, profiles

Measured = dict[str, Any]


@dataclass(frozen=True)
class Plot:
    """One plot. `of` is given the session, what is measured a few times a second, and what was measured the last time."""

    label: str
    unit: str
    of: Callable[[Any, Measured, Measured], Any]
    along: str = ""  # what a profile is drawn over; its `of` gives two lists


def _load(session: Any, now: Measured, before: Measured) -> float:
    weight = now["mass_kg"] * float(np.hypot(*session.sim.scene.gravity))
    return now["floor_force_N"] / weight if weight else float("nan")


def _flow(session: Any, now: Measured, before: Measured) -> float:
    """Through the ruler, if one lies there; else out of the box."""
    if session.watching.line is not None:
        return profiles.crossing(session.sim, session.watching.line)
    passed = now["time"] - before.get("time", now["time"])
    return (now["gone"] - before["gone"]) / passed if passed > 0 and "gone" in before else 0.0


PLOTS = {
    "kinetic": Plot("kinetic energy", "J", lambda session, now, before: now["kinetic_energy_J"]),
    "floor": Plot("force on the floor / weight", "", _load),
    "flow": Plot("flow by the ruler, or out", "grains/s", _flow),
    "order": Plot("order: mean |psi6|", "", lambda session, now, before: named.order(session.sim)),
    "repose": Plot("angle of repose of a heap", "degrees", lambda session, now, before: named.repose_angle(session.sim)),
    "energy": Plot("kinetic + potential energy", "J", lambda session, now, before: now["energy"]),
    "contacts": Plot("contacts a grain", "", lambda session, now, before: now["coordination"]),
    "overlap": Plot("overlap, 99th percentile", "d", lambda session, now, before: now["overlap_p99"]),
    "P(f)": Plot("log10 P(f), contact forces", "", lambda session, now, before: profiles.force_distribution(session.sim), "f / mean f"),
    "depth": Plot("vertical stress", "N/m", lambda session, now, before: profiles.stress_by_depth(session.sim), "depth / d"),
}
FIRST = ("kinetic", "floor")
"""Those that are shown until others are chosen: their numbers are measured anyway."""
