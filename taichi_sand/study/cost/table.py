"""A study of cost as a table, as CSV, and as a `[solver]` table to paste."""

import csv
import io
import math
from pathlib import Path

from rich.table import Table
from rich.text import Text

from taichi_sand.files import writing
from taichi_sand.study.cost.cost import Point, Study
from taichi_sand.study.cost.errors import NAMES


def number(three: tuple[float, float, float], digits: int = 2) -> str:
    """A median and how far the runs lie from it: 0.021 ±0.002; – where there is none."""
    low, middle, high = three
    if math.isnan(middle):
        return "–"
    off = max(high - middle, middle - low)
    return f"{middle:.{digits}g} ±{off:.1g}" if math.isfinite(off) else f"{middle:.{digits}g}"


def as_table(study: Study) -> Table:
    """For the terminal: a row a setting; what lies on a front stands in the colour of the accent, with a star."""
    table = Table("solver", "tolerance", "CPU s / s", *NAMES, title=f"{study.title}: what accuracy costs", header_style="bold", box=None)
    fronts = {name: {id(p) for p in study.front(name)} for name in NAMES}
    for point in study.points:
        cells = []
        for name in NAMES:
            best = id(point) in fronts[name]
            cells.append(Text(number(point.error(name)) + (" *" if best else ""), "#F2A65A" if best else ""))
        if point.failure:
            cells[0] = Text("failed", "#E5534B")
        table.add_row(point.setting.family, f"{point.setting.tolerance:g}", number(point.cost, 3), *cells)
    return table


def legend(study: Study) -> str:
    """What the table does not say of itself."""
    horizons = ", ".join(f"{kind} {seconds:.3g} s" for kind, seconds in study.horizon.items())
    lines = [
        f"{study.seconds:g} s simulated a run; median of the runs ± the farthest of them, each with a seed of its own; * on the front.",
        f"Trajectories are compared until chaos takes over: {horizons or 'not at all'}.",
        *(f"{name}: {text}." for name, text in NAMES.items()),
        *(f"failed: {p.setting.family}, tolerance {p.setting.tolerance:g}: {p.failure}" for p in study.points if p.failure),
    ]
    return "\n".join(lines)


def as_csv(study: Study) -> str:
    """A row a setting; of cost and every error lowest, median and highest run; empty where one has no meaning."""
    parts = ("low", "median", "high")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    measures = ["cost_s_per_s", *NAMES]
    writer.writerow(["solver", "integrator", "precision", "tolerance", *(f"{m}_{part}" for m in measures for part in parts), "failure"])
    for point in study.points:
        s = point.setting
        values = [*point.cost, *(v for name in NAMES for v in point.error(name))]
        cells = ("" if math.isnan(v) else f"{v:.6g}" for v in values)
        writer.writerow([s.kind, s.integrator, s.precision, s.tolerance, *cells, point.failure])
    return text.getvalue()


def write_csv(study: Study, path: Path) -> None:
    """Writes `as_csv` to `path`, completely or not at all."""
    with writing.replacing(path) as made:
        made.write_text(as_csv(study), "utf-8")


def as_toml(point: Point, name: str) -> str:
    """The `[solver]` table of a point, ready to paste, with what it gave as a comment."""
    head = f"# {name} {number(point.error(name))} at {number(point.cost)} s of CPU time a simulated second"
    return "\n".join([head, "[solver]", *(f"{key} = {value}" for key, value in point.setting.table.items())])
