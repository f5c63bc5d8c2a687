"""A session in words for a page: what there is (`panel`, when that changes) and how it stands (`state`)."""

import base64
from functools import cache
from importlib import resources
from typing import Any

from taichi_sand import effects
from taichi_sand.play import choices, numbers
from taichi_sand.play.keys import KEYS
from taichi_sand.play.plots import PLOTS
from taichi_sand.play.session import Session
from taichi_sand.play.tools import TOOLS
from taichi_sand.scene import loading
from taichi_sand.view.planes import scene_of


def thumbnail(name: str) -> str:
    """A small picture of a scene as an address that holds it all; "" if there is none."""
    file = resources.files("taichi_sand.view") / "page" / "scenes" / f"{name}.webp"
    return f"data:image/webp;base64,{base64.b64encode(file.read_bytes()).decode()}" if file.is_file() else ""


@cache
def scenes() -> list[list[str]]:
    """Name, title, `about` and picture of every bundled scene."""
    heads = {name: loading.read(path) for name, path in loading.bundled().items()}
    return [[name, str(data.get("title", name)), str(data.get("about", "")), thumbnail(name)] for name, data in heads.items()]


@cache
def tables() -> dict[str, Any]:
    """Tools and keys, as every face has them."""
    tools = [
        {"name": name, "key": tool.key, "help": tool.help, "uses": [f"tool.{use}" for use in tool.uses]} for name, tool in TOOLS.items()
    ]
    plots = [{"name": name, "label": plot.label, "unit": plot.unit, "along": plot.along} for name, plot in PLOTS.items()]
    return {"tools": tools, "keys": [[key.key, key.name, key.help, key.group] for key in KEYS], "plots": plots}


def panel(session: Session) -> dict[str, Any]:
    """What there is to set: sliders, effects, views, switches."""
    scene = session.sim.scene
    knobs = [{"key": k.key, "label": k.label, "group": k.group, "unit": k.unit, "help": k.help} for k in session.knobs()]
    return {
        **tables(),
        "scene": scene_of(session.sim),
        "knobs": knobs,
        "effects": effects.fitting(scene.solver.kind),
        "switches": choices.switches(session),
        "swatches": {end: choices.swatches(session, end) for end in choices.SWATCHES},
    }


def state(session: Session, measured: dict[str, Any], said: str) -> dict[str, Any]:
    """How all that stands."""
    values = {}
    for knob in session.knobs():
        value = session.value(knob.key)
        values[knob.key] = [knob.share(value, session.opened), numbers.shown(knob, value), not knob.physical(value), value]
    return {
        "solver": session.sim.scene.solver.kind,
        "effects": list(session.sim.scene.effects),
        "values": values,
        "tool": session.tool,
        "kind": session.brush.kind,
        "size": session.brush.size,
        "look": session.look,
        "opened": session.opened,
        "unphysical": session.unphysical(),
        "undo": len(session.history.past),
        "redo": len(session.history.future),
        "accuracy": numbers.accuracy(session, measured),
        "lines": numbers.lines(session, measured) if measured else [],
        "time": measured.get("time"),
        "rewind": [round(time, 6) for time in session.rewind.times()] if session.rewind.on else None,
        "paused": measured.get("paused", False),
        "said": said,
        "offer": session.offer[0] if session.offer else "",
    }
