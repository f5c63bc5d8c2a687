"""Trajectories of bundled scenes as freud opens them: radii, ids, times and bonds are those of the simulation."""

from pathlib import Path

import gsd.hoomd
import numpy as np
import pytest

import taichi_sand as sand

EVERY = 0.05


@pytest.mark.parametrize("name", ["hourglass", "hard_sand", "hopper"])
def test_in_freud(name: str, tmp_path: Path) -> None:
    """What touches, as freud finds it from places and radii over the box of the file, is bonded, and nothing is that is apart; grains that
    come and go, too.
    """
    freud = pytest.importorskip("freud", reason="freud-analysis has no wheel for this Python")
    sim = sand.Simulation(sand.load(name), threads=1)
    sim.advance_to(0.4)
    recorder = sim.record(tmp_path / "run.gsd", every=EVERY)
    sim.advance_to(0.6)
    recorder.stop()
    with gsd.hoomd.open(tmp_path / "run.gsd") as file:
        frames = list(file)
    times = [float(frame.log["time"][0]) for frame in frames]
    assert times == pytest.approx([0.4, 0.45, 0.5, 0.55, 0.6], abs=sim.step)
    for frame in frames:
        p, ids, group = frame.particles, frame.log["particles/id"], frame.bonds.group
        assert (np.diff(ids) >= 0).all() and len(group) > 100
        box, reach = freud.box.Box.from_box(frame.configuration.box), float(p.diameter.max())
        found = freud.locality.AABBQuery(box, p.position).query(p.position, {"r_max": reach, "exclude_ii": True}).toNeighborList()
        one, two = found[:].T
        radii = p.diameter / 2
        straight = np.linalg.norm(p.position[one] - p.position[two], axis=1) < reach  # these boxes have walls: freud goes on beyond them
        touch = straight & (found.distances < radii[one] + radii[two] - 1e-6) & (ids[one] < ids[two])
        bonded = {(int(i), int(j)) for i, j in group}
        assert {(int(i), int(j)) for i, j in zip(one[touch], two[touch], strict=True)} <= bonded and len(bonded) == len(group)
        apart = box.compute_distances(p.position[group[:, 0]], p.position[group[:, 1]]) - radii[group].sum(axis=1)
        assert apart.max() < 0.05 * reach  # such as have just pushed one another off
        assert -apart == pytest.approx(frame.log["bonds/overlap"], abs=1e-6)
    last, rows = frames[-1], np.searchsorted(sim.ids, frames[-1].log["particles/id"])
    assert np.array_equal(np.unique(last.log["particles/id"]), sim.ids)
    single = last.particles.body < 0
    assert last.particles.diameter[single] / 2 == pytest.approx(sim.radii[rows][single], rel=1e-6)
    numbers = {frame.particles.N for frame in frames}
    assert (len(numbers) > 1) == (name == "hopper")
