"""Run by .ci/ovito, without the package: what OVITO shows of trajectories is what stands in them, read by gsd."""

import sys

import gsd.hoomd
import numpy as np
from ovito.io import import_file

for path in sys.argv[1:]:
    pipeline = import_file(path)
    with gsd.hoomd.open(path) as trajectory:
        assert pipeline.source.num_frames == len(trajectory)
        numbers, contacts = [], []
        for k, frame in enumerate(trajectory):
            data = pipeline.compute(k)
            particles, bonds = data.particles, data.particles.bonds
            assert particles.count == frame.particles.N and data.cell.is2D
            assert np.array_equal(particles["Radius"], frame.particles.diameter / 2)
            assert np.array_equal(particles["Position"], frame.particles.position)
            assert np.array_equal(particles["id"], frame.log["particles/id"])
            assert np.array_equal(particles["force"], frame.log["particles/force"])
            assert data.attributes["time"] == frame.log["time"][0]
            assert [one.name for one in particles.particle_types.types] == frame.particles.types
            found = 0 if bonds is None else bonds.count
            assert found == frame.bonds.N
            if found:
                assert np.array_equal(bonds["Topology"], frame.bonds.group)
                for name in ("force_n", "force_t", "overlap"):
                    assert np.array_equal(bonds[name], frame.log[f"bonds/{name}"])
            numbers.append(int(frame.particles.N))
            contacts.append(found)
    assert max(contacts) > 0
    print(f"{path}: particles {numbers}, bonds {contacts}")
