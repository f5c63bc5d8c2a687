"""Pictures of a study: cost against every error, both logarithmic."""

import math
from pathlib import Path
from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.study.cost.cost import Point, Study
from taichi_sand.study.cost.errors import NAMES

GROUND, PANEL, LINE, TEXT, DIM, ACCENT, WRONG = "#14161A", "#1E2229", "#343A44", "#E6E8EB", "#9AA3AD", "#F2A65A", "#E5534B"
COLOURS = ("#4FA3D1", "#E8C98A", "#7BC47F", "#C58AE8", "#E88A8A", "#8AE8D8", "#B9854A", "#9AA3AD")
STYLES = tuple(zip("os^DvPXh", COLOURS, strict=True))
"""Marker and colour of each family; the front is drawn in the accent, what failed as a cross."""
COLUMNS = 3
TYPE = {"font.size": 9, "axes.titlesize": 10, "text.color": TEXT, "axes.labelcolor": DIM, "xtick.color": DIM, "ytick.color": DIM}


def pyplot() -> Any:
    """matplotlib without a display; SandError if it is not installed."""
    try:
        import matplotlib
    except ModuleNotFoundError:
        raise SandError("plots need matplotlib: pip install 'taichi-sand[study]'") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update(TYPE)  # type: ignore[arg-type]
    return plt


def plot(study: Study, path: Path) -> None:
    """Draws every error that the study has into one PNG, complete or not at all."""
    plt = pyplot()
    names = [name for name in NAMES if any(point.error(name)[1] > 0 for point in study.points)]
    rows = max(1, math.ceil(len(names) / COLUMNS))
    figure, panels = plt.subplots(rows, COLUMNS, figsize=(4.1 * COLUMNS, 3.1 * rows + 0.9), facecolor=GROUND, squeeze=False)
    families = list(dict.fromkeys(point.setting.family for point in study.points))
    styles: dict[str, tuple[str, str]] = {family: STYLES[k % len(STYLES)] for k, family in enumerate(families)}
    for panel in panels.flat[len(names) :]:
        panel.set_visible(False)
    for panel, name in zip(panels.flat, names, strict=False):
        draw(panel, study, name, styles)
    handles = {label: handle for panel in panels.flat for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="upper right", ncols=4, frameon=False, labelcolor=TEXT)
    horizon = ", ".join(f"{kind} {seconds:.2g} s" for kind, seconds in study.horizon.items())
    figure.suptitle(f"{study.title}: what accuracy costs", x=0.012, ha="left", color=TEXT, fontsize=14)
    note = f"{study.seconds:g} s simulated a run, median and range of the runs; numbers beside points: tolerance asked"
    figure.text(0.012, 0.008, note + (f"; trajectories until {horizon}" if horizon else ""), color=DIM, fontsize=8, va="bottom")
    figure.tight_layout(rect=(0, 0.02, 1, 0.97))
    save(figure, path)


def save(figure: Any, path: Path) -> None:
    """Writes a figure as a PNG file, completely or not at all, and lets go of it."""
    with writing.replacing(path) as made:
        figure.savefig(made, dpi=90, facecolor=GROUND, format="png")
    pyplot().close(figure)


def draw(panel: Any, study: Study, name: str, styles: dict[str, tuple[str, str]]) -> None:
    """One error: a line a family, ranges as bars, the front, and what failed."""
    from matplotlib.ticker import LogLocator, NullFormatter

    panel.set(xscale="log", yscale="log", title=NAMES[name], xlabel="CPU time, s a simulated second", facecolor=PANEL)
    panel.title.set_color(TEXT)
    panel.grid(True, which="major", color=LINE, linewidth=0.6)
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(NullFormatter())
    for spine in panel.spines.values():
        spine.set_color(LINE)
    for family, (marker, colour) in styles.items():
        points = [p for p in study.points if p.setting.family == family and p.costs and p.error(name)[1] > 0]
        good, bad = [p for p in points if not p.failure], [p for p in points if p.failure]
        if good:
            bars = {"xerr": ranges([p.cost for p in good]), "yerr": ranges([p.error(name) for p in good])}
            x, y = places(good, name)
            panel.errorbar(x, y, **bars, marker=marker, ms=5, color=colour, lw=1, elinewidth=0.8, capsize=2, label=family)
            for point, place in zip(good, zip(x, y, strict=True), strict=True):
                style = {"textcoords": "offset points", "xytext": (5, 4), "color": colour, "fontsize": 7}
                panel.annotate(f"{point.setting.tolerance:g}", place, **style)
        if bad:
            panel.plot(*places(bad, name), "x", color=WRONG, ms=8, mew=2, ls="", label="failed")
    front = [point for point in study.front(name) if point.error(name)[1] > 0]
    if front:
        panel.step(*places(front, name), where="post", color=ACCENT, lw=2.5, alpha=0.45, label="front", zorder=1)


def places(points: list[Point], name: str) -> tuple[list[float], list[float]]:
    """Medians of cost and error."""
    return [p.cost[1] for p in points], [p.error(name)[1] for p in points]


def ranges(threes: list[tuple[float, float, float]]) -> list[list[float]]:
    """How far lowest and highest lie from the median, as error bars want it."""
    return [[middle - low for low, middle, _ in threes], [high - middle for _, middle, high in threes]]
