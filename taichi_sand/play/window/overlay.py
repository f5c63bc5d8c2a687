"""What is drawn over the grains: arrows of velocity and force, the grid, the outline of the brush."""

from typing import Any

import numpy as np

from taichi_sand.play.knobs import nice
from taichi_sand.play.window.sheet import ACCENT, TEXT
from taichi_sand.view import kernels, palette, placing
from taichi_sand.view.paint import LINES_PER_GRAIN, Painter
from taichi_sand.view.text import number_text
from taichi_sand.view.views import PERCENTILE, quantile
from taichi_sand.world import edit

ARROW = 2.0
"""Length of the longest arrow, in mean diameters."""
LEAST = 14.0
"""Least length of the longest arrow, in pixels."""
FORCE_SHARE = 0.6
"""Length of the longest arrow of a force over that of a velocity."""
HEAD = 0.35
"""Length of an arrow's head over its own."""
RING = 48
"""Corners of a circle."""
VELOCITY, FORCE, GRID = "#6FC3FF", "#FF9A3C", "#343A44"


class Ruler:
    """What the longest arrow stands for: a round number that stays while arrows of it can be seen and none is longer than a half more."""

    def __init__(self) -> None:
        self.top = 0.0

    def follow(self, value: float) -> float:
        """The number, where the data reach up to `value`."""
        if value > 0 and not 0.2 * self.top <= value <= 1.5 * self.top:
            self.top = nice(value)
        return self.top or 1.0


class Overlay:
    """Draws over the pictures of one painter."""

    def __init__(self, painter: Painter) -> None:
        self.painter, self.world = painter, painter.world
        self.speeds, self.forces = Ruler(), Ruler()

    @property
    def reach(self) -> float:
        """Length of the longest arrow [px]."""
        return max(LEAST, ARROW * float(self.world.box[None].diameter) * self.painter.scale)

    def paint(self, canvas: np.ndarray, look: dict[str, Any]) -> list[tuple[str, float, str]]:
        """What of it is switched on; returns the colour, length [px] and meaning of an arrow of each sort."""
        legends = []
        if look["grid"]:
            self.grid(canvas)
        if look["velocities"]:
            legends.append((VELOCITY, self.reach, f"{number_text(self.velocities(canvas))} m/s"))
        if look["forces"]:
            legends.append((FORCE, FORCE_SHARE * self.reach, f"{number_text(self.contacts(canvas))} N"))
        return legends

    def lines(self, canvas: np.ndarray, lines: np.ndarray, width: float, colour: str) -> None:
        """Lines (n, 4): x, y, x, y [px], y down."""
        if len(lines):
            count = len(lines)
            thickness = np.full(count, width, np.float32)
            colours = np.full(count, palette.packed(colour), np.uint32)
            p = self.painter
            kernels.paint_lines(canvas, p.width, p.height, np.ascontiguousarray(lines, np.float32), thickness, colours)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Points [m] (n, 2) in pixels."""
        return self.painter.camera.pixels(points, self.painter.height)

    def velocities(self, canvas: np.ndarray) -> float:
        """An arrow for the velocity of every grain; returns the speed of the longest [m/s]."""
        world = self.world
        places, whole = edit.places(world)
        velocity = world.grains.twist.to_numpy()[: len(places), :2].astype(float)
        speed = np.hypot(*velocity.T)
        top = self.speeds.follow(quantile(speed, PERCENTILE))
        shown = (speed > 0.03 * top) & (whole[:, 2] == 0)
        way = velocity[shown] * [1, -1] * (self.reach / max(top, 1e-30))
        size = np.maximum(np.hypot(*way.T), 1e-9)
        way *= (np.minimum(size, 1.5 * self.reach) / size)[:, None]
        self.lines(canvas, arrows(self.pixels(places[shown, :2]), way), 1.2, VELOCITY)
        return top

    def contacts(self, canvas: np.ndarray) -> float:
        """Two arrows for every contact that pushes, apart from the contact, their length by the normal force; returns that of the longest
        [N].
        """
        p = self.painter
        lines = np.zeros((LINES_PER_GRAIN * self.world.capacity, 4), np.float32)
        sizes = np.zeros(len(lines), np.float32)
        found = placing.place_forces(self.world, p.scale, *p.box[:2], p.height, lines, sizes)
        lines, sizes = lines[:found].astype(float), sizes[:found]
        top = self.forces.follow(quantile(sizes, PERCENTILE))
        middle, way = 0.5 * (lines[:, :2] + lines[:, 2:]), lines[:, 2:] - lines[:, :2]
        length = np.maximum(np.hypot(*way.T), 1e-9)
        way *= (FORCE_SHARE * self.reach * np.minimum(1.0, sizes / max(top, 1e-30)) / length)[:, None]
        seen = np.hypot(*way.T) > 1.0
        self.lines(canvas, np.concatenate([arrows(middle[seen], sign * way[seen]) for sign in (1, -1)]), 1.2, FORCE)
        return top

    def grid(self, canvas: np.ndarray) -> None:
        """The cells that the cell list sorted the grains into."""
        p, grid = self.painter, self.world.grid
        columns, rows = int(grid.columns[None]), int(grid.rows[None])
        left, low, wide, high = p.box
        right, bottom = wide - left, p.height + low
        x, y = np.linspace(-left, right, columns + 1), np.linspace(bottom - high, bottom, rows + 1)
        upright = np.stack([x, np.full_like(x, bottom - high), x, np.full_like(x, bottom)], axis=1)
        level = np.stack([np.full_like(y, -left), y, np.full_like(y, right), y], axis=1)
        self.lines(canvas, np.concatenate([upright, level]), 1.0, GRID)

    def edged(self, canvas: np.ndarray, points: np.ndarray, width: float, colour: str) -> None:
        """A line through points [m] (n, 2) with dark edges, so that it can be seen on sand too."""
        at = self.pixels(points)
        lines = np.concatenate([at[:-1], at[1:]], axis=1)
        self.lines(canvas, lines, width + 2.4, palette.GROUND)
        self.lines(canvas, lines, width, colour)

    def brush(self, canvas: np.ndarray, x: float, y: float, radius: float, colour: str = ACCENT) -> None:
        """A circle around (x, y) [m] of this radius [m]."""
        turn = np.linspace(0, 2 * np.pi, RING + 1)
        self.edged(canvas, np.stack([x + radius * np.cos(turn), y + radius * np.sin(turn)], axis=1), 1.4, colour)

    def path(self, canvas: np.ndarray, points: np.ndarray) -> None:
        """A line through points [m] (n, 2): the wall that is being drawn."""
        self.edged(canvas, points, 2.0, ACCENT)

    def string(self, canvas: np.ndarray, grain: int, x: float, y: float) -> None:
        """From a grain, by its id, to the hand."""
        places, whole = edit.places(self.world)
        held = np.flatnonzero(whole[:, 0] == grain)
        if len(held):
            self.edged(canvas, np.array([places[held[0], :2], [x, y]]), 1.4, TEXT)


def arrows(start: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Lines (3 n, 4) of arrows from `start` along `way`, both (n, 2): shafts and heads."""
    tip = start + way
    side = np.stack([-way[:, 1], way[:, 0]], axis=1)
    barbs = [tip - HEAD * way + sign * 0.5 * HEAD * side for sign in (1, -1)]
    return np.concatenate([np.concatenate([a, b], axis=1) for a, b in ((start, tip), (tip, barbs[0]), (tip, barbs[1]))])
