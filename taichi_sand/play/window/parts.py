"""What the panel is made of: heads, rows, sliders, buttons, one below the other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand.play import numbers
from taichi_sand.play.knobs import Knob
from taichi_sand.play.window.sheet import ACCENT, ATTENTION, DIM, GROUND, HOVER, IDLE, PRESSED, TEXT, WRONG, Sheet, Type
from taichi_sand.view.text import in_lines, shortened, spaced

BAR, KNOB = 4, 10
GAP = 4
MOST_COLUMNS = 4
Button = tuple[str, str, bool, dict[str, Any]]
"""Text, key, whether it is on, and what it does and says."""


@dataclass(frozen=True)
class Zone:
    """A part of the window that answers to the mouse: a slider (`knob`), or a button that does an action or calls a control."""

    left: float
    top: float
    width: float
    height: float
    name: str
    knob: Knob | None = None
    action: tuple = ()
    call: tuple = ()
    tip: str = ""  # what it says while the mouse rests on it

    def holds(self, x: float, y: float) -> bool:
        """Whether a point lies in it."""
        return self.left <= x < self.left + self.width and self.top <= y < self.top + self.height

    def share(self, x: float) -> float:
        """Where along it x lies, 0 .. 1 for a slider."""
        return (x - self.left - KNOB / 2) / (self.width - KNOB)


def places(zones: Sequence[Zone]) -> dict[str, list[int]]:
    """Where zones are in the window, by name: left, top, width, height [px]; some of the panel are scrolled out of it."""
    return {zone.name: [round(zone.left), round(zone.top), round(zone.width), round(zone.height)] for zone in zones}


class Column:
    """Parts one below the other, with room for `inner` pixels; `hovered` and `pressed` name the zones under the mouse, `typed` is the key
    of a slider for which a value is being typed, and the text so far.
    """

    def __init__(self, left: float, y: float, inner: float, type: Type, hovered: str, pressed: str, typed: tuple[str, str] | None) -> None:
        self.left, self.y, self.inner, self.type = left, y, inner, type
        self.hovered, self.pressed, self.typed = hovered, pressed, typed
        self.sheet, self.zones = Sheet(), list[Zone]()

    @property
    def line(self) -> int:
        """From one line of text to the next [px]."""
        return self.type.text + 4

    @property
    def high(self) -> int:
        """Of a button [px]."""
        return self.type.text + 9

    def head(self, text: str, note: str = "") -> None:
        """Begins a group."""
        self.y += 6 if self.zones else 0
        self.sheet.text(self.left, self.y, text, self.type.strong, TEXT)
        if note:
            room = self.inner - spaced(text, self.type.strong)[1] - 8
            note = shortened(note, self.type.text, int(room))
            self.sheet.text(self.left + self.inner, self.y + 2, note, self.type.text, ATTENTION if "unphysical" in note else DIM, align=1)
        self.y += self.type.strong + 7

    def row(self, label: str, value: str, colour: str = TEXT) -> None:
        """A label and what it is."""
        self.sheet.text(self.left, self.y, label, self.type.text)
        self.sheet.text(self.left + self.inner, self.y, value, self.type.text, colour, align=1)
        self.y += self.line + 1

    def note(self, text: str) -> None:
        """A sentence."""
        for line in in_lines(text, self.type.text, int(self.inner)):
            self.sheet.text(self.left, self.y, line, self.type.text, DIM)
            self.y += self.line
        self.y += GAP

    def slider(self, knob: Knob, value: float, opened: bool) -> None:
        """A number: label and value, which can be typed, above the slider."""
        why, size = knob.why(value), self.type.text
        shown, colour = numbers.shown(knob, value), WRONG if why else DIM
        if self.typed and self.typed[0] == knob.key:
            shown, colour = self.typed[1] + "_", ACCENT
        wide = spaced(shown, size)[1] + 8
        name = f"{knob.label} value"
        if self.hovered == name or colour == ACCENT:
            self.sheet.plate(self.left + self.inner - wide, self.y - 1, wide, size + 5, IDLE, 3)
        self.sheet.text(self.left, self.y, shortened(knob.label, size, int(self.inner - wide)), size)
        self.sheet.text(self.left + self.inner - 4, self.y, shown, size, colour, align=1)
        self.zones.append(
            Zone(self.left + self.inner - wide, self.y - 1, wide, size + 4, name, call=("edit", knob), tip="click to type a value")
        )
        share, middle = knob.share(value, opened), self.y + size + 10
        at = self.left + KNOB / 2 + share * (self.inner - KNOB)
        live = knob.label in (self.hovered, self.pressed)
        self.sheet.plate(self.left, middle - BAR / 2, self.inner, BAR, HOVER if live else IDLE, BAR // 2)
        if at - self.left >= BAR:
            self.sheet.plate(self.left, middle - BAR / 2, at - self.left, BAR, WRONG if why else ACCENT, BAR // 2)
        thick = KNOB + 2 * live
        self.sheet.plate(at - thick / 2, middle - thick / 2, thick, thick, TEXT, thick // 2)
        tip = f"{why}: unphysical" if why else f"{knob.help}; a double click resets it"
        self.zones.append(Zone(self.left, self.y + size + 3, self.inner, 14, knob.label, knob=knob, tip=tip))
        self.y += size + 20

    def swatches(self, label: str, colours: Sequence[str], chosen: str, action: Any) -> None:
        """Colours to choose from; `action(colour)` is what each does."""
        self.sheet.text(self.left, self.y + 3, label, self.type.text)
        for number, colour in enumerate(colours):
            x = self.left + 60 + 28 * number
            if chosen == colour:
                self.sheet.plate(x - 3, self.y - 1, 26, 22, ACCENT, 5)
            self.sheet.plate(x, self.y + 2, 20, 16, colour, 3)
            self.zones.append(Zone(x - 3, self.y - 1, 26, 22, f"{label} {colour}", action=action(colour)))
        self.y += self.high + GAP

    def buttons(self, buttons: Sequence[Button]) -> None:
        """Buttons side by side, in as many columns as their texts have room in."""
        size = self.type.text
        widest = max(spaced(text, size)[1] + (20 if key else 8) for text, key, _, _ in buttons)
        columns = max(1, min(MOST_COLUMNS, len(buttons), int((self.inner + GAP) // (widest + GAP))))
        width, step = (self.inner - (columns - 1) * GAP) / columns, self.high + GAP
        for number, (text, key, active, does) in enumerate(buttons):
            x, y = self.left + number % columns * (width + GAP), self.y + number // columns * step
            ground = PRESSED if text == self.pressed else ACCENT if active else HOVER if text == self.hovered else IDLE
            self.sheet.plate(x, y, width, self.high, ground)
            colour = GROUND if active and ground != PRESSED else TEXT
            if key:
                self.sheet.text(x + 5, y + 4, key, size, colour if active else DIM)
                self.sheet.text(x + 18, y + 4, text, size, colour)
            else:
                self.sheet.text(x + width / 2 - spaced(text, size)[1] / 2, y + 4, text, size, colour)
            self.zones.append(Zone(x, y, width, self.high, text, **does))
        self.y += -(-len(buttons) // columns) * step + GAP

    def paint(self, canvas: np.ndarray, width: int, height: int) -> None:
        """Lays all of it over a canvas."""
        self.sheet.paint(canvas, width, height)
