"""The reference ladder as a table: every case for each solver, what is known beside what was measured."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from taichi_sand.errors import SandError
from taichi_sand.study.cost.plot import ACCENT, DIM, GROUND, LINE, PANEL, TEXT, WRONG, pyplot, save

GOOD = "#7BC47F"


@dataclass(frozen=True)
class Result:
    """A row of a case as it came out."""

    case: str
    source: str
    solver: str
    what: str
    reference: float
    measured: float
    error: float
    within: float
    passed: bool


def validate(quick: bool, only: list[str] | None = None, progress: Callable[[float], None] | None = None) -> list[Result]:
    """Runs the cases, all of them or the `quick` ones, or those whose names start with one of `only` (A5); SandError if there is none."""
    try:
        from taichi_sand.study.validate.cases import CASES
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != "scipy":
            raise
        raise SandError("the reference cases need scipy: pip install 'taichi-sand[study]'") from None
    chosen = [case for case in CASES if case.quick or not quick]
    if only:
        known = {case.name.split()[0].rstrip(",") for case in CASES}
        if unknown := [name for name in only if name not in known]:
            raise SandError(f"--only {unknown[0]}: must be one of {', '.join(sorted(known))}")
        chosen = [case for case in CASES if case.name.split()[0].rstrip(",") in only]
    jobs = [(case, kind) for case in chosen for kind in case.kinds]
    results = []
    for k, (case, kind) in enumerate(jobs):
        for row in case.rows(kind):
            numbers = (float(row.reference), float(row.measured), float(row.error), float(row.within), bool(row.passed))
            results.append(Result(case.name, case.source, kind, row.what, *numbers))
        if progress:
            progress((k + 1) / len(jobs))
    return results


def as_json(results: list[Result]) -> list[dict[str, Any]]:
    """The results as JSON has them: what is no number is null."""
    clean = lambda value: None if isinstance(value, float) and not math.isfinite(value) else value  # noqa: E731
    return [{key: clean(value) for key, value in asdict(result).items()} for result in results]


def as_table(results: list[Result]) -> Table:
    """For the terminal."""
    table = Table("case", "source", "solver", "", "reference", "measured", "error", "allowed", "", box=None, header_style="bold")
    last = ""
    for r in results:
        verdict = Text("passed", GOOD) if r.passed else Text("FAILED", WRONG)
        head = (r.case, r.source) if r.case != last else ("", "")
        table.add_row(
            *head, r.solver, r.what, *(f"{v:.5g}" for v in (r.reference, r.measured)), f"{r.error:.1e}", f"{r.within:.1e}", verdict
        )
        last = r.case
    return table


def plot(results: list[Result], path: Path) -> None:
    """Every error as a share of what is allowed, in one PNG, complete or not at all."""
    plt = pyplot()
    figure, panel = plt.subplots(figsize=(9, 1.2 + 0.17 * len(results)), facecolor=GROUND)
    panel.set(facecolor=PANEL, xscale="log", ylim=(len(results), -1), xlim=(1e-5, 10))
    for k, r in enumerate(results):
        share = min(max(r.error / r.within if r.within else (0.0 if r.passed else 10.0), 1e-5), 10.0)
        panel.plot([1e-5, share], [k, k], color=LINE, lw=1)
        panel.plot(share, k, "os"[r.solver == "rigid"], color=GOOD if r.passed else WRONG, ms=5)
    panel.axvline(1.0, color=ACCENT, lw=1.5)
    panel.set_yticks(range(len(results)), [f"{r.case}, {r.solver}: {r.what}" for r in results], fontsize=6.5)
    panel.set_xlabel("error / allowed (circles: md, squares: rigid)", color=DIM)
    panel.set_title("Reference cases", color=TEXT, loc="left")
    for spine in panel.spines.values():
        spine.set_color(LINE)
    figure.tight_layout()
    save(figure, path)
