"""The page that shows states in a browser: its two files, and the colours that it takes from here."""

import json
from functools import cache
from importlib import resources
from typing import Any

from taichi_sand.view import kernels, paint, palette, wet
from taichi_sand.view.planes import ABSENT, ASLEEP, LAST, LEVELS
from taichi_sand.view.views import VIEWS

SCRIPT, DATA = "/* SCRIPT */", "<!-- DATA -->"
"""Where in the page its script and what it shows are put."""


def table(colours: Any) -> str:
    """A colour map as text, six digits an entry."""
    return "".join(f"{int(colour):06x}" for colour in colours)


@cache
def style() -> dict[str, Any]:
    """Colours, widths and codes, for JSON."""
    maps = {name: table(palette.colour_map(view.stops)) for name, view in VIEWS.items() if view.stops}
    maps |= {"chains": table(palette.colour_map(palette.CHAIN)), "water": table(palette.colour_map(palette.WATER))}
    return {
        "maps": maps,
        "units": {name: view.unit for name, view in VIEWS.items()} | {"chains": "N"},
        "ground": palette.GROUND,
        "fixed": palette.FIXED,
        "bond": palette.BOND,
        "foam": palette.FOAM,
        "dim": palette.CHAIN_GRAIN,
        "shown": palette.SHOWN_RADIUS,
        "spoke": [kernels.SPOKE_LIGHTNESS, kernels.SPOKE_LENGTH, kernels.SPOKE_WIDTH, *kernels.SPOKE_RADII],
        "spoked": list(paint.SPOKED),
        "wall": paint.WALL_WIDTH,
        "width": paint.REFERENCE_WIDTH,
        "chain": [*paint.CHAIN_WIDTHS, *paint.CHAIN_WIDEST_GRAIN],
        "bar": paint.BOND_WIDTH,
        "wet": [paint.BEHIND, paint.OVER],
        "darkness": wet.DARKNESS,
        "wet_views": paint.WET_VIEWS,
        "levels": LEVELS,
        "last": LAST,
        "bits": {"asleep": ASLEEP, "absent": ABSENT},
    }


def in_page(thing: Any) -> str:
    """JSON that may stand within a script element of a page, whatever texts are in it."""
    return json.dumps(thing, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c").replace("\u2028", "\\u2028")


@cache
def page() -> tuple[str, str]:
    """The page, its script in its place, in two parts: before and after what it shows."""
    folder = resources.files("taichi_sand.view") / "page"
    script = (folder / "page.js").read_text("utf-8")
    before, after = (folder / "page.html").read_text("utf-8").split(DATA)
    return before, after.replace(SCRIPT, script)
