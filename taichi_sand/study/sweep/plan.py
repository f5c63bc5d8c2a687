"""What a sweep is to run: a job for every combination of values and every seed, each known by a key that its result is found by again."""

import hashlib
import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import taichi_sand
from taichi_sand import effects
from taichi_sand.errors import SandError, suggest
from taichi_sand.measure.named import MEASURES
from taichi_sand.scene.schema import Scene
from taichi_sand.study.sweep.specs import values_of

KEY_LENGTH = 16
"""Hexadecimal digits of a key: a million runs share one by chance once in 4e7 sweeps."""


@dataclass(frozen=True)
class Job:
    """One run, ready to be sent anywhere: plain texts and numbers."""

    key: str
    values: dict[str, Any]  # of the varied keys, and `seed`
    scene: str  # as JSON; empty if it was refused
    seconds: float
    every: float | None  # simulated time between two rows of the series [s]; None = no series
    arch: str
    own: dict[str, str]  # source text of effects of the user's own, by name
    measures: tuple[str, ...]  # of measure.named, taken at the end besides the report
    structure: str  # runs of equal structure take over one another's kernels
    refusal: str = ""  # why the scene was refused


@dataclass(frozen=True)
class Plan:
    """All jobs of a sweep, in the order of its table: the last varied key fastest, then the seeds."""

    title: str
    vary: dict[str, list[Any]]
    seeds: list[int]
    jobs: list[Job] = field(repr=False)

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of values, and of seeds."""
        return (*(len(values) for values in self.vary.values()), len(self.seeds))


@dataclass(frozen=True)
class Asked:
    """What is asked of every run."""

    seconds: float | None = None  # simulated time [s]; the scene's duration if None
    every: float | None = None
    arch: str = "cpu"
    own: dict[str, str] = field(default_factory=dict)
    measures: tuple[str, ...] = ()


def key_of(scene: str, seconds: float, asked: Asked) -> str:
    """Hash of all that decides the files of a run: scene (precision in it), time, version, backend. Not of threads, which do not."""
    parts = [taichi_sand.__version__, scene, repr(seconds), repr(asked.every), asked.arch, sorted(asked.own.items()), asked.measures]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:KEY_LENGTH]


def plan(load: Callable[[list[str]], Scene], vary: Mapping[str, Any], seeds: int | Sequence[int], asked: Asked) -> Plan:
    """The jobs of a sweep.

    Args:
        load: makes the scene for `KEY=VALUE` overrides.
        vary: the values of each varied key, as `specs.values_of` takes them.
        seeds: how many seeds, from that of the scene on, or which.
        asked: what is asked of every run.

    Raises:
        SandError: a seed is varied as well, or there is nothing to run. A scene that is refused is a row of the table, no error, unless
            all are: then the sentence of the first is raised.
    """
    if "seed" in vary:
        raise SandError("vary seed: seeds are counted by `seeds` (--seeds N), which is a dimension of its own")
    vary, base = {key: values_of(key, spec) for key, spec in vary.items()}, load([])
    numbers = [base.seed + k for k in range(seeds)] if isinstance(seeds, int) else [int(seed) for seed in seeds]
    if not numbers:
        raise SandError("seeds: there must be at least one")
    if strange := [name for name in asked.measures if name not in MEASURES]:
        raise SandError(
            f"measure {strange[0]}: there is no such measurement{suggest(strange[0], MEASURES)}; there are {', '.join(MEASURES)}"
        )
    jobs = []
    for values in itertools.product(*vary.values()):
        named = dict(zip(vary, values, strict=True))
        scene, refusal = _scene(load, named)
        jobs += [_job(scene, refusal, {**named, "seed": seed}, asked) for seed in numbers]
    if all(job.refusal for job in jobs):
        raise SandError(jobs[0].refusal)
    return Plan(base.title, vary, numbers, jobs)


def _scene(load: Callable[[list[str]], Scene], named: Mapping[str, Any]) -> tuple[Scene | None, str]:
    try:
        return load([f"{key}={as_toml_value(value)}" for key, value in named.items()]), ""
    except SandError as error:
        return None, str(error)


def as_toml_value(value: Any) -> str:
    """A value as `--set` takes it."""
    return repr(value) if isinstance(value, float) else json.dumps(value)


def _job(scene: Scene | None, refusal: str, values: dict[str, Any], asked: Asked) -> Job:
    rest = (asked.every, asked.arch, asked.own, asked.measures)
    if scene is None:
        key = key_of(json.dumps({"refused": refusal, **values}, sort_keys=True), 0.0, asked)
        return Job(key, values, "", 0.0, *rest, structure="", refusal=refusal)
    text = scene.model_copy(update={"seed": values["seed"]}).to_json()
    seconds = scene.duration if asked.seconds is None else asked.seconds
    return Job(key_of(text, seconds, asked), values, text, seconds, *rest, structure=structure_of(scene))


def structure_of(scene: Scene) -> str:
    """Roughly what of a scene is compiled into its kernels: runs that share it are dealt to the same process."""
    fixed = {name: sorted((p.name, repr(table[p.name])) for p in effects.find(name).parameters if not p.live)
             for name, table in effects.check(scene).items()}  # fmt: skip
    solver, shapes = scene.solver, sorted({grains.shape for grains in (*scene.grains, *scene.sources)})
    return json.dumps([solver.kind, solver.law, solver.integrator, solver.k_d is None, solver.precision, fixed, shapes, scene.edges.left])
