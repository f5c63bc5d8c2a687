"""Rewinding: moments that are kept while it is played, to go back to. Switched off it keeps none, and costs nothing."""

from taichi_sand.play.history import bytes_of
from taichi_sand.play.snapshot import Snapshot

EVERY = 0.5
"""Simulated time between two moments [s]."""
MOST_BYTES = 2**28
"""All of them take at most so much together; the oldest go first. 10000 grains take some 4 MB a moment."""


class Rewind:
    """The moments there are, by their times."""

    def __init__(self) -> None:
        self.on = False
        self.kept: list[tuple[float, Snapshot]] = []
        self.at = -1  # the one that was kept, or gone to, last

    def switch(self, on: bool) -> None:
        """Begins to keep moments, or forgets them."""
        self.on = on
        self.forget()

    def forget(self) -> None:
        """Lets go of all moments."""
        self.kept, self.at = [], -1

    def due(self, time: float) -> bool:
        """Whether another moment is to be kept at `time` [s]."""
        return self.on and (not self.kept or not 0 <= time - self.kept[self.at][0] < EVERY * (1 - 1e-9))

    def last(self) -> Snapshot | None:
        """The moment that a new one may share tables with."""
        return self.kept[self.at][1] if self.kept else None

    def keep(self, time: float, moment: Snapshot) -> None:
        """Keeps a moment; those that came later, before somebody went back, are no more."""
        self.kept = [*(one for one in self.kept[: self.at + 1] if one[0] < time), (time, moment)]
        while len(self.kept) > 1 and bytes_of(one for _, one in self.kept) > MOST_BYTES:
            self.kept.pop(0)
        self.at = len(self.kept) - 1

    def back(self, time: float) -> Snapshot | None:
        """The moment that is nearest to `time` [s], to be gone to; None if there is none."""
        if not self.kept:
            return None
        self.at = min(range(len(self.kept)), key=lambda k: abs(self.kept[k][0] - time))
        return self.kept[self.at][1]

    def times(self) -> list[float]:
        """Of the moments there are [s]."""
        return [time for time, _ in self.kept]
