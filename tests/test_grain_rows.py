"""A column of the grain table follows its grain, wherever that goes: through sorts, sleep, waking and removals; new grains start at 0."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_sand.world.extras.grain_rows import CLEARED, COLUMNS, NUMBERS, NUMBERS_AT_REST, WHOLE, WHOLE_AT_REST

ROOT = Path(__file__).parents[1]
RADIUS = "    radius: Annotated[Any, Column()]"
COLUMN = "    mark: Annotated[Any, Column()]  # a number that a grain keeps for itself\n"
RUN = """
import numpy as np
import taichi_sand as sand
from taichi_sand.world.extras.grain_rows import NUMBERS
assert sand.__file__.startswith({folder!r})
scene = sand.Scene(size=[0.3, 0.3], grains=[{{"radius": [0.004, 0.006], "count": 300}}], seed=3, solver={{"kind": "rigid"}},
                   effects={{"friction": {{}}, "sleeping": {{"time": 0.1}}}})
sim = sand.Simulation(scene, threads=1, room=10)
world = sim.world
def marks():
    count = world.count[None]
    ids, found = world.grains.id.to_numpy()[:count], world.grains.mark.to_numpy()[:count]
    return dict(zip(ids.tolist(), found.tolist()))
start = world.grains.mark.to_numpy()
start[: world.count[None]] = 0.5 + world.grains.id.to_numpy()[: world.count[None]]
world.grains.mark.from_numpy(start)
wanted = marks()
sim.advance(2.0)
assert int(world.sleep.state[None].asleep) > 100
assert marks() == wanted
sim.remove(sim.ids[:40])
wanted = {{key: value for key, value in wanted.items() if key in set(sim.ids.tolist())}}
new = sim.add([[0.15, 0.28]], radius=0.005)
sim.advance(0.5)
assert marks() == wanted | {{int(new[0]): 0.0}}
print("held")
"""


def test_a_row_is_made_of_its_columns() -> None:
    """What goes along and what is cleared are all there is, each once, and places in the scratch have no gaps."""
    names = list(COLUMNS)
    going = {names[part.column] for part in WHOLE + NUMBERS}
    assert going == {name for name, column in COLUMNS.items() if column.lasts}
    resting = {names[part.column] for part in WHOLE_AT_REST + NUMBERS_AT_REST}
    cleared = {names[index] for index in CLEARED}
    assert resting | cleared == {name for name, column in COLUMNS.items() if not column.clumps} and not resting & cleared
    for parts in (WHOLE, NUMBERS, WHOLE_AT_REST, NUMBERS_AT_REST):
        assert [part.place for part in parts] == list(range(len(parts)))


@pytest.mark.slow
def test_a_new_column_is_one_line(tmp_path: Path) -> None:
    """The package with one line more: 300 discs settle, fall asleep, are woken as some are taken out, one comes; all keep their numbers."""
    shutil.copytree(ROOT / "taichi_sand", tmp_path / "taichi_sand", ignore=shutil.ignore_patterns("__pycache__"))
    file = tmp_path / "taichi_sand" / "world" / "extras" / "grain_rows.py"
    text = file.read_text("utf-8")
    assert text.count(RADIUS) == 1
    file.write_text(text.replace(RADIUS, COLUMN + RADIUS), "utf-8")
    run = RUN.format(folder=str(tmp_path))
    paths = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", run], cwd=tmp_path, capture_output=True, text=True, check=False, env=paths)
    assert done.returncode == 0 and done.stdout.split()[-1] == "held", done.stderr[-2000:]
