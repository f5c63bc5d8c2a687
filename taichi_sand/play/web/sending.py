"""What a page is sent: itself, and the bytes of every frame."""

from typing import Any

import numpy as np

from taichi_sand.play.session import Session
from taichi_sand.view.planes import State, message, scene_of
from taichi_sand.view.style import DATA, in_page, page, style
from taichi_sand.world.extras.hand import GRAB


def live_page() -> bytes:
    """The page as the server sends it."""
    before, after = page()
    head = f'<script type="application/json" id="head">{in_page({"kind": "live", "style": style()})}</script>\n'
    return f"{before}{head}{after}".replace("<!-- TITLE -->", "taichi_sand").replace(DATA, "").encode()


def frame(session: Session, state: State, roster: int) -> bytes:
    """A frame for those who have the roster of this number: six bytes a disc, and what else there is to draw."""
    head: dict[str, Any] = {"kind": "frame", "roster": roster, "time": state.time, "grains": session.sim.count, "tops": state.tops}
    head |= {"scene": scene_of(session.sim), "look": session.look}
    if session.look["grid"]:
        grid = session.sim.world.grid
        head["grid"] = [int(grid.columns[None]), int(grid.rows[None])]
    if session.stroke is not None:
        now = session.sim.hand.now[None]
        head |= {"path": np.array(session.stroke.path).tolist(), "held": int(now.grain) if now.work == GRAB else None}
    planes = [("x", state.x), ("y", state.y), ("angle", state.angle), ("walls", state.walls)]
    if state.flags.any():
        planes.append(("flags", state.flags))
    planes += [(f"shade {name}", values) for name, values in state.shades.items()]
    if state.bonds is not None:
        planes.append(("bonds", state.bonds))
    if state.chains is not None:
        planes += [(f"chain {name}", values) for name, values in state.chains.items()]
    if state.water is not None:
        head["water"] = [state.water["columns"], state.water["rows"]]
        planes += [(f"water {name}", state.water[name]) for name in ("level", "foam", "shade")]
    return message(head, planes)
