"""What a window shows while kernels are compiled, and what it does then with the mouse and the keys."""

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.errors import SandError
from taichi_sand.play.window.shape import Shape
from taichi_sand.play.window.sheet import ACCENT, DIM, GROUND, IDLE, TEXT, Sheet, Type
from taichi_sand.view.text import spaced

UNSEEN = 0.15
"""What takes less [s] needs no bar."""
BAR = (280, 8)
GUESS = 24
"""So many kernels are made ready for a structure of which nothing is known."""


class CancelledError(SandError):
    """The user does not want to wait."""


class Waiting:
    """Counts kernels as they are compiled, and tells of them. Input is dropped meanwhile, but for keys and buttons that come up, which are
    kept in `kept`; esc cancels, where `free` says that all can be as it was.
    """

    def __init__(self, gui: Any, shape: Shape, type: Type, free: Callable[[], bool]) -> None:
        self.gui, self.shape, self.type, self.free = gui, shape, type, free
        self.kept: list[Any] = []
        self.expected: dict[str, int] = {}  # kernels that structures took before, by what is made ready
        self.begin("")

    def begin(self, what: str) -> None:
        """From now on `what` is made ready."""
        self.what, self.count, self.since, self.shown = what, 0, time.perf_counter(), False

    def end(self) -> None:
        """It is."""
        if self.count:
            self.expected[self.what] = self.count
        if self.shown and sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)
        self.begin("")

    def kernel(self, name: str) -> None:
        """A kernel is about to be compiled."""
        self.count += 1
        self._listen()
        if self.shown or time.perf_counter() - self.since > UNSEEN:
            self.show()

    def _listen(self) -> None:
        if not self.gui.running:
            if self.free():
                raise CancelledError("closed")
            return
        cancelled = False
        for event in list(self.gui.get_events()):
            if event.type == ti.GUI.RELEASE or event.key == ti.GUI.EXIT:
                self.kept.append(event)
            cancelled |= event.key == ti.GUI.ESCAPE and event.type == ti.GUI.PRESS
        if cancelled and self.free():
            raise CancelledError("cancelled")

    def text(self) -> str:
        """What is told."""
        total = max(self.expected.get(self.what, GUESS), self.count)
        return f"making {self.what or 'it'} ready: kernels {self.count} of {total}"

    def show(self) -> None:
        """A bar over what there was, and the same in a terminal."""
        self.shown = True
        self.draw(self.gui.img)
        if self.gui.running:
            self.gui.core.update()
        if sys.stderr.isatty():
            print(f"\r{self.text()}\033[K", end="", file=sys.stderr, flush=True)

    def draw(self, canvas: np.ndarray) -> None:
        """The bar."""
        sheet, text = Sheet(), self.text()
        total = max(self.expected.get(self.what, GUESS), self.count)
        wide = max(BAR[0], spaced(text, self.type.text)[1]) + 32
        left, top = (self.shape.wide - wide) // 2, self.shape.high // 2 - 40
        sheet.plate(left, top, wide, 72, GROUND, 6)
        sheet.text(left + 16, top + 10, text, self.type.text, TEXT)
        sheet.plate(left + 16, top + 34, wide - 32, BAR[1], IDLE, 4)
        sheet.plate(left + 16, top + 34, max(8, (wide - 32) * self.count / total), BAR[1], ACCENT, 4)
        sheet.text(left + 16, top + 48, "esc cancels" if self.free() else "", self.type.text, DIM)
        sheet.lay(canvas, *self.shape.size)
