"""The examples run, and what they show is right."""

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "TI_LOG_LEVEL": "warn"}

MINIMAL = """
import json, sys
sys.path.insert(0, sys.argv[1])
import numpy as np
import minimal_md as md

def start(count, x, v=None, w=None):
    discs = md.Discs(count)
    r = discs.r.to_numpy()
    discs.x.from_numpy(np.array(x(r), np.float32))
    if v is not None:
        discs.v.from_numpy(np.array(v, np.float32))
    if w is not None:
        discs.w.from_numpy(np.array(w, np.float32))
    return discs, md.DENSITY * np.pi * r**2

found = {}
discs, mass = start(1, lambda r: [[0.25, r[0]]])
discs.steps(10000)
sunk = discs.r.to_numpy()[0] - discs.x.to_numpy()[0, 1]
found["overlap"] = float(sunk * md.STIFFNESS / (mass[0] * 9.81))

discs, mass = start(2, lambda r: [[0.25 - r[0], 0.4], [0.25 + r[1] + 1e-5, 0.4]], v=[[5, 0], [-5, 0]])
discs.steps(100)
found["restitution"] = float(np.diff(discs.v.to_numpy()[:, 0])[0] / 10)

discs, mass = start(1, lambda r: [[0.25, r[0]]], w=[-20.0])
discs.steps(8000)
found["spin"] = float(discs.w.to_numpy()[0] / -20)
found["speed"] = float(discs.v.to_numpy()[0, 0] / (20 * discs.r.to_numpy()[0]))

discs, mass = start(2, lambda r: [[0.2, 0.4], [0.216, 0.404]], v=[[1, 0], [-1, 0]])
before = (mass[:, None] * discs.v.to_numpy()).sum(0)
discs.steps(300)
fallen = np.array([0, -9.81 * 300 * md.STEP])
found["momentum"] = float(abs((mass[:, None] * (discs.v.to_numpy() - fallen)).sum(0) - before).max() / mass.sum())
found["turned"] = float(abs(discs.w.to_numpy()).min())
print(json.dumps(found))
"""


def python(*words: str | Path, folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, *map(str, words)], cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_minimal_method_is_short_and_paints_a_bed(tmp_path: Path) -> None:
    assert len((EXAMPLES / "minimal_md.py").read_text("utf-8").splitlines()) < 120
    python(EXAMPLES / "minimal_md.py", "--discs", "60", "--seconds", "0.2", "-o", "bed.png", folder=tmp_path)
    assert Image.open(tmp_path / "bed.png").size == (500, 800)


def test_the_minimal_method_is_right(tmp_path: Path) -> None:
    """Overlap at rest m g / k; restitution of a clipped spring and dashpot at a ratio of 0.3 (physics.md A1); a spin drop ends at a third
    (A5); what two discs do to one another leaves their momentum (A15).
    """
    (tmp_path / "check.py").write_text(MINIMAL)
    found = json.loads(python("check.py", EXAMPLES, folder=tmp_path).splitlines()[-1])
    assert found["overlap"] == pytest.approx(1, rel=2e-3)
    assert found["restitution"] == pytest.approx(0.451, abs=0.02)  # at a twentieth of the contact a step
    assert found["spin"] == pytest.approx(1 / 3, rel=2e-3) and found["speed"] == pytest.approx(1 / 3, rel=2e-3)
    assert found["momentum"] < 1e-5 and found["turned"] > 1


def test_the_scan_of_tolerances(tmp_path: Path) -> None:
    few = ("--scale", "0.1", "--seconds", "1.5", "--tolerances", "0.02", "0.005", "--csv", "scan.csv")
    python(EXAMPLES / "scan_tolerance.py", *few, folder=tmp_path)
    rows = list(csv.DictReader((tmp_path / "scan.csv").open(encoding="utf-8")))
    assert [(row["solver"], float(row["tolerance"])) for row in rows] == [(kind, x) for kind in ("rigid", "md") for x in (0.02, 0.005)]
    for row in rows:
        assert 0 < float(row["overlap_p99"]) <= float(row["tolerance"])
    for wide, narrow in (rows[:2], rows[2:]):
        assert float(narrow["step_s"]) == pytest.approx(float(wide["step_s"]) / 2, rel=0.3)


def test_the_whirl_is_the_effect_of_the_tutorial(tmp_path: Path) -> None:
    """The same statements; the example has docstrings besides. tests/test_effects.py says that they do what they should."""

    def statements(text: str) -> list[str]:
        plain = re.sub(r'^\s*""".*?"""\n', "", text, flags=re.DOTALL | re.MULTILINE)
        return [line for line in plain.splitlines() if line.strip() and not line.startswith("#")]

    tutorial = (ROOT / "docs" / "tutorial" / "effect.md").read_text("utf-8")
    shown = re.search(r"```python\n# whirl\.py\n(.*?)```", tutorial, re.DOTALL)
    assert shown
    assert statements((EXAMPLES / "whirl.py").read_text("utf-8")) == statements(shown[1])


def test_the_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is kept without outputs, runs from top to bottom, and finds what grains do: those that interlock heap up steeper."""
    for name, value in ENVIRONMENT.items():
        monkeypatch.setenv(name, value)
    book = nbformat.read(EXAMPLES / "angle_of_repose.ipynb", 4)
    cells = [cell for cell in book.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in cells)
    NotebookClient(book, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    text = "".join(out.get("text", "") for cell in cells for out in cell.outputs)
    speed = re.search(r"the fastest grain has (\S+) sqrt", text)
    angles = {shape: float(angle) for shape, angle in re.findall(r"(disc|triangle) +([\d.]+) ±", text)}
    assert speed and float(speed[1]) < 0.02
    assert 8 < angles["disc"] < angles["triangle"] - 2 < 40
    assert any("image/png" in out.get("data", {}) for cell in cells for out in cell.outputs)


def test_the_first_measurement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is kept without outputs, runs from top to bottom, and finds what is known: a heap has a slope (physics.md B4), walls bear most of
    a silo (B1), and forces are spread about exponentially above their mean.
    """
    for name, value in ENVIRONMENT.items():
        monkeypatch.setenv(name, value)
    book = nbformat.read(EXAMPLES / "first_measurement.ipynb", 4)
    cells = [cell for cell in book.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in cells)
    NotebookClient(book, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    text = "".join(out.get("text", "") for cell in cells for out in cell.outputs)
    found = [
        re.search(words, text)
        for words in (r"repose ([\d.]+) deg", r"of the weight: ([\d.]+)", r"exp\((-[\d.]+) f\)", r"; ([\d.]+) of the")
    ]
    angle, share, slope, below = (float(one[1]) for one in found if one)
    assert 8 < angle < 30 and share < 0.7 and -2.5 < slope < -0.7 and 0.5 < below < 0.75
    assert sum("image/png" in out.get("data", {}) for cell in cells for out in cell.outputs) == 3


def test_the_map_of_repose_angles(tmp_path: Path) -> None:
    """A heap of few grains is steeper with friction than nearly without (physics.md B4)."""
    (tmp_path / "small.py").write_text(
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from pathlib import Path\n"
        "import repose_map\n"
        "if __name__ == '__main__':\n"
        "    repose_map.main(Path('map'), 1, '0.02,0.8', '0.02,0.1', ('grains[1].count=200', 'grains[2].count=200', 'duration=2.5'))\n"
    )
    python("small.py", EXAMPLES, folder=tmp_path)
    rows = list(csv.DictReader((tmp_path / "map" / "sweep.csv").open(encoding="utf-8")))
    angle = {(row["effects.rolling.mu"], row["effects.friction.mu"]): float(row["repose_angle"]) for row in rows}
    assert angle["0.1", "0.8"] > angle["0.02", "0.02"] + 3
    assert Image.open(tmp_path / "map" / "repose_map.png").size[0] > 400
