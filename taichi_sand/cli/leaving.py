"""How the command ends: what went wrong in one sentence, an exit status, and nothing lost of what it had to say.

Exit status: 0 done, 1 the physics failed a check, 2 wrong input or a full disk, 130 interrupted, 143 terminated, 141 nobody reads on.
"""

import codecs
import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

import typer

from taichi_sand.errors import PhysicsError, SandError

NOBODY_READS = 128 + 13
PLAIN = {
    **{"μ": "u", "α": "alpha", "β": "beta", "ζ": "zeta", "ψ": "psi", "π": "pi", "κ": "kappa"},
    **{"→": "->", "×": "x", "·": "-", "±": "+-", "–": "-", "—": "-", "−": "-", "…": "...", "≤": "<=", "≥": ">=", "√": "sqrt ", "°": " deg"},
    **{"²": "2", "³": "3", "“": '"', "”": '"', "‘": "'", "’": "'", "█": "#", "━": "-", "─": "-", "│": "|"},
}  # fmt: skip
"""What a terminal that knows no such letters gets to see."""


class Terminated(KeyboardInterrupt):
    """The system wants the command to end; it does as after Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


@contextmanager
def in_one_sentence() -> Iterator[None]:
    """Turns what a user can put right into one sentence on stderr and an exit status."""
    try:
        yield
    except SandError as error:
        _leave(2, f"error: {error}")
    except PhysicsError as error:
        _leave(1, f"failed: {error}")
    except OSError as error:
        if error.filename is None:
            raise
        _leave(2, f"error: {error.filename}: {error.strerror}")
    except Terminated as stop:
        _leave(128 + stop.number, "terminated")
    except KeyboardInterrupt:
        _leave(130, "interrupted")


def _leave(status: int, text: str) -> None:
    print(f"taichi-sand: {text}", file=sys.stderr)
    raise typer.Exit(status)


def plain(error: UnicodeError) -> tuple[str, int]:
    """Error handler of codecs: letters that an encoding has not, in those that all have."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


class Out(io.TextIOWrapper):
    """stdout that ends the process where nobody reads it, or where it cannot be written down."""

    def write(self, text: str) -> int:
        """As of any text file."""
        return self._surely(super().write, text)

    def flush(self) -> None:
        """As of any text file."""
        self._surely(super().flush)

    def _surely(self, act: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return act(*arguments)
        except OSError as error:
            with suppress(OSError, ValueError):  # what is still waiting goes nowhere, so that Python does not try again at its end
                os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if not isinstance(error, BrokenPipeError):
                print(f"taichi-sand: error: stdout: {error.strerror}", file=sys.stderr)
            raise SystemExit(NOBODY_READS if isinstance(error, BrokenPipeError) else 2) from None


def prepare() -> None:
    """Before the command: whoever ends it is answered as Ctrl-C is, and whatever it says can be said."""
    codecs.register_error("taichi_sand.plain", plain)
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors="taichi_sand.plain")
    if isinstance(sys.stdout, io.TextIOWrapper):
        encoding, by_line = sys.stdout.encoding, sys.stdout.line_buffering
        sys.stdout = Out(sys.stdout.detach(), encoding, "taichi_sand.plain", line_buffering=by_line)
        sys.__stdout__ = sys.stdout  # Taichi takes two different ones for a notebook
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:  # not under nohup
            signal.signal(number, _terminate)


def _terminate(number: int, frame: Any) -> NoReturn:
    raise Terminated(number)


def run(command: Callable[[], Any]) -> None:
    """Runs a command of click, which ends the process."""
    prepare()
    try:
        command()
    finally:
        if sys.stdout is not None:
            sys.stdout.flush()
