"""The numbers over the picture, and the sentences that must not be missed."""

from typing import TYPE_CHECKING

import numpy as np

from taichi_sand.play.keys import GROUPS, KEYS
from taichi_sand.play.numbers import DOT
from taichi_sand.play.window.sheet import DIM, GROUND, IDLE, PANEL, TEXT, TONES, WRONG, Sheet
from taichi_sand.view.caption import spaced

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

LINE = 16
SIZE = 11
TOP, LEFT = 84, 14


def compose(shown: list[tuple[str, str]], width: int) -> list[tuple[int, int, np.ndarray]]:
    """Lines and their tones on their ground, as tiles; a sentence that is too long goes on in the next line."""
    fitted = [(part, TONES[tone]) for text, tone in shown for part in wrap(text, width - 2 * LEFT - 16)]
    sheet = Sheet()
    wide = max(spaced(text, SIZE)[1] for text, _ in fitted)
    sheet.plate(LEFT - 8, TOP - 6, 16 * (-(-(wide + 16) // 16)), LINE * len(fitted) + 10, GROUND, 4, 0.72)
    for number, (text, colour) in enumerate(fitted):
        sheet.text(LEFT, TOP + LINE * number, text, SIZE, colour)
    return sheet.tiles


def wrap(text: str, room: int) -> list[str]:
    """Text in lines of at most `room` pixels, cut between its parts, or between words if it has none."""
    between = DOT if DOT in text else " "
    first, *rest = text.split(between)
    found = [first]
    for part in rest:
        longer = found[-1] + between + part
        if spaced(longer, SIZE)[1] > room:
            found.append(part)
        else:
            found[-1] = longer
    return found


def badge(sheet: Sheet, text: str, middle: float, y: float, colour: str, ink: str = TEXT) -> None:
    """A plate with a sentence, centred."""
    wide = spaced(text, 12)[1]
    sheet.plate(middle - wide / 2 - 10, y, wide + 20, 26, colour, 5)
    sheet.text(middle - wide / 2, y + 5, text, 12, ink)


def notices(session: "Session", width: int, height: int, told: str) -> Sheet:
    """What must be seen: unphysical values at the top, the last message at the bottom."""
    sheet = Sheet()
    if session.sim.over:
        badge(sheet, f"UNPHYSICAL: {', '.join(session.unphysical())}", width / 2, 10, WRONG, "#FFFFFF")
    for number, line in enumerate(reversed(wrap(told, width - 40) if told else [])):
        badge(sheet, line, width / 2, height - 40 - 28 * number, IDLE)
    return sheet


def help_sheet(width: int, height: int) -> Sheet:
    """All keys, over the whole window."""
    sheet = Sheet()
    texts = {group: [key for key in KEYS if key.group == group] for group in GROUPS}
    rows = sum(len(keys) + 2 for keys in texts.values())
    step = min(20, (height - 60) // (rows + 2))
    size = min(12, step - 4)
    wide = max(spaced(key.help, size)[1] for key in KEYS) + 110
    left, y = max(4, (width - wide) // 2), max(10, (height - (rows + 3) * step) // 2)
    sheet.plate(0, 0, width, height, GROUND, 0, 0.7)
    sheet.plate(left, y, wide, (rows + 2) * step, PANEL, 8)
    y += step
    for group, keys in texts.items():
        sheet.text(left + 20, y, group.upper(), size - 2, DIM)
        for key in keys:
            y += step
            sheet.plate(left + 20, y - 1, 44, step - 2, IDLE)
            sheet.text(left + 42 - spaced(key.name, size)[1] / 2, y, key.name, size)
            sheet.text(left + 78, y, key.help, size)
        y += 2 * step
    sheet.text(left + 20, y - step // 2, "The wheel changes the brush. Right button: the opposite of the tool.", size, DIM)
    return sheet
