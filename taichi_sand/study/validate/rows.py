"""What a reference case is made of: rows of what is known beside what was measured."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A number that is known, what was measured, and how far off it may be."""

    what: str
    reference: float
    measured: float
    within: float

    @property
    def error(self) -> float:
        """Distance from the reference."""
        return abs(self.measured - self.reference)

    @property
    def passed(self) -> bool:
        """Whether it is near enough; what is no number is not."""
        return self.error <= self.within


@dataclass(frozen=True)
class Case:
    """A case of the ladder; `quick` ones take seconds."""

    name: str
    source: str
    rows: Callable[[str], list[Row]]
    kinds: tuple[str, ...] = ("md", "rigid")
    quick: bool = True
