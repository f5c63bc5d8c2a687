"""What a window says of itself in its report."""

from typing import Any

from taichi_sand.play.window.parts import places
from taichi_sand.taichi_support.runtime import compiled


def state_of(window: Any) -> dict[str, Any]:
    """What a window shows at this moment, as JSON may hold it."""
    session, screen = window.session, window.screen
    return {
        **window.measured,
        "scene": window.name,
        "solver": session.sim.scene.solver.kind,
        "effects": list(session.sim.effects),
        "values": {knob.key: session.value(knob.key) for knob in session.knobs()},
        "unphysical": session.unphysical(),
        "walls": [wall.points for wall in session.sim.scene.walls],
        "tool": session.tool,
        "kind": session.brush.kind,
        "undo": len(session.history.past),
        "look": session.look,
        "help": screen.help,
        "said": session.message or window.controls.told,
        "compiled": compiled(),
        "hash": session.digest(),
        "window": screen.size,
        "picture": [screen.left, screen.top, *screen.picture],
        "camera": [screen.camera.x, screen.camera.y, screen.camera.scale],
        "badges": [badge.text for badge in window.badges],
        "offer": session.offer[0] if session.offer else "",
        "panel": [screen.wide, screen.panel.scrolled, screen.panel.full],
        "controls": places([*screen.panel.zones, *screen.zones]),
    }
