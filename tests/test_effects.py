"""The mechanism of effects: what is off is not there, what is on with neutral values changes nothing, a user's own works the same way."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import Disc, simulate

import taichi_sand as sand
from taichi_sand import effects
from taichi_sand.errors import SandError
from taichi_sand.study.cost import price

ROOT = Path(__file__).parents[1]
SOLVERS = {"md": {"kind": "md", "restitution": 0.3}, "rigid": {"kind": "rigid"}}
BYTES_OF_A_LIVE_PARAMETER = 4

RUN = """
import json, sys
import taichi_sand as sand
from taichi_sand.world.checkpoint import read_field
sys.path.insert(0, sys.argv[1])
from helpers import digest
found = {}
for kind in ("md", "rigid"):
    scene = sand.Scene(size=[0.2, 0.2], grains=[{"radius": [0.004, 0.006], "count": 60}], solver={"kind": kind},
                       effects={"friction": {"mu": 0.5}}, seed=5)
    sim = sand.Simulation(scene, threads=1)
    sim.advance(0.1)
    size = sum(a.nbytes for field in sim._fields().values() for a in read_field(field).values())
    found[kind] = [digest(sim), size, sorted(m for m in sys.modules if m.startswith("taichi_sand.effects."))]
    del sim
print(json.dumps(found))
"""


def test_off_is_as_if_it_were_not_there(tmp_path: Path) -> None:
    """A scene with friction gives the same bits, and tables of the same size, in a package without the files of all other effects;
    none of them is imported.
    """
    shutil.copytree(ROOT / "taichi_sand", tmp_path / "taichi_sand", ignore=shutil.ignore_patterns("__pycache__"))
    for path in (tmp_path / "taichi_sand" / "effects").glob("*.py"):
        if path.stem not in ("__init__", "base", "friction"):
            path.unlink()
    shutil.rmtree(tmp_path / "taichi_sand" / "effects" / "water")
    found = []
    for folder in (ROOT, tmp_path):
        done = _run(folder, [sys.executable, "-c", RUN, str(ROOT / "tests")], folder)
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout))
    assert found[0] == found[1]
    assert found[0]["md"][2] == found[0]["rigid"][2] == ["taichi_sand.effects.base", "taichi_sand.effects.friction"]


def _run(folder: Path, command: list[str], package: Path = ROOT) -> subprocess.CompletedProcess:
    """Runs a command in `folder` with the package that lies in `package`."""
    paths = {**os.environ, "PYTHONPATH": str(package)}
    return subprocess.run(command, cwd=folder, env=paths, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", SOLVERS)
def test_neutral_values_change_nothing(name: str) -> None:
    """Every effect on, with values that mean nothing: 40 discs fall and collide as without them, to rounding.

    A rigid contact that just touches is taken or not by the last bit, which the next step shows: there only 20 steps are compared.
    """
    rng = np.random.default_rng(3)
    discs = [Disc(0.012 * (k % 8 + 1) + rng.uniform(-5e-4, 5e-4), 0.012 * (k // 8 + 1), spin=rng.normal()) for k in range(40)]
    ends = []
    neutral = {effect: effects.find(effect).neutral for effect in effects.fitting(name) if effect != "friction"}
    # a longer reach lists more pairs, and Gauss-Seidel then takes them in another order
    neutral["cohesion"] = {"bond_number": 0.0, "rupture": 0.001}
    assert len(neutral) >= 4
    for more in ({}, neutral):
        sim = simulate(discs, (0.11, 0.11), SOLVERS[name], gravity=(0, -9.81), effects={"friction": {"mu": 0.4}, **more})
        sim.advance_steps(round(0.05 / sim.step) if name == "md" else 20)
        ends.append(np.column_stack([sim.positions, sim.velocities, sim.spins]))
        del sim
    assert np.abs(ends[0] - ends[1]).max() < 1e-9


def test_misfit_names_what_fits() -> None:
    path = ROOT / "tests" / "own_effects" / "only_md.py"
    scene = {"size": [1, 1], "grains": [{"radius": 0.01, "count": 2}], "solver": {"kind": "rigid"}}
    effects.add(path)
    try:
        with pytest.raises(SandError, match=r"effects\.only_md: does not fit the rigid solver, only md; what fits rigid: .*drag, friction"):
            effects.check(sand.Scene(**scene, effects={"only_md": {}}))
    finally:
        del effects.own["only_md"]


HEAD = "from taichi_sand.effects import Effect\n\n\nclass Own(Effect):\n    "
WRONG = {
    "no_such.py": (None, "there is no such Python file"),
    "Big.py": ("", "cannot be its name"),
    "drag.py": ("", "cannot be its name"),
    "base.py": ("parameters = ()", r"it must define one class that derives from taichi_sand\.effects\.Effect, not 0"),
    "broken.py": ("PARAMETERS = (1 +", "cannot be imported: SyntaxError"),
    "listed.py": (HEAD + "parameters = [1]", "`parameters` must be a tuple"),
    "other.py": (HEAD + 'solvers = ("sph",)', "`solvers` must name those it fits"),
    "bare.py": ("from taichi_sand.effects import Effect", "must define one class that derives from .*, not 0"),
    "two.py": (HEAD + "pass\n\n\nclass More(Effect):\n    pass", "must define one class that derives from .*, not 2"),
    "misspelt.py": (
        HEAD + "def on_pauze(self, world, solver): ...",
        r"effect Own: there is no hook `on_pauze`; did you mean `on_pause`\? \(a method of its own begins with _\)",
    ),
    "called.py": (HEAD + "def body(self, w, i): ...", r"effect Own: the hook `body` takes \(w, c, i\), not \(w, i\)"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_files_are_told(name: str, tmp_path: Path) -> None:
    text, sentence = WRONG[name]
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(SandError, match=sentence):
        effects.add(tmp_path / name)
    assert not effects.own


@pytest.mark.parametrize("hook", [None, "friction_bound"])
def test_an_effect_without_a_hook_is_told(hook: str | None, tmp_path: Path) -> None:
    """One that has none, and one that has only such as the other solver calls."""
    path = tmp_path / "idle.py"
    path.write_text(HEAD + (f"def {hook}(self, w, c, p, wall, normal): ..." if hook else "pass"))
    effects.add(path)
    try:
        with pytest.raises(SandError, match=r"idle has no hook that the md solver calls; there are: normal, tangent, "):
            effects.build("idle", {}, (), "md")
    finally:
        del effects.own["idle"]


def example() -> tuple[str, str]:
    """Name and text of the effect that the tutorial shows."""
    found = re.search(r"```python\n# (\w+)\.py\n(.*?)```", (ROOT / "docs" / "tutorial" / "effect.md").read_text("utf-8"), re.DOTALL)
    assert found
    return found[1], found[2]


def test_the_example_of_the_tutorial(tmp_path: Path) -> None:
    """Under 30 lines; on with `--effect`, set with `--set`, does what it says: discs circle about the middle of the box."""
    name, text = example()
    assert len(text.splitlines()) < 30
    (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "scene.toml").write_text("size = [1, 1]\ngravity = [0, 0]\n[[grains]]\nradius = 0.01\npositions = [[0.7, 0.5]]\n")
    command = [sys.executable, "-m", "taichi_sand", "run", "scene.toml", "--effect", f"{name}.py", "--set", f"effects.{name}.strength=3"]
    done = _run(tmp_path, [*command, "--seconds", "0.1", "--json"])
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["effects"] == [name]
    assert report["speed_max_m_s"] == pytest.approx(0.3, rel=0.02)
    done = _run(tmp_path, [*command[:-1], f"effects.{name}.strength=-1"])
    assert done.returncode == 2 and "strength = -1: must lie in 0 … 100 m/s2" in done.stderr


def test_inventory_and_prices() -> None:
    """What is on is listed with its loops, its live parameters and the bytes by which the tables grow; what is off, with nothing."""
    scene = sand.Scene(size=[0.2, 0.2], grains=[{"radius": 0.005, "count": 40}], effects={"friction": {}, "rolling": {"mu": 0.2}})
    sims = [sand.Simulation(s, threads=1) for s in (scene, scene.model_copy(update={"effects": {"friction": {}}}))]
    rows = {row["name"]: row for row in price.inventory(sims[0])}
    assert rows["drag"] == {"name": "drag", "on": False}
    assert rows["rolling"]["live"] == {"mu": 0.2} and rows["rolling"]["loops"] == ["pairs, twice"]
    assert rows["rolling"]["bytes"] == price.table_bytes(sims[0]) - price.table_bytes(sims[1]) - BYTES_OF_A_LIVE_PARAMETER > 0
    assert rows["friction"]["bytes"] == 0
    assert set(price.variants(scene)) >= {"", "-friction", "-rolling", "+drag"}
    only = scene.model_copy(update={"effects": {}})
    assert "-rolling" not in price.variants(only)
