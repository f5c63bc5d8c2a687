"""The panel beside the picture: solver, accuracy, numbers with sliders, effects, tools, views."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_sand import effects
from taichi_sand.play import choices, numbers
from taichi_sand.play.knobs import Knob
from taichi_sand.play.tools import TOOLS
from taichi_sand.play.window.hud import wrap
from taichi_sand.play.window.sheet import ACCENT, ATTENTION, DIM, GROUND, IDLE, PANEL, TEXT, TONES, WRONG, Sheet
from taichi_sand.view.caption import spaced
from taichi_sand.view.views import views_of

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

WIDTH = 264
PAD = 14
HEAD, VALUE = 9, 12
INNER = WIDTH - 2 * PAD
BAR, KNOB = 4, 10
SLIDER_STEP, ROW_STEP, BUTTON_STEP, LINE, HEAD_GAP = 28, 17, 26, 15, 5


@dataclass(frozen=True)
class Zone:
    """A part of the panel that answers to the mouse: a slider (`knob`), or a button that does an action or calls a control."""

    left: float
    top: float
    width: float
    height: float
    name: str
    knob: Knob | None = None
    action: tuple = ()
    call: tuple = ()

    def holds(self, x: float, y: float) -> bool:
        """Whether a point lies in it."""
        return self.left <= x < self.left + self.width and self.top <= y < self.top + self.height

    def share(self, x: float) -> float:
        """Where along it x lies, 0 .. 1 for a slider."""
        return (x - self.left - KNOB / 2) / (self.width - KNOB)


class Panel:
    """Lays the controls out, paints them, and says what lies under the mouse. Coordinates are those of the panel, y down."""

    def __init__(self, height: int) -> None:
        self.height = height
        self.scrolled = 0
        self.full = height  # height of all controls
        self.zones: list[Zone] = []

    def scroll(self, pixels: int) -> None:
        """Moves the controls up, as far as there are any."""
        self.scrolled = max(0, min(self.full - self.height, self.scrolled + pixels))

    def under(self, x: float, y: float) -> Zone | None:
        """The zone at a point."""
        return next((zone for zone in self.zones if zone.holds(x, y)), None)

    def places(self) -> dict[str, list[int]]:
        """Where each slider and button is in the window: left, top, width, height [px]."""
        return {zone.name: [round(zone.left), round(zone.top), round(zone.width), round(zone.height)] for zone in self.zones}

    def paint(self, canvas: np.ndarray, width: int, height: int, session: "Session", measured: dict[str, Any]) -> None:
        """Paints the panel along the right edge of a canvas of the whole window."""
        canvas.reshape(height, width)[:, width - WIDTH :] = int(PANEL[1:], 16)
        self.sheet, self.zones = Sheet(), []
        self.left, self.y = width - WIDTH + PAD, PAD - self.scrolled
        self.knobs = session.knobs()
        self._solver(session, measured)
        self._numbers(session)
        self._effects(session)
        self._tools(session)
        self._views(session)
        self.full = self.y + self.scrolled + PAD
        self.sheet.paint(canvas, width, height)

    # groups

    def _solver(self, session: "Session", measured: dict[str, Any]) -> None:
        scene = session.sim.scene
        self._head("SOLVER")
        self._buttons([(kind, "", scene.solver.kind == kind, {"action": ("solver", kind)}) for kind in ("rigid", "md")], 2)
        self._head("ACCURACY")
        for knob in self.knobs:
            if knob.group == "accuracy":
                self._slider(session, knob)
        for label, value, tone in numbers.accuracy(session, measured):
            self._row(label, value, TONES[tone])

    def _numbers(self, session: "Session") -> None:
        self._head("WORLD", "ranges open: unphysical" if session.opened else "")
        for knob in self.knobs:
            if knob.group == "world":
                self._slider(session, knob)

    def _effects(self, session: "Session") -> None:
        scene = session.sim.scene
        self._head("EFFECTS", "off: they cost nothing" if len(scene.effects) < len(effects.names()) else "")
        fitting = effects.fitting(scene.solver.kind)
        buttons = [(name, "", name in scene.effects, {"action": ("effect", name, name not in scene.effects)}) for name in fitting]
        self._buttons(buttons, 3)
        for knob in self.knobs:
            if knob.group in scene.effects:
                self._slider(session, knob)

    def _tools(self, session: "Session") -> None:
        self._head("TOOLS")
        self._buttons([(name, tool.key, session.tool == name, {"call": ("choose", name)}) for name, tool in TOOLS.items()], 3)
        tool = TOOLS[session.tool]
        for line in wrap(tool.help, INNER):
            self.sheet.text(self.left, self.y, line, 11, DIM)
            self.y += LINE
        self.y += 4
        for knob in self.knobs:
            if knob.group == "tools" and knob.key[5:] in tool.uses:
                self._slider(session, knob)

    def _views(self, session: "Session") -> None:
        look = session.look
        self._head("VIEW")
        names = views_of(session.sim.world)
        self._buttons([(name, "", look["color"] == name, {"action": ("look", "color", name)}) for name in names], 4)
        if look["color"] == "energy":
            for end in choices.SWATCHES:
                self._swatches(session, end)
        switches = choices.switches(session)
        self._buttons([(text, "", look[key], {"action": ("look", key, not look[key])}) for key, text in switches], 3)
        self.sheet.text(self.left, self.y, "space pause · z undo · h help", 11, DIM)
        self.y += ROW_STEP

    # parts

    def _head(self, text: str, note: str = "") -> None:
        self.y += HEAD_GAP if self.zones else 0
        self.sheet.text(self.left, self.y, text, HEAD, DIM)
        if note:
            self.sheet.text(self.left + INNER, self.y, note, HEAD, ATTENTION if "unphysical" in note else DIM, align=1)
        self.y += ROW_STEP - 2

    def _row(self, label: str, value: str, colour: str = TEXT) -> None:
        self.sheet.text(self.left, self.y, label, VALUE)
        self.sheet.text(self.left + INNER, self.y, value, VALUE, colour, align=1)
        self.y += ROW_STEP

    def _slider(self, session: "Session", knob: Knob) -> None:
        value = session.value(knob.key)
        self.sheet.text(self.left, self.y, knob.label, VALUE)
        shown = numbers.shown(knob, value)
        odd = not knob.physical(value)
        self.sheet.text(self.left + INNER, self.y, shown, VALUE, WRONG if odd else DIM, align=1)
        share, middle = knob.share(value, session.opened), self.y + 21
        at = self.left + KNOB / 2 + share * (INNER - KNOB)
        self.sheet.plate(self.left, middle - BAR / 2, INNER, BAR, IDLE, BAR // 2)
        if at - self.left >= BAR:
            self.sheet.plate(self.left, middle - BAR / 2, at - self.left, BAR, WRONG if odd else ACCENT, BAR // 2)
        self.sheet.plate(at - KNOB / 2, middle - KNOB / 2, KNOB, KNOB, TEXT, KNOB // 2)
        self.zones.append(Zone(self.left, self.y + 13, INNER, 17, knob.label, knob=knob))
        self.y += SLIDER_STEP

    def _swatches(self, session: "Session", end: str) -> None:
        """Colours for one end of the scale of energy."""
        self.sheet.text(self.left, self.y + 3, end, VALUE)
        for number, colour in enumerate(choices.swatches(session, end)):
            x = self.left + 60 + 28 * number
            if session.look[end] == colour:
                self.sheet.plate(x - 3, self.y - 1, 26, 22, ACCENT, 5)
            self.sheet.plate(x, self.y + 2, 20, 16, colour, 3)
            self.zones.append(Zone(x - 3, self.y - 1, 26, 22, f"{end} {colour}", action=("look", end, colour)))
        self.y += BUTTON_STEP

    def _buttons(self, buttons: Sequence[tuple[str, str, bool, dict]], columns: int) -> None:
        gap = 4
        width = (INNER - (columns - 1) * gap) / columns
        for number, (text, key, active, does) in enumerate(buttons):
            x, y = self.left + number % columns * (width + gap), self.y + number // columns * BUTTON_STEP
            self.sheet.plate(x, y, width, BUTTON_STEP - 4, ACCENT if active else IDLE)
            colour = GROUND if active else TEXT
            if key:
                self.sheet.text(x + 7, y + 5, key, 11, colour if active else DIM)
                self.sheet.text(x + 21, y + 5, text, 11, colour)
            else:
                self.sheet.text(x + width / 2 - spaced(text, 11)[1] / 2, y + 5, text, 11, colour)
            self.zones.append(Zone(x, y, width, BUTTON_STEP - 4, text, **does))
        self.y += -(-len(buttons) // columns) * BUTTON_STEP + 6
