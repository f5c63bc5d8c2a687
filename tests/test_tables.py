"""Tables that `run` writes: what pandas and pyarrow read back is the simulation."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app
from taichi_sand.output import tables
from tests.outputs import run, simulated
from tests.test_writing import disk_of

NAMES = "time id1 id2 pos1_x pos1_y pos2_x pos2_y contact_point_x contact_point_y normal_x normal_y".split()
NAMES += "force_normal force_tangential overlap history bridge".split()
READ = {".csv": pd.read_csv, ".parquet": pd.read_parquet}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both tables in both formats, of one run each."""
    folder = tmp_path_factory.mktemp("tables")
    for ending in READ:
        run(folder, 0.3, contacts=f"contacts{ending}", series=f"series{ending}")
    return folder


@pytest.fixture(scope="module")
def sim() -> Any:
    return simulated(0.3)


@pytest.mark.parametrize("ending", READ)
def test_contacts(folder: Path, sim: Any, ending: str) -> None:
    """As `contacts()` has them; the centres are as far apart as radii and overlap say, also over the edge."""
    table, found = READ[ending](folder / f"contacts{ending}"), sim.contacts()
    assert list(table.columns) == NAMES and len(table) == len(found) > 10
    for name, own in {"id1": "id1", "id2": "id2", "force_normal": "force_n", "force_tangential": "force_t", "overlap": "overlap"}.items():
        assert np.array_equal(table[name], found[own])
    assert np.array_equal(table[["contact_point_x", "contact_point_y"]], found["point"])
    radius = dict(zip(sim.ids, sim.radii, strict=True))
    apart = np.hypot(table.pos2_x - table.pos1_x, table.pos2_y - table.pos1_y)
    touching = [radius[i] + radius.get(j, 0.0) for i, j in zip(table.id1, table.id2, strict=True)]
    assert apart.to_numpy() == pytest.approx(np.array(touching) - table.overlap.to_numpy(), abs=1e-6)
    wall = table.id2 < 0
    assert wall.any() and (np.abs(table.pos1_x - table.contact_point_x) < 0.02).all()
    assert np.array_equal(table[wall][["pos2_x", "pos2_y"]], table[wall][["contact_point_x", "contact_point_y"]])


@pytest.mark.parametrize("ending", READ)
def test_series(folder: Path, sim: Any, ending: str) -> None:
    """A row at the start, at each time, and at the end; the last is the report."""
    table, report = READ[ending](folder / f"series{ending}"), sim.report()
    assert np.abs(table["time_s"] - 0.05 * np.arange(7)).max() <= 0.5 * sim.step
    last = table.iloc[-1]
    assert {"kinetic_energy_J", "coordination", "momentum_Ns_x", "momentum_Ns_y", "floor_force_N"} <= set(table.columns)
    assert not {"wall_time_s", "real_time_factor", "solver"} & set(table.columns)
    for name in ("steps", "grains", "contacts", "kinetic_energy_J", "floor_force_N"):
        assert last[name] == report[name]


@pytest.mark.parametrize("option", ["--contacts", "--series"])
def test_what_cannot_be_written(tmp_path: Path, option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence before anything is simulated; without the library, one that names the extra."""
    (tmp_path / "folder.csv").mkdir()
    for name, sentence in {"table.xlsx": "a table ends in .csv or .parquet", "folder.csv": "it is a folder"}.items():
        done = CliRunner().invoke(app, ["run", "settle", option, str(tmp_path / name)])
        assert done.exit_code == 2 and sentence in done.output and option in done.output
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    done = CliRunner().invoke(app, ["run", "settle", option, str(tmp_path / "table.parquet")])
    assert done.exit_code == 2 and "pip install 'taichi-sand[data]'" in done.output


def test_a_full_disk(sim: Any, tmp_path: Path) -> None:
    """Leaves no half of a table, and of a series the rows that there was room for."""
    columns = {"a": np.arange(100_000), "b": np.random.default_rng(0).random(100_000)}
    for ending in READ:
        with disk_of(20_000), pytest.raises(sand.SandError, match="cannot be written"):
            tables.write(tmp_path / f"table{ending}", columns)
    assert not list(tmp_path.iterdir())
    series = tables.Series(tmp_path / "series.csv")
    with disk_of(8_000), pytest.raises(sand.SandError, match="it ends with what could still be written"):
        for _ in range(40):
            series.done = -1
            series.note(sim)
    table = pd.read_csv(tmp_path / "series.csv")
    assert len(table) >= 1 and table["steps"].eq(sim.steps).all()
