"""The same bits, whatever the number of threads, and every time."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

RUN = """
import json, sys
sys.path.insert(0, "tests")
from helpers import digest, simulate
import taichi_sand as sand

threads = int(sys.argv[1])
LOOSE = {"radius": [0.008, 0.012], "density": 1000.0, "count": 400, "fill": "lattice", "pitch": 1.3, "jitter": 0.1}
DENSE = {"radius": 0.001, "count": 33000, "fill": "hexagonal", "bonded": True}
BOULDER = {"positions": [[0.3, 0.218, 0.02, 0.0, -2.0]]}
WALLS = [{"points": [[0.0, 0.3], [0.25, 0.15]]}, {"points": [[0.6, 0.3], [0.35, 0.15]]}]

def run(name, grains, size, solver, steps, **keys):
    sim = simulate(grains, size, {"precision": 32, **solver}, gravity=(0.0, -9.81), threads=threads, **keys)
    sim.advance_steps(steps)
    found[name] = [sim.world.layout, sim.steps, sim.flags(), digest(sim)]

found = {}
funnel = {"walls": WALLS, "edges": {"bottom": "open", "left": "periodic", "right": "periodic"}, "mu": 0.5, "seed": 1}
for kind, steps in (("rigid", 1500), ("md", 6000)):
    run(kind + " funnel", [LOOSE], (0.6, 0.9), {"kind": kind}, steps, **funnel)
    run(kind + " strips", [DENSE, BOULDER], (0.6, 0.3), {"kind": kind}, 60, effects={"friction": {}, "bonds": {"strength": 20}})
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def runs() -> dict[int, dict]:
    """The digests of all cases, by number of threads, each in a process of its own."""
    found = {}
    for threads in (1, 2):
        done = subprocess.run(
            [sys.executable, "-c", RUN, str(threads)],
            cwd=Path(__file__).parents[1],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            text=True,
            timeout=500,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-3000:]
        found[threads] = json.loads(done.stdout.splitlines()[-1])
    return found


@pytest.mark.parametrize("case", ["funnel", "strips"])
@pytest.mark.parametrize("kind", ["rigid", "md"])
def test_threads_do_not_matter(runs: dict[int, dict], kind: str, case: str) -> None:
    """design.md 4 and 7: bit for bit the same for 1 and 2 threads, in one block and in strips."""
    one, two = runs[1][f"{kind} {case}"], runs[2][f"{kind} {case}"]
    assert one == two
    assert one[0] == ("strips" if case == "strips" else "one") and one[2] == []
