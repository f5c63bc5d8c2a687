"""Fuzzing: random valid scenes must stay finite and lose nobody, broken files must be refused in a sentence.

`python tests/fuzzing.py --examples 5000` draws so many scenes and so many broken files; it needs the extra `test`. A scene of
another structure is compiled anew, so a run draws its structures first and many scenes of each. It goes on after a finding.
"""

import argparse
import json
import math
import os
import sys
import tempfile
import traceback
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from tampering import (
    ROWS,
    SAMPLE,
    arrays_of,
    broken,
    check_checkpoint,
    check_files,
    check_recording,
    checkpoint_bytes,
    recorded_lines,
    retold,
    tampered,
    to_archive,
    with_hash,
    within_limits,
)

import taichi_sand as sand
from taichi_sand import effects
from taichi_sand.scene.parameters import Parameter
from taichi_sand.study.laboratory import fresh_taichi

SECONDS, MOST_STEPS = 0.3, 1500
"""How long a scene is simulated, and by how many steps at most: stiff contacts of small grains would take millions."""
GONE_ON = 0.01
"""How long a checkpoint that is believed is gone on from."""
SHAPES = ("disc", "2x1", "triangle", "square")
STRUCTURES = (
    ("rigid", "disc", ()),
    ("md", "disc", ("friction",)),
    ("rigid", "triangle", ("friction", "rolling")),
    ("md", "square", ("friction", "drag")),
    ("rigid", "disc", ("friction", "cohesion", "moisture")),
    ("md", "disc", ("friction", "sleeping", "heat")),
)
"""Solver, shape and effects of the scenes that the tests draw."""
DRIVES = {"drag", "safe_direction", "bonds", "cohesion", "moisture", "heat"}
"""Effects that give energy, or keep some that a report does not count."""
KEYS = ("time_s", "grains", "grains_lost", "overlap_max", "kinetic_energy_J", "potential_energy_J", "speed_max_m_s", "flags")


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers of all sizes between two positive ones."""
    return st.floats(math.log(low), math.log(high)).map(math.exp)


def value_of(parameter: Parameter) -> st.SearchStrategy[Any]:
    """All that a parameter may be, its limits more often than others."""
    if isinstance(parameter.default, bool):
        return st.booleans()
    if isinstance(parameter.default, str):
        return st.sampled_from(parameter.choices or (parameter.default,))
    low, high = float(parameter.low or 0.0), float(1e6 if parameter.high is None else parameter.high)
    return st.one_of(st.sampled_from([low, high]), st.floats(low, high))


def tables(names: tuple[str, ...]) -> st.SearchStrategy[dict[str, Any]]:
    """Tables of these effects, with any of their keys that may change without a new structure."""
    live = {name: {p.name: value_of(p) for p in effects.find(name).parameters if p.live and p.default is not None} for name in names}
    return st.fixed_dictionaries({name: st.fixed_dictionaries({}, optional=keys) for name, keys in live.items()})


@st.composite
def scenes(draw: Callable, structure: tuple[str, str, tuple[str, ...]]) -> dict[str, Any]:
    """Keys of a scene of few grains, of any size, weight and speed that is allowed."""
    kind, shape, names = structure
    radius = draw(numbers(1e-4, 1.0))
    count = draw(st.integers(1, 30))
    side = radius * draw(st.floats(14, 60))
    pull = draw(st.one_of(st.just(0.0), numbers(1e-2, 1e3)))
    way = draw(st.floats(0, 2 * math.pi))
    return {
        "size": [side, side * draw(st.floats(1, 2))],
        "gravity": [pull * math.cos(way), pull * math.sin(way)],
        "seed": draw(st.integers(0, 2**63 - 1)),
        "solver": {
            "kind": kind,
            "tolerance": draw(st.one_of(st.sampled_from([0.0005, 0.3]), numbers(0.0005, 0.3))),
            "restitution": draw(st.floats(0, 1)),
        },
        "grains": [
            {
                "shape": shape,
                "radius": [radius * draw(st.floats(0.2, 1.0)), radius],
                "density": draw(numbers(1e-3, 1e6)),
                "count": count,
                "speed": [0.0, radius * draw(st.one_of(st.just(0.0), numbers(1e-2, 1e3)))],
                "spin": draw(st.sampled_from([0.0, 1e3, -1e3])),
                "angle": "random",
            }
        ],
        "effects": draw(tables(names)),
    }


def check_scene(keys: dict[str, Any]) -> None:
    """Runs a scene; AssertionError says what went wrong. A scene that is refused in a sentence is no finding."""
    fresh_taichi()
    with within_limits():
        _check_scene(keys)


def _check_scene(keys: dict[str, Any]) -> None:
    try:
        sim = sand.Simulation(sand.Scene(**keys), arch="cpu", threads=1)
    except sand.SandError as error:
        assert "\n" not in str(error)
        assume(False)
    before = sim.report()
    sim.advance_steps(max(1, min(MOST_STEPS, round(SECONDS / sim.step))))
    after = sim.report()
    json.dumps(after, allow_nan=False)
    assert set(KEYS) <= set(after)
    for values in (sim.positions, sim.velocities, sim.angles, sim.spins):
        assert np.isfinite(values).all(), "a number is not finite"
    assert after["grains"] == before["grains"] and after["grains_lost"] == 0, "a grain is lost"
    size, beyond = np.array(sim.scene.size), sim.radii.max()
    assert ((sim.positions > -beyond) & (sim.positions < size + beyond)).all(), "a grain is outside"
    if not DRIVES & set(keys["effects"]):
        gained = sum(after[key] - before[key] for key in ("kinetic_energy_J", "potential_energy_J"))
        scale = before["kinetic_energy_J"] + before["mass_kg"] * float(np.hypot(*sim.scene.gravity)) * float(size.max())
        assert gained <= 2e-3 * scale + 1e-30, f"energy rose by {gained / scale:.3g} of its scale"


def fuzz(check: Callable, examples: int, *strategies: st.SearchStrategy) -> None:
    """Calls `check` with so many draws; what it raises is shown with the smallest draw that raises it."""
    quiet = [HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large]
    phases = [Phase.explicit, Phase.generate, Phase.shrink]
    rules = settings(max_examples=examples, deadline=None, database=None, derandomize=examples < 200, suppress_health_check=quiet)

    @settings(rules, phases=phases)
    @given(st.tuples(*strategies))
    def trial(drawn: tuple[Any, ...]) -> None:
        check(*drawn)

    trial()


def fuzz_scenes(structure: tuple[str, str, tuple[str, ...]], examples: int) -> None:
    """Scenes of one structure."""
    fuzz(check_scene, examples, scenes(structure))


def fuzz_files(examples: int) -> None:
    """Scene files beside a CSV file that is whole, and CSV files beside a scene file that is: a third as many."""
    with tempfile.TemporaryDirectory() as name:
        fuzz(lambda toml: check_files(Path(name), toml, ROWS), examples - examples // 4, broken(SAMPLE))
        fuzz(lambda rows: check_files(Path(name), SAMPLE, rows), examples // 4, broken(ROWS))


def fuzz_checkpoints(examples: int) -> None:
    """Checkpoints: two of three with other numbers in them and a hash that fits, gone on from; the others with other bytes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        good = checkpoint_bytes(folder)
        fuzz(lambda data: check_checkpoint(folder, data), examples - 2 * examples // 3, broken(good))
        changed = tampered(arrays_of(good), "header").map(with_hash)
        fuzz(lambda arrays: check_checkpoint(folder, to_archive(arrays), GONE_ON), 2 * examples // 3, changed)


def fuzz_recordings(examples: int) -> None:
    """Recordings: two of three with other values in them, the others with other bytes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lines = recorded_lines(folder)
        fuzz(lambda text: check_recording(folder, text), examples - 2 * examples // 3, broken("\n".join([*lines, ""]).encode()))
        fuzz(lambda told: check_recording(folder, "\n".join([*told, ""]).encode()), 2 * examples // 3, retold(lines))


def structures(examples: int, seed: int) -> list[tuple[str, str, tuple[str, ...]]]:
    """Those of the tests, and one at random for every hundred examples."""
    random = np.random.default_rng(seed)
    found = list(STRUCTURES)
    for _ in range(examples // 100):
        kind = str(random.choice(["md", "rigid"]))
        names = [name for name in effects.fitting(kind) if random.random() < 0.3]
        found.append((kind, str(random.choice(SHAPES)), tuple(names)))
    return found


def tried(task: Callable[[int], None], examples: int) -> str:
    """What the task found: a traceback, or nothing."""
    try:
        task(examples)
    except Exception:  # whatever it is: it is what was looked for
        return traceback.format_exc()
    return ""


def alone(task: Callable[[int], None], examples: int) -> str:
    """What the task found in a process of its own, which it may crash."""
    try:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            return pool.submit(tried, task, examples).result()
    except BrokenProcessPool:
        return f"the process crashed; what it tried last is left in {tempfile.gettempdir()}"


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Draws random scenes and broken files, and says what they break.")
    parser.add_argument("--examples", type=int, default=200, help="scenes, and as many broken files")
    parser.add_argument("--seed", type=int, default=0, help="of the structures that are drawn beyond those of the tests")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes that share the work")
    asked = parser.parse_args()
    drawn = structures(asked.examples, asked.seed)
    each, third = max(1, asked.examples // len(drawn)), max(3, asked.examples // 3)
    tasks: dict[str, Callable[[int], None]] = {"scene files": fuzz_files, "checkpoints": fuzz_checkpoints, "recordings": fuzz_recordings}
    work = {f"broken {name}": (task, third) for name, task in tasks.items()}
    for k, (kind, shape, names) in enumerate(drawn):
        work[f"structure {k}: " + " ".join([kind, shape, *names])] = (partial(fuzz_scenes, (kind, shape, names)), each)
    findings = 0
    with ThreadPoolExecutor(asked.jobs) as pool:
        waiting = {pool.submit(alone, *task): (name, task[1]) for name, task in work.items()}
        for k, done in enumerate(as_completed(waiting)):
            (name, examples), finding = waiting[done], done.result()
            findings += bool(finding)
            print(f"[{k + 1}/{len(work)}] {name}: {examples} examples, {finding or 'nothing found'}", flush=True)
    print(f"{findings or 'no'} finding{'s' * (findings != 1)}")
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
