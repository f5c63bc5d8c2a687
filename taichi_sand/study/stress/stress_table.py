"""What `taichi-sand stress` found, for the terminal and for the documentation."""

import math
from itertools import groupby

from rich.table import Table

from taichi_sand.study.stress.gates import TOP_SPEED, Gate
from taichi_sand.study.stress.stress import Row


def as_table(done: list[Row]) -> Table:
    """For the terminal: of every row the gate that failed, or came nearest to it."""
    table = Table("case", "set-up", "solver", "tolerance", "gate", "measured", "at most", "verdict", header_style="bold", box=None)
    for row in done:
        gate = row.tightest
        cells = (gate.what, f"{gate.measured:.3g}", f"{gate.most:.3g}") if gate and not row.error else (row.error or "no gate", "", "")
        verdict = "passed" if row.passed else "failed"
        table.add_row(row.case, row.setup, row.solver, f"{row.tolerance:g}", *cells, verdict, style="" if row.passed else "#E5534B")
    return table


def as_markdown(done: list[Row]) -> str:
    """A line a case: the gate that failed or came nearest to it in any of its rows, and the worst that was measured of it by solver. The
    top speed, which any fall comes near to, stands there only where it failed.
    """
    solvers = list(dict.fromkeys(row.solver for row in done))
    lines = [f"| case | gate | at most | {' | '.join(solvers)} | verdict |", "|" + "---|" * (4 + len(solvers))]
    for name, group in groupby(done, key=lambda row: row.case):
        of_case = list(group)
        gates = [gate for row in of_case for gate in row.gates if gate.what != TOP_SPEED or not gate.passed]
        nearest = max(reversed(gates), key=lambda gate: gate.share, default=Gate("none measured", 0.0, 0.0))
        worst = [worst_of([row for row in of_case if row.solver == solver], nearest.what) for solver in solvers]
        failed = [f"{row.solver} {row.tolerance:g}" for row in of_case if not row.passed]
        verdict = f"fails: {', '.join(failed)}" if failed else "passes"
        lines.append(f"| `{name}`: {of_case[0].setup} | {nearest.what} | {nearest.most:.3g} | {' | '.join(worst)} | {verdict} |")
    return "\n".join(lines)


def worst_of(rows: list[Row], what: str) -> str:
    """Largest value of this gate in these rows."""
    found = [gate.measured for row in rows for gate in row.gates if gate.what == what]
    return f"{max(found, key=lambda value: math.inf if math.isnan(value) else value):.2g}" if found else ""
