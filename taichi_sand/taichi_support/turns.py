"""One at a time: Taichi knows neither threads nor interrupts, so whoever works with it takes a turn.

A turn is a lock, which a thread may take again while it has it. Within one of the main thread a signal waits whose handler is a Python
function (Ctrl-C raises KeyboardInterrupt in one): raised amid Taichi's own Python code it would leave that in pieces. It is dealt with when
the turn ends, where all is as it should be.
"""

import contextlib
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

SIGNALS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGINT") if hasattr(signal, name)]
"""That wait; the last is let through last."""
LOOK, COURTESY = 0.1, 1e-4
"""Somebody who waits for a turn looks after signals so often; who ends one while others wait leaves them so much time [s]."""


class Turn:
    """The turn of a process. `with turn:` takes it."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.depth = 0  # how often the thread that has it has taken it
        self.owner: int | None = None
        self.waiting = 0  # threads
        self.holding = False  # whether signals wait
        self.handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self.pending: dict[int, FrameType | None] = {}

    def __enter__(self) -> None:
        if self.owner == threading.get_ident():
            self.depth += 1
            return
        main = threading.current_thread() is threading.main_thread()
        if main:
            self._hold()
        if not self.lock.acquire(blocking=False):
            self._wait(main)
        self.owner, self.depth = threading.get_ident(), 1

    def __exit__(self, *_: object) -> None:
        if self.owner != threading.get_ident():  # it has ended already: what a signal raised came out of `pause`
            return
        self.depth -= 1
        if self.depth:
            return
        self.owner = None
        self.lock.release()
        if self.waiting:
            time.sleep(COURTESY)
        if self.holding and threading.current_thread() is threading.main_thread():
            self._let_through()

    def pause(self) -> None:
        """Within a turn, where all is as it should be: signals that wait are dealt with, and others get theirs."""
        if self.depth == 1 and (self.pending or self.waiting):
            self.__exit__()
            self.__enter__()

    def _wait(self, main: bool) -> None:
        """Until others have ended theirs; a signal ends the waiting."""
        self.waiting += 1
        try:
            while not self.lock.acquire(timeout=LOOK):
                if main and self.pending:
                    self._let_through()  # may raise
                    self._hold()
        finally:
            self.waiting -= 1

    def _hold(self) -> None:
        """From now on signals wait."""
        self.holding = True
        for number in reversed(SIGNALS):
            handler = signal.getsignal(number)
            if callable(handler) and handler != self._note:
                self.handlers[number] = handler
                with contextlib.suppress(ValueError):  # in an interpreter that is not the main one
                    signal.signal(number, self._note)

    def _let_through(self) -> None:
        """Signals have their own handlers again, which get those that have come meanwhile."""
        for number in SIGNALS:
            if signal.getsignal(number) == self._note:
                signal.signal(number, self.handlers[number])
        self.holding = False
        pending, self.pending = self.pending, {}
        for number, frame in pending.items():
            self.handlers[number](number, frame)

    def _note(self, number: int, frame: FrameType | None) -> None:
        """The handler while signals wait."""
        if self.holding:
            self.pending[number] = frame
        else:
            self.handlers[number](number, frame)

    def after_fork(self) -> None:
        """In a child process nobody has it."""
        held, self.holding = self.holding, False
        if held:
            self._let_through()
        self.lock, self.depth, self.owner, self.waiting = threading.RLock(), 0, None, 0


turn = Turn()
