"""Parameters that an effect declares: they give its table in the scene file ranges, defaults and errors in words."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from taichi_sand.errors import SandError, show, suggest


@dataclass(frozen=True)
class Parameter:
    """One number, switch or choice of an effect.

    The type of `default` is the type of the parameter: a float takes any number, an int a whole one, a bool true or false, a str
    one of `choices` (any text if there are none), None a number that the effect finds itself unless the scene names it.
    """

    name: str
    default: float | bool | str | None
    help: str  # one line, for --help, sliders and errors
    unit: str = ""
    low: float | None = None  # lowest and highest value allowed, both included
    high: float | None = None
    choices: tuple[str, ...] | None = None
    live: bool = True  # may change while the simulation runs
    decades: bool = False  # a change by a factor matters, not by a sum: its slider is logarithmic

    def wrong(self, value: Any) -> str:
        """Returns what is allowed if `value` is not, else ""."""
        if isinstance(self.default, bool):
            return "" if isinstance(value, bool) else "must be true or false"
        if isinstance(self.default, str):
            return self._wrong_text(value)
        return self._wrong_number(value)

    def _wrong_text(self, value: Any) -> str:
        if not isinstance(value, str):
            return "must be a text in quotes"
        if self.choices and value not in self.choices:
            return f"must be one of {', '.join(self.choices)}{suggest(value, self.choices)}"
        return ""

    def _wrong_number(self, value: Any) -> str:
        whole = isinstance(self.default, int)
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
            return "must be a whole number" if whole else "must be a number"
        try:
            finite = math.isfinite(value)
        except OverflowError:  # a Python int beyond the range of floats
            finite = False
        if not finite:
            return "must be a finite number"
        unit = f" {self.unit}" if self.unit else ""
        below = self.low is not None and value < self.low
        above = self.high is not None and value > self.high
        if (below or above) and None not in (self.low, self.high):
            return f"must lie in {show(self.low)} … {show(self.high)}{unit}"
        if below:
            return f"must be at least {show(self.low)}{unit}"
        return f"must be at most {show(self.high)}{unit}" if above else ""


def check_table(where: str, table: Mapping[str, Any], parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Checks a table of the scene against the parameters that an effect declares, and fills in defaults.

    Args:
        where: file and table, such as "pile.toml: effects.friction"; stands in front of every error.
        table: the table as the scene has it.
        parameters: what the effect declares.

    Returns:
        A value for every parameter, in the order declared.

    Raises:
        SandError: an unknown key, a wrong type, a value out of range.
    """
    known = {parameter.name: parameter for parameter in parameters}
    key = where.rpartition(": ")[2]
    for name, value in table.items():
        if name not in known:
            raise SandError(
                f"{where}.{name} is not a known key{suggest(name, known)} (allowed: {', '.join(known) or 'none'})",
                f"{key}.{name}",
            )
        wrong = known[name].wrong(value)
        if wrong:
            raise SandError(f"{where}.{name} = {show(value)}: {wrong} ({known[name].help})", f"{key}.{name}")
    return {name: table.get(name, parameter.default) for name, parameter in known.items()}
