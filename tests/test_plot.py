"""`plot`: what it reads of the files that `run` writes, the numbers that it draws, and its pictures."""

import math
from pathlib import Path

import gsd.hoomd
import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from taichi_sand.cli.main import app
from taichi_sand.output import tables
from taichi_sand.study.plots import draw, written

rng = np.random.default_rng(4)
COUNT = 400
ANGLE = rng.uniform(-np.pi, np.pi, COUNT)
FORCE = rng.exponential(2.0, COUNT)
STARTS = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A file of each kind, made by hand."""
    time = np.linspace(0, 1, 11)
    for ending in tables.ENDINGS:
        tables.write(tmp_path / f"series{ending}", {"time_s": time, "kinetic_energy_J": time**2, "grains": np.full(11, 7.0)})
        contacts = {"id1": np.arange(COUNT), "id2": np.where(np.arange(COUNT) % 4, 1, -1), "force_normal": FORCE}
        tables.write(tmp_path / f"contacts{ending}", {**contacts, "normal_x": np.cos(ANGLE), "normal_y": np.sin(ANGLE)})
    trajectory(tmp_path / "run.gsd")
    fields(tmp_path / "fields.nc")
    return tmp_path


def trajectory(path: Path) -> None:
    """Two frames; in the last a contact across the edge of the box, and one upwards."""
    with gsd.hoomd.open(path, "w") as out:
        for k in range(2):
            frame = gsd.hoomd.Frame()
            frame.configuration.box = [1, 1, 0, 0, 0, 0]
            frame.particles.N = 3
            frame.particles.position = [(-0.49, 0, 0), (0.49, 0, 0), (0.49, 0.02, 0)]
            frame.bonds.N, frame.bonds.group = 2 * k, [(1, 0), (1, 2)][: 2 * k]
            frame.log = {"time": [0.5 * k], "kinetic_energy_J": [3.0 * k], "bonds/force_n": [2.0, 4.0][: 2 * k]}
            out.append(frame)


def fields(path: Path) -> None:
    """Two moments of a bed that is half as dense in its upper half, and there flows with the height."""
    y, x = np.linspace(0, 1, 6), np.linspace(0, 1, 4)
    dense = np.where(y < 0.5, 2.0, 1.0)[:, None] * np.ones(4)
    flow = np.stack([np.where(y < 0.5, 0.0, y)[:, None] * np.ones(4), np.full((6, 4), np.nan)], axis=-1)
    stress = np.zeros((6, 4, 2, 2))
    stress[..., 1, 1] = (1 - y)[:, None]
    data = {"density": (("y", "x"), dense), "packing_fraction": (("y", "x"), dense / 2)}
    data |= {"velocity": (("y", "x", "i"), flow), "contact_stress": (("y", "x", "i", "j"), stress)}
    one = xarray.Dataset(data, {"x": x, "y": y})
    xarray.concat([one * 0, one], xarray.Variable("time", [0.0, 1.0])).to_netcdf(path, engine="scipy")


def test_what_is_read(folder: Path) -> None:
    for ending in tables.ENDINGS:
        assert written.read(folder / f"series{ending}").series["kinetic_energy_J"] == pytest.approx(np.linspace(0, 1, 11) ** 2)
        found = written.read(folder / f"contacts{ending}").contacts
        assert np.array_equal(found["force"], FORCE[np.arange(COUNT) % 4 > 0])  # those of grains
        assert np.cos(found["angle"]) == pytest.approx(np.cos(ANGLE[np.arange(COUNT) % 4 > 0]))
    found = written.read(folder / "run.gsd")
    assert found.series["time_s"].tolist() == [0, 0.5] and found.series["contacts"].tolist() == [0, 2]
    assert found.contacts["force"].tolist() == [2, 4] and found.contacts["angle"] == pytest.approx([0, math.pi / 2], abs=1e-6)
    profile = written.read(folder / "fields.nc").profiles
    assert profile["packing_fraction"].tolist() == [1, 1, 1, 0.5, 0.5, 0.5] and profile["stress_yy"] == pytest.approx(1 - profile["y"])
    assert profile["velocity_x"] == pytest.approx(np.where(profile["y"] < 0.5, 0, profile["y"]))


@pytest.mark.parametrize(("size", "direction"), [(0.0, 0.0), (0.3, 0.5), (0.8, 2.0)])
def test_the_fabric_is_the_one_that_contacts_were_drawn_from(size: float, direction: float) -> None:
    angle = np.linspace(-np.pi, np.pi, 200_000, endpoint=False)
    drawn = angle[rng.random(len(angle)) * (1 + size) < 1 + size * np.cos(2 * (angle - direction))]
    found, along = draw.anisotropy(drawn)
    assert found == pytest.approx(size, abs=0.01)
    assert size == 0 or math.cos(2 * (along - direction)) > 0.999


@pytest.mark.parametrize("ending", STARTS)
def test_pictures(folder: Path, ending: str) -> None:
    names = ("series.csv", "contacts.parquet", "run.gsd", "fields.nc")
    done = CliRunner().invoke(app, ["plot", *(str(folder / name) for name in names), "-o", str(folder / f"plot{ending}")])
    assert done.exit_code == 0, done.output
    assert "12 panels" in done.output  # 1 of the series, 2 of contacts, 4 of the trajectory, 5 profiles
    assert (folder / f"plot{ending}").read_bytes().startswith(STARTS[ending])


def test_single_numbers(folder: Path) -> None:
    done = CliRunner().invoke(app, ["plot", str(folder / "series.csv"), "--show", "grains", "-o", str(folder / "plot.png")])
    assert done.exit_code == 0 and "1 panels" in done.output


BAD = {
    ("series.csv", "-o", "plot.jpg"): "a plot ends in .png, .svg, .pdf",
    ("series.csv", "--show", "grain"): "no file holds such a number; did you mean `grains`",
    ("nothing.csv",): "there is no such file",
    ("pipe.csv",): "is a pipe, a device or the like",
    ("series.txt",): "in files that end in .csv, .parquet, .gsd, .nc, .vtu",
    ("other.csv",): "holds neither a series, nor contacts, nor fields",
    ("words.csv",): "cannot be read",
    ("words.gsd",): "not a trajectory",
    ("words.nc",): "cannot be read",
    ("words.parquet",): "cannot be read",
    ("words.vtu",): "cannot be read",
}


@pytest.mark.parametrize("arguments", BAD, ids=" ".join)
def test_one_sentence(folder: Path, arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    monkeypatch.chdir(folder)
    os.mkfifo("pipe.csv")
    Path("other.csv").write_text("a,b\n1,2\n")
    for name in ("words.csv", "words.gsd", "words.nc", "words.parquet", "words.vtu"):
        Path(name).write_text("time_s,b\n1,two\n")
    done = CliRunner().invoke(app, ["plot", *arguments])
    assert done.exit_code == 2 and BAD[arguments] in " ".join(done.output.split()) and "Traceback" not in done.output
    assert not Path("plot.png").exists()
