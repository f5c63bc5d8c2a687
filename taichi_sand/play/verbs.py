"""What can be done in a session, by verb."""

import base64
import re
from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.play import calls, transfer
from taichi_sand.play.chapter import Chapter
from taichi_sand.play.snapshot import from_bytes
from taichi_sand.play.stroke import Stroke
from taichi_sand.play.tools import TOOLS, check_need
from taichi_sand.run import live
from taichi_sand.scene.schema import Scene
from taichi_sand.view.views import check_view

COLOUR = re.compile("#[0-9a-fA-F]{6}")


def _set(session: Any, key: str, value: float) -> None:
    knob = next((k for k in session.knobs() if k.key == key), None)
    if knob is None:
        raise SandError(f"there is nothing called {key} to be changed here")
    value = knob.bounded(float(value), session.opened)
    if key == "time":
        session.speed = value
    elif key.startswith("tool."):
        setattr(session.brush, key[5:], value)
    else:
        before = session.value(key)
        session.sim.set(key, value, unphysical=session.opened)
        if knob.physical(before) and not knob.physical(value):
            session.physical[key] = before


def _default(session: Any, key: str) -> None:
    """Back to what the scene says."""
    knob = next((k for k in session.knobs() if k.key == key), None)
    if knob is not None and knob.home is not None:
        _set(session, key, knob.home)


def _mark(session: Any) -> None:
    session.history.keep(session.moment())


def _undo(session: Any) -> None:
    moment = session.history.back(session.moment()) if session.history.past else None
    if moment is None:
        raise SandError("there is nothing to undo")
    session.go_to(moment)


def _redo(session: Any) -> None:
    moment = session.history.forth(session.moment()) if session.history.future else None
    if moment is None:
        raise SandError("there is nothing to do again")
    session.go_to(moment)


def _reset(session: Any) -> None:
    _mark(session)
    session.go_to(session.chapter.start)


def _solver(session: Any, kind: str) -> None:
    scene = session.sim.scene
    if kind == scene.solver.kind:
        return
    session.become(transfer.with_solver(scene, kind, session.home))


def _effect(session: Any, name: str, on: bool) -> None:
    from taichi_sand import effects

    scene = session.sim.scene
    tables = {key: value for key, value in scene.effects.items() if key != name}
    if on:
        tables[name] = session.home.effects.get(name, {})
    new = scene.model_copy(update={"effects": tables})
    effects.check(new)
    session.become(new)


def _rewinding(session: Any, on: bool) -> None:
    session.rewind.switch(on)
    if on:
        _snap(session)


def _snap(session: Any) -> None:
    session.rewind.keep(session.sim.time, session.moment(session.rewind.last()))


def _back(session: Any, time: float) -> None:
    """To the kept moment that is nearest to a time; that can be undone."""
    _end(session)
    before, moment = session.moment(), session.rewind.back(time)
    if moment is None:
        raise SandError("no moments are kept to go back to; switch on rewind first")
    session.go_to(moment)
    session.history.keep(before)


def _look(session: Any, key: str, value: Any) -> None:
    if key == "color":
        check_view(value, session.sim.world)
    if key in ("cold", "hot") and not COLOUR.fullmatch(value):
        raise SandError(f"{key} = {value[:20]!r} is no colour; it reads #RRGGBB")
    session.look[key] = value


def _open_ranges(session: Any, on: bool) -> None:
    session.opened = on
    if not on and session.sim.over:
        _mark(session)
        for key in list(session.sim.over):
            session.sim.set(key, session.physical.get(key, live.read(session.sim.scene, key)))
        session.physical.clear()


def _choose(session: Any, tool: str) -> None:
    _end(session)
    session.tool = tool


def _end(session: Any) -> None:
    stroke, session.stroke = session.stroke, None
    if stroke:
        stroke.end()


def _stroke(session: Any, phase: str, x: float, y: float, vx: float = 0.0, vy: float = 0.0, other: bool = False) -> None:
    """A stroke ends with its release, and before if its tool refuses, whatever that raises."""
    if phase == "press":
        _end(session)
        tool = TOOLS[session.tool]
        tool = TOOLS[tool.inverse] if other and tool.inverse else tool
        check_need(session, tool)
        before = session.moment()
        session.stroke = Stroke(session, tool)
        _move(session, phase, x, y, vx, vy)
        session.history.keep(before)
    elif session.stroke:
        _move(session, phase, x, y, vx, vy)
    if phase == "release":
        _end(session)


def _move(session: Any, *motion: Any) -> None:
    """The hand moves; what it cannot do ends its stroke."""
    stroke = session.stroke
    try:
        stroke.move(*motion)
    except BaseException:
        session.stroke = None
        stroke.let_go()
        raise


def _kind(session: Any, step: int) -> None:
    session.brush.next_kind(session.sim, step)


def _open(session: Any, scene: str) -> None:
    new = Scene.from_json(scene)
    _end(session)
    session.open(new)


def _call(session: Any, name: str, given: dict[str, Any]) -> None:
    calls.call(session.sim, name, given)
    session.keep_built()


def _load(session: Any, data: str) -> None:
    """A checkpoint; one of another scene is gone on with as if that had been opened."""
    moment = from_bytes(base64.b64decode(data))
    before = session.moment()
    if not live.same_box(session.home, moment.host.scene):
        moment.chapter = Chapter(moment.host.scene)
    session.go_to(moment)
    session.history.keep(before)
    if moment.chapter is not None:
        moment.chapter.start = session.moment()


VERBS = {
    "set": _set, "default": _default, "mark": _mark, "undo": _undo, "redo": _redo, "reset": _reset, "solver": _solver, "effect": _effect,
    "look": _look, "opened": _open_ranges, "choose": _choose, "stroke": _stroke, "kind": _kind, "open": _open, "load": _load, "call": _call,
    "rewinding": _rewinding, "snap": _snap, "back": _back,
}  # fmt: skip
