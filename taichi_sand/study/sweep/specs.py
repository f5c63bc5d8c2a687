"""What `--vary KEY=SPEC` means: a list (`0.1,0.2`), a range (`0..1:5`), a logarithmic one (`log:0.001..0.1:5`), or words (`md,rigid`)."""

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from typing import Any

from taichi_sand.errors import SandError, show

RANGE = re.compile(r"(log:)?([^:,]+?)\.\.([^:,]+):(\d+)")
FORMS = "`0.1,0.2,0.5`, `0..1:5`, `log:0.001..0.1:5` or words such as `md,rigid`"
MOST_VALUES = 100_000
DIGITS = 12
"""Values of a range are rounded to so many digits: 0.1 is then 0.1, whatever the steps before it added up to."""


def parse(text: str) -> tuple[str, list[Any]]:
    """Key and values of one `KEY=SPEC`; SandError if it cannot be read."""
    key, equals, spec = text.partition("=")
    key = key.strip()
    if not equals or not key or not spec.strip():
        raise SandError(f"--vary {show(text)} must read KEY=SPEC, SPEC being {FORMS}")
    return key, values_of(key, spec.strip())


def values_of(key: str, spec: Any) -> list[Any]:
    """The values that a SPEC, or any sequence of values, stands for; SandError if there are none or one comes twice."""
    if isinstance(spec, str):
        match = RANGE.fullmatch(spec.replace(" ", ""))
        found = spread(key, *match.groups()) if match else [value_of(part) for part in split(spec)]
    elif isinstance(spec, Iterable) and not isinstance(spec, Mapping):
        found = [getattr(value, "tolist", lambda value=value: value)() for value in spec]
    else:
        raise SandError(f"vary {key}: {show(spec)} must be a list of values, or a text such as {FORMS}")
    if not found or "" in found:
        raise SandError(f"vary {key}: {show(spec)} holds an empty value; write {FORMS}")
    if len({repr(value) for value in found}) < len(found):
        raise SandError(f"vary {key}: {show(spec)} names a value twice")
    return found


def split(spec: str) -> list[str]:
    """The parts between commas, but for commas within brackets."""
    return [part.strip() for part in re.split(r",(?![^\[\]]*\])", spec)]


def value_of(text: str) -> Any:
    """A value as TOML has it; a word is a text."""
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return table["value"] if list(table) == ["value"] else text


def spread(key: str, log: str | None, low: str, high: str, count: str) -> list[float]:
    """So many values from `low` to `high`, evenly or, after `log:`, by equal ratios."""
    try:
        ends = float(low), float(high)
    except ValueError:
        raise SandError(f"vary {key}: {show(f'{low}..{high}')} must run from a number to a number") from None
    many = int(count)
    if not all(map(math.isfinite, ends)) or not 2 <= many <= MOST_VALUES:
        raise SandError(f"vary {key}: a range takes two finite numbers and 2 to {MOST_VALUES} values, not {low}..{high}:{count}")
    if log and min(ends) <= 0:
        raise SandError(f"vary {key}: a logarithmic range needs numbers above 0, not {low}..{high}")
    shares = [k / (many - 1) for k in range(many)]
    if log:
        return [rounded(ends[0] * (ends[1] / ends[0]) ** share) for share in shares]
    return [rounded(ends[0] + share * (ends[1] - ends[0])) for share in shares]


def rounded(value: float) -> float:
    """To DIGITS digits."""
    return float(f"{value:.{DIGITS}g}")
