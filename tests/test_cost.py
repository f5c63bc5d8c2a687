"""What accuracy costs: the ladder, its errors and fronts, and that finer steps never do worse."""

import csv
import io
import math
import tomllib
from collections.abc import Sequence
from typing import Any

import pytest
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app
from taichi_sand.errors import SandError
from taichi_sand.study.cost import cost, plot
from taichi_sand.study.cost.errors import NAMES
from taichi_sand.study.cost.table import as_csv, as_table, as_toml, legend

SMALL = ("scale=0.12", "grains.0.pitch=1.1")
"""120 grains that soon lie still."""


def small(more: Sequence[str]) -> Any:
    return sand.load("settle", [*SMALL, *more])


@pytest.fixture(scope="module")
def found() -> cost.Study:
    """Two tolerances, both solvers; molecular dynamics at the finer one is asked for a step that is not stable."""

    def make(more: Sequence[str]) -> Any:
        broken = 'solver.kind="md"' in more and "solver.tolerance=0.01" in more
        return small([*more, "solver.step=0.05"] if broken else more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cost, "QUICK_LADDER", (0.1, 0.01))
        patch.setattr(cost, "REPEATS", 2)
        patch.setattr(cost, "REFERENCE_WORK", {True: 2e7})
        return cost.study(make, seconds=0.8, quick=True)  # until they lie: the tolerance is one at rest


def test_study_measures(found: cost.Study) -> None:
    """The finer rigid run overlaps less, its bed bears its weight, and trajectories were compared for a while."""
    rigid = {point.setting.tolerance: point for point in found.points if point.setting.kind == "rigid"}
    for name in ("overlap_mean", "overlap_p99", "overlap_max", "trajectory"):
        assert 0 < rigid[0.01].error(name)[1] < rigid[0.1].error(name)[1], name
    for tolerance, point in rigid.items():
        assert point.failure == "" and len(point.runs) == 2
        assert 0.1 * tolerance < point.error("overlap_p99")[1] < tolerance
        assert point.error("force")[1] < 0.02
        assert point.error("momentum")[1] < 1e-5
        assert point.cost[0] > 0
    assert rigid[0.1].error("height")[1] > 0 and math.isnan(rigid[0.01].error("height")[1])
    assert 0.02 < found.horizon["rigid"] <= 0.8


def test_failed_points_are_marked(found: cost.Study, tmp_path: Any) -> None:
    """What cannot be simulated says why, is on no front, and the rest stands."""
    failed = [point for point in found.points if point.failure]
    assert [(p.setting.kind, p.setting.tolerance) for p in failed] == [("md", 0.01)], [p.failure for p in failed]
    assert "stability limit" in failed[0].failure and "stability limit" in legend(found)
    assert not any(point in failed for name in NAMES for point in found.front(name))
    assert any("failed" in str(cell) for column in as_table(found).columns for cell in column.cells)
    plot.plot(found, tmp_path / "cost.png")
    assert (tmp_path / "cost.png").read_bytes()[:4] == b"\x89PNG"
    assert [file.name for file in tmp_path.iterdir()] == ["cost.png"]


def test_front_and_target(found: cost.Study) -> None:
    """Along a front cost rises and the error falls; the cheapest table that meets a target is a `[solver]` table."""
    front = found.front("overlap_p99")
    assert [p.cost[1] for p in front] == sorted(p.cost[1] for p in front)
    assert [p.error("overlap_p99")[1] for p in front] == sorted((p.error("overlap_p99")[1] for p in front), reverse=True)
    point = found.cheapest("overlap_p99", 0.02)
    assert point is not None and tomllib.loads(as_toml(point, "overlap_p99"))["solver"] == {"kind": "rigid", "tolerance": 0.01}
    assert found.cheapest("overlap_p99", 1e-9) is None


def test_csv(found: cost.Study) -> None:
    rows = list(csv.DictReader(io.StringIO(as_csv(found))))
    assert len(rows) == len(found.points)
    for row, point in zip(rows, found.points, strict=True):
        assert row["solver"] == point.setting.kind and float(row["tolerance"]) == point.setting.tolerance
        if not point.failure:
            assert float(row["overlap_p99_low"]) <= float(row["overlap_p99_median"]) <= float(row["overlap_p99_high"])


def test_full_tries_everything() -> None:
    settings = cost.settings_of(small([]), cost.LADDER, full=True)
    assert len(settings) == len(set(settings)) == 2 * (1 + 3) * 5
    assert {s.family for s in settings} >= {"rigid", "md rk4", "md velocity verlet 64 bit"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rigid", "md"])
def test_halving_the_step_never_hurts(kind: str) -> None:
    """Half the step: the range of the runs of no error lies above that before. (md keeps its stiffness.)

    Twice six runs that differ by nothing but luck do that once in 900 times, twice three once in 20.
    """
    runner = cost.Runner(small, 1.2, "cpu", 1)
    setting = cost.Setting(kind, 0.03)
    runner.trust(cost.Setting(kind, 0.03, "", 64), 6, 2e7)
    step = runner.plan(setting)[0]
    last = None
    for part in (1, 2):
        point = cost.Point(setting)
        for repeat in range(6):
            _, run, flags = runner.run(setting, repeat, [f"solver.step={step / part}"])
            assert flags == []
            point.runs.append(run)
        if last is not None:
            for name in ("overlap_mean", "overlap_p99", "energy", "force", "trajectory"):
                assert point.error(name)[0] <= last.error(name)[2], (name, part, last.error(name), point.error(name))
        last = point


def test_wrong_input(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wrong names and a missing matplotlib: a sentence and exit status 2, before anything runs."""
    for arguments, text in (
        (["--error", "overlap"], "must be one of overlap_mean"),
        (["--seconds", "0"], "must be more than 0"),
        (["--plot", "/dev/null/cost.png"], "cannot be written"),
    ):
        done = CliRunner().invoke(app, ["cost", "settle", *arguments])
        assert done.exit_code == 2 and text in done.stderr, done.stderr
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(SandError, match="need matplotlib"):
        plot.pyplot()
