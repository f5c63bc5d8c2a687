"""The panel beside the picture, in the order of use: tools, view, material, solver."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_sand import effects
from taichi_sand.play import choices, numbers
from taichi_sand.play.tools import TOOLS
from taichi_sand.play.window.parts import Column, Zone
from taichi_sand.play.window.sheet import DIM, HOVER, IDLE, PANEL, TONES, Type
from taichi_sand.view.paint import kind_colour
from taichi_sand.view.views import views_of

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

PAD, SCROLL_WIDTH = 14, 6
SCROLL = "scroll bar"


class Panel:
    """Lays the controls out, paints them, and says what lies under the mouse. Coordinates are those of the window, y down."""

    def __init__(self, width: int, height: int, type: Type) -> None:
        self.width, self.height, self.type = width, height, type
        self.scrolled = 0
        self.full = height  # height of all controls
        self.zones: list[Zone] = []
        self.hovered = self.pressed = ""  # names of zones
        self.typed: tuple[str, str] | None = None  # the key of a slider for which a value is being typed, and the text so far

    def scroll(self, pixels: int) -> None:
        """Moves the controls up, as far as there are any."""
        self.scrolled = max(0, min(self.full - self.height, self.scrolled + pixels))

    def scroll_to(self, y: float) -> None:
        """The middle of the scroll bar goes to this height."""
        self.scroll(round(y / self.height * self.full - self.height / 2) - self.scrolled)

    def under(self, x: float, y: float) -> Zone | None:
        """The zone at a point."""
        return next((zone for zone in self.zones if zone.holds(x, y)), None)

    def paint(self, canvas: np.ndarray, width: int, height: int, session: "Session", measured: dict[str, Any]) -> None:
        """Paints the panel along the right edge of a canvas of the whole window."""
        canvas.reshape(height, width)[:, width - self.width :] = int(PANEL[1:], 16)
        column = self.compose(width, session, measured)
        column.paint(canvas, width, height)

    def compose(self, width: int, session: "Session", measured: dict[str, Any]) -> Column:
        """All controls of a window so wide, as they lie now."""
        inner = self.width - 2 * PAD
        self.scrolled = max(0, min(self.full - self.height, self.scrolled))
        left, top = width - self.width + PAD, PAD - self.scrolled
        column = Column(left, top, inner, self.type, self.hovered, self.pressed, self.typed)
        for group in (self._tools, self._view, self._material, self._solver):
            group(column, session, measured)
        self.full = round(column.y + self.scrolled + PAD)
        if self.full > self.height:
            self._scroll_bar(column, width)
        self.zones = column.zones
        return column

    def _scroll_bar(self, column: Column, width: int) -> None:
        high = self.height**2 / self.full
        colour = HOVER if SCROLL in (self.hovered, self.pressed) else IDLE
        x = width - SCROLL_WIDTH - 3
        column.sheet.plate(x, self.scrolled / self.full * self.height, SCROLL_WIDTH, high, colour, SCROLL_WIDTH // 2)
        column.zones.insert(0, Zone(x - 3, 0, SCROLL_WIDTH + 6, self.height, SCROLL))

    # groups

    def _tools(self, column: Column, session: "Session", measured: dict[str, Any]) -> None:
        column.head("Tools")
        column.buttons([(name, t.key, session.tool == name, {"call": ("choose", name), "tip": t.help}) for name, t in TOOLS.items()])
        tool = TOOLS[session.tool]
        column.note(tool.help)
        kinds = session.sim.scene.grains
        if "low" in tool.uses and len(kinds) > 1:
            self._kind(column, session)
        for knob in session.knobs():
            if knob.group == "tools" and knob.key[5:] in tool.uses:
                column.slider(knob, session.value(knob.key), session.opened)

    def _kind(self, column: Column, session: "Session") -> None:
        """Which kind of grain is made, in its colour."""
        scene, kind = session.sim.scene, session.brush.kind
        colour = f"#{kind_colour(kind, len(scene.grains) + len(scene.sources)):06X}"
        column.sheet.plate(column.left, column.y + 2, 20, column.high - 4, colour, 3)
        table = scene.grains[kind]
        text = f"kind {kind + 1} of {len(scene.grains)}: {table.shape}"
        zone = Zone(column.left, column.y, column.inner, column.high, "kind of grain", call=("next_kind",), tip="the next kind (t)")
        column.sheet.text(column.left + 28, column.y + 4, text, self.type.text)
        column.zones.append(zone)
        column.y += column.high + 6

    def _view(self, column: Column, session: "Session", measured: dict[str, Any]) -> None:
        look = session.look
        column.head("View")
        names = views_of(session.sim.world)
        column.buttons([(name, "", look["color"] == name, {"action": ("look", "color", name)}) for name in names])
        if look["color"] == "energy":
            for end in choices.SWATCHES:
                column.swatches(end, choices.swatches(session, end), look[end], lambda colour, end=end: ("look", end, colour))
        switches = choices.switches(session)
        column.buttons([(text, "", look[key], {"action": ("look", key, not look[key])}) for key, text in switches])

    def _material(self, column: Column, session: "Session", measured: dict[str, Any]) -> None:
        scene = session.sim.scene
        column.head("Material", "ranges open: unphysical" if session.opened else "")
        self._sliders(column, session, "world")
        buttons = []
        for name in effects.fitting(scene.solver.kind):
            about = (effects.find(name).__doc__ or "").strip().partition("\n")[0]
            does = {"action": ("effect", name, name not in scene.effects), "tip": f"{about} Off, it costs nothing.".strip()}
            buttons.append((name, "", name in scene.effects, does))
        column.buttons(buttons)
        for name in scene.effects:
            self._sliders(column, session, name)

    def _solver(self, column: Column, session: "Session", measured: dict[str, Any]) -> None:
        scene = session.sim.scene
        column.head("Solver")
        column.buttons([(kind, "", scene.solver.kind == kind, {"action": ("solver", kind)}) for kind in ("rigid", "md")])
        self._sliders(column, session, "accuracy")
        for label, value, tone in numbers.accuracy(session, measured):
            column.row(label, value, TONES[tone])
        column.sheet.text(column.left, column.y + 4, "space pause · z undo · h help", self.type.text, DIM)
        column.y += column.line + 4

    def _sliders(self, column: Column, session: "Session", group: str) -> None:
        for knob in session.knobs():
            if knob.group == group:
                column.slider(knob, session.value(knob.key), session.opened)
