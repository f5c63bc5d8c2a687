"""What the commands have in common: options, and a bar that shows how far they are."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from taichi_sand.errors import SandError

SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="Path of a scene file, or name of a bundled scene.")]
Seconds = Annotated[float | None, typer.Option("--seconds", help="Simulated seconds; else the scene's duration.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Any scene key by dotted path, such as solver.kind=md; repeatable."),
]
Effects = Annotated[
    list[Path] | None,
    typer.Option("--effect", metavar="FILE", help="Python file with an effect of your own, which is then on; repeatable."),
]
Arch = Annotated[Literal["cpu", "cuda", "vulkan", "metal", "gpu"], typer.Option("--arch", help="Where kernels run.")]
Threads = Annotated[int | None, typer.Option("--threads", min=1, help="CPU threads; results do not depend on it.")]
Precision = Annotated[int | None, typer.Option("--precision", metavar="32|64", help="Bits of a number in the solver.")]


TOLD_EVERY = 30.0
"""Seconds between two lines of progress where there is no terminal: a log of a night says how far it came, in a thousand lines."""


@contextmanager
def progress_bar(label: str, more: Callable[[], str] = str) -> Iterator[Callable[[float], None]]:
    """What is to be told the share done: a bar on stderr while that is a terminal, else a line there now and then, for logs. What `more`
    gives meanwhile stands behind the label.
    """
    if not sys.stderr.isatty():
        yield lines(label, more)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=1.0)
        yield lambda share: bar.update(task, completed=share, description=label + more())


def lines(label: str, more: Callable[[], str]) -> Callable[[float], None]:
    """Prints how far it is, and how long the rest will take at the pace so far, every `TOLD_EVERY` seconds. Where that cannot be written,
    to a full disk or to nobody, work goes on all the same.
    """
    began = told = time.monotonic()

    def tell(share: float) -> None:
        nonlocal told
        now = time.monotonic()
        if now < told + TOLD_EVERY or share >= 1:
            return
        told = now
        left = f", some {(now - began) * (1 / share - 1):.0f} s to go" if share > 0 else ""
        with suppress(OSError):
            print(f"{label}{more()}: {share:.0%}{left}", file=sys.stderr, flush=True)

    return tell


def settings(overrides: list[str] | None, precision: int | None, **flags: Any) -> list[str]:
    """What `--set` gives, and flags that stand for a key each; None = not given."""
    named = {"solver.precision": precision, **flags}
    return [*(overrides or ()), *(f"{key}={value}" for key, value in named.items() if value is not None)]


def check_seconds(seconds: float | None) -> None:
    """SandError unless it is a number of seconds, or none was given."""
    if seconds is not None and not (0 <= seconds < math.inf):
        raise SandError(f"--seconds {seconds:g} must be a number of seconds, 0 or more")
