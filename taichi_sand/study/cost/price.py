"""What the effects of a scene allocate and compile, what it leaves out, and what each costs."""

import statistics
import time
from typing import Any

from taichi_sand import effects
from taichi_sand.run.simulation import Simulation
from taichi_sand.scene.schema import Scene
from taichi_sand.world.checkpoint import fields_of
from taichi_sand.world.extras.hooks import offers

LOOPS = {
    **dict.fromkeys(("normal", "tangent", "couple", "touch", "release", "store"), "pairs"),
    **dict.fromkeys(("min_normal_impulse", "friction_bound", "rolling_bound"), "pairs, twice"),
    **dict.fromkeys(("link", "snap", "kept"), "links"),
    "body": "grains",
    "heat": "pairs and grains",
}
"""Loops of a step in which a hook runs; `on_pause` and `on_step` run in none, `stored` where another effect asks for it."""
ROUNDS = 9
ROUND_TIME = 0.05
"""Rounds of a measurement, and about how long one takes [s of CPU]."""


def bytes_of(field: Any) -> int:
    """Bytes that a Taichi field holds."""
    if hasattr(field, "keys"):
        return sum(bytes_of(field.get_member_field(key)) for key in field.keys)
    rows = 1
    for side in field.shape:
        rows *= side
    width = getattr(field, "n", 1) * getattr(field, "m", 1)
    return rows * width * (8 if "64" in str(field.dtype) else 4)


def inventory(sim: Simulation) -> list[dict[str, Any]]:
    """A row an effect there is: name, whether it is on, what it allocates [bytes], its hooks, loops and live parameters."""
    kind = sim.scene.solver.kind
    built = dict(zip(sim.effects, sim.solver.effects, strict=False))
    rows = []
    for name in effects.names():
        if name not in built:
            rows.append({"name": name, "on": False})
            continue
        effect, values = built[name], sim.effects[name]
        hooks = [hook for hook in {**effects.HOOKS[kind], **effects.HOOKS["both"]} if offers(effect, hook)]
        loops = sorted({LOOPS[hook] for hook in hooks if hook in LOOPS})
        if "on_pause" in hooks:
            loops.append(f"pauses of {effect.interval:.3g} s" if effect.interval else "pauses of its own")
        if "on_step" in hooks:
            loops.append(f"looks every {effect.interval:.3g} s")
        live = {p.name: values[p.name] for p in effects.find(name).parameters if p.live}
        size = effects.columns(name, values, kind) * bytes_of(sim.world.pairs.gap)
        size += sum(bytes_of(getattr(sim.world.carried, column)) for column in effects.carried({name: values}))
        if effects.sleeps([name]):
            size += sleep_bytes(sim.world)
        if "link" in hooks and sim.world.linked:
            size += sum(map(bytes_of, sim.world.links))
        rows.append({"name": name, "on": True, "bytes": size, "hooks": hooks, "loops": loops, "live": live})
    return rows


def sleep_bytes(world: Any) -> int:
    """Bytes of the tables of sleep: its own, and the third part of the neighbour list."""
    pairs = {id(field): field for field in (*world.pairs, *world.pairs.memory) if hasattr(field, "shape")}
    thirds = [field for field in pairs.values() if field.shape[0] in (3 * world.half, 3 * world.wall_half)]
    return sum(map(bytes_of, world.sleep)) + sum(map(bytes_of, thirds)) // 3


def table_bytes(sim: Simulation) -> int:
    """Bytes of all tables of a simulation, each field once."""
    fields = {id(field): field for field in fields_of((sim.world, sim.solver), "", scratch=True).values()}
    return sum(bytes_of(field) for field in fields.values())


def variants(scene: Scene) -> dict[str, Scene]:
    """The scene as it is (""), without each of its effects (-name), and with each absent one that fits, at neutral values (+name)."""
    found = {"": scene}
    for name in scene.effects:
        rest = {other: table for other, table in scene.effects.items() if other != name}
        found[f"-{name}"] = scene.model_copy(update={"effects": rest})
    for name in effects.fitting(scene.solver.kind):
        if name not in scene.effects and effects.find(name).neutral is not None:
            table = dict(effects.find(name).neutral or {})
            found[f"+{name}"] = scene.model_copy(update={"effects": {**scene.effects, name: table}})
    return found


def measure(scene: Scene, seconds: float, arch: str = "cpu", threads: int | None = 1) -> dict[str, tuple[float, float]]:
    """CPU ns per grain and step of every variant of the scene, and the standard error.

    Each variant first simulates `seconds` on its own; then all take turns, ROUNDS times. Medians over the rounds.
    """
    sims = {name: Simulation(variant, arch=arch, threads=threads) for name, variant in variants(scene).items()}
    steps = {}
    for name, sim in sims.items():
        sim.advance(seconds)
        start = time.process_time()
        sim.advance_steps(20)
        steps[name] = max(20, round(20 * ROUND_TIME / max(time.process_time() - start, 1e-6)))
    times: dict[str, list[float]] = {name: [] for name in sims}
    for _ in range(ROUNDS):
        for name, sim in sims.items():
            start = time.process_time()
            sim.advance_steps(steps[name])
            times[name].append(1e9 * (time.process_time() - start) / steps[name] / max(sim.count, 1))
    return {name: (statistics.median(row), 1.25 * statistics.stdev(row) / ROUNDS**0.5) for name, row in times.items()}
