"""The caption over a picture: title, one line of facts, the range of the colours, and a scale bar.

Text is drawn by Pillow onto small tiles 0xAARRGGBB that one kernel lays over the canvas. A tile is kept while its text stays:
a new frame costs one short string, the time.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from taichi_sand.view import palette
from taichi_sand.view.kernels import paint_tiles
from taichi_sand.view.paint import REFERENCE_WIDTH, WALL_WIDTH, Legend

TITLE_SIZE, LINE_SIZE = 17, 12
"""Heights of the text [px] in a picture REFERENCE_WIDTH wide; they follow the width within LEAST .. MOST."""
LEAST, MOST = 0.7, 2.0
WORD_GAP = 0.3
"""Words are at least this much of the height of the text apart; the font's own space is hard to see in small text."""
MARGIN = 16
LINE_STEP = 18
BETWEEN = "  ·  "
BAR_SHARE = 0.1
"""The scale bar is the largest round length that is not above this part of the picture's width."""
BAR_LEAST_WIDTH = 240
"""Narrower pictures [px] have no scale bar."""
LEGEND_WIDTH, LEGEND_HEIGHT = 96, 6
SHADE = 0.72
"""How much of what lies under the text is hidden, so that it can be read over grains."""

SHADE_STEP = 32
"""The patch under the text grows by so many pixels, so that it does not follow every digit."""

Placed = tuple[int, int, np.ndarray]
"""A tile and where its left upper corner lies [px]."""


@lru_cache(maxsize=16)
def font_of(size: int) -> ImageFont.FreeTypeFont:
    """The font that comes with Pillow, so that captions look alike everywhere."""
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font


@lru_cache(maxsize=1024)
def spaced(text: str, size: int) -> tuple[list[int], int]:
    """Where the words of a line begin, and how wide it is [px]."""
    font, x, starts = font_of(size), 0.0, []
    gap = max(WORD_GAP * size, font.getlength(" "))
    for word in text.split(" "):
        starts.append(round(x))
        x += font.getlength(word) + gap
    return starts, max(1, math.ceil(x - gap))


@lru_cache(maxsize=512)
def text_tile(text: str, size: int, colour: str) -> np.ndarray:
    """Text in one colour on nothing; its own width, the height of a line."""
    font, (starts, width) = font_of(size), spaced(text, size)
    mask = Image.new("L", (width, size + size // 3))
    for start, word in zip(starts, text.split(" "), strict=True):
        ImageDraw.Draw(mask).text((start, 0), word, font=font, fill=255)
    return (np.asarray(mask, np.uint32) << 24) | np.uint32(palette.packed(colour))


@lru_cache(maxsize=16)
def shade_tile(width: int, height: int, soft: int) -> np.ndarray:
    """A patch of the ground colour that fades out over its last `soft` pixels to the sides and below."""
    across = np.minimum(np.arange(width) + 0.5, np.arange(width, 0, -1) - 0.5) / soft
    down = (np.arange(height, 0, -1) - 0.5) / soft
    cover = SHADE * np.minimum(1.0, down)[:, None] * np.minimum(1.0, across)
    return (np.rint(255 * cover).astype(np.uint32) << 24) | np.uint32(palette.packed(palette.GROUND))


def solid_tile(width: int, height: int, colours: np.ndarray | int) -> np.ndarray:
    """A bar of one colour, or of one colour a column."""
    return np.ascontiguousarray(np.broadcast_to(np.asarray(colours, np.uint32) | np.uint32(0xFF000000), (height, width)))


def round_length(longest: float) -> float:
    """The largest of 1, 2, 5 · 10^k that is not above `longest`."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1 + 1e-9))


def length_text(metres: float) -> str:
    """A round length in the unit people would use."""
    for unit, size in (("km", 1e3), ("m", 1.0), ("cm", 1e-2)):
        if metres >= size * (1 - 1e-9):
            return f"{metres / size:.4g} {unit}"
    return f"{metres * 1e3:.4g} mm"


def number_text(value: float) -> str:
    """Three digits, without an exponent where that can be read."""
    if not math.isfinite(value):
        return str(value)
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        return f"{float(f'{value:.3g}'):.10g}"
    digits, power = f"{value:.1e}".split("e")
    return f"{digits}e{int(power)}"


class Caption:
    """Lays captions over canvases of one size. `scale`: px/m; `least`: smallest size of the text, over that of LINE_SIZE."""

    def __init__(self, width: int, height: int, scale: float, least: float = LEAST) -> None:
        self.width, self.height = width, height
        self.size = min(MOST, max(least, width / REFERENCE_WIDTH))
        self.bar = round_length(BAR_SHARE * width / scale)
        self.bar_width = round(self.bar * scale)

    def draw(self, canvas: np.ndarray, title: str, facts: Sequence[str], legend: Legend | None) -> None:
        """Lays the caption over `canvas`; `facts` stand in one line, or in more where the picture is too narrow."""
        margin, step = self._px(MARGIN), self._px(LINE_STEP)
        right = self._scale_tiles(margin) if self.width >= BAR_LEAST_WIDTH else []
        room = min([self.width] + [x for x, _, _ in right]) - 2 * margin
        tiles: list[Placed] = []
        y = self._px(0.7 * MARGIN)
        if title:
            tiles.append((margin, y, text_tile(title, self._px(TITLE_SIZE), palette.TEXT)))
            y += self._px(LINE_STEP + 6)
        for line in self._lines(facts, room):
            tiles += self._row(line, margin, y)
            y += step
        if legend:
            tiles += self._legend_tiles(legend, margin, y)
            y += step
        laid = [*self._backed(tiles), *self._backed(right)]
        spans = np.array([(x, y, tile.shape[1], tile.shape[0]) for x, y, tile in laid], np.int32).reshape(-1, 4)
        if laid:
            paint_tiles(canvas, self.width, self.height, spans, np.concatenate([tile.ravel() for _, _, tile in laid]))

    def _px(self, length: float) -> int:
        """Whole pixels of a length that is meant for a picture REFERENCE_WIDTH wide."""
        return max(1, round(length * self.size))

    def _tile(self, text: str) -> np.ndarray:
        """Tile of dim text."""
        return text_tile(text, self._px(LINE_SIZE), palette.DIM_TEXT)

    def _lines(self, facts: Sequence[str], room: int) -> list[list[str]]:
        """Facts dealt to lines that fit into `room` pixels."""
        gap = self._tile(BETWEEN).shape[1]
        lines: list[list[str]] = []
        used = room + 1
        for fact in facts:
            width = self._tile(fact).shape[1]
            if used + gap + width > room:
                lines.append([])
                used = -gap
            lines[-1].append(fact)
            used += gap + width
        return lines

    def _row(self, facts: Sequence[str], x: int, y: int) -> list[Placed]:
        """Facts side by side, with dots between."""
        placed = []
        for number, fact in enumerate(facts):
            for text in (BETWEEN, fact) if number else (fact,):
                placed.append((x, y, self._tile(text)))
                x += placed[-1][2].shape[1]
        return placed

    def _legend_tiles(self, legend: Legend, x: int, y: int) -> list[Placed]:
        """Name of the view, and its colours between the ends of the range."""
        wide, high, gap = self._px(LEGEND_WIDTH), self._px(LEGEND_HEIGHT), self._px(8)
        shown = legend.colours[np.linspace(0, len(legend.colours) - 1, wide).round().astype(int)]
        parts = [self._tile(legend.name), self._tile("0"), solid_tile(wide, high, shown)]
        parts.append(self._tile(f"{number_text(legend.top)} {legend.unit}".rstrip()))
        placed = []
        for part in parts:
            drop = self._px(0.62 * LINE_SIZE) - high // 2 if part is parts[2] else 0
            placed.append((x, y + drop, part))
            x += part.shape[1] + gap
        return placed

    def _scale_tiles(self, margin: int) -> list[Placed]:
        """A white bar with its length below, at the right."""
        label = self._tile(length_text(self.bar))
        wide = max(self.bar_width, label.shape[1])
        middle, y = self.width - margin - wide // 2, self._px(1.3 * MARGIN)
        bar = solid_tile(self.bar_width, self._px(2), palette.packed(palette.TEXT))
        return [(middle - self.bar_width // 2, y, bar), (middle - label.shape[1] // 2, y + self._px(7), label)]

    def _backed(self, tiles: Sequence[Placed]) -> list[Placed]:
        """Tiles, and before them the patch that keeps them legible."""
        if not tiles:
            return []
        soft = self._px(MARGIN)
        left, right = min(x for x, _, _ in tiles) - soft, max(x + tile.shape[1] for x, _, tile in tiles) + soft
        bottom = max(y + tile.shape[0] for _, y, tile in tiles) + soft
        wide = SHADE_STEP * math.ceil((right - left) / SHADE_STEP)
        edge = math.ceil(WALL_WIDTH * self.width / REFERENCE_WIDTH)
        start = left if left < self.width // 2 else right - wide - edge
        return [(max(start, edge), edge, shade_tile(wide, bottom, soft)), *tiles]
