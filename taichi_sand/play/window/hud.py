"""What is written over the picture: numbers, badges, messages, keys."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taichi_sand.play.keys import GROUPS, KEYS
from taichi_sand.play.numbers import DOT
from taichi_sand.play.window.parts import Zone
from taichi_sand.play.window.sheet import ACCENT, ATTENTION, DIM, GROUND, IDLE, PANEL, TEXT, TONES, WRONG, Sheet, Type
from taichi_sand.view.text import Placed, in_lines, shortened, spaced

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

MARGIN, LEFT = 8, 14
OFFER = "offer"


@dataclass(frozen=True)
class Badge:
    """A plate with a word that must not be missed."""

    text: str
    ground: str = IDLE
    ink: str = TEXT


def badges(session: "Session", measured: dict[str, Any], *, paused: bool, filming: bool, recording: bool) -> list[Badge]:
    """What goes on besides what can be seen."""
    found = [Badge(f"unphysical: {', '.join(session.unphysical())}", WRONG, "#FFFFFF")] if session.sim.over else []
    found += [Badge("paused", ATTENTION, GROUND)] if paused else []
    found += [Badge("● filming", WRONG, "#FFFFFF")] if filming else []
    found += [Badge("● recording", IDLE, TEXT)] if recording else []
    if measured.get("slowed") and not paused:
        found.append(Badge(f"slowed down to {measured['real_time']:.2f}x", IDLE, ATTENTION))
    return found


class Numbers:
    """Lines and their tones on their ground, as tiles from y = 0 on; a sentence that is too long goes on in the next line."""

    def __init__(self, shown: list[tuple[str, str]], width: int, type: Type) -> None:
        self.step, size = type.text + 4, type.text
        fitted = [(part, TONES[tone]) for text, tone in shown for part in wrap(text, width - 2 * LEFT - 16, size)]
        self.wide = 16 * (-(-(max(spaced(text, size)[1] for text, _ in fitted) + 16) // 16))
        self.rows = fitted
        self.size = size

    @property
    def height(self) -> int:
        """Of all lines [px]."""
        return self.step * len(self.rows) + 10

    def tiles(self, x: int, y: int, room: int) -> list[Placed]:
        """As many lines as there is room for [px], at x, y."""
        rows = self.rows[: max(0, (room - 10) // self.step)]
        sheet = Sheet()
        if rows:
            sheet.plate(x + LEFT - 8, y, self.wide, self.step * len(rows) + 10, GROUND, 4, 0.72)
        for number, (text, colour) in enumerate(rows):
            sheet.text(x + LEFT, y + 5 + self.step * number, text, self.size, colour)
        return sheet.tiles


def wrap(text: str, room: int, size: int) -> list[str]:
    """Text in lines of at most `room` pixels, cut between its parts, or between words if a part is too long."""
    found: list[str] = []
    for part in text.split(DOT):
        longer = found[-1] + DOT + part if found else part
        if spaced(longer, size)[1] <= room:
            found[-1:] = [longer]
        else:
            found += in_lines(part, size, room)
    return found


class Notices:
    """Badges and the last message, with what is offered against it, from the lower edge of a window upwards: `width` is that of the part
    that has the picture, `bottom` where they end [px].
    """

    def __init__(self, shown: Sequence[Badge], told: str, offer: str, width: int, bottom: int, type: Type) -> None:
        self.sheet, self.zones, self.type = Sheet(), list[Zone](), type
        self.high, self.step = type.text + 11, type.text + 15
        self.top = bottom - MARGIN
        for row in self._rows(shown, width):
            self._row(row, width, IDLE)
        if offer:
            wide = spaced(offer, type.strong)[1] + 24
            self.top -= self.step + 4
            left = (width - wide) / 2
            self.sheet.plate(left, self.top, wide, self.high + 4, ACCENT, 5)
            self.sheet.text(left + 12, self.top + 6, offer, type.strong, GROUND)
            self.zones.append(Zone(left, self.top, wide, self.high + 4, OFFER, call=("help_out",)))
        for line in reversed(in_lines(told, type.text, width - 40) if told else []):
            self._row([Badge(line)], width, IDLE)

    def _rows(self, shown: Sequence[Badge], width: int) -> list[list[Badge]]:
        rows: list[list[Badge]] = []
        used = width
        for badge in shown:
            for line in in_lines(badge.text, self.type.text, width - 40):
                wide = spaced(line, self.type.text)[1] + 26
                if used + wide > width - 16:
                    rows.append([])
                    used = 0
                rows[-1].append(Badge(line, badge.ground, badge.ink))
                used += wide
        return rows

    def _row(self, row: list[Badge], width: int, ground: str) -> None:
        self.top -= self.step
        wides = [spaced(badge.text, self.type.text)[1] + 20 for badge in row]
        x = (width - sum(wides) - 6 * (len(row) - 1)) / 2
        for badge, wide in zip(row, wides, strict=True):
            self.sheet.plate(x, self.top, wide, self.high, badge.ground, 5)
            self.sheet.text(x + 10, self.top + 5, badge.text, self.type.text, badge.ink)
            x += wide + 6


def tooltip(zone: Zone, right: float, height: int, type: Type) -> Sheet:
    """What a control of the panel does, beside it; it ends at x = `right`."""
    sheet = Sheet()
    lines = in_lines(zone.tip, type.text, 260)
    wide, high = max(spaced(line, type.text)[1] for line in lines) + 16, (type.text + 4) * len(lines) + 10
    left, top = right - wide - 6, min(max(4, zone.top), height - high - 4)
    sheet.plate(left, top, wide, high, IDLE, 4)
    for number, line in enumerate(lines):
        sheet.text(left + 8, top + 5 + (type.text + 4) * number, line, type.text)
    return sheet


def help_sheet(width: int, height: int, type: Type) -> Sheet:
    """All keys, over the whole window, in two columns."""
    sheet, size = Sheet(), type.text
    columns = [[group for group in GROUPS if (group in ("tools", "views")) == first] for first in (True, False)]
    room, high = width // 2 - 98, height - 84
    for most in (3, 2, 1):  # lines of a key, as many as there is room for
        told = {key: in_lines(key.help, size, room) for key in KEYS}
        texts = {key: [*lines[: most - 1], " ".join(lines[most - 1 :])] if len(lines) > most else lines for key, lines in told.items()}
        rows = [sum(sum(len(texts[key]) for key in KEYS if key.group == group) + 2 for group in column) for column in columns]
        if (size + 5) * max(rows) <= high:
            break
    step = min(size + 7, high // max(rows))
    sheet.plate(0, 0, width, height, GROUND, 0, 0.7)
    sheet.plate(12, 12, width - 24, height - 24, PANEL, 8)
    for number, column in enumerate(columns):
        left, y = 28 + number * (width // 2 - 8), 24
        for group in column:
            sheet.text(left, y, group.capitalize(), type.strong, DIM)
            y += step + 4
            for key in (key for key in KEYS if key.group == group):
                sheet.plate(left, y - 1, 52, step - 3, IDLE)
                sheet.text(left + 26 - spaced(key.name, size)[1] / 2, y, key.name, size)
                for line in texts[key]:
                    sheet.text(left + 62, y, shortened(line, size, room), size)
                    y += step
            y += step // 2
    told = "Wheel: zoom at the cursor. Shift and wheel: the brush. Middle button: move. Right button: the opposite of the tool."
    for number, line in enumerate(in_lines(told, size, width - 80)):
        sheet.text(28, height - 60 + (size + 4) * number, line, size, DIM)
    return sheet
