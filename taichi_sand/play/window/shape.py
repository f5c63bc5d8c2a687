"""How large a window is, and where its picture and its panel lie."""

from collections.abc import Sequence
from typing import NamedTuple, Self

from taichi_sand.play.window.display import FRAME, display_size
from taichi_sand.play.window.sheet import LEAST_TEXT
from taichi_sand.view.camera import picture_height

MOST_WIDTH, MOST_HEIGHT = 1080, 860
"""A picture that nobody gave a width is not larger than this [px], nor than fits the display."""
LEAST_WIDTH, LEAST_HEIGHT = 320, 840
"""A narrower or lower picture [px] stands in a strip of the ground, so that there is room for numbers and for the panel."""
PANEL = 264
"""Width of the panel with text of the least size [px]; it grows with that."""


class Shape(NamedTuple):
    """Sizes in pixels."""

    picture: tuple[int, int]
    wide: int  # of the part left of the panel
    high: int
    panel: int  # its width

    @classmethod
    def of(cls, box: Sequence[float], width: int | None = None, text: int = LEAST_TEXT, display: tuple[int, int] | None = None) -> Self:
        """For a box of this size [m]: with a picture so wide, or as large as fits the display."""
        display = display or display_size()
        panel = round(PANEL * text / LEAST_TEXT)
        room = min(MOST_WIDTH, display[0] - FRAME[0] - panel), min(MOST_HEIGHT, display[1] - FRAME[1])
        width = width or max(16, int(min(room[0], (room[1] - 1) * box[0] / box[1])))
        height = picture_height(box, width)
        return cls((width, height), max(width, LEAST_WIDTH), max(height, min(LEAST_HEIGHT, room[1])), panel)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the window."""
        return self.wide + self.panel, self.high

    @property
    def left(self) -> int:
        """Where the picture begins."""
        return (self.wide - self.picture[0]) // 2

    @property
    def top(self) -> int:
        """Where it begins, from above."""
        return (self.high - self.picture[1]) // 2
