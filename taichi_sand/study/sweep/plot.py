"""Pictures of a sweep: lines with bands over one key, a map over two."""

from pathlib import Path
from typing import Any

import numpy as np

from taichi_sand.errors import SandError, suggest
from taichi_sand.files import writing
from taichi_sand.study.cost.plot import COLOURS, DIM, GROUND, LINE, PANEL, TEXT, pyplot

BAND = 1.96
"""Half-width of the band, in standard errors of the mean over the seeds: 95 %."""


def means(found: Any, measure: str) -> tuple[np.ndarray, np.ndarray]:
    """Mean over the seeds, and its standard error (0 with one seed), over the varied keys; NaN where all failed."""
    values = found[measure]
    count = values.count("seed")
    spread = values.std("seed", ddof=1) if found.sizes["seed"] > 1 else values.mean("seed") * 0
    return values.mean("seed").values, (spread / np.sqrt(count.where(count > 0))).values


def numeric(values: Any) -> bool:
    """Whether a key is varied over numbers."""
    return np.issubdtype(np.asarray(values).dtype, np.number)


def plot(found: Any, measure: str, path: Path) -> None:
    """Draws one number of a sweep's dataset into a PNG.

    Raises:
        SandError: there is no such number, more than two keys are varied, or the file cannot be written.
    """
    names = [name for name in found.data_vars if name not in ("run", "status", "sentence")]
    if measure not in names and not (found["status"] == "done").any():
        raise SandError(f"--plot: every run failed, the first with: {found['sentence'].values.flat[0]}")
    if measure not in names:
        raise SandError(f"--measure {measure}: the sweep has no such number{suggest(measure, names)}")
    keys = [dim for dim in found.dims if dim != "seed"]
    if not 1 <= len(keys) <= 2:
        raise SandError(f"--plot draws one or two varied keys, not {len(keys)}")
    plt = pyplot()
    figure, panel = plt.subplots(figsize=(6.4, 4.4), facecolor=GROUND)
    panel.set(facecolor=PANEL, xlabel=keys[-1])
    unit = found[measure].attrs.get("units", "1")
    label = measure if unit == "1" else f"{measure} [{unit}]"
    if len(keys) == 2 and all(numeric(found[key]) for key in keys):
        draw_map(figure, panel, found, keys, means(found, measure)[0], label)
    else:
        draw_lines(panel, found, keys, *means(found, measure))
        panel.set_ylabel(label)
        panel.grid(True, color=LINE, linewidth=0.6)
    for spine in panel.spines.values():
        spine.set_color(LINE)
    figure.suptitle(found.attrs.get("title", ""), x=0.02, ha="left", color=TEXT)
    note = f"mean over {found.sizes['seed']} seeds" + (", band: 95 % of the mean" if panel.lines and found.sizes["seed"] > 1 else "")
    figure.text(0.02, 0.01, note, color=DIM, fontsize=8, va="bottom")
    figure.tight_layout(rect=(0, 0.03, 1, 0.97))
    with writing.replacing(path) as made:
        figure.savefig(made, format="png", dpi=110, facecolor=GROUND)
    plt.close(figure)


def draw_lines(panel: Any, found: Any, keys: list[str], mean: np.ndarray, error: np.ndarray) -> None:
    """A line with its band for every value of the first of two keys, or one."""
    x = found[keys[-1]].values
    places = x if numeric(x) else np.arange(len(x))
    if numeric(x) and len(x) > 2 and (x > 0).all() and x.max() / x.min() > 30:
        panel.set_xscale("log")
    rows = mean.reshape(-1, len(x)), error.reshape(-1, len(x))
    labels = [f"{keys[0]} = {value}" for value in found[keys[0]].values] if len(keys) == 2 else [None]
    for k, (values, band, label) in enumerate(zip(*rows, labels, strict=True)):
        colour = COLOURS[k % len(COLOURS)]
        panel.plot(places, values, "o-", color=colour, ms=4, label=label)
        panel.fill_between(places, values - BAND * band, values + BAND * band, color=colour, alpha=0.2, lw=0)
    if not numeric(x):
        panel.set_xticks(places, x)
    if len(keys) == 2:
        panel.legend(frameon=False, labelcolor=TEXT)


def draw_map(figure: Any, panel: Any, found: Any, keys: list[str], mean: np.ndarray, label: str) -> None:
    """Values over two keys, in colours."""
    y, x = found[keys[0]].values, found[keys[1]].values
    image = panel.pcolormesh(x, y, mean, shading="nearest", cmap="viridis")
    panel.set(ylabel=keys[0], xticks=x, yticks=y)
    bar = figure.colorbar(image, ax=panel)
    bar.set_label(label, color=TEXT)
