"""One frame of the window: the painter's picture, what is drawn over it, the panel beside it."""

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_sand.play import numbers
from taichi_sand.play.window import hud
from taichi_sand.play.window.arrange import arrange
from taichi_sand.play.window.overlay import Overlay
from taichi_sand.play.window.panel import Panel
from taichi_sand.play.window.parts import Zone
from taichi_sand.play.window.shape import Shape
from taichi_sand.play.window.sheet import DIM, TEXT, Sheet, Type
from taichi_sand.view import palette
from taichi_sand.view.camera import Camera
from taichi_sand.view.caption import Caption
from taichi_sand.view.paint import Painter
from taichi_sand.view.picture import SIDES, facts, wall_lines, water_of
from taichi_sand.view.text import LINE_SIZE, spaced
from taichi_sand.world.extras.hand import GRAB

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

ZOOM = 1.25
"""The picture grows by this factor a notch."""


class Screen:
    """Paints frames for one window; `canvas` is what the window shows, u32, flat, rows from the top.

    text: size of its text [px]; None: as in a film.
    """

    def __init__(self, session: "Session", shape: Shape, text: int | None = None) -> None:
        self.session, self.chapter, self.text = session, session.chapter, text
        box = session.sim.scene.size
        self.picture, self.size, self.wide, self.left, self.top = shape.picture, shape.size, shape.wide, shape.left, shape.top
        self.type = Type.of(text) if text else Type.of()
        self.panel = Panel(shape.panel, shape.high, self.type)
        self.painter: Painter = None  # type: ignore[assignment]  # `ready` makes it
        self.home = Camera.shown(None, box, self.picture)
        self.camera = Camera.shown(session.home.view.window, box, self.picture)
        self.numbers: hud.Numbers | None = None
        self.zones: list[Zone] = []  # over the picture
        self.stages: dict[str, float] = {}
        self.help = False

    # the camera

    def place(self, x: float, y: float) -> tuple[float, float]:
        """The point of the world [m] under a pixel of the window."""
        return self.camera.place(x - self.left, y - self.top, self.picture[1])

    def shows(self, x: float, y: float) -> bool:
        """Whether a pixel of the window is one of the picture."""
        return 0 <= x - self.left < self.picture[0] and 0 <= y - self.top < self.picture[1]

    def look(self, camera: Camera) -> None:
        """Shows another part of the box, or the nearest that there is."""
        self.camera = camera.within(self.session.sim.scene.size, self.picture, self.home.scale)

    def zoom(self, notches: int, x: float, y: float) -> None:
        """Nearer, or farther away, at a pixel of the window."""
        self.look(self.camera.zoomed(ZOOM**notches, self.place(x, y)))

    def pan(self, x: float, y: float) -> None:
        """Moves what is shown by so many pixels."""
        self.look(self.camera.moved(-x / self.camera.scale, y / self.camera.scale))

    # painting

    def ready(self) -> None:
        """A painter for the world there is now, that paints as the session looks."""
        session, look = self.session, self.session.look
        sim, scene = session.sim, session.sim.scene
        if self.painter is None or self.painter.world is not sim.world:
            edges = [getattr(scene.edges, side) == "wall" for side in SIDES]
            kinds = max(1, len(scene.grains) + len(scene.sources))
            self.painter = Painter(sim.world, scene.size, self.picture[0], edges=edges, kinds=kinds, ground=scene.view.ground)
            self.painter.water = water_of(sim)
            self.caption = Caption(*self.picture, self.painter.scale, self.text / LINE_SIZE if self.text else None, scene.view.ground)
            self.overlay = Overlay(self.painter)
        painter = self.painter
        if painter.camera != self.camera:
            painter.look_at(self.camera)
            self.caption.rescale(self.camera.scale)
        painter.color, painter.force_chains, painter.walls = look["color"], look["chains"], wall_lines(sim)
        painter.sleepers, painter.bonds, painter.dimmed = look["asleep"], look["bonds"], look["forces"]
        painter.set_energy_colours(look["cold"], look["hot"])

    def paint_picture(self) -> tuple[np.ndarray, int]:
        """The picture alone, as films have it, u32, flat; and where its caption ends [px]."""
        self.ready()
        session, look = self.session, self.session.look
        picture = self.painter.paint(session.sim.time)
        arrows = self.overlay.paint(picture, look)
        return picture, self.caption.draw(picture, session.sim.scene.title, facts(session.sim), self.painter.legend, arrows)

    def film_frame(self) -> np.ndarray:
        """The picture alone, (height, width, 3) uint8."""
        picture, _ = self.paint_picture()
        return self.painter.rgb(picture)

    def paint(
        self, canvas: np.ndarray, shown: list[hud.Badge], cursor: tuple[float, float] | None, told: str, offer: str = ""
    ) -> np.ndarray:
        """Paints all but the panel; `cursor` is in metres. Returns the picture alone, as films have it."""
        start = time.perf_counter()
        picture, caption = self.paint_picture()
        painted = time.perf_counter()
        self.stages["paint"] = painted - start
        self._blit(canvas, picture)
        notices = hud.Notices(shown, told, offer, self.wide, self.size[1], self.type)
        self.zones = notices.zones
        sheet = Sheet()
        if self.session.look["hud"] and self.numbers:
            ends = self.top, self.top + self.picture[1]
            begin, room = arrange(self.size[1], ends, self.top + caption, self.numbers.height, notices.top)
            sheet.tiles += self.numbers.tiles(0, begin, room)
        sheet.tiles += notices.sheet.tiles
        if cursor is not None:
            self._cursor(canvas, cursor)
        sheet.paint(canvas, *self.size)
        if self.help:
            hud.help_sheet(*self.size, self.type).paint(canvas, *self.size)
        self.stages["hud"] = time.perf_counter() - painted
        return picture

    def paint_panel(self, canvas: np.ndarray, measured: dict[str, Any]) -> None:
        """Paints the panel, and composes the numbers over the picture."""
        self.panel.paint(canvas, *self.size, self.session, measured)
        self.numbers = hud.Numbers(numbers.lines(self.session, measured), self.wide, self.type) if measured else None

    def paint_tip(self, canvas: np.ndarray, zone: Zone) -> None:
        """What the control under the mouse does."""
        hud.tooltip(zone, self.wide, self.size[1], self.type).paint(canvas, *self.size)

    def _blit(self, canvas: np.ndarray, picture: np.ndarray) -> None:
        width, height = self.picture
        whole = canvas.reshape(self.size[1], self.size[0])
        if (self.wide, self.size[1]) != self.picture:
            whole[:, : self.wide] = palette.packed(palette.GROUND)
        whole[self.top : self.top + height, self.left : self.left + width] = picture.reshape(height, width)

    def _cursor(self, canvas: np.ndarray, cursor: tuple[float, float]) -> None:
        """The outline of the brush, and the string of the grain that is held; over the picture, not in films."""
        session, width, height = self.session, *self.picture
        rows = canvas.reshape(self.size[1], self.size[0])[self.top : self.top + height, self.left : self.left + width]
        part = np.ascontiguousarray(rows).reshape(-1)
        stroke = session.stroke
        self.overlay.brush(part, *cursor, session.brush.size, "#F2A65A" if stroke else DIM)
        if stroke:
            path = [*stroke.path, np.array(cursor)]
            self.overlay.path(part, np.array(path))
            now = session.sim.hand.now[None]
            if now.work == GRAB:
                self.overlay.string(part, now.grain, *cursor)
        name, size = stroke.tool.name if stroke else session.tool, self.type.text
        sheet = Sheet()
        (at_x, at_y), wide = self.overlay.pixels(np.array([cursor]))[0], spaced(name, size)[1] + 10
        at_x, at_y = min(at_x + 9, width - wide), max(2, at_y - size - 13)
        sheet.plate(at_x, at_y, wide, size + 7, palette.GROUND, 4, 0.72)
        sheet.text(at_x + 5, at_y + 2, name, size, TEXT)
        sheet.paint(part, width, height)
        rows[:] = part.reshape(height, width)
