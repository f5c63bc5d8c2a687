"""What is drawn over the grains: arrows of velocity and force, the grid, the outline of the brush."""

import numpy as np

from taichi_sand.play.window.sheet import ACCENT, TEXT
from taichi_sand.view import kernels, palette
from taichi_sand.view.paint import LINES_PER_GRAIN, Painter
from taichi_sand.view.views import PERCENTILE, Range, quantile
from taichi_sand.world import edit

ARROW = 2.0
"""Length of the longest arrow, in mean diameters."""
LEAST = 14.0
"""Least length of the longest arrow, in pixels."""
HEAD = 0.35
"""Length of an arrow's head over its own."""
RING = 48
"""Corners of a circle."""
VELOCITY, FORCE, GRID = "#6FC3FF", "#FF9A3C", "#343A44"


class Overlay:
    """Draws over the pictures of one painter."""

    def __init__(self, painter: Painter) -> None:
        self.painter, self.world = painter, painter.world
        self.speeds, self.forces = Range(least=1e-2), Range()
        self.reach = max(LEAST, ARROW * float(self.world.box[None].diameter) * painter.scale)

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
        return np.stack([points[:, 0] * self.painter.scale, self.painter.height - points[:, 1] * self.painter.scale], axis=1)

    def velocities(self, canvas: np.ndarray, time: float) -> None:
        """An arrow for the velocity of every grain, its length over the 99th percentile of the speed."""
        world = self.world
        places, whole = edit.places(world)
        velocity = world.grains.twist.to_numpy()[: len(places), :2].astype(float)
        speed = np.hypot(*velocity.T)
        top = self.speeds.follow(quantile(speed, PERCENTILE), time)
        shown = (speed > 0.03 * top) & (whole[:, 2] == 0)
        way = velocity[shown] * [1, -1] * (self.reach / max(top, 1e-30))
        size = np.maximum(np.hypot(*way.T), 1e-9)
        way *= (np.minimum(size, 1.5 * self.reach) / size)[:, None]
        self.lines(canvas, arrows(self.pixels(places[shown, :2]), way), 1.2, VELOCITY)

    def contacts(self, canvas: np.ndarray, time: float) -> None:
        """Two arrows for every contact that pushes, apart from the contact, their length by the normal force."""
        p = self.painter
        lines = np.zeros((LINES_PER_GRAIN * self.world.capacity, 4), np.float32)
        sizes = np.zeros(len(lines), np.float32)
        found = kernels.place_forces(self.world, p.scale, p.height, lines, sizes)
        lines, sizes = lines[:found].astype(float), sizes[:found]
        top = self.forces.follow(quantile(sizes, PERCENTILE), time)
        middle, way = 0.5 * (lines[:, :2] + lines[:, 2:]), lines[:, 2:] - lines[:, :2]
        length = np.maximum(np.hypot(*way.T), 1e-9)
        way *= (0.6 * self.reach * np.minimum(1.0, sizes / max(top, 1e-30)) / length)[:, None]
        seen = np.hypot(*way.T) > 1.0
        self.lines(canvas, np.concatenate([arrows(middle[seen], sign * way[seen]) for sign in (1, -1)]), 1.2, FORCE)

    def grid(self, canvas: np.ndarray) -> None:
        """The cells that the cell list sorted the grains into."""
        p, grid = self.painter, self.world.grid
        columns, rows = int(grid.columns[None]), int(grid.rows[None])
        x, y = (np.linspace(0, side, count + 1) for side, count in ((p.width, columns), (p.height, rows)))
        upright = np.stack([x, np.zeros_like(x), x, np.full_like(x, p.height)], axis=1)
        level = np.stack([np.zeros_like(y), y, np.full_like(y, p.width), y], axis=1)
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
