"""Text as small pictures, drawn by Pillow."""

import math
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from taichi_sand.view import palette

TITLE_SIZE, LINE_SIZE = 17, 12
"""Heights of the text [px] of a caption in a picture as wide as usual; they follow its width."""
Placed = tuple[int, int, np.ndarray]
"""A tile and where its left upper corner lies [px]."""
WORD_GAP = 0.3
"""Words are at least this much of the height of the text apart; the font's own space is hard to see in small text."""


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


def in_lines(text: str, size: int, room: int) -> list[str]:
    """Text in lines of at most `room` pixels, cut between words, and within a word that is longer."""
    first, *rest = text.split(" ")
    found = [first]
    for word in rest:
        longer = f"{found[-1]} {word}"
        if spaced(longer, size)[1] > room:
            found.append(word)
        else:
            found[-1] = longer
    return [shortened(line, size, room) for line in found]


def shortened(text: str, size: int, room: int) -> str:
    """As much of a text as goes into `room` pixels."""
    while len(text) > 1 and spaced(text, size)[1] > room:
        text = text[:-2] + "…"
    return text


def number_text(value: float) -> str:
    """Three digits, without an exponent where that can be read."""
    if not math.isfinite(value):
        return str(value)
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        return f"{float(f'{value:.3g}'):.10g}"
    digits, power = f"{value:.1e}".split("e")
    return f"{digits}e{int(power)}"
