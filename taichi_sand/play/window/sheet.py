"""Plates, texts and sliders, collected as tiles and laid over a canvas in one go."""

from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw

from taichi_sand.view import palette
from taichi_sand.view.caption import text_tile
from taichi_sand.view.kernels import paint_tiles

PANEL, IDLE, ACCENT = "#1E2229", "#343A44", "#F2A65A"
GOOD, ATTENTION, WRONG = "#7BC47F", "#F2C14E", "#E5534B"
GROUND, TEXT, DIM = palette.GROUND, palette.TEXT, palette.DIM_TEXT
TONES = {"": TEXT, "dim": DIM, "good": GOOD, "attention": ATTENTION}
FINE = 4
"""Plates are drawn this much larger and shrunk, which smooths their corners."""


@lru_cache(maxsize=256)
def plate_tile(width: int, height: int, colour: str, radius: int, cover: float = 1.0) -> np.ndarray:
    """A rectangle with round corners."""
    mask = Image.new("L", (FINE * width, FINE * height))
    ImageDraw.Draw(mask).rounded_rectangle((0, 0, FINE * width - 1, FINE * height - 1), FINE * radius, fill=round(255 * cover))
    small = np.asarray(mask.resize((width, height), Image.Resampling.BOX), np.uint32)
    return (small << 24) | np.uint32(palette.packed(colour))


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

    def paint(self, canvas: np.ndarray, width: int, height: int) -> None:
        """Lays all tiles over a canvas (u32, flat)."""
        if self.tiles:
            spans = np.array([(x, y, tile.shape[1], tile.shape[0]) for x, y, tile in self.tiles], np.int32)
            paint_tiles(canvas, width, height, spans, np.concatenate([tile.ravel() for _, _, tile in self.tiles]))
