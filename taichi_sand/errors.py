"""The two ways in which things go wrong for a user, and how they are put into words."""

import difflib
import math
from collections.abc import Iterable
from typing import Any


class SandError(Exception):
    """Wrong input. Its text is one sentence that says where, what, and what would be right; the command then exits with 2.

    `key` is the scene key it is about, as in `--set` (`grains[0].count`), or "" when it is about none.
    """

    def __init__(self, text: str, key: str = "") -> None:
        super().__init__(text)
        self.key = key


class PhysicsError(Exception):
    """The input was right but the physics failed a check; the command then exits with 1."""


LONGEST_WORD = 200
"""Of what somebody wrote, this much is compared with names: to look at a file of many MB that is one word takes all memory there is."""


def suggest(word: object, known: Iterable[str]) -> str:
    """Returns "; did you mean `x`?" for the name nearest to `word`, or "" if none is near."""
    near = difflib.get_close_matches(str(word)[:LONGEST_WORD], list(known), n=1, cutoff=0.5)
    return f"; did you mean `{near[0]}`?" if near else ""


def show(value: Any, most: int = 60) -> str:
    """Returns a value as a scene file would write it, cut to `most` characters."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str):
        text = '"' + value.replace("\n", "\\n") + '"'
    elif isinstance(value, float) and math.isfinite(value):
        text = f"{float(value):g}"
    elif isinstance(value, int) and value.bit_length() > 200:
        text = "a huge number"
    elif isinstance(value, list | tuple):
        text = "[" + ", ".join(show(item, most) for item in value[:8]) + (", …]" if len(value) > 8 else "]")
    elif isinstance(value, dict):
        text = "{ " + ", ".join(map(str, list(value)[:8])) + " }"
    else:
        text = str(value)
    return text if len(text) <= most else text[: most - 1] + "…"


class Wrong(ValueError):
    """What is wrong with a key of the table being checked; `text` follows the name of the key, which may be ""."""

    def __init__(self, name: str, text: str) -> None:
        super().__init__(text)
        self.name = name
