"""What a session says of itself while it is played: numbers, and lines that every face shows."""

from typing import TYPE_CHECKING, Any

from taichi_sand.measure.report import contacts, motion
from taichi_sand.play.knobs import Knob
from taichi_sand.view.text import number_text

if TYPE_CHECKING:
    from taichi_sand.play.session import Session

DOT = " · "


def measure(session: "Session", before: dict[str, Any]) -> dict[str, Any]:
    """What is measured a few times a second; `before` is what it was the last time."""
    sim = session.sim
    found = {**contacts(sim), **motion(sim), "grains": sim.count, "lost": sim.lost, "time": sim.time, "flags": sim.flags()}
    found["gone"] = sim.made - sim.removed - sim.count  # by edges and sinks
    found["asleep"] = int(sim.world.sleep.state[None].asleep) if sim.world.sleeps else 0
    found["energy"] = found["kinetic_energy_J"] + found["potential_energy_J"]
    passed = found["time"] - before.get("time", found["time"])
    found["power"] = (found["energy"] - before["energy"]) / passed if passed > 0 else 0.0
    return found


def lines(session: "Session", m: dict[str, Any]) -> list[tuple[str, str]]:
    """The numbers as lines of text and their tones."""
    stages = m.get("stages", {})
    counted = [f"{m[name]} {name}" for name in ("asleep", "lost") if m.get(name)]
    shown = [
        (DOT.join([f"{m['grains']} grains", *counted, f"{m['contacts']} contacts"]), ""),
        (f"{m.get('frames', 0.0):.0f} frames/s · {m.get('real_time', 0.0):.2f}x real time · asked {session.speed:g}x", ""),
        (
            f"tolerance {session.value('solver.tolerance'):g} d · measured mean {m['overlap_mean']:.4f}, "
            f"p99 {m['overlap_p99']:.4f}, worst {m['overlap_max']:.4f} d",
            "" if m["overlap_p99"] <= session.value("solver.tolerance") else "attention",
        ),
        (f"energy {number_text(m['energy'])} J, {m['power']:+.3g} W · kinetic {number_text(m['kinetic_energy_J'])} J", ""),
        (DOT.join(f"{name} {1e3 * seconds:.1f} ms" for name, seconds in stages.items()), "dim"),
    ]
    if any(m.get("given", ())):
        shown.append((f"hand gave {m['given'][0]:.4g}, {m['given'][1]:.4g} N s", ""))
    return shown + [(sentence, "attention") for sentence in m["flags"]]


def accuracy(session: "Session", m: dict[str, Any]) -> list[tuple[str, str, str]]:
    """What accuracy there is and what it costs: labels, values, tones."""
    found, factor = m.get("overlap_p99", 0.0), m.get("real_time", 0.0)
    good = found <= session.value("solver.tolerance")
    keeps_up = factor > 0.95 * session.speed or m.get("paused", False)
    word = "paused" if m.get("paused") else f"{factor:.2f}x" if keeps_up else f"{factor:.2f}x  slowed down"
    return [
        ("measured p99", f"{found:.4f} d  {'within' if good else 'above'}", "good" if good else "attention"),
        ("cost", f"{m.get('cost', 0.0):.2g} s per s", ""),
        ("real time", word, "good" if keeps_up else "attention"),
    ]


def shown(knob: Knob, value: float) -> str:
    """The value of a knob with its unit."""
    return f"{number_text(value)} {knob.unit}".rstrip()
