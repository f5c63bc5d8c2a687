"""JSON that everybody reads: null for a number that is none."""

import json
import math
from typing import Any


def as_line(thing: Any) -> str:
    """One line of JSON."""
    return json.dumps(finite(thing), separators=(",", ":"), allow_nan=False)


def as_text(thing: Any) -> str:
    """JSON to be read by people too."""
    return json.dumps(finite(thing), indent=2, allow_nan=False)


def finite(thing: Any) -> Any:
    """`thing` with None in the place of numbers that are not finite."""
    if isinstance(thing, dict):
        return {key: finite(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [finite(value) for value in thing]
    return None if isinstance(thing, float) and not math.isfinite(thing) else thing
