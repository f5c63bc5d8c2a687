"""The layout "cells", which a GPU runs on: all there is runs in it, to the same bits every time, and does what the other layouts do.

On a CPU the layout is forced; `pytest tests/test_cells.py -m "slow or not slow" --arch cuda` runs the same tests on a GPU.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import taichi as ti
from helpers import D, R, digest, fresh_taichi, listed

import taichi_sand as sand
from taichi_sand.run import stepping
from taichi_sand.world import build, checkpoint
from taichi_sand.world.search import prefix_sum

LOOSE = {"radius": [0.004, 0.006], "count": 300, "fill": "lattice", "pitch": 1.3, "jitter": 0.1, "region": [0.0, 0.0, 0.3, 0.3]}
FRICTION = {"friction": {"mu": 0.5}}
SLEEPY = {"sleeping": {"speed": 0.05, "time": 0.05}}
SHAKEN = {"points": [[0.1, 0.03], [0.2, 0.03]], "shake": {"amplitude": [0.002, 0.0005], "frequency": 5.0}}
LID = {"points": [[0.02, 0.33], [0.28, 0.33]], "velocity": [0.0, -0.5], "force": 5.0}
PERIODIC_X = {"left": "periodic", "right": "periodic"}
TRIANGLES = {"shape": "triangle", "radius": 0.004, "count": 60, "fill": "lattice", "region": [0.0, 0.06, 0.3, 0.3], "angle": "random"}
BAR = {"positions": [[0.05 + 0.01 * k, 0.35] for k in range(12)], "radius": R, "bonded": True}
BOULDERS = {"positions": [[0.08 + 0.14 * k, 0.42, 0.03] for k in range(2)]}
SPRING = {"shape": "disc", "radius": 0.005, "rate": 200, "region": [0.02, 0.4, 0.28, 0.48]}
CASES: dict[str, dict[str, Any]] = {
    "plain": {"grains": [LOOSE]},
    "clumps, shaken wall, periodic": {"grains": [TRIANGLES], "walls": [SHAKEN, LID], "edges": PERIODIC_X},
    "damp, warm, asleep": {
        "grains": [{**LOOSE, "pitch": 1.05, "count": 250, "region": [0.0, 0.0, 0.3, 0.12]}],
        "walls": [{"points": [[0.2, 0.0], [0.2, 0.2]]}],
        "effects": {**FRICTION, **SLEEPY, "cohesion": {}, "moisture": {"evaporation": 0.1}, "heat": {}},
    },
    "bonds, boulders, sources, sinks": {
        "grains": [LOOSE, BAR, BOULDERS],
        "sources": [SPRING],
        "sinks": [{"region": [0.1, 0.0, 0.2, 0.01]}],
        "effects": {**FRICTION, "bonds": {"reach": 0.2}},
    },
}


@pytest.fixture
def arch(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The backend, with the layout "cells" on any."""
    monkeypatch.setattr(build, "layout_of", lambda gpu, grains: "cells")
    return request.config.getoption("--arch")


def scene_of(case: str, kind: str, **more: Any) -> sand.Scene:
    keys = {"size": [0.3, 0.5], "effects": FRICTION, "solver": {"kind": kind, "tolerance": 0.05}, "seed": 4}
    return sand.Scene(**{**keys, **CASES[case], **more})


def start(scene: sand.Scene, arch: str, threads: int = 2) -> sand.Simulation:
    fresh_taichi()
    return sand.Simulation(scene, arch=arch, threads=threads)


def check_contacts(sim: sand.Simulation) -> None:
    """Every overlap that O(n^2) finds is listed, and no pair twice."""
    wraps = sim.scene.size[0] if sim.scene.edges.left == "periodic" else np.inf
    pairs = [(min(c.first, c.second), max(c.first, c.second)) for c in listed(sim) if not c.wall]
    x, r, ids = sim.positions, sim.radii, sim.ids
    way = x[:, None] - x[None]
    way[..., 0] -= np.round(way[..., 0] / wraps) * wraps if np.isfinite(wraps) else 0.0
    gap = np.hypot(way[..., 0], way[..., 1]) - r[:, None] - r[None]
    found = {(min(ids[i], ids[j]), max(ids[i], ids[j])) for i, j in np.argwhere(np.triu(gap < 0, 1))}
    if not sim.world.clumps:  # the circles around those may overlap while they do not
        assert len(pairs) == len(set(pairs)) and not found - set(pairs)


def test_sums_and_order(arch: str) -> None:
    """The parallel sort's parts against NumPy, over three levels of runs."""
    fresh_taichi()
    ti.init(arch=getattr(ti, arch), cpu_max_num_threads=2)
    rows = prefix_sum.RUN**2 * 5 + 3
    column, sums = ti.field(ti.i32, rows), ti.field(ti.i32, prefix_sum.scratch_rows(rows))

    @ti.kernel
    def add_up():
        prefix_sum.prefix_sum(column, sums, True)

    @ti.kernel
    def put_in_order():
        for k in range(rows // 8):
            prefix_sum.put_in_order(column, 8 * k, 8 * k + 8)

    values = np.random.default_rng(1).integers(0, 9, rows).astype(np.int32)
    column.from_numpy(values)
    add_up()
    assert (column.to_numpy() == np.cumsum(values) - values).all()
    column.from_numpy(values)
    put_in_order()
    assert (column.to_numpy()[: rows // 8 * 8].reshape(-1, 8) == np.sort(values[: rows // 8 * 8].reshape(-1, 8), axis=1)).all()
    ti.reset()


def test_goes_on_to_the_same_bits(arch: str) -> None:
    """A bed of discs falls: no contact is missed, nobody is lost, and from half-way on it goes the same way twice."""
    sim = start(scene_of("plain", "md"), arch)
    assert sim.world.layout == "cells"
    sim.advance(0.05)
    fields = sim._fields()
    there = {name + part: array for name, field in fields.items() for part, array in checkpoint.read_field(field).items()}
    ends, steps, owed = [], sim.steps, sim.owed
    for _ in range(2):
        checkpoint.restore(fields, there)
        sim.steps, sim.owed = steps, owed
        sim.advance(0.1)
        check_contacts(sim)
        ends.append(digest(sim))
    assert ends[0] == ends[1] and sim.count == 300 and sim.flags() == []
    assert sim.world.pace[None].list_builds > 10


def test_a_driver_that_leaves_cells_out_is_refused(arch: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if one cell had listed nothing, which leaves what the other half of the table had."""
    real = stepping.march

    def careless(sim: Any, *given: Any) -> None:
        real(sim, *given)
        sim.world.blocks.pair_end[5] = 0

    monkeypatch.setattr(stepping, "march", careless)
    with pytest.raises(sand.SandError, match=f"--arch {arch}: its driver leaves out"):
        start(scene_of("plain", "md"), arch)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["md", "rigid"])
@pytest.mark.parametrize("case", CASES)
def test_all_there_is(case: str, kind: str, arch: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Every part of the physics: the same bits on any number of threads and after a resume; what falls comes to rest as in "one"."""
    seconds, reports, ends = 0.5, [], []
    for threads in (1, 2):
        sim = start(scene_of(case, kind), arch, threads)
        assert sim.world.layout == "cells"
        sim.advance(0.5 * seconds)
        if threads == 2:
            sim.save(tmp_path / "half.npz")
            del sim
            fresh_taichi()
            sim = sand.Simulation.resume(tmp_path / "half.npz", arch=arch, threads=2)
        sim.advance(0.5 * seconds)
        check_contacts(sim)
        assert sim.made - sim.taken == sim.count and sim.flags() == []
        ends.append(digest(sim))
        reports.append(sim.report())
        del sim
    assert ends[0] == ends[1]
    monkeypatch.setattr(build, "layout_of", lambda gpu, grains: "one")
    sim = start(scene_of(case, kind), "cpu", 1)
    sim.advance(seconds)
    one, cells = sim.report(), reports[0]
    print(case, kind, {key: (one[key], cells[key]) for key in cells if isinstance(cells[key], int | float)})
    assert cells["grains"] == pytest.approx(one["grains"], abs=20 if "sinks" in case else 0)
    height = [report["potential_energy_J"] / report["mass_kg"] for report in (cells, one)]  # sinks have taken more from one or the other
    assert height[0] == pytest.approx(height[1], rel=0.03)
    for key, share in (("overlap_mean", 0.3), ("packing_fraction", 0.05), ("floor_force_N", 0.2)):
        assert cells[key] == pytest.approx(one[key], rel=share), key
    if "heat_J" in one:
        assert cells["heat_J"] == pytest.approx(one["heat_J"], rel=0.05)
        assert cells["wetness_mean"] == pytest.approx(one["wetness_mean"], rel=0.01)
    if "grains_asleep" in one:
        assert cells["grains_asleep"] > 0 and one["grains_asleep"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_momentum_is_kept(kind: str, arch: str) -> None:
    """Discs that collide in free space, over periodic edges: momentum stays to the rounding of 32 bits."""
    rng = np.random.default_rng(3)
    places = (np.stack(np.meshgrid(np.arange(12), np.arange(12)), -1).reshape(-1, 2) + 0.5) * 2 * D
    rows = [[*place, R, *rng.uniform(-1, 1, 2)] for place in places]
    edges = dict.fromkeys(("left", "right", "bottom", "top"), "periodic")
    scene = sand.Scene(
        size=[24 * D, 24 * D], gravity=[0, 0], edges=edges, grains=[{"positions": rows}], solver={"kind": kind}, effects=FRICTION
    )
    sim = start(scene, arch)
    before = np.array(sim.report()["momentum_Ns"])
    energy = sim.report()["kinetic_energy_J"]
    sim.advance(0.2)
    after = sim.report()
    mass = after["mass_kg"]
    assert after["kinetic_energy_J"] < 0.9 * energy
    assert np.abs(np.array(after["momentum_Ns"]) - before).max() < 1e-5 * mass
    check_contacts(sim)


@pytest.mark.slow
@pytest.mark.parametrize("color", ["kind", "order"])
def test_pictures(color: str, arch: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same picture, to the rounding of a channel, as "one" on a CPU paints of the same grains; rims may meet in another order."""
    scene = scene_of("plain", "md", view={"color": color})
    pictures = []
    for backend, layout in ((arch, "cells"), ("cpu", "one")):
        monkeypatch.setattr(build, "layout_of", lambda gpu, grains, layout=layout: layout)
        sim = start(scene, backend, 1)
        pictures.append(sim.image().astype(int))
        del sim
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 2).mean() < 1e-3
