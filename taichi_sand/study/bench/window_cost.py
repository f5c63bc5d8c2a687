"""What the window costs; part of the benchmark. It needs a display: `xvfb-run` gives one where there is none."""

import statistics
import time
from pathlib import Path
from typing import Any

PICTURES, SECONDS = 120, 8.0


def opened(count: int, width: int) -> Any:
    """A window on the `settle` scene with `count` grains, at rest; one CPU thread."""
    from taichi_sand import load
    from taichi_sand.play.window.opening import Opening
    from taichi_sand.play.window.sheet import LEAST_TEXT
    from taichi_sand.play.window.window import Window

    window = Window(Opening(load("settle", [f"scale={count / 1000}"]), "settle", width, LEAST_TEXT), Path(), threads=1)
    while window.session.sim.time < 1.0:
        window.frame()
    return window


def showing(count: int, width: int) -> dict[str, float]:
    """ms of CPU time to paint a picture with all that goes over it, without and with the numbers, and to show it."""
    window = opened(count, width)
    found = {}
    for name, hud in (("plain", False), ("numbers", True)):
        window.session.look["hud"] = hud
        window.stale = True
        times = []
        for _ in range(PICTURES):
            window.frame()
            start = time.process_time()
            window.show()
            times.append(time.process_time() - start)
        found[name] = 1e3 * statistics.median(times)
    return found


def real_time(count: int, width: int) -> dict[str, float]:
    """Frames a second (median), and simulated over wall time."""
    window = opened(count, width)
    start, before, frames = time.perf_counter(), window.session.sim.time, []
    window.tick()
    while time.perf_counter() - start < SECONDS:
        window.tick()
        frames.append(window.frame_time)
    passed = time.perf_counter() - start
    return {"frames": 1 / statistics.median(frames), "factor": (window.session.sim.time - before) / passed}
