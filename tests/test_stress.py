"""The hard cases of `taichi-sand stress` that are cheap, and that a failing case is told."""

import json

import pytest
from typer.testing import CliRunner

from taichi_sand.cli.main import app
from taichi_sand.study.stress import stress
from taichi_sand.study.stress.stress_table import as_markdown

QUICK = [("elastic", "md"), ("elastic", "rigid"), ("bullet-wall", "md"), ("bullet-wall", "rigid"), ("corners", "rigid")]


@pytest.mark.parametrize(("name", "solver"), QUICK)
def test_hard_case(name: str, solver: str) -> None:
    """Every gate of the case holds at tolerance 0.05 (physics.md C)."""
    (one,) = stress.rows(name, [solver], [0.05])
    row = stress.run(*one)
    assert row.passed, (row.error, [gate for gate in row.gates if not gate.passed])


def test_failing_case_exits_1(monkeypatch: pytest.MonkeyPatch) -> None:
    """A gate that does not hold is a failure of the physics; a case that raises is one too."""
    bad = stress.Case("bad", "", lambda solver: iter([stress.Gate("x", float("nan"), 1.0)]), True)
    worse = stress.Case("worse", "", lambda solver: iter([1 / 0]), True)
    monkeypatch.setattr(stress, "rows", lambda *given: [(bad, "md", 0.05), (worse, "md", 0.05)])
    done = CliRunner().invoke(app, ["stress", "--json", "--jobs", "1"])
    assert done.exit_code == 1
    first, second = json.loads(done.stdout)
    assert not first["passed"] and not second["passed"]
    assert "ZeroDivisionError" in second["error"]
    lines = as_markdown([stress.run(*one) for one in stress.rows()]).splitlines()
    assert lines[2] == "| `bad`:  | x | 1 | nan | fails: md 0.05 |"
    assert lines[3] == "| `worse`:  | none measured | 0 |  | fails: md 0.05 |"


def test_cases_in_processes_of_their_own() -> None:
    """Two at a time give what one after the other gives, in the order asked for."""
    asked = stress.rows("open", ["rigid", "md"], [0.05])
    done = stress.run_all(asked, 2, None, None)
    assert [(row.case, row.solver, row.passed) for row in done] == [("open", "rigid", True), ("open", "md", True)]


def test_unknown_case_exits_2() -> None:
    """A name that no case has is wrong input."""
    done = CliRunner().invoke(app, ["stress", "--only", "nonsense"])
    assert done.exit_code == 2
