"""Shared by all tests: Taichi keeps quiet and keeps its cache of compiled kernels."""

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("NO_COLOR", "1")  # messages without control characters


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--arch cuda` runs tests/test_cells.py on a GPU."""
    parser.addoption("--arch", default="cpu", help="backend for the tests of the layout that a GPU runs on")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What slow.txt names is marked slow, beside what is marked in its own place."""
    lines = Path(__file__).with_name("slow.txt").read_text().splitlines()
    names = tuple(line for line in lines if line and not line.startswith("#"))
    for item in items:
        if item.nodeid.startswith(names):
            item.add_marker("slow")


@pytest.fixture(scope="module", autouse=True)
def nobody_elses_simulation() -> None:
    """Fixtures of another file may still hold theirs, on other threads or of other precision.

    What is there when a file begins, modules mostly, is looked at by no later collection of garbage: each test that makes a simulation
    has one, and it would take longer than the test.
    """
    from taichi_sand.study.laboratory import fresh_taichi

    fresh_taichi()
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def nobody_elses_effects() -> Iterator[None]:
    """Effects of a user's own that a test has loaded are gone after it."""
    yield
    if effects := sys.modules.get("taichi_sand.effects"):
        effects.own.clear()


@pytest.fixture(autouse=True)
def nobody_elses_turn() -> Iterator[None]:
    """Each test ends its turns and lets signals through: the interrupts of another one would be lost."""
    yield
    turns = sys.modules.get("taichi_sand.taichi_support.turns")
    if turns:
        turn = turns.turn
        state = {"depth": turn.depth, "owner": turn.owner, "waiting": turn.waiting, "pending": turn.pending}
        assert turn.owner is None and turn.depth == 0 and not turn.pending and signal.getsignal(signal.SIGINT) != turn._note, state


@pytest.fixture
def arithmetic_as_written(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Taichi starts afresh without leave to fuse products and sums, and afresh once more for whoever comes next."""
    from taichi_sand.study.laboratory import fresh_taichi
    from taichi_sand.taichi_support import runtime

    monkeypatch.setenv("TI_FAST_MATH", "0")
    fresh_taichi()
    runtime.forget()
    yield
    fresh_taichi()
    runtime.forget()


@pytest.fixture
def scene_file(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a scene file, `scene.toml` in a folder of its own, and returns its path."""

    def write(text: str | bytes) -> Path:
        path = tmp_path / "scene.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write
