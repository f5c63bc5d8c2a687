"""Draws what was read: a panel for each series, for P(f), for the fabric, and for each profile."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichi_sand.errors import SandError, suggest
from taichi_sand.files import writing
from taichi_sand.study.cost.plot import ACCENT, COLOURS, DIM, GROUND, LINE, PANEL, TEXT, pyplot
from taichi_sand.study.plots.written import Columns, Written
from taichi_sand.study.sweep.results import unit_of

COLUMNS = 3
FIRST = (
    "kinetic_energy_J",
    "potential_energy_J",
    "contacts",
    "coordination",
    "packing_fraction",
    "bed_height_m",
    "floor_force_N",
    "grains",
)
"""Of a series these are drawn unless others are asked for, as far as they change."""
BINS, PETALS = 24, 36
UNITS = {"packing_fraction": "", "velocity_x": " [m/s]", "velocity_y": " [m/s]", "stress_xx": " [N/m]", "stress_yy": " [N/m]"}
Panel = tuple[str, str, Callable[[Any], None]]
"""Title, projection, and what draws it."""


def plot(files: Sequence[Written], out: Path, show: Sequence[str] = ()) -> int:
    """Draws all that the files hold, and returns how many panels that are.

    Args:
        files: what was read.
        out: ends in .png, .svg or .pdf.
        show: names of numbers to be drawn, instead of all there are, or the usual ones.

    Raises:
        SandError: a number that is asked for is in none of the files, or the picture cannot be written.
    """
    known = [name for file in files for name in (*file.series, *file.profiles)]
    for name in show:
        if name not in known:
            raise SandError(f"--show {name}: no file holds such a number{suggest(name, known)}")
    panels = [panel for file in files for panel in panels_of(file, show, len(files) > 1)]
    if not panels:
        raise SandError("there is nothing to draw: no number of the series changes, and there are no contacts")
    plt = pyplot()
    wide = min(COLUMNS, len(panels))
    rows = -(-len(panels) // wide)
    figure = plt.figure(figsize=(4.1 * wide, 3.3 * rows), facecolor=GROUND)
    for k, (title, projection, draw) in enumerate(panels):
        axes = figure.add_subplot(rows, wide, k + 1, projection=projection or None)
        axes.set(facecolor=PANEL)
        axes.set_title(title, color=TEXT, loc="left")
        for spine in axes.spines.values():
            spine.set_color(LINE)
        axes.grid(True, color=LINE, linewidth=0.6)
        draw(axes)
    figure.tight_layout()
    with writing.replacing(out) as made:
        figure.savefig(made, format=out.suffix[1:], dpi=110, facecolor=GROUND)
    plt.close(figure)
    return len(panels)


def panels_of(file: Written, show: Sequence[str], named: bool) -> list[Panel]:
    """The panels of one file; `named` puts its name into their titles."""
    tail = f"  {file.path.name}" if named else ""
    wanted = show or [name for name in FIRST if name in file.series and np.nanmax(file.series[name]) > np.nanmin(file.series[name])]
    panels = [(name + tail, "", line(file.series, name)) for name in wanted if name in file.series]
    if file.contacts and not show:
        panels += [("force distribution" + tail, "", forces(file.contacts)), ("fabric" + tail, "polar", rose(file.contacts))]
    names = [name for name in file.profiles if name != "y" and (not show or name in show)]
    return panels + [(f"profile of {name}{tail}", "", profile(file.profiles, name)) for name in names]


def line(series: Columns, name: str) -> Callable[[Any], None]:
    """A number over time."""

    def draw(axes: Any) -> None:
        unit = unit_of(name)
        axes.plot(series["time_s"], series[name], color=COLOURS[0])
        axes.set(xlabel="time [s]", ylabel=name if unit == "1" else f"{name.removesuffix('_' + unit)} [{unit}]")

    return draw


def forces(contacts: Columns) -> Callable[[Any], None]:
    """P(f): probability density of the normal forces over their mean, of those that push; beside exp(-f)."""

    def draw(axes: Any) -> None:
        force = contacts["force"][contacts["force"] > 0]
        if len(force):
            share = force / force.mean()
            count, edges = np.histogram(share, BINS, (0.0, max(3.0, float(share.max()))))
            density, middle = count / (len(share) * np.diff(edges)), (edges[1:] + edges[:-1]) / 2
            axes.semilogy(middle[count > 0], density[count > 0], "o", ms=4, color=COLOURS[0], label=f"{len(share)} contacts")
            axes.semilogy(middle, np.exp(-middle), "--", lw=1, color=DIM, label="exp(−f)")
            axes.set_ylim(0.5 * density[count > 0].min(), 2 * density.max())
            axes.legend(frameon=False, labelcolor=TEXT)
        axes.set(xlabel="f = normal force / mean", ylabel="P(f)")

    return draw


def anisotropy(angle: np.ndarray) -> tuple[float, float]:
    """a and its direction [rad] of the fabric E(θ) = (1 + a cos 2(θ - θ₀)) / 2π of contact normals (Rothenburg and Bathurst 1989)."""
    mean = np.exp(2j * angle).mean()
    return float(2 * np.abs(mean)), float(np.angle(mean) / 2)


def rose(contacts: Columns) -> Callable[[Any], None]:
    """Rose of the directions of contact normals, each both ways, beside the fabric that they have."""

    def draw(axes: Any) -> None:
        angle = contacts["angle"]
        both = np.concatenate([angle, angle + np.pi]) % (2 * np.pi)
        count, edges = np.histogram(both, PETALS, (0.0, 2 * np.pi))
        density, middle = count / (len(both) * np.diff(edges)), (edges[1:] + edges[:-1]) / 2
        size, direction = anisotropy(angle)
        axes.bar(middle, density, np.diff(edges), color=COLOURS[0], edgecolor=PANEL, linewidth=0.5)
        turn = np.linspace(0, 2 * np.pi, 181)
        axes.plot(turn, (1 + size * np.cos(2 * (turn - direction))) / (2 * np.pi), color=ACCENT, lw=1.2)
        axes.set(yticklabels=[])
        axes.set_xlabel(f"a = {size:.2g} along {np.degrees(direction) % 180:.0f}°")

    return draw


def profile(profiles: Columns, name: str) -> Callable[[Any], None]:
    """A number over the height, upwards."""

    def draw(axes: Any) -> None:
        axes.plot(profiles[name], profiles["y"], color=COLOURS[0])
        axes.set(xlabel=f"{name}{UNITS[name]}", ylabel="y [m]")

    return draw
