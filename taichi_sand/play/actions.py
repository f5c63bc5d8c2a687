"""What an action of a session looks like: a recording may come from anybody."""

from typing import Any

from taichi_sand.play.calls import fits
from taichi_sand.play.chapter import LOOKS
from taichi_sand.play.tools import TOOLS
from taichi_sand.play.verbs import VERBS

FARTHEST, LARGEST = 1e9, 1e30
"""Places and motions of the hand, and values that are set, are within this, either way: kernels have 32 bits for them."""
NUMBER = (int, float)
ARGUMENTS: dict[str, tuple] = {
    **dict.fromkeys(("mark", "undo", "redo", "reset", "snap"), ()),
    **dict.fromkeys(("choose", "solver", "open", "load", "default"), (str,)),
    **{"set": (str, NUMBER), "effect": (str, bool), "look": (str, (str, bool)), "opened": (bool,), "kind": (int,)},
    **{"rewinding": (bool,), "back": (NUMBER,)},
    "call": (str, dict),
    "stroke": (str, NUMBER, NUMBER, NUMBER, NUMBER, bool),
}
"""What each verb is given; a stroke may do without its last three."""
CHOICES: dict[str, Any] = {
    "choose": TOOLS,
    "solver": ("md", "rigid"),
    "stroke": ("press", "drag", "release"),
    "look": {*LOOKS, "cold", "hot"},
}


def is_action(action: Any) -> bool:
    """Whether something is an action as `do` takes it: a verb, and arguments of the kinds that it needs."""
    if not isinstance(action, list) or not action or not isinstance(action[0], str) or action[0] not in VERBS:
        return False
    verb, *given = action
    kinds = ARGUMENTS[verb][: len(given)] if verb == "stroke" and len(given) >= 3 else ARGUMENTS[verb]
    if len(kinds) != len(given):
        return False
    for kind, value in zip(kinds, given, strict=True):
        if not isinstance(value, kind) or (isinstance(value, bool) and kind in (NUMBER, int)):
            return False
        if kind is NUMBER and not abs(value) <= (LARGEST if verb == "set" else FARTHEST):
            return False
    if verb == "look" and type(given[1]) is not type(LOOKS.get(given[0], "")):
        return False
    if verb == "call":
        return fits(*given)
    return verb not in CHOICES or given[0] in CHOICES[verb]
