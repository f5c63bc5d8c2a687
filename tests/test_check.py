"""[[checks]] of scenes, and the command that holds scenes to them."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app
from taichi_sand.scene import loading
from taichi_sand.study.check.check import check

SCENE = """size = [0.2, 0.2]
duration = 0.5
[[grains]]
radius = 0.01
density = 1000.0
count = 10
"""
WEIGHT = 10 * 1000.0 * 3.14159265 * 0.01**2 * 9.81
FLOOR = f"""[[checks]]
observable = "floor_force_N"
low = {0.99 * WEIGHT}
high = {1.01 * WEIGHT}
"""
FALLING = f"""[[checks]]
observable = "momentum_Ns_y"
high = {-0.5 * WEIGHT * 0.02}
at = 0.02
"""


def checked(folder: Path, *checks: str) -> tuple[int, list[dict]]:
    """Exit status and rows of the command for the scene with these checks."""
    (folder / "scene.toml").write_text(SCENE + "".join(checks))
    done = CliRunner().invoke(app, ["check", str(folder / "scene.toml"), "--json", "--threads", "1"])
    return done.exit_code, json.loads(done.stdout) if done.exit_code < 2 else [done.stderr]


def test_what_a_scene_must_show(tmp_path: Path) -> None:
    """In the order of their times, at the step nearest to each; one that fails is exit status 1."""
    code, rows = checked(tmp_path, FLOOR, FALLING)
    assert code == 0 and [row["observable"] for row in rows] == ["momentum_Ns_y", "floor_force_N"]
    assert [row["at"] for row in rows] == pytest.approx([0.02, 0.5], abs=3e-3)
    assert all(row["passed"] for row in rows)
    code, rows = checked(tmp_path, FLOOR, '[[checks]]\nobservable = "grains"\nlow = 11\n')
    assert code == 1 and [row["passed"] for row in rows] == [True, False]


def test_over_a_time(tmp_path: Path) -> None:
    """Grains fall: p = - W t. Over the last 0.01 s before 0.02 s its mean is - 0.015 W, its least - 0.02 W, its most - 0.01 W."""
    for take, share in (("mean", 0.015), ("least", 0.02), ("most", 0.01)):
        table = f'[solver]\nstep = 2e-4\n[[checks]]\nobservable = "momentum_Ns_y"\nhigh = 0.0\nat = 0.02\nover = 0.01\ntake = "{take}"\n'
        code, [row] = checked(tmp_path, table)
        assert code == 0 and row["value"] == pytest.approx(-share * WEIGHT, rel=0.05)


def test_walls_are_numbers_too(tmp_path: Path) -> None:
    """What the floor bears, by its name, and its torque about its middle, which the places of the grains make."""
    checks = [f'[[checks]]\nobservable = "{name}"\nlow = -1e9\n' for name in ("wall_forces_N.bottom_y", "wall_torques_Nm.bottom")]
    code, rows = checked(tmp_path, *checks)
    assert code == 0 and rows[0]["value"] == pytest.approx(-WEIGHT, rel=0.01)
    assert abs(rows[1]["value"]) < 0.1 * WEIGHT


def test_a_number_that_is_not_there_is_no_number() -> None:
    """A heap that is none has no angle: that fails, whatever the range."""
    scene = sand.Scene(size=[0.2, 0.2], duration=0.0, checks=[{"observable": "repose_angle", "low": -1e9, "high": 1e9}])
    [row] = check("none", scene, threads=1)
    assert not row.passed and row.to_dict()["value"] is None


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('observable = "floor_forze_N"\nlow = 1', "did you mean `floor_force_N`?"),
        ('observable = "grains"', "checks[0] needs `low` or `high`"),
        ('observable = "grains"\nlow = 2\nhigh = 1', "checks[0].high = 1 must be at least `low` = 2"),
        ('observable = "grains"\nlow = 2\nat = "soon"', 'checks[0].at = "soon" must be a time in seconds, or "end"'),
        ('observable = "grains"\nlow = 2\nat = -1.0', 'must be a time in seconds, or "end"'),
        ("low = 2", "checks[0].observable"),
        ('observable = "grains"\nlow = 2\ntake = "most"', 'checks[0].take = "most" needs a time `over`'),
    ],
)
def test_wrong_checks(table: str, said: str, tmp_path: Path) -> None:
    code, [text] = checked(tmp_path, f"[[checks]]\n{table}\n")
    assert code == 2 and said in text and text.count("\n") == 1


def test_a_scene_without_checks(tmp_path: Path) -> None:
    code, [text] = checked(tmp_path)
    assert code == 2 and "has no [[checks]]" in text


SHOWN = [name for name, path in loading.bundled().items() if "[[checks]]" in path.read_text("utf-8")]


@pytest.mark.slow
@pytest.mark.parametrize("name", SHOWN)
def test_bundled_scenes_show_what_they_must(name: str) -> None:
    rows = check(name, sand.load(name), threads=1)
    assert not [row for row in rows if not row.passed]
