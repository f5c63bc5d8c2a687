"""Drives the real window: Xvfb for a display, xdotool for mouse and keys, the window's own report for what came of it."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest
from PIL import ImageGrab

import taichi_sand as sand

NEEDED = ("Xvfb", "xdotool")
PATIENCE = 60.0
"""How long the window may take to come to what it was asked for: a busy machine is no failure [s]."""
CLOSE = """
import ctypes, sys
class Message(ctypes.Structure):
    _fields_ = [("type", ctypes.c_int), ("serial", ctypes.c_ulong), ("send", ctypes.c_int), ("display", ctypes.c_void_p),
                ("window", ctypes.c_ulong), ("kind", ctypes.c_ulong), ("format", ctypes.c_int), ("data", ctypes.c_long * 5),
                ("room", ctypes.c_long * 24)]
x = ctypes.CDLL("libX11.so.6")
x.XOpenDisplay.restype = ctypes.c_void_p
x.XInternAtom.restype, x.XInternAtom.argtypes = ctypes.c_ulong, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int]
x.XSendEvent.argtypes = [ctypes.c_void_p, ctypes.c_ulong, ctypes.c_int, ctypes.c_long, ctypes.c_void_p]
x.XSync.argtypes = [ctypes.c_void_p, ctypes.c_int]
display, window = x.XOpenDisplay(None), int(sys.argv[1])
kind, close = (x.XInternAtom(display, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW"))
message = Message(33, 0, 1, display, window, kind, 32, (ctypes.c_long * 5)(close, 0))
x.XSendEvent(display, window, 0, 0, ctypes.byref(message))
x.XSync(display, 0)
"""
"""What a window manager sends when the close button is pressed."""


def need_a_display() -> None:
    """Where the tools are missing, CI fails and others skip."""
    missing = [name for name in NEEDED if not shutil.which(name)]
    if missing:
        text = f"{' and '.join(missing)} must be installed to drive the window"
        if os.environ.get("CI") == "true":
            pytest.fail(text)
        pytest.skip(text)


class Playing:
    """`taichi-sand play` in a process and on a display of its own."""

    def __init__(self, folder: Path, *arguments: str, threads: int = 1) -> None:
        need_a_display()
        self.folder, self.file = folder, folder / "report.jsonl"
        self.server = subprocess.Popen(
            ["Xvfb", "-displayfd", "1", "-screen", "0", "1600x1000x24", "-nolisten", "tcp", "-noreset"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        number = self.server.stdout.readline().decode().strip()
        paths = {"PYTHONPATH": str(Path(sand.__file__).parents[1])}
        self.environment = {**os.environ, **paths, "DISPLAY": f":{number}"}
        command = [sys.executable, "-m", "taichi_sand", "play", *arguments, "--report", str(self.file), "--folder", str(folder)]
        self.process = subprocess.Popen(
            [*command, "--threads", str(threads)], env=self.environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.now: dict[str, Any] = {}
        try:
            self.until(lambda now: now["grains"] >= 0, 120)
            self.find()
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.server.terminate()
        self.server.wait()

    def find(self) -> None:
        """Looks for the window, which another scene opens anew; keys go to the window under the mouse."""
        end, found = time.monotonic() + PATIENCE, []
        while not found and time.monotonic() < end:  # --sync at times waits for ever
            found = self.tool("search", "--name", "^taichi_sand", wrong=True).split()
        self.window = found[-1]
        self.to(0.5, 0.5)

    def tool(self, *words: object, wrong: bool = False) -> str:
        """xdotool; `wrong`: it may fail."""
        return subprocess.run(
            ["xdotool", *map(str, words)], env=self.environment, check=not wrong, capture_output=True, text=True, timeout=30
        ).stdout

    def read(self) -> dict[str, Any]:
        """The newest line of the report."""
        if self.file.exists():
            lines = self.file.read_text().split("\n")
            if len(lines) > 1:
                self.now = json.loads(lines[-2])
        return self.now

    def until(self, holds: Callable[[dict[str, Any]], Any], patience: float = PATIENCE) -> dict[str, Any]:
        """Waits for the report to say what is asked for."""
        end = time.monotonic() + patience
        while time.monotonic() < end:
            now = self.read()
            if now and holds(now):
                return now
            if self.process.poll() is not None:
                raise AssertionError(f"the window closed with {self.process.returncode}: {self.process.stderr.read()}")
            time.sleep(0.02)
        raise AssertionError(
            f"the window never came to what was asked for; it says { ({k: v for k, v in self.now.items() if k != 'controls'}) }"
        )

    def fresh(self, patience: float = PATIENCE) -> dict[str, Any]:
        """A line of the report that was written after this call; the mouse is moved a little, so that a paused window writes one."""
        size = self.file.stat().st_size
        self.tool("mousemove_relative", "--", 1, 0, "mousemove_relative", "--", -1, 0)
        return self.until(lambda _: self.file.stat().st_size > size, patience)

    def key(self, *names: str) -> None:
        """Presses keys, as xdotool calls them."""
        for name in names:
            self.tool("key", name)
            time.sleep(0.04)

    def to(self, x: float, y: float) -> None:
        """Moves the mouse to a point of the picture, in parts of its width and height, y up."""
        left, top, width, height = self.now["picture"]
        self.tool("mousemove", "--window", self.window, round(left + x * width), round(top + (1 - y) * height))
        time.sleep(0.06)

    def press(self, button: int = 1) -> None:
        """Presses a mouse button."""
        self.tool("mousedown", button)
        time.sleep(0.06)

    def release(self, button: int = 1) -> None:
        """Lets it go."""
        self.tool("mouseup", button)
        time.sleep(0.06)

    def stroke(self, *points: tuple[float, float], button: int = 1) -> None:
        """A stroke through points of the picture."""
        self.to(*points[0])
        self.press(button)
        for point in points[1:]:
            self.to(*point)
        self.release(button)

    def click(self, control: str, share: float = 0.5, drag_to: float | None = None) -> None:
        """Clicks on a control of the panel, at this part of its width; or drags from there."""
        left, top, width, height = self.seen(control)
        self.tool("mousemove", "--window", self.window, round(left + share * width), round(top + 0.5 * height))
        time.sleep(0.06)
        self.press()
        if drag_to is not None:
            for part in (0.3, 0.7, 1.0):
                x = share + part * (drag_to - share)
                self.tool("mousemove", "--window", self.window, round(left + x * width), round(top + 0.5 * height))
                time.sleep(0.06)
        self.release()

    def seen(self, control: str) -> list[int]:
        """Where a control is: they move when others come and go. Scrolled out of the window, it is scrolled into it."""
        for _ in range(40):
            left, top, width, height = self.fresh()["controls"][control]
            high, (wide, scrolled, _) = self.now["window"][1], self.now["panel"]
            if (0 <= top and top + height <= high) or left < wide:
                break
            self.tool("mousemove", "--window", self.window, wide + 4, 300)
            self.tool("click", 5 if top > 0 else 4)
            self.until(lambda now, before=scrolled: now["panel"][1] != before)
        return [left, top, width, height]

    def switched(self, key: str) -> dict[str, Any]:
        """Presses a key that changes how it looks; what the window says when it shows that."""
        before = self.now["look"], self.now["help"]
        self.tool("key", key)
        return self.until(lambda now: (now["look"], now["help"]) != before)

    def settled(self, strip: bool = False) -> np.ndarray:
        """What the display shows of a picture that stands still, when all input has come through."""
        self.fresh()
        return self.shot(strip)

    def shot(self, strip: bool = False) -> np.ndarray:
        """What the display shows of the picture, (height, width, 3) uint8; with what is above and below it if `strip`."""
        left, top, width, height = self.now["picture"]
        if strip:
            top, height = 0, self.now["window"][1]
        where = dict(line.split("=") for line in self.tool("getwindowgeometry", "--shell", self.window).split())
        left, top = left + int(where["X"]), top + int(where["Y"])
        box = (left, top, left + width, top + height)
        return np.asarray(ImageGrab.grab(box, xdisplay=self.environment["DISPLAY"]).convert("RGB"))

    def close(self, patience: float = PATIENCE) -> int:
        """Closes the window as its close button does; the exit status."""
        subprocess.run([sys.executable, "-c", CLOSE, self.window], env=self.environment, check=True, timeout=30)
        return self.process.wait(patience)
