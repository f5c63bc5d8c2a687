"""Fields as files: NetCDF (xarray) with a time axis, VTU (meshio) of one moment, PVD of many, told by the ending of the name."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.files import writing

if TYPE_CHECKING:
    from taichi_sand.run.simulation import Simulation

LIBRARIES = {".nc": ("xarray", "scipy"), ".vtu": ("meshio",), ".pvd": ("meshio",)}
"""Endings, and what each needs."""
AXES = ("x", "y")


def check(path: Path, option: str) -> None:
    """SandError unless fields can be written there, and the libraries are installed."""
    if path.suffix not in LIBRARIES:
        raise SandError(f"{option} {path}: fields go to a file that ends in {', '.join(LIBRARIES)}")
    for name in LIBRARIES[path.suffix]:
        try:
            __import__(name)
        except ModuleNotFoundError:
            raise SandError(f"{option} needs {name} to write {path.suffix}: pip install 'taichi-sand[data]'") from None
    writing.check(path, option)


def arrays_of(found: Any) -> dict[str, np.ndarray]:
    """What `Simulation.fields` gave, with xarray or without, as arrays by name."""
    if isinstance(found, dict):
        return found
    return {name: found[name].values for name in (*found.data_vars, *AXES)}


def mesh(found: Any) -> Any:
    """Fields as a mesh of squares; vectors and tensors with the third dimension that ParaView expects, zeros."""
    import meshio

    arrays = arrays_of(found)
    x, y = arrays.pop("x"), arrays.pop("y")
    corner = np.arange(len(x) * len(y)).reshape(len(y), len(x))
    squares = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 4)
    places = np.stack([*(axis.ravel() for axis in np.meshgrid(x, y)), np.zeros(corner.size)], axis=1)
    data = {}
    for name, values in arrays.items():
        more = values.ndim - 2
        whole = np.pad(values, [(0, 0)] * 2 + [(0, 1)] * more)
        data[name] = whole.reshape(corner.size, *([-1] if more else []))
    return meshio.Mesh(places, [("quad", squares)], point_data=data)


def write_vtu(path: Path, found: Any) -> None:
    """One file; SandError if it cannot be written."""
    from meshio import vtu

    with writing.replacing(path) as made:
        vtu.write(made, mesh(found))


class Fields:
    """The fields of a simulation, a moment after the other, on the grid of the first: for .vtu the last one counts."""

    def __init__(self, path: Path, sim: "Simulation") -> None:
        self.path, self.last_only = path, path.suffix == ".vtu"
        self.spacing = sim.bed.diameter
        self.found: list[Any] = []
        self.times: list[float] = []
        self.done = -1  # step of the last moment

    def note(self, sim: "Simulation") -> None:
        """Takes this moment, unless that has been done. SandError if it cannot be written."""
        if sim.steps == self.done:
            return
        self.done, found = sim.steps, sim.fields(self.spacing, 2 * self.spacing)
        self.times.append(sim.time)
        if self.path.suffix == ".pvd":
            write_vtu(self.path.with_name(self._part(len(self.times) - 1)), found)
            self._list()
        elif self.path.suffix == ".nc":
            self.found.append(found)
        else:
            self.found = [found]

    def close(self) -> None:
        """The end; SandError if it cannot be written."""
        if self.path.suffix == ".vtu" and self.found:
            write_vtu(self.path, self.found[0])
        elif self.path.suffix == ".nc" and self.found:
            import xarray

            whole: Any = xarray.concat(self.found, xarray.Variable("time", self.times, {"units": "s"}), combine_attrs="drop_conflicts")
            with writing.replacing(self.path) as made:
                whole.to_netcdf(made, engine="scipy", format="NETCDF3_64BIT")

    def _part(self, number: int) -> str:
        return f"{self.path.stem}_{number:05d}.vtu"

    def _list(self) -> None:
        """Writes the list of files and their times."""
        lines = [f'<DataSet timestep="{time!r}" part="0" file="{self._part(k)}"/>' for k, time in enumerate(self.times)]
        text = '<VTKFile type="Collection" version="0.1"><Collection>\n' + "\n".join(lines) + "\n</Collection></VTKFile>\n"
        with writing.replacing(self.path) as made:
            made.write_text(text, "utf-8")
