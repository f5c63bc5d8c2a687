"""In a notebook: makes, advances, is interrupted, shows pictures, closes, as cells of a kernel of Jupyter."""

import asyncio
import threading
import time
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="Jupyter is not installed")
nbclient = pytest.importorskip("nbclient", reason="Jupyter is not installed")
pytest.importorskip("ipykernel", reason="Jupyter is not installed")

ROOT = Path(__file__).parents[1]
MAKE = """
import taichi_sand as sand
scene = sand.Scene(size=[0.2, 0.3], grains=[{"radius": 0.01, "count": 20}])
sim = sand.Simulation(scene, threads=1)
sim.advance(0.05)
print(sim.count)
"""
ENDLESS = """
open("endless", "w").close()
sim.advance(1e5)
"""
AFTER = """
reached = sim.steps
assert sim.world.pace[None].done == sim.steps == sim.report()["steps"]
sim.advance_steps(10)
again = sand.Simulation(scene, threads=1)
again.advance_steps(reached + 10)
assert (again.positions == sim.positions).all() and reached > 0
print("the same")
"""
PICTURE = """
from PIL import Image
Image.fromarray(sim.image())
"""
CLOSE = """
sim.close()
again.close()
try:
    sim.positions
except sand.SandError as error:
    print(error)
"""
OWN = """
import taichi as ti
numbers = ti.field(ti.i32, 3)

@ti.kernel
def count():
    for i in numbers:
        numbers[i] = i

with sand.Simulation(scene, threads=1) as sim:
    count()
    sim.advance(0.05)
    print(sim.count, numbers.to_numpy().tolist())
"""


def test_cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    cells = [nbformat.v4.new_code_cell(source.strip()) for source in (MAKE, ENDLESS, AFTER, PICTURE, CLOSE, OWN)]
    notebook = nbformat.v4.new_notebook(cells=cells)
    client = nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}})
    answered: list[float] = []

    def interrupt() -> None:
        while not (tmp_path / "endless").exists():
            time.sleep(0.05)
        time.sleep(0.3)
        answered.append(time.perf_counter())
        asyncio.run(client.km.interrupt_kernel())

    with client.setup_kernel():
        for number, cell in enumerate(cells):
            if number == 1:
                thread = threading.Thread(target=interrupt)
                thread.start()
                with pytest.raises(nbclient.exceptions.CellExecutionError, match="KeyboardInterrupt"):
                    client.execute_cell(cell, number)
                answered.append(time.perf_counter())
                thread.join()
            else:
                client.execute_cell(cell, number)
    printed = ["".join(part.get("text", "") for part in cell.outputs if part.output_type == "stream") for cell in cells]
    assert printed[0] == "20\n" and printed[2] == "the same\n" and "has been closed" in printed[4] and printed[5] == "20 [0, 1, 2]\n"
    assert any("image/png" in part.get("data", {}) for part in cells[3].outputs)
    assert answered[1] - answered[0] < 5.0, "of wall time, on a machine that may be busy"
