"""A browser without a screen for tests of pages: Debian's chromium, driven by playwright, drawing on the CPU."""

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
READY = "window.sand && sand.picture.frame"
ON_THE_CPU = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


def need_a_browser() -> str:
    """The browser's program. Where there is none, or no playwright, CI fails and others skip."""
    found = next((path for path in map(shutil.which, NAMES) if path), None)
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        found = None
    if found is None:
        text = "chromium and the Python package playwright must be installed to try pages"
        if os.environ.get("CI") == "true":
            pytest.fail(text)
        pytest.skip(text)
    return found


@contextmanager
def browser() -> Iterator[Any]:
    """A browser; its pages must not say anything on their consoles, and not fail: see `opened`."""
    program = need_a_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        one = play.chromium.launch(executable_path=program, args=ON_THE_CPU)
        try:
            yield one
        finally:
            one.close()


def until(page: Any, condition: str, seconds: float = 60.0) -> None:
    """Waits until something holds in a page. (playwright's own way to wait is not allowed by the page, which runs no texts as code.)"""
    end = time.monotonic() + seconds
    while not page.evaluate(f"() => Boolean({condition})"):
        assert time.monotonic() < end, condition
        page.wait_for_timeout(30)


@contextmanager
def opened(
    one: Any, url: str, size: tuple[int, int] = (1366, 768), ready: str = "window.sand && sand.picture.frame", **options: Any
) -> Iterator[Any]:
    """A page of this size [px] at this address, once `ready` holds; AssertionError if it complains, or asks for another address."""
    context = one.new_context(viewport={"width": size[0], "height": size[1]}, **options)
    page = context.new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on(
        "request",
        lambda asked: (
            said.append(asked.url)
            if not asked.url.startswith((url.split("?", maxsplit=1)[0].split("#", maxsplit=1)[0], "data:", "blob:"))
            else None
        ),
    )
    try:
        page.goto(url)
        until(page, ready)
        yield page
    finally:
        context.close()
    assert not [text for text in said if "GPU stall" not in text and "swiftshader" not in text.lower()]
