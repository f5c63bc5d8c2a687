"""Reads what `run` has written, for pictures: tables, trajectories and fields, told by the ending of the name."""

import csv
import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.files.reading import opened, read_text, reason
from taichi_sand.files.trajectory import believed
from taichi_sand.measure.numbers import WALLS

Columns = dict[str, np.ndarray]
OF_WALLS = "log/walls/"


class Written(NamedTuple):
    """What a file holds; an empty part is not there."""

    path: Path
    series: Columns  # numbers over time_s
    contacts: Columns  # of grains: force (n,) [N] and angle of the normal (n,) [rad]
    profiles: Columns  # numbers over y [m]


def read(path: Path) -> Written:
    """What a file holds.

    Raises:
        SandError: it is no file that `run` writes, or a damaged one; or a library to read it is missing.
    """
    readers = {".csv": _csv, ".parquet": _parquet, ".gsd": _trajectory, ".nc": _netcdf, ".vtu": _vtu}
    if path.suffix not in readers:
        raise SandError(f"{path}: `plot` draws what `run` writes, in files that end in {', '.join(readers)}")
    opened(path).close()
    try:
        found = readers[path.suffix](path)
    except SandError:
        raise
    except ModuleNotFoundError as error:
        raise SandError(f"{path}: needs {error.name} to be read: pip install 'taichi-sand[data]'") from None
    except Exception as error:  # of whatever library reads it
        raise SandError(f"{path}: cannot be read: {reason(error)}") from None
    if not any(map(len, found[1:])):
        raise SandError(f"{path}: holds neither a series, nor contacts, nor fields that `run` writes")
    return found


def _of_table(path: Path, columns: Columns) -> Written:
    """A table of contacts, or of a series."""
    if {"id2", "force_normal", "normal_x", "normal_y"} <= columns.keys():
        angle, between = np.arctan2(columns["normal_y"], columns["normal_x"]), columns["id2"] >= 0
        return Written(path, {}, {"force": columns["force_normal"][between], "angle": angle[between]}, {})
    return Written(path, columns if "time_s" in columns else {}, {}, {})


def _csv(path: Path) -> Written:
    rows = list(csv.reader(io.StringIO(read_text(path), newline="")))
    names, numbers = rows[0], np.array([[float(cell or "nan") for cell in row] for row in rows[1:]]).reshape(-1, len(rows[0]))
    return _of_table(path, dict(zip(names, numbers.T, strict=True)))


def _parquet(path: Path) -> Written:
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    return _of_table(path, {name: table[name].to_numpy() for name in table.column_names})


def _trajectory(path: Path) -> Written:
    """The energies and numbers of its frames, and the contacts of the last one."""
    with believed(path) as file:

        def chunk(frame: int, name: str) -> Any:
            at = frame if file.chunk_exists(frame, name) else 0
            return file.read_chunk(at, name) if file.chunk_exists(at, name) else np.zeros(1)

        names = {"time_s": "log/time", "grains": "particles/N", "contacts": "bonds/N"}
        names |= {name: f"log/{name}" for name in ("kinetic_energy_J", "potential_energy_J")}
        frames = range(file.nframes)
        series = {key: np.array([float(np.ravel(chunk(k, name))[0]) for k in frames]) for key, name in names.items()}
        for name in sorted(file.find_matching_chunk_names(OF_WALLS)):
            rows = np.array([file.read_chunk(k, name) if file.chunk_exists(k, name) else np.full(3, np.nan) for k in frames])
            named = [form.format(name.removeprefix(OF_WALLS)) for form in WALLS["wall_forces_N"]]
            series |= dict(zip(named, rows.T, strict=True))
        last = file.nframes - 1
        group, place, size = (chunk(last, name) for name in ("bonds/group", "particles/position", "configuration/box"))
        force = chunk(last, "log/bonds/force_n")
    if np.ndim(group) < 2 or not len(group):
        return Written(path, series, {}, {})
    way = place[group[:, 1], :2].astype(float) - place[group[:, 0], :2]
    way -= size[:2] * np.round(way / size[:2])
    return Written(path, series, {"force": force.astype(float), "angle": np.arctan2(way[:, 1], way[:, 0])}, {})


def _netcdf(path: Path) -> Written:
    """Profiles of the last moment."""
    import xarray

    with xarray.open_dataset(path, engine="scipy") as found:
        last = found.isel(time=-1) if "time" in found.dims else found
        return Written(path, {}, {}, profiles({str(name): last[name].values for name in (*last.data_vars, "y")}))


def _vtu(path: Path) -> Written:
    from meshio import vtu

    found: Any = vtu.read(path)  # meshio.read would end the process where it is none
    y, rows = np.unique(found.points[:, 1], return_inverse=True)
    order, shape = np.argsort(rows, kind="stable"), (len(y), len(found.points) // len(y))
    arrays = {"y": y}
    for name, values in found.point_data.items():
        wide = values[order].reshape(*shape, *({3: (3,), 9: (3, 3)}.get(values.shape[-1], ()) if values.ndim > 1 else ()))
        arrays[name] = wide
    return Written(path, {}, {}, profiles(arrays))


def profiles(arrays: dict[str, np.ndarray]) -> Columns:
    """Means over the width at each height: packing fraction; velocity by mass; contact stress."""
    density = arrays["density"]
    weight = np.where(density > 0, density, 0.0)
    total = weight.sum(axis=1)
    inside = total > 0
    found = {"y": arrays["y"][inside], "packing_fraction": arrays["packing_fraction"].mean(axis=1)[inside]}
    for k, axis in enumerate("xy"):
        moving = np.where(weight > 0, arrays["velocity"][..., k], 0.0)
        found[f"velocity_{axis}"] = ((weight * moving).sum(axis=1)[inside]) / total[inside]
        found[f"stress_{axis}{axis}"] = arrays["contact_stress"][..., k, k].mean(axis=1)[inside]
    return found
