"""The picture of a simulation, as its scene wants it: what `sim.image()` gives and a film is made of."""

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from taichi_sand.taichi_support.turns import turn
from taichi_sand.view.caption import Caption
from taichi_sand.view.paint import Painter
from taichi_sand.world.walls.build import wall_segments

SIDES = ("left", "right", "bottom", "top")
_painters: WeakKeyDictionary[Any, Painter] = WeakKeyDictionary()


def image(sim: Any) -> np.ndarray:
    """This moment as an image, (height, width, 3) uint8, row 0 at the top; with a caption if the scene wants one."""
    with turn:
        painter = painter_of(sim)
        painter.walls = wall_lines(sim)
        canvas = painter.paint(sim.time)
        if sim.scene.view.caption:
            caption = Caption(painter.width, painter.height, painter.scale, ground=sim.scene.view.ground)
            caption.draw(canvas, sim.scene.title, facts(sim), painter.legend)
        return painter.rgb(canvas)


def painter_of(sim: Any) -> Painter:
    """The painter of a simulation: made once, as the scene's [view] says."""
    painter = _painters.get(sim)
    if painter is None or painter.world is not sim.world:
        scene, view = sim.scene, sim.scene.view
        painter = _painters[sim] = Painter(
            sim.world,
            scene.size,
            view.width,
            color=view.color,
            force_chains=view.force_chains,
            cold=view.cold,
            hot=view.hot,
            edges=[getattr(scene.edges, side) == "wall" for side in SIDES],
            kinds=max(1, len(scene.grains) + len(scene.sources)),
            window=view.window,
            ground=view.ground,
        )
        painter.water = water_of(sim)
    return painter


def water_of(sim: Any) -> Any:
    """What paints the water of a simulation, or None; nothing is imported for that without any."""
    if "water" not in sim.scene.effects:
        return None
    from taichi_sand.view.water import pool_of

    return pool_of(sim)


def facts(sim: Any) -> list[str]:
    """What the caption says of this moment: time, the event that came last, grains, how it is computed."""
    grains, solver = sim.count, sim.scene.solver
    come = sorted(sim.events.items(), key=lambda event: event[1])[-1:]
    return [
        f"t = {sim.time:.2f} s",
        *(f"{name} at {time:.2f} s" for name, time in come),
        f"{grains} grain{'' if grains == 1 else 's'}",
        f"{solver.kind}, tolerance {solver.tolerance:g} d",
    ]


def wall_lines(sim: Any) -> np.ndarray:
    """Walls and their images where they are now, as straight parts: x, y of one end, x, y of the other [m]; shape (n, 4)."""
    return wall_segments(sim.world, sim.scene).reshape(-1, 4)
