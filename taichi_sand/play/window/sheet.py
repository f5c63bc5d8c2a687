"""Plates, texts and sliders, collected as tiles and laid over a canvas in one go."""

from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from PIL import Image, ImageDraw

from taichi_sand.view import palette
from taichi_sand.view.text import LINE_SIZE, TITLE_SIZE, text_tile

IDLE, ACCENT = "#343A44", "#F2A65A"
GOOD, ATTENTION, WRONG = "#7BC47F", "#F2C14E", "#E5534B"
GROUND, PANEL, TEXT, DIM = palette.GROUND, palette.PANEL, palette.TEXT, palette.DIM_TEXT
TONES = {"": TEXT, "dim": DIM, "good": GOOD, "attention": ATTENTION}
LEAST_TEXT = 13
"""Smaller text [px] is hard to read on a screen."""
HOVER, PRESSED = "#464D59", "#262B33"
FINE = 4
"""Plates are drawn this much larger and shrunk, which smooths their corners."""


@lru_cache(maxsize=256)
def plate_tile(width: int, height: int, colour: str, radius: int, cover: float = 1.0) -> np.ndarray:
    """A rectangle with round corners."""
    mask = Image.new("L", (FINE * width, FINE * height))
    ImageDraw.Draw(mask).rounded_rectangle((0, 0, FINE * width - 1, FINE * height - 1), FINE * radius, fill=round(255 * cover))
    small = np.asarray(mask.resize((width, height), Image.Resampling.BOX), np.uint32)
    return (small << 24) | np.uint32(palette.packed(colour))


class Type(NamedTuple):
    """The three sizes of text of a window [px]."""

    text: int
    strong: int
    title: int

    @classmethod
    def of(cls, text: int = LEAST_TEXT) -> Self:
        """With text of this size."""
        return cls(text, text + 2, round(text * TITLE_SIZE / LINE_SIZE))


class Sheet:
    """Tiles, the last on top. Coordinates are pixels from the upper left corner, y down."""

    def __init__(self) -> None:
        self.tiles: list[tuple[int, int, np.ndarray]] = []

    def tile(self, x: float, y: float, tile: np.ndarray) -> None:
        """Any tile."""
        self.tiles.append((round(x), round(y), tile))

    def plate(self, x: float, y: float, width: float, height: float, colour: str, radius: int = 4, cover: float = 1.0) -> None:
        """A rectangle with round corners; `cover` 0 .. 1 is how much it hides."""
        self.tile(x, y, plate_tile(max(1, round(width)), max(1, round(height)), colour, radius, cover))

    def text(self, x: float, y: float, text: str, size: int, colour: str = TEXT, align: float = 0.0) -> int:
        """A line of text; `align` 0 = x is its left end, 1 = its right end. Returns its width."""
        tile = text_tile(text, size, colour)
        self.tile(x - align * tile.shape[1], y, tile)
        return tile.shape[1]

    def lay(self, canvas: np.ndarray, width: int, height: int) -> None:
        """As `paint`, without a kernel: while others are compiled."""
        whole = canvas.reshape(height, width)
        for x, y, tile in self.tiles:
            part = whole[max(0, y) : max(0, y + tile.shape[0]), max(0, x) : max(0, x + tile.shape[1])]
            over = tile[max(0, -y) :, max(0, -x) :][: part.shape[0], : part.shape[1]]
            share, mixed = (over >> 24).astype(np.float32) / 255, np.zeros_like(part)
            for shift in (16, 8, 0):
                below, above = (part >> shift) & 255, (over >> shift) & 255
                mixed |= (below + (above.astype(np.float32) - below) * share + 0.5).astype(np.uint32) << np.uint32(shift)
            part[:] = mixed

    def paint(self, canvas: np.ndarray, width: int, height: int) -> None:
        """Lays all tiles over a canvas (u32, flat)."""
        from taichi_sand.view.kernels import paint_tiles  # not before there is a kernel to be compiled

        if self.tiles:
            spans = np.array([(x, y, tile.shape[1], tile.shape[0]) for x, y, tile in self.tiles], np.int32)
            paint_tiles(canvas, width, height, spans, np.concatenate([tile.ravel() for _, _, tile in self.tiles]))
