"""What the command prints to be read: the report as a table, effects and their prices."""

from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

GROUPS = {
    "accuracy": {
        "tolerance": ("tolerance asked", "d"),
        "depth": ("pile depth reckoned with", "grains"),
        "overlap_mean": ("overlap, mean", "d"),
        "overlap_p99": ("overlap, 99 % below", "d"),
        "overlap_max": ("overlap, worst", "d"),
        "flow_softness": ("softness of the flow", ""),
    },
    "cost": {
        "wall_time_s": ("wall time", "s"),
        "compile_time_s": ("compiling, apart from it", "s"),
        "real_time_factor": ("simulated / wall time", "×"),
        "step_s": ("time step", "s"),
        "steps": ("steps", ""),
        "ns_per_grain_step": ("a grain and step", "ns"),
    },
    "bed": {
        "time_s": ("simulated", "s"),
        "grains": ("grains", ""),
        "grains_lost": ("left through open edges", ""),
        "grains_made": ("made", ""),
        "grains_waiting": ("waiting for room", ""),
        "grains_removed": ("taken out", ""),
        "bonds": ("bonds that hold", ""),
        "bonds_broken": ("bonds broken", ""),
        "contacts": ("contacts", ""),
        "pairs": ("pairs in the neighbour list", ""),
        "coordination": ("contacts of a grain", ""),
        "packing_fraction": ("packing fraction", ""),
        "bed_height_m": ("bed height", "m"),
        "floor_force_N": ("force on floors", "N"),
        "wall_force_N": ("force on walls", "N"),
    },
    "motion": {
        "kinetic_energy_J": ("kinetic energy", "J"),
        "potential_energy_J": ("potential energy", "J"),
        "momentum_Ns": ("momentum", "N s"),
        "angular_momentum_Nms": ("angular momentum", "N m s"),
        "speed_max_m_s": ("fastest grain", "m/s"),
    },
    "water": {
        "water_m2": ("water", "m2"),
        "water_floor_Pa": ("pressure on the floor", "Pa"),
        "water_speed_max_m_s": ("fastest water", "m/s"),
        "water_divergence_1_s": ("divergence left", "1/s"),
        "water_iterations": ("iterations of the projection", ""),
        "water_step_s": ("its time step", "s"),
    },
}


def console(width: int | None = None) -> Console:
    """Where tables are printed on stdout; `width` letters wide if that is no terminal."""
    page = Console(highlight=False)
    return page if width is None or page.is_terminal else Console(highlight=False, width=width)


def print_report(title: str, report: dict[str, Any]) -> None:
    """Prints a report (design.md section 6) on stdout: what was asked next to what was measured, then the rest in groups."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(style="dim")
    table.add_column()
    table.add_column(justify="right")
    table.add_column(style="dim")
    for group, keys in GROUPS.items():
        head = group
        for key, (label, unit) in keys.items():
            if key in report:
                table.add_row(head, label, _value(report[key]), Text(unit) + _verdict(key, report))
                head = ""
        table.add_section()
    for name, time in report.get("events", {}).items():
        table.add_row("events", name, _value(time), Text("s"))
    out = console()
    effects = ", ".join(report["effects"]) or "none"
    threads = {None: "all threads", 1: "1 thread"}.get(report["threads"], f"{report['threads']} threads")
    bits = f"{report['precision']} bit, {report['arch']}, {threads}"
    out.print(Text.assemble((title or "scene", "bold"), f"  {report['solver']} · effects: {effects} · {bits}"))
    out.print(table)


def stage_of(sim: Any) -> Callable[[], str]:
    """A function that says which event came last."""
    return lambda: "".join(f", {name} at {time:.2f} s" for name, time in sorted(sim.events.items(), key=lambda event: event[1])[-1:])


def effect_lines(effects: Any) -> list[str]:
    """All effects, a line each, with their parameters: what the package `effects` declares."""
    lines = []
    for name in effects.names():
        effect, about = effects.find(name), effects.about(name).splitlines()[0].rstrip(".")
        keys = ", ".join(f"{p.name} = {p.default}{f' {p.unit}' if p.unit else ''}" for p in effect.parameters)
        lines.append(f"{name} ({', '.join(effect.solvers)}): {about}. {keys}")
    return lines


def print_effects(scene: Any, rows: list[dict[str, Any]], tables: int, prices: dict[str, tuple[float, float]]) -> None:
    """Prints what study.cost.price found: `rows` of its inventory, bytes of all tables, and prices by variant if they were measured."""
    table = Table("effect", "", "allocates", "loops of a step", "live parameters", *(["ns per grain and step"] if prices else []), box=None)
    for row in rows:
        name = row["name"]
        cells = ["compiled in" if row["on"] else "left out"]
        if row["on"]:
            live = ", ".join(f"{key} = {value}" for key, value in row["live"].items())
            cells += [f"{row['bytes'] / 1024:,.0f} KiB", ", ".join(row["loops"]), live]
        else:
            cells += ["0", "", ""]
        if prices:
            cells.append(_price(prices, f"-{name}" if row["on"] else f"+{name}"))
        table.add_row(name, *cells, style=None if row["on"] else "dim")
    out = console()
    out.print(Text.assemble((scene.title or "scene", "bold"), f"  {scene.solver.kind} · tables {tables / 2**20:.1f} MiB"))
    out.print(table)
    if prices:
        out.print("as it is: {:.1f} ± {:.1f} ns; of what is on, the change if it is removed, else if it is added".format(*prices[""]))


def _price(prices: dict[str, tuple[float, float]], key: str) -> str:
    """What a variant costs more or less than the scene as it is, with its standard error."""
    if key not in prices:
        return "does not fit"
    (base, base_error), (other, error) = prices[""], prices[key]
    return f"{other - base:+.1f} ± {(error**2 + base_error**2) ** 0.5:.1f}"


def _verdict(key: str, report: dict[str, Any]) -> Text:
    """Whether the measured overlap is what was asked, in a word and a colour; and who asked for a shorter step than the tolerance."""
    if key == "step_s" and report["step_set_by"] != "tolerance":
        return Text(f"  set by the {report['step_set_by']}", "#F2C14E")
    if key != "overlap_p99":
        return Text("")
    good = report[key] <= report["tolerance"]
    return Text("  within the tolerance" if good else "  above the tolerance", "#7BC47F" if good else "#F2C14E")


def _value(value: Any) -> str:
    if isinstance(value, list):
        return "  ".join(map(_value, value))
    return f"{value:,}".replace(",", " ") if isinstance(value, int) else f"{value:.4g}"
