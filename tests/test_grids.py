"""Fields that `run` writes: what xarray, meshio and any XML reader read back are those of the simulation."""

import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from taichi_sand.cli.main import app
from taichi_sand.output.grids import arrays_of
from tests.outputs import run, simulated


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of each kind, of a run each."""
    folder = tmp_path_factory.mktemp("fields")
    for name in ("fields.nc", "fields.vtu", "many.pvd"):
        run(folder, 0.1, fields=name)
    return folder


@pytest.fixture(scope="module")
def sim() -> Any:
    return simulated(0.1)


def check(found: meshio.Mesh, fields: dict[str, np.ndarray]) -> None:
    """Whether a mesh has these fields at its points, and squares between them."""
    count = fields["density"].size
    assert len(found.points) == count and found.cells[0].type == "quad"
    assert np.array_equal(found.points[:, 0].reshape(fields["density"].shape)[0], fields["x"])
    assert np.array_equal(found.points[:, 1].reshape(fields["density"].shape)[:, 0], fields["y"])
    corners = found.points[found.cells[0].data]
    sides = np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=-1)
    assert sides.min() > 0 and len(corners) == (len(fields["x"]) - 1) * (len(fields["y"]) - 1)
    assert np.array_equal(found.point_data["density"], fields["density"].ravel())
    assert np.array_equal(found.point_data["momentum"][:, :2], fields["momentum"].reshape(count, 2))
    stress = found.point_data["contact_stress"].reshape(count, 3, 3)
    assert np.array_equal(stress[:, :2, :2], fields["contact_stress"].reshape(count, 2, 2)) and not stress[:, 2].any()


def test_netcdf(folder: Path, sim: Any) -> None:
    """Over time; the mass in them is that of the grains."""
    with xarray.open_dataset(folder / "fields.nc", engine="scipy") as found:
        assert found.sizes["time"] == 3 and np.abs(found["time"].values - [0, 0.05, 0.1]).max() <= 0.5 * sim.step
        assert found["density"].attrs["units"] == "kg/m2" and found["time"].attrs["units"] == "s"
        cell = float(found["x"].diff("x")[0] * found["y"].diff("y")[0])
        assert found["density"].sum(("x", "y")).values * cell == pytest.approx(sim.report()["mass_kg"], rel=1e-3)
        now = arrays_of(sim.fields(sim.bed.diameter, 2 * sim.bed.diameter))
        for name, values in now.items():
            last = found[name] if name in ("x", "y") else found[name].isel(time=-1)
            assert np.array_equal(last.values, values, equal_nan=True), name


def test_vtu(folder: Path, sim: Any) -> None:
    check(meshio.read(folder / "fields.vtu"), arrays_of(sim.fields(sim.bed.diameter, 2 * sim.bed.diameter)))


def test_pvd(folder: Path, sim: Any) -> None:
    """A list of files and their times, which are there."""
    sets = ElementTree.parse(folder / "many.pvd").getroot().findall("./Collection/DataSet")
    assert np.abs(np.array([float(one.get("timestep", "nan")) for one in sets]) - [0, 0.05, 0.1]).max() <= 0.5 * sim.step
    files = [folder / one.get("file", "") for one in sets]
    check(meshio.read(files[-1]), arrays_of(sim.fields(sim.bed.diameter, 2 * sim.bed.diameter)))
    assert sorted(folder.glob("many_*.vtu")) == files


def test_without_xarray_it_is_the_same_mesh(sim: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with_it = arrays_of(sim.fields())
    monkeypatch.setitem(sys.modules, "xarray", None)
    without = arrays_of(sim.fields())
    assert all(np.array_equal(with_it[name], without[name], equal_nan=True) for name in {*with_it} - {"i", "j"})


@pytest.mark.parametrize(("name", "library"), [("fields.nc", "xarray"), ("fields.vtu", "meshio"), ("fields.pvd", "meshio")])
def test_what_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, library: str) -> None:
    """One sentence before anything is simulated; without the library, one that names the extra."""
    (tmp_path / name).mkdir()
    for wrong, sentence in {"fields.txt": "a file that ends in .nc, .vtu, .pvd", name: "it is a folder"}.items():
        done = CliRunner().invoke(app, ["run", "settle", "--fields", str(tmp_path / wrong)])
        assert done.exit_code == 2 and sentence in done.output and "--fields" in done.output
    monkeypatch.setitem(sys.modules, library, None)
    done = CliRunner().invoke(app, ["run", "settle", "--fields", str(tmp_path / "other" / name)])
    assert done.exit_code == 2 and f"--fields needs {library}" in done.output and "pip install 'taichi-sand[data]'" in done.output
