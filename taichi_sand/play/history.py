"""What can be undone: the moments before each stroke and each change of a parameter."""

from collections.abc import Iterable

from taichi_sand.play.snapshot import Snapshot

MOST_STEPS = 200
MOST_BYTES = 2**28
"""All kept moments take at most so much together, but for the last, which is always there; the oldest go first. A moment of 10000 grains
takes some 4 MB, of 100000 some 40."""


class History:
    """Two stacks of moments: before what was done, and after what was undone."""

    def __init__(self) -> None:
        self.past: list[Snapshot] = []
        self.future: list[Snapshot] = []

    def keep(self, moment: Snapshot) -> None:
        """Something is about to be done at this moment; what was undone before cannot be done again."""
        self.past.append(moment)
        self.future.clear()
        while len(self.past) > MOST_STEPS or (len(self.past) > 1 and self.bytes() > MOST_BYTES):
            self.past.pop(0)

    def forget(self) -> None:
        """Nothing can be undone."""
        self.past.clear()
        self.future.clear()

    def back(self, now: Snapshot) -> Snapshot | None:
        """The moment before what was done last; None if there is none."""
        return self._move(self.past, self.future, now)

    def forth(self, now: Snapshot) -> Snapshot | None:
        """The moment after what was undone last; None if there is none."""
        return self._move(self.future, self.past, now)

    @staticmethod
    def _move(source: list[Snapshot], target: list[Snapshot], now: Snapshot) -> Snapshot | None:
        if not source:
            return None
        target.append(now)
        return source.pop()

    def last(self) -> Snapshot | None:
        """The moment kept last, with which a new one may share tables."""
        return self.past[-1] if self.past else None

    def bytes(self) -> int:
        """Room that all moments take, tables that they share counted once."""
        return bytes_of((*self.past, *self.future))


def bytes_of(moments: Iterable[Snapshot]) -> int:
    """Room that moments take, tables that they share counted once."""
    return sum({id(rows): rows.rows.nbytes for moment in moments for rows in moment.fields.values()}.values())
