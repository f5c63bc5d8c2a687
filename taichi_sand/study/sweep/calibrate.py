"""Finds the values at which a scene measures what was measured elsewhere, and says how sure that is.

Optuna proposes and keeps the trials. A run is noisy, as every seed packs its grains otherwise, so every trial has a seed of its own, and
what is found is not the best of the trials but where a curve through those near the target meets it: of one key a least-squares line,
whose uncertainty follows from how the trials scatter about it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_sand.errors import PhysicsError, SandError
from taichi_sand.study.sweep.engine import Runner, execute
from taichi_sand.study.sweep.job import numbers
from taichi_sand.study.sweep.plan import Asked, Plan, plan
from taichi_sand.study.sweep.specs import rounded
from taichi_sand.study.sweep.store import Store

FIRST = 6
"""Trials spread over the whole range before any is aimed."""
NEAR, LEAST_NEAR, ROUNDS = 0.6, 6, 3
"""The line is laid through this share of the trials, those nearest to where it meets the target, but through so many at least; first
through all, then so often through those near."""
SURE = 1.96
"""Standard errors of a 95 % interval."""
AIMED = 2 / 3
"""Share of the later trials that are aimed at where the line meets the target; the others are Optuna's."""


@dataclass
class Calibration:
    """What was found."""

    values: dict[str, float]  # of the varied keys
    errors: dict[str, float]  # standard error of each; NaN with several keys
    measured: float  # mean of the measurement there, by the line
    error: float  # its standard error
    spread: float  # standard deviation of a single run
    trials: list[tuple[dict[str, float], float]] = field(repr=False)  # values and measurement of every run that has one
    within: float = 0.0

    @property
    def sure(self) -> bool:
        """Whether the 95 % interval of the mean lies within what was allowed."""
        return SURE * self.error <= self.within


@dataclass(frozen=True)
class Range:
    """Where a key may lie."""

    low: float
    high: float
    log: bool = False

    def flat(self, value: float) -> float:
        """On a scale on which the range is even."""
        return math.log(value) if self.log else value

    def back(self, flat: float) -> float:
        """From that scale, cut to the range."""
        return min(self.high, max(self.low, math.exp(flat) if self.log else flat))


def ranges_of(vary: Mapping[str, Sequence[float]], logs: Mapping[str, bool]) -> dict[str, Range]:
    """Ranges from the ends of the values of each key; SandError if they are no numbers."""
    for key, values in vary.items():
        if not all(isinstance(value, int | float) for value in values) or len(values) < 2:
            raise SandError(f"vary {key}: a calibration needs a range of numbers, such as 0.1..0.8:2")
    return {key: Range(min(values), max(values), logs.get(key, False)) for key, values in vary.items()}


def optuna() -> Any:
    """The library, quiet; SandError if it is not installed."""
    try:
        import optuna as library
    except ModuleNotFoundError:
        raise SandError("calibrations need Optuna: pip install 'taichi-sand[calibrate]'") from None
    library.logging.set_verbosity(library.logging.ERROR)
    return library


def calibrate(
    load: Callable[[list[str]], Any],
    ranges: Mapping[str, Range],
    measure: str,
    target: float,
    within: float,
    asked: Asked,
    store: Store,
    run: Runner,
    *,
    most: int = 24,
    abreast: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Calibration:
    """Runs at most `most` trials, `abreast` at a time; stops once the mean measurement is known to lie `within` of `target`.

    Raises:
        SandError: there is no such measurement.
        PhysicsError: no value in the ranges measures the target, or nearly all runs fail.
    """
    library = optuna()
    sampler = library.samplers.TPESampler(seed=0, n_startup_trials=0, multivariate=len(ranges) > 1)
    study = library.create_study(sampler=sampler)
    first = starts(ranges)
    base, trials = load([]).seed, []
    while len(study.trials) < most:
        batch = min(abreast, most - len(study.trials))
        asked_trials = []
        for _ in range(batch):
            number = len(study.trials)
            aim = first[number] if number < len(first) else _aim(trials, ranges, target, number)
            if aim is not None:
                study.enqueue_trial(aim)
            asked_trials.append((study.ask(), number))
        points = [
            ({key: rounded(trial.suggest_float(key, r.low, r.high, log=r.log)) for key, r in ranges.items()}, base + number)
            for trial, number in asked_trials
        ]
        for (trial, _), point, value in zip(asked_trials, points, _run(load, points, measure, asked, store, run), strict=True):
            if value is None:
                study.tell(trial, state=library.trial.TrialState.FAIL)
            else:
                study.tell(trial, abs(value - target))
                trials.append((point[0], value))
        if progress:
            progress(len(study.trials) / most)
        found = conclude(trials, ranges, target, within)
        if len(study.trials) >= len(first) + LEAST_NEAR and found and found.sure:
            return found
    found = conclude(trials, ranges, target, within)
    if found is None:
        seen = (
            f"; the runs measured {min(v for _, v in trials):.4g} to {max(v for _, v in trials):.4g}" if trials else "; no run measured it"
        )
        raise PhysicsError(f"no value in the ranges gives {measure} = {target:g}{seen}")
    return found


def starts(ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """FIRST points that fill the ranges evenly (a Kronecker sequence; of one key, at even distances)."""
    points = []
    for k in range(FIRST):
        shares = [(0.5 + k) / FIRST] if len(ranges) == 1 else [(0.5 + k * math.sqrt(p)) % 1.0 for p in (2, 3, 5, 7, 11, 13)]
        flat = {
            key: r.flat(r.low) + share * (r.flat(r.high) - r.flat(r.low)) for (key, r), share in zip(ranges.items(), shares, strict=False)
        }
        points.append({key: ranges[key].back(value) for key, value in flat.items()})
    return points


def _run(load: Callable, points: list[tuple[dict, int]], measure: str, asked: Asked, store: Store, run: Runner) -> list[float | None]:
    """The measurement at each point, with its seed; None where a run failed. What is in the store is not run again."""
    plans = [plan(load, {key: [value] for key, value in values.items()}, [seed], asked) for values, seed in points]
    whole = Plan(plans[0].title, {}, [], [job for one in plans for job in one.jobs])
    execute(whole, store, run)
    found: list[float | None] = []
    for job in whole.jobs:
        report = store.report(job)
        known = numbers(report) if report else {}
        if report and measure not in known and not asked.measures:
            raise SandError(f"measure {measure}: the report has no such number; it has {', '.join(known)}")
        found.append(known.get(measure))
    return found


def _aim(trials: list, ranges: Mapping[str, Range], target: float, number: int) -> dict[str, float] | None:
    """Where the line meets the target, for one key; None leaves the proposal to Optuna."""
    if len(ranges) != 1 or number % 3 >= 3 * AIMED:
        return None
    found = conclude(trials, ranges, target, 0.0)
    return found.values if found else None


def conclude(trials: list[tuple[dict, float]], ranges: Mapping[str, Range], target: float, within: float) -> Calibration | None:
    """Fits the measurement by a plane over the keys, near where that meets the target; None if it does not do so within the ranges.

    Which trials are near is told by their places, not by what they measured: to choose by a noisy number would bias the fit.
    """
    names = list(ranges)
    least = max(LEAST_NEAR, len(names) + 3)
    if len(trials) < least:
        return None
    flat = np.array([[ranges[key].flat(values[key]) for key in names] for values, _ in trials])
    value = np.array([v for _, v in trials])
    ends = np.array([[r.flat(r.low), r.flat(r.high)] for r in ranges.values()])
    rows = np.arange(len(trials))
    for _ in range(ROUNDS):
        centre = flat[rows].mean(0)
        design = np.column_stack([np.ones(len(rows)), flat[rows] - centre])
        fit, *_ = np.linalg.lstsq(design, value[rows], rcond=None)
        if not fit[1:].any():
            return None
        way = (target - fit[0]) * fit[1:] / (fit[1:] @ fit[1:])  # to the nearest point of the plane's contour
        at = np.clip(centre + way, ends[:, 0], ends[:, 1])
        row = np.concatenate([[1.0], at - centre])
        spread = float(np.sqrt(((value[rows] - design @ fit) ** 2).sum() / (len(rows) - design.shape[1])))
        covariance = spread**2 * np.linalg.pinv(design.T @ design)
        measured, error = float(row @ fit), float(np.sqrt(row @ covariance @ row))
        away = np.linalg.norm((flat - at) / np.ptp(ends, axis=1), axis=1)
        rows = np.argsort(away, kind="stable")[: max(least, math.ceil(NEAR * len(trials)))]
    if abs(measured - target) > max(within, SURE * error):
        return None
    slope = fit[1:]
    values = {key: rounded(ranges[key].back(float(place))) for key, place in zip(names, at, strict=True)}
    errors = dict.fromkeys(names, math.nan)
    if len(names) == 1:
        step = error / abs(float(slope[0]))
        errors = {names[0]: step * values[names[0]] if ranges[names[0]].log else step}
    return Calibration(values, errors, measured, error, spread, trials, within)
