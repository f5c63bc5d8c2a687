"""One frame of the window: the painter's picture, what is drawn over it, the panel beside it."""

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_sand.play import numbers
from taichi_sand.play.window import hud
from taichi_sand.play.window.overlay import Overlay
from taichi_sand.play.window.panel import WIDTH as PANEL_WIDTH
from taichi_sand.play.window.panel import Panel
from taichi_sand.play.window.sheet import DIM, IDLE, TEXT, Sheet
from taichi_sand.view import palette
from taichi_sand.view.caption import Caption, spaced
from taichi_sand.view.paint import Painter, picture_height
from taichi_sand.view.picture import SIDES, facts, wall_lines, water_of
from taichi_sand.world.extras.hand import GRAB

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

MOST_WIDTH, MOST_HEIGHT = 1080, 860
"""A picture that nobody gave a width is not larger than this [px], so that the window fits a screen."""
LEAST_TEXT = 0.92
"""Size of the caption's text below which it is hard to read on a screen, over that in a picture 720 px wide."""
MARGIN = 8
LEAST_HEIGHT = 840
"""Height of a window [px] below which the panel would be cramped."""


def picture_width(session: "Session", asked: int | None) -> int:
    """Width of the picture [px]: what was asked, or the scene's, made to fit a screen."""
    width, height = session.sim.scene.size
    return asked or int(min(MOST_WIDTH, MOST_HEIGHT * width / height))


class Screen:
    """Paints frames for one window; `canvas` is what the window shows, u32, flat, rows from the top."""

    def __init__(self, session: "Session", width: int) -> None:
        self.session = session
        self.picture = (width, picture_height(session.sim.scene.size, width))
        self.size = (width + PANEL_WIDTH, max(self.picture[1], LEAST_HEIGHT))
        self.top = (self.size[1] - self.picture[1]) // 2
        self.panel = Panel(self.size[1])
        self.painter: Painter = None  # type: ignore[assignment]  # `ready` makes it
        self.lines: list = []
        self.stages: dict[str, float] = {}
        self.help = False

    def place(self, x: float, y: float) -> tuple[float, float]:
        """The point of the world [m] under a pixel of the window."""
        return x / self.painter.scale, (self.picture[1] - (y - self.top)) / self.painter.scale

    def ready(self) -> None:
        """A painter for the world there is now, that paints as the session looks."""
        session, look = self.session, self.session.look
        sim, scene = session.sim, session.sim.scene
        if self.painter is None or self.painter.world is not sim.world:
            edges = [getattr(scene.edges, side) == "wall" for side in SIDES]
            kinds = max(1, len(scene.grains) + len(scene.sources))
            self.painter = Painter(sim.world, scene.size, self.picture[0], edges=edges, kinds=kinds)
            self.painter.water = water_of(sim)
            self.caption = Caption(*self.picture, self.painter.scale, LEAST_TEXT)
            self.overlay = Overlay(self.painter)
        painter = self.painter
        painter.color, painter.force_chains, painter.walls = look["color"], look["chains"], wall_lines(sim)
        painter.sleepers, painter.bonds, painter.dimmed = look["asleep"], look["bonds"], look["forces"]
        painter.set_energy_colours(look["cold"], look["hot"])

    def paint(self, canvas: np.ndarray, measured: dict[str, Any], cursor: tuple[float, float] | None, told: str) -> np.ndarray:
        """Paints all but the panel; `cursor` is in metres. Returns the picture alone, as films have it."""
        self.ready()
        session, look = self.session, self.session.look
        start = time.perf_counter()
        picture = self.painter.paint(session.sim.time)
        self._overlays(picture, session.sim.time, look)
        self.caption.draw(picture, session.sim.scene.title, facts(session.sim), self.painter.legend)
        painted = time.perf_counter()
        self.stages["paint"] = painted - start
        self._blit(canvas, picture)
        sheet = hud.notices(session, self.picture[0], self.size[1], told)
        if look["hud"] and self.lines:
            down = self._down()
            sheet.tiles = [(x, y + down, tile) for x, y, tile in self.lines] + sheet.tiles
        if cursor is not None:
            self._cursor(canvas, cursor)
        sheet.paint(canvas, *self.size)
        if self.help:
            hud.help_sheet(*self.size).paint(canvas, *self.size)
        self.stages["hud"] = time.perf_counter() - painted
        return picture

    def paint_panel(self, canvas: np.ndarray, measured: dict[str, Any]) -> None:
        """Paints the panel, and composes the numbers over the picture."""
        self.panel.paint(canvas, *self.size, self.session, measured)
        self.lines = hud.compose(numbers.lines(self.session, measured), self.picture[0]) if measured else []

    def _down(self) -> int:
        """How far down the numbers go [px]: above the picture if there is room, else into it, below its caption."""
        first, last = self.lines[0][1], max(y + tile.shape[0] for _, y, tile in self.lines)
        return MARGIN - first if last - first + 2 * MARGIN < self.top else self.top

    def message(self, canvas: np.ndarray, text: str) -> None:
        """A sentence over everything, for what takes a while."""
        sheet = Sheet()
        hud.badge(sheet, text, self.picture[0] / 2, self.size[1] / 2 - 13, IDLE)
        sheet.paint(canvas, *self.size)

    def _blit(self, canvas: np.ndarray, picture: np.ndarray) -> None:
        width, height = self.picture
        whole = canvas.reshape(self.size[1], self.size[0])
        if self.size[1] > height:
            ground = palette.packed(palette.GROUND)
            whole[: self.top, :width] = ground
            whole[self.top + height :, :width] = ground
        whole[self.top : self.top + height, :width] = picture.reshape(height, width)

    def _overlays(self, picture: np.ndarray, now: float, look: dict[str, Any]) -> None:
        if look["grid"]:
            self.overlay.grid(picture)
        if look["velocities"]:
            self.overlay.velocities(picture, now)
        if look["forces"]:
            self.overlay.contacts(picture, now)

    def _cursor(self, canvas: np.ndarray, cursor: tuple[float, float]) -> None:
        """The outline of the brush, and the string of the grain that is held; over the picture, not in films."""
        session, width, height = self.session, *self.picture
        rows = canvas.reshape(self.size[1], self.size[0])[self.top : self.top + height, :width]
        part = np.ascontiguousarray(rows).reshape(-1)
        stroke = session.stroke
        self.overlay.brush(part, *cursor, session.brush.size, "#F2A65A" if stroke else DIM)
        if stroke:
            path = [*stroke.path, np.array(cursor)]
            self.overlay.path(part, np.array(path))
            now = session.sim.hand.now[None]
            if now.work == GRAB:
                self.overlay.string(part, now.grain, *cursor)
        name = stroke.tool.name if stroke else session.tool
        sheet = Sheet()
        at_x, at_y = cursor[0] * self.painter.scale, height - cursor[1] * self.painter.scale
        sheet.plate(at_x + 9, at_y - 24, spaced(name, 11)[1] + 10, 18, palette.GROUND, 4, 0.72)
        sheet.text(at_x + 14, at_y - 22, name, 11, TEXT)
        sheet.paint(part, width, height)
        rows[:] = part.reshape(height, width)
