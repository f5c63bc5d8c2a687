"""Which hooks an effect has. An effect is anything with some of them: solvers and world know nothing else of it."""

from typing import Any


def offers(effect: Any, name: str) -> bool:
    """Whether the effect has the hook `name`; one that is only declared (effects.base) it has not."""
    hook = getattr(effect, name, None)
    return hook is not None and not hasattr(hook, "declared_for")
