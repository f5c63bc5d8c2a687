"""What the functions of a simulation are given: NumPy's numbers and arrays, lists, checked and named in errors."""

import math
from typing import Any

import numpy as np

from taichi_sand.errors import SandError, show
from taichi_sand.world.tables import MOST_STEPS

HUGE = 1e12
"""Numbers are no larger, as in scene files: 32 bits hold the square of a number, and the products made of it."""


def number(function: str, name: str, value: Any, low: float = -HUGE, high: float = HUGE, open_low: bool = False) -> float:
    """`value` as a number within these bounds, above the lower one if that is open; SandError if it is something else."""
    plain = value.item() if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0) else value
    if not isinstance(plain, int | float) or isinstance(plain, bool) or not low <= plain <= high or (open_low and plain == low):
        raise SandError(f"{function}: {name} = {show(plain)} must be a number {bounds(low, high, open_low)}".rstrip())
    return float(plain)


def bounds(low: float, high: float, open_low: bool = False) -> str:
    """In words."""
    if high < HUGE:
        return f"in {low:g} … {high:g}"
    if low > -HUGE:
        return f"greater than {low:g}" if open_low else f"of {low:g} or more"
    return f"within ±{HUGE:g}"


def array(function: str, name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """`value` as an array of this shape, one number or row standing for as many as are wanted; SandError if it is something else, or holds
    what is no finite number.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iuf":
            raise TypeError
        found = np.broadcast_to(given.astype(float), shape)
    except (TypeError, ValueError):
        raise SandError(f"{function}: {name} = {shown(value)} must be numbers of shape {shape}") from None
    wrong = ~np.isfinite(found) | (np.abs(found) > HUGE)
    if wrong.any():
        at = tuple(np.argwhere(wrong)[0])
        place = "".join(f"[{index}]" for index in at)
        raise SandError(f"{function}: {name}{place} = {show(float(found[at]))} must be a finite number within ±{HUGE:g}")
    return np.array(found)


def shown(value: Any) -> str:
    """A value, of an array its shape."""
    return f"an array of shape {value.shape}" if isinstance(value, np.ndarray) and value.ndim else show(value)


def whole(function: str, name: str, value: Any) -> np.ndarray:
    """`value` as a row of whole numbers; SandError if it is something else."""
    try:
        given = np.asarray(value)
        found = given.astype(np.int64)
        if given.ndim > 1 or (given.size and (given.dtype.kind not in "iu" or not (found == given).all())):
            raise TypeError
    except (TypeError, ValueError, OverflowError):
        raise SandError(f"{function}: {name} = {shown(value)} must be whole numbers") from None
    return np.atleast_1d(found)


def stretch(seconds: Any) -> float:
    """`seconds` as a number of seconds, 0 or more; SandError if it is something else."""
    number = isinstance(seconds, int | float | np.integer | np.floating) and not isinstance(seconds, bool)
    if not number or not 0 <= seconds < math.inf:
        raise SandError(f"advance({show(seconds)}): must be a number of seconds, 0 or more")
    return float(seconds)


def steps_of(count: Any) -> int:
    """`count` as a number of steps, 0 or more; SandError if it is something else."""
    if not isinstance(count, int | np.integer) or isinstance(count, bool) or not 0 <= count <= MOST_STEPS:
        raise SandError(f"advance_steps({show(count)}): must be a whole number of steps, 0 … {MOST_STEPS}")
    return int(count)
