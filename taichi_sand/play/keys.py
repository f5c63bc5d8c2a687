"""The keys: one table from which keys are dispatched and the help on screen and the reference are written."""

from dataclasses import dataclass

from taichi_sand.play.tools import TOOLS


@dataclass(frozen=True)
class Key:
    """What a key does: a method of Controls."""

    key: str  # as ti.GUI names it
    help: str
    call: str
    arguments: tuple = ()
    group: str = "keys"

    @property
    def name(self) -> str:
        """How the key is called on screen."""
        return {" ": "space", "Escape": "esc", "Home": "home"}.get(self.key, self.key)


def _look(key: str, name: str, help: str) -> Key:
    return Key(key, help, "switch", (name,), "views")


KEYS = (
    *(Key(tool.key, f"{name}: {tool.help}", "choose", (name,), "tools") for name, tool in TOOLS.items()),
    Key("t", "next kind of grain for create and pour", "next_kind", (), "tools"),
    Key(" ", "pause, go on", "pause"),
    Key(".", "one step of the solver, while paused", "single_step"),
    Key(",", "one sixtieth of a second, while paused", "single_frame"),
    Key("r", "reset to the start", "reset"),
    Key("-", "slower", "faster", (0.5,)),
    Key("=", "faster", "faster", (2.0,)),
    Key("z", "undo the last stroke, change of a number, or of the scene", "undo"),
    Key("y", "do it again", "redo"),
    Key("m", "the other solver, on the grains as they are", "other_solver"),
    Key("u", "open the ranges of the sliders to unphysical values, and close them", "open_ranges"),
    Key("s", "quick save: a checkpoint", "save", (), "files"),
    Key("l", "quick load", "load", (), "files"),
    Key("p", "picture of the window, PNG", "picture", (), "files"),
    Key("f", "start and stop a film, MP4", "film", (), "files"),
    Key("[", "previous scene", "other_scene", (-1,), "files"),
    Key("]", "next scene", "other_scene", (1,), "files"),
    Key("v", "next colours: kind, speed, energy, …", "next_view", (), "views"),
    _look("c", "chains", "force chains"),
    _look("x", "forces", "contact forces as arrows"),
    _look("a", "velocities", "velocities as arrows"),
    _look("g", "grid", "cells of the cell list"),
    _look("b", "bonds", "bonds"),
    _look("n", "asleep", "sleeping grains fainter"),
    _look("i", "hud", "numbers over the picture"),
    Key("h", "this help", "help", (), "views"),
    Key("Home", "all of the box: the wheel zooms, the middle button moves", "fit", (), "keys"),
    Key("Escape", "close what is open; quit, when pressed twice", "quit", (), "files"),
)
BY_KEY = {key.key: key for key in KEYS}
GROUPS = ("tools", "keys", "views", "files")


def table() -> str:
    """The keys as a table in Markdown, for the reference."""
    rows = [f"| `{key.name}` | {key.help} |" for group in GROUPS for key in KEYS if key.group == group]
    return "\n".join(["| key | does |", "|---|---|", *rows])
