"""What a page may say: lists [verb, arguments…], as the actions of a session are."""

from typing import Any

from taichi_sand.play.actions import FARTHEST, LARGEST, NUMBER, is_action

MESSAGES: dict[str, tuple] = {
    **dict.fromkeys(("cancel", "scene_file", "record", "help_out", "unrule"), ()),
    **dict.fromkeys(("press",), (NUMBER, NUMBER, bool)),
    **dict.fromkeys(("move", "release"), (NUMBER, NUMBER)),
    **dict.fromkeys(("key", "take", "scene", "default"), (str,)),
    "slide": (str, NUMBER),
    "value": (str, NUMBER),
    "grow": (int,),
    "inspect": (int,),
    "rule": (NUMBER, NUMBER, NUMBER, NUMBER),
    "plot": (str, bool),
    "upload": (str, int),
}
"""Verbs, and the kinds of their arguments: strokes of the hand [m], keys by their names, sliders by their keys and places 0 … 1."""
DONE = ("solver", "effect", "look", "choose", "rewinding", "back")
"""Actions of the session that a page asks for as they are: ["do", [verb, arguments…]]."""
LONGEST = 200
"""Letters of a text."""


def is_message(said: Any) -> bool:
    """Whether something is a message."""
    if not isinstance(said, list) or not said or not isinstance(said[0], str):
        return False
    verb, *given = said
    if verb == "do":
        return len(given) == 1 and is_action(given[0]) and given[0][0] in DONE
    kinds = MESSAGES.get(verb)
    most = LARGEST if verb == "value" else FARTHEST
    return kinds is not None and len(kinds) == len(given) and all(fits(kind, value, most) for kind, value in zip(kinds, given, strict=True))


def fits(kind: Any, value: Any, most: float) -> bool:
    """Whether an argument is of its kind, and a number no larger than `most`, a text no longer than LONGEST."""
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        return False
    if isinstance(value, str):
        return len(value) <= LONGEST
    return kind is bool or abs(value) <= most
