"""Colours of look.md, and colour maps as tables of 256 packed colours (0xRRGGBB)."""

import re
from typing import NamedTuple

import numpy as np

GROUND = "#14161A"
TEXT = "#E6E8EB"
DIM_TEXT = "#9AA3AD"
PANEL = "#1E2229"
FIXED = "#6C7A89"
SAND = ("#E8C98A", "#D9B36C", "#C99B55", "#B9854A")
KINDS = ("#E8C98A", "#4C9BE0", "#D5602B", "#2FA67E", "#C77BB0", "#F2E24B", "#8B6FE8", "#8A9A5B")
"""Of several kinds of grains: after sand in the order and hues of Okabe and Ito (2008), so that those who see fewer colours tell them apart
too; by their lightness as well.
"""
COLD = "#2B5DA8"
HOT = "#F2542D"
BOND = "#6B4A2B"
WATER = ("#3F96C9", "#2B78AE", "#1D5C8F", "#164873", "#11385C")
FOAM = "#DCEFF7"
CHAIN_GRAIN = "#343840"
FRINGES = ("#1D232B", "#9FB4A0", "#F6F3DC")
CHAIN = ("#5B3A1E", "#FF7A18", "#FFE9C4")

# 17 even points of matplotlib's maps; between them a straight line is at most 5/255 off. Inferno starts at 20 %: below, a grain
# could not be told from the ground.
INFERNO = "420A68 57106E 6A176E 7F1E6C 932667 A82E5F BC3754 CC4248 DD513A EA632A F37819 F98E09 FCA50A FBBE23 F6D746 F1EF75 FCFFA4"
VIRIDIS = "440154 48186A 472D7B 424086 3B528B 33638D 2C728E 26828E 21918C 1FA088 28AE80 3FBC73 5EC962 84D44B ADDC30 D8E219 FDE725"
DRY_TO_WET = "E8C98A D9B878 C2A066 A88850 8A6A3F 6F6B62 5C7D96 4FA3D1"
# A periodic spline in OKLab through sand, orange, violet and blue: light faces dark, so that hue is not needed to read it.
CYCLIC = "F4E3BE FFD69D FFBE76 FFA056 E9824C C8675B A5526F 854384 6E3F97 5E4BA8 5163B8 4883C6 4FA3D1 72C0D8 A1D6DA D0E3D2 F4E3BE"

ENTRIES = 256
SHOWN_RADIUS, LIGHTNESS_SPREAD = 0.985, 0.07
"""Part of a disc's radius that is painted, so that neighbours stay apart; and by how much grains of a tone are lighter or darker."""


class Ground(NamedTuple):
    """What a picture is painted on, and the colours of text on it."""

    colour: str
    text: str
    dim: str


GROUNDS = {"dark": Ground(GROUND, TEXT, DIM_TEXT), "light": Ground("#FFFFFF", "#14161A", "#4A525C")}
"""The light one is for slides and print."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green, blue (0..255) of '#RRGGBB' or '#RGB'; the hash may be left out."""
    digits = colour.strip().lstrip("#")
    if not re.fullmatch(r"[0-9A-Fa-f]{3}|[0-9A-Fa-f]{6}", digits):
        raise ValueError(f"'{colour}' is not a colour; write it as '#RRGGBB', for example '{HOT}'")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    return int(digits[0:2], 16), int(digits[2:4], 16), int(digits[4:6], 16)


def pack(colours: np.ndarray) -> np.ndarray:
    """0xRRGGBB of colours of shape (..., 3) in 0..255, rounded."""
    whole = np.clip(np.rint(colours), 0, 255).astype(np.uint32)
    return (whole[..., 0] << 16) | (whole[..., 1] << 8) | whole[..., 2]


def packed(colour: str) -> int:
    """0xRRGGBB of a hex colour."""
    return int(pack(np.array(rgb(colour))))


def colour_map(stops: str | tuple[str, ...]) -> np.ndarray:
    """Table through evenly spaced stops, straight in sRGB; u32, shape (256,)."""
    points = np.array([rgb(stop) for stop in (stops.split() if isinstance(stops, str) else stops)], float)
    places = np.linspace(0.0, len(points) - 1.0, ENTRIES)
    return pack(np.stack([np.interp(places, np.arange(len(points)), points[:, k]) for k in range(3)], axis=1))


def blend_map(cold: str, hot: str) -> np.ndarray:
    """Table from one colour to another, mixed as light is (linear in intensity), which keeps the middle from going dull."""
    ends = (np.array([rgb(cold), rgb(hot)]) / 255.0) ** 2.2
    share = np.linspace(0.0, 1.0, ENTRIES)[:, None]
    return pack(255.0 * ((1.0 - share) * ends[0] + share * ends[1]) ** (1.0 / 2.2))
