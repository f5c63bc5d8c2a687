"""A monkey at the window: random keys, strokes, sliders and buttons, ten a second, until something breaks or the time is over.

`python tests/monkey.py MINUTES [SCENE]` plays as long as one likes and prints what came of it.
"""

import contextlib
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from playing import Playing

PER_SECOND = 10.0
RARE = {"m": 0.01, "[": 0.01, "]": 0.01, "Escape": 0.1, "f": 0.1, "p": 0.1}
"""How often a key is pressed, against the others: other solvers and scenes are compiled, films and pictures fill the disk, and two esc in
turn would close the window."""
NAMES = {" ": "space", ".": "period", ",": "comma", "-": "minus", "=": "equal", "[": "bracketleft", "]": "bracketright", "Home": "Home"}
PAGE = 2**20
LONGEST = 180.0
"""Time in which the window must have done all that it was told [s]: other effects and solvers are compiled."""
BEHIND = 1.0
"""Where the window has shown nothing for so long [s], the monkey waits for it, as what it is told piles up while something is compiled;
then it catches up."""


def memory(window: Playing) -> float:
    """What the window's process holds [MB]."""
    pages = Path(f"/proc/{window.process.pid}/statm").read_text().split()[1]
    return int(pages) * 4096 / PAGE


def act(window: Playing, chance: random.Random, keys: list[str], weights: list[float]) -> None:
    """One thing that a monkey might do."""
    scene = window.now["scene"]
    if window.read()["scene"] != scene:
        window.find()
    what = chance.random()
    left, top, width, height = window.now["picture"]
    if what < 0.35:
        key = chance.choices(keys, weights)[0]
        if key == "Escape":  # another key answers to the question whether to quit
            window.tool("key", "Escape", "key", "h", "key", "h")
        else:
            window.tool("key", NAMES.get(key, key))
    elif what < 0.7:
        words: list[Any] = []
        for _ in range(3):
            x, y = left + chance.random() * width, top + chance.random() * height
            words += ["mousemove", "--window", window.window, round(x), round(y)]
            words += ["mousedown", chance.choice((1, 1, 2, 3))] if len(words) == 5 else []
        window.tool(*words, "mouseup", 1, "mouseup", 2, "mouseup", 3)
    elif what < 0.8:
        wheel = ("click", chance.choice((4, 5)))
        window.tool(*chance.choice((wheel, ("keydown", "shift", *wheel, "keyup", "shift"))))
    else:
        name, (x, y, wide, high) = chance.choice(list(window.now["controls"].items()))
        hidden = not 0 <= y < window.now["window"][1] - high
        if hidden or name in ("md", "rigid") or (wide < 100 and chance.random() > 0.02):  # switches compile at times
            return
        place = ["mousemove", "--window", window.window, round(x + chance.random() * wide), round(y + high / 2)]
        window.tool(*place, "mousedown", 1, *place[:3], round(x + chance.random() * wide), round(y + high / 2), "mouseup", 1)


def another(window: Playing, key: str) -> None:
    """Another scene, which opens a window of its own."""
    window.fresh(LONGEST)
    before = window.now["scene"]
    window.tool("key", key)
    window.until(lambda now: now["scene"] != before, LONGEST)
    window.find()


def play(window: Playing, seconds: float, keys: list[str], seed: int = 1, scenes: int = 0) -> dict[str, Any]:
    """Plays for so long, and has the scene changed so many times meanwhile; what the window said at the end, and by how much more memory it
    held at most in the last third of the time than in the first [MB]: it rises and falls with the structures that are kept ready, and with
    what can be undone.
    """
    chance = random.Random(seed)
    weights = [RARE.get(key, 1.0) for key in keys]
    start, events, changed, peaks = time.monotonic(), 0, 0, [0.0, 0.0, 0.0]
    while (passed := time.monotonic() - start) < seconds:
        with contextlib.suppress(subprocess.CalledProcessError):  # the window is gone: why is told below
            if passed > (changed + 1) / (scenes + 1) * seconds:
                changed += 1
                waited = time.monotonic()
                another(window, chance.choice(("bracketleft", "bracketright")))
                start += time.monotonic() - waited  # what is compiled is not played
            act(window, chance, keys, weights)
        events += 1
        if time.time() - window.file.stat().st_mtime > BEHIND:
            waited = time.monotonic()
            window.fresh(LONGEST)
            start += time.monotonic() - waited
        if window.process.poll() is not None:
            raise AssertionError(f"the window closed with {window.process.returncode}: {window.process.stderr.read()}")
        third = int(3 * passed / seconds)
        peaks[third] = max(peaks[third], memory(window))
        time.sleep(max(0.0, start + events / PER_SECOND - time.monotonic()))
    window.to(0.5, 0.5)
    window.fresh(LONGEST)
    return {**window.now, "events": events, "peaks": [round(peak) for peak in peaks], "grown": peaks[2] - peaks[0]}


if __name__ == "__main__":
    from taichi_sand.play.keys import KEYS

    with tempfile.TemporaryDirectory() as folder, Playing(Path(folder), *(sys.argv[2:] or ["pile"])) as monkeys_window:
        minutes = float(sys.argv[1])
        told = play(monkeys_window, 60 * minutes, [key.key for key in KEYS], scenes=round(minutes))
        shown = ("events", "time", "grains", "kinetic_energy_J", "speed_max_m_s", "solver", "flags", "unphysical", "undo", "peaks", "grown")
        print({name: told[name] for name in shown}, flush=True)
        print("exit", monkeys_window.close(LONGEST), monkeys_window.process.stderr.read())
