"""The caption over a picture: title, one line of facts, the range of the colours, and a scale bar.

Text is drawn by Pillow onto small tiles 0xAARRGGBB that one kernel lays over the canvas. A tile is kept while its text stays:
a new frame costs one short string, the time.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw

from taichi_sand.view import palette
from taichi_sand.view.kernels import paint_tiles
from taichi_sand.view.paint import REFERENCE_WIDTH, WALL_WIDTH, Legend
from taichi_sand.view.text import LINE_SIZE, TITLE_SIZE, Placed, in_lines, number_text, shortened, text_tile

LEAST, MOST = 0.7, 2.0
MARGIN = 16
LINE_STEP = 18
BETWEEN = "  ·  "
BAR_SHARE = 0.1
"""The scale bar is the largest round length that is not above this part of the picture's width."""
BAR_LEAST_WIDTH = 240
"""Narrower pictures [px] have no scale bar."""
LEGEND_WIDTH, LEGEND_HEIGHT, LEAST_LEGEND = 96, 6, 40
SHADE = 0.72
"""How much of what lies under the text is hidden, so that it can be read over grains."""

ARROW_HIGH = 11
"""Height of an arrow that shows what arrows stand for [px]."""
SHADE_STEP = 32
"""The patch under the text grows by so many pixels, so that it does not follow every digit."""


@lru_cache(maxsize=16)
def shade_tile(width: int, height: int, soft: int, ground: str = palette.GROUND) -> np.ndarray:
    """A patch of the ground colour that fades out over its last `soft` pixels to the sides and below."""
    across = np.minimum(np.arange(width) + 0.5, np.arange(width, 0, -1) - 0.5) / soft
    down = (np.arange(height, 0, -1) - 0.5) / soft
    cover = SHADE * np.minimum(1.0, down)[:, None] * np.minimum(1.0, across)
    return (np.rint(255 * cover).astype(np.uint32) << 24) | np.uint32(palette.packed(ground))


@lru_cache(maxsize=16)
def arrow_tile(length: int, colour: str) -> np.ndarray:
    """An arrow to the right."""
    mask = Image.new("L", (4 * length, 4 * ARROW_HIGH))
    draw, tip, middle = ImageDraw.Draw(mask), 4 * length - 3, 2 * ARROW_HIGH
    head = min(1.6 * ARROW_HIGH, 0.5 * tip)
    for start in ((0, middle), (tip - head, middle - 0.6 * head), (tip - head, middle + 0.6 * head)):
        draw.line([start, (tip, middle)], fill=255, width=6)
    small = np.asarray(mask.resize((length, ARROW_HIGH), Image.Resampling.BOX), np.uint32)
    return (small << 24) | np.uint32(palette.packed(colour))


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


class Caption:
    """Lays captions over canvases of one size. `scale`: px/m; `size`: of the text over that of TITLE_SIZE and LINE_SIZE, by default as the
    picture is wide; `ground`: what it is painted on.
    """

    def __init__(self, width: int, height: int, scale: float, size: float | None = None, ground: str = "dark") -> None:
        self.width, self.height, self.ground = width, height, palette.GROUNDS[ground]
        self.size = size or min(MOST, max(LEAST, width / REFERENCE_WIDTH))
        self.rescale(scale)

    def rescale(self, scale: float) -> None:
        """The picture shows a metre as `scale` pixels now."""
        self.bar = round_length(BAR_SHARE * self.width / scale)
        self.bar_width = round(self.bar * scale)

    def draw(
        self, canvas: np.ndarray, title: str, facts: Sequence[str], legend: Legend | None, arrows: Sequence[tuple[str, float, str]] = ()
    ) -> int:
        """Lays the caption over `canvas`; `facts` stand in one line, or in more where the picture is too narrow. `arrows`: colour, length
        [px] and meaning of what is drawn as arrows. Returns where it ends [px].
        """
        parts = self.parts(title, facts, legend, arrows)
        laid = [tile for part in parts for tile in self._backed(part)]
        spans = np.array([(x, y, tile.shape[1], tile.shape[0]) for x, y, tile in laid], np.int32).reshape(-1, 4)
        if laid:
            paint_tiles(canvas, self.width, self.height, spans, np.concatenate([tile.ravel() for _, _, tile in laid]))
        return max((y + tile.shape[0] for part in parts for _, y, tile in part), default=0)

    def parts(
        self, title: str, facts: Sequence[str], legend: Legend | None, arrows: Sequence[tuple[str, float, str]] = ()
    ) -> tuple[list[Placed], list[Placed]]:
        """The tiles of the text at the left, and of the scale bar and arrows at the right; none lies on another."""
        margin, step = self._px(MARGIN), self._px(LINE_STEP)
        right = self._scale_tiles(margin) + self._arrow_tiles(margin, arrows) if self.width >= BAR_LEAST_WIDTH else []
        room = min([self.width] + [x for x, _, _ in right]) - 2 * margin
        tiles: list[Placed] = []
        y = self._px(0.7 * MARGIN)
        for line in in_lines(title, self._px(TITLE_SIZE), room) if title else []:
            tiles.append((margin, y, text_tile(line, self._px(TITLE_SIZE), self.ground.text)))
            y += self._px(LINE_STEP + 6)
        for row in self._lines([shortened(fact, self._px(LINE_SIZE), room) for fact in facts], room):
            tiles += self._row(row, margin, y)
            y += step
        if legend:
            tiles += self._legend_tiles(legend, margin, y, room)
        return tiles, right

    def _px(self, length: float) -> int:
        """Whole pixels of a length that is meant for a picture REFERENCE_WIDTH wide."""
        return max(1, round(length * self.size))

    def _tile(self, text: str) -> np.ndarray:
        """Tile of dim text."""
        return text_tile(text, self._px(LINE_SIZE), self.ground.dim)

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

    def _legend_tiles(self, legend: Legend, x: int, y: int, room: int) -> list[Placed]:
        """Name of the view, and its colours between the ends of the range: shorter, and below the name, where there is no room."""
        high, gap, start = self._px(LEGEND_HEIGHT), self._px(8), x
        name, low, top = (self._tile(text) for text in (legend.name, "0", f"{number_text(legend.top)} {legend.unit}".rstrip()))
        placed = [(x, y, name)]
        ends = low.shape[1] + top.shape[1] + 2 * gap
        if name.shape[1] + gap + ends + LEAST_LEGEND <= room:
            x += name.shape[1] + gap
        else:
            y += self._px(LINE_STEP)
        wide = max(1, min(self._px(LEGEND_WIDTH), room - ends - (x - start)))
        shown = legend.colours[np.linspace(0, len(legend.colours) - 1, wide).round().astype(int)]
        for part, drop in ((low, 0), (solid_tile(wide, high, shown), self._px(0.62 * LINE_SIZE) - high // 2), (top, 0)):
            placed.append((x, y + drop, part))
            x += part.shape[1] + gap
        return placed

    def _scale_tiles(self, margin: int) -> list[Placed]:
        """A white bar with its length below, at the right."""
        label = self._tile(length_text(self.bar))
        wide = max(self.bar_width, label.shape[1])
        middle, y = self.width - margin - wide // 2, self._px(1.3 * MARGIN)
        bar = solid_tile(self.bar_width, self._px(2), palette.packed(self.ground.text))
        return [(middle - self.bar_width // 2, y, bar), (middle - label.shape[1] // 2, y + self._px(7), label)]

    def _arrow_tiles(self, margin: int, arrows: Sequence[tuple[str, float, str]]) -> list[Placed]:
        """An arrow and what it stands for, one below the other, under the scale bar."""
        placed, y = [], self._px(1.3 * MARGIN + 7 + LINE_STEP)
        for colour, length, text in arrows:
            label, shaft = self._tile(text), arrow_tile(min(round(length), self.width // 4), colour)
            x = self.width - margin - label.shape[1]
            placed += [(x, y, label), (x - shaft.shape[1] - self._px(6), y + (label.shape[0] - shaft.shape[0]) // 2, shaft)]
            y += self._px(LINE_STEP)
        return placed

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
        return [(max(start, edge), edge, shade_tile(wide, bottom, soft, self.ground.colour)), *tiles]
