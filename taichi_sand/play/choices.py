"""What there is to choose from in a session, besides numbers, tools and views."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

SWITCHES = {
    "chains": "chains",
    "forces": "forces",
    "velocities": "velocities",
    "grid": "grid",
    "hud": "numbers",
    "asleep": "sleepers",
    "bonds": "bonds",
}
SWATCHES = {"cold": ("#2B5DA8", "#4FA3D1", "#1B7A6E", "#5E4BA8", "#343A44"), "hot": ("#F2542D", "#F2C14E", "#E85D9E", "#7BC47F", "#FFFFFF")}
"""Colours that the ends of the scale of energy can be given, besides those of the scene."""


def switches(session: "Session") -> list[tuple[str, str]]:
    """Parts of the picture that can be switched, and what they are called; those that there are."""
    there = {"asleep": session.sim.world.sleeps, "bonds": session.sim.world.linked}
    return [(key, text) for key, text in SWITCHES.items() if there.get(key, True)]


def swatches(session: "Session", end: str) -> list[str]:
    """Colours for one end of the scale of energy, `cold` or `hot`: that of the scene first."""
    return list(dict.fromkeys((getattr(session.home.view, end), *SWATCHES[end])))
