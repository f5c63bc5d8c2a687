"""What comes out of a sweep: a table (sweep.csv) and the same as an array with a dimension a varied key (sweep.nc, xarray)."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

import taichi_sand
from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.measure.named import UNITS
from taichi_sand.study.sweep.job import as_csv, numbers
from taichi_sand.study.sweep.plan import Job, Plan
from taichi_sand.study.sweep.store import Store

ENDINGS = {"kg": "kg", "J": "J", "Ns": "N s", "Nms": "N m s", "N": "N", "m_s": "m/s", "m": "m", "s": "s"}
"""Units by the endings of names of the report."""
IN_DIAMETERS = ("overlap", "tolerance")


def unit_of(name: str) -> str:
    """Unit of a number of the report, told by its name; "1" if it has none."""
    if name in UNITS:
        return UNITS[name]
    if name.startswith(IN_DIAMETERS):
        return "d"
    match = re.search(rf"_({'|'.join(ENDINGS)})(_[xy])?$", name)
    return ENDINGS[match[1]] if match else "1"


def rows_of(plan: Plan, store: Store) -> list[dict[str, Any]]:
    """A row a job, in the order of the plan: key, varied values, seed, status, sentence, and the numbers of its report."""
    rows = []
    for job in plan.jobs:
        report = store.report(job)
        status = store.status(job) or "missing"
        sentence = "; ".join(report["flags"]) if report else store.failure(job).get("sentence", "")
        row = {"run": job.key, **{key: as_text(value) for key, value in job.values.items()}, "status": status, "sentence": sentence}
        rows.append(row | (numbers(report) if report else {}))
    return rows


def as_text(value: Any) -> Any:
    """Numbers and words as they are, anything else as JSON."""
    return value if isinstance(value, int | float | str) and not isinstance(value, bool) else json.dumps(value)


def table(plan: Plan, store: Store) -> bytes:
    """The rows as CSV; what a failed run does not have stays empty."""
    rows = rows_of(plan, store)
    names = list(dict.fromkeys(name for row in rows for name in row))
    return as_csv([{name: row.get(name, "") for name in names} for row in rows])


def xarray() -> Any:
    """The library; SandError if it is not installed."""
    try:
        import xarray as library
    except ModuleNotFoundError:
        raise SandError("sweeps need xarray: pip install 'taichi-sand[study]'") from None
    return library


def dataset(plan: Plan, store: Store, command: str) -> Any:
    """An xarray.Dataset with a dimension a varied key and one for seeds; NaN where a run has no such number, `status` says why.

    Attributes: title, the command that gives the same again, the version.
    """
    library, rows = xarray(), rows_of(plan, store)
    dims = [*plan.vary, "seed"]
    coords = {key: [as_text(value) for value in values] for key, values in plan.vary.items()} | {"seed": np.array(plan.seeds, np.int32)}
    words = ("run", "status", "sentence", *dims)
    names = list(dict.fromkeys(name for row in rows for name in row if name not in words))
    variables = {}
    for name in names:
        values = np.array([row.get(name, np.nan) for row in rows], float).reshape(plan.shape)
        variables[name] = (dims, values, {"units": unit_of(name)})
    for name in ("run", "status", "sentence"):
        variables[name] = (dims, np.array([row[name] for row in rows], dtype=object).astype(str).reshape(plan.shape))
    attributes = {"title": plan.title, "command": command, "version": f"taichi-sand {taichi_sand.__version__}"}
    return library.Dataset(variables, coords, attributes)


def write(plan: Plan, store: Store, command: str) -> Any:
    """Writes sweep.csv and sweep.nc, each complete or as it was; returns the dataset."""
    found = dataset(plan, store, command)
    _put(store.folder / "sweep.csv", table(plan, store))
    _put(store.folder / "sweep.nc", bytes(found.to_netcdf(engine="scipy", format="NETCDF3_64BIT")))
    return found


def _put(path: Path, content: bytes) -> None:
    with writing.replacing(path) as made:
        made.write_bytes(content)


def failed(plan: Plan, store: Store) -> list[tuple[Job, str]]:
    """Jobs without a report, each with how it failed."""
    return [(job, status) for job in plan.jobs if (status := store.status(job)) != "done"]
