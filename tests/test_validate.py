"""The command `validate`: reference cases as a table, and what becomes of a failed one. (The cases themselves: tests/physics.)"""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taichi_sand.cli.main import app
from taichi_sand.study.validate import cases, validate


def test_rows_pass_as_json_and_as_a_picture(tmp_path: Path) -> None:
    """A14 for both solvers: every row has its numbers, and passes."""
    picture = tmp_path / "cases.png"
    done = CliRunner().invoke(app, ["validate", "--only", "A14", "--json", "--plot", str(picture)])
    assert done.exit_code == 0, done.stderr
    rows = json.loads(done.stdout)
    assert {row["solver"] for row in rows} == {"md", "rigid"} and len(rows) == 6
    for row in rows:
        assert row["passed"] and row["error"] == pytest.approx(abs(row["measured"] - row["reference"])) and row["error"] <= row["within"]
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_a_failed_row_fails_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit status 1, the row named on stderr and marked in the table; NaN is no pass."""
    rows = [cases.Row("good", 1.0, 1.01, 0.1), cases.Row("nan", 1.0, float("nan"), 0.1), cases.Row("bad", 1.0, 2.0, 0.1)]
    monkeypatch.setattr(cases, "CASES", (cases.Case("A1 trial", "nobody", lambda kind: rows, ("md",)),))
    done = CliRunner().invoke(app, ["validate"])
    assert done.exit_code == 1 and "2 of 3 rows" in done.stderr and "bad" in done.stderr and "FAILED" in done.stdout
    done = CliRunner().invoke(app, ["validate", "--json"])
    assert [row["passed"] for row in json.loads(done.stdout)] == [True, False, False] and json.loads(done.stdout)[1]["measured"] is None


def test_unknown_case() -> None:
    done = CliRunner().invoke(app, ["validate", "--only", "A99"])
    assert done.exit_code == 2 and "--only A99: must be one of A1, A10" in done.stderr


def test_quick_leaves_long_cases_out(monkeypatch: pytest.MonkeyPatch) -> None:
    ran = []

    def trial(name: str, quick: bool) -> cases.Case:
        return cases.Case(name, "", lambda kind: ran.append((name, kind)) or [], quick=quick)

    monkeypatch.setattr(cases, "CASES", (trial("A1 a", True), trial("A2 b", False)))
    validate.validate(quick=True)
    assert ran == [("A1 a", "md"), ("A1 a", "rigid")]
