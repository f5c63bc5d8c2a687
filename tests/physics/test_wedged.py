"""Walls without `force` yield only where grains are wedged between walls that close on each other."""

from typing import Any

import numpy as np
import pytest
from helpers import D, Disc, G, R, simulate

import taichi_sand as sand
from taichi_sand.world.walls.build import standing_walls

SOLVERS = ("rigid", "md")
SHAKE = {"amplitude": [0.006, 0.006], "frequency": 12.0}
CORNERS = [[0.04, 0.2], [0.04, 0.04], [0.16, 0.04], [0.16, 0.2], [0.04, 0.2]]


def nut(**solver: Any) -> Any:
    """The Brazil nut with other numbers of the solver; `seed` is the scene's."""
    seed = solver.pop("seed", 6)
    scene = sand.load("brazil_nut")
    return sand.Simulation(scene.model_copy(update={"seed": seed, "solver": scene.solver.model_copy(update=solver)}))


def keeps(sim: Any, until: float) -> None:
    """Nothing holds the walls up: their clocks show the time."""
    sim.advance(until)
    assert not any("held up" in flag for flag in sim.flags()), sim.flags()
    movers = sim.world.movers
    assert float(movers.age[0]) + float(movers.since[0]) == pytest.approx(sim.time, rel=1e-5)


@pytest.mark.parametrize("numbers", [{}, {"seed": 77}, {"tolerance": 0.1}, {"tolerance": 0.05, "seed": 3}])
def test_a_shaken_box_keeps_its_motion(numbers: dict[str, Any]) -> None:
    """Whatever the seed and the tolerance: it carries its grains up, and nothing is in its way. All of these were held up in 1 s."""
    keeps(nut(**numbers), 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("numbers", [{"precision": 64}, {"kind": "md"}, {"kind": "md", "tolerance": 0.05, "seed": 77}])
def test_a_shaken_box_keeps_its_motion_with_other_solvers(numbers: dict[str, Any]) -> None:
    """The same."""
    keeps(nut(**numbers), 1.5)


@pytest.mark.parametrize("kind", SOLVERS)
def test_what_moves_together_does_not_close(kind: str) -> None:
    """A closed box of four walls, shaken alike in both directions; and a floor that is shaken between still, rough sides."""
    grains = [{"radius": [0.8 * R, R], "count": 100, "fill": "hexagonal", "region": [0.05, 0.05, 0.15, 0.19]}]
    plates = [{"points": CORNERS[k : k + 2], "shake": SHAKE} for k in range(4)]
    floor = [{"points": [[0.0, 0.02], [0.12, 0.02]], "shake": {"amplitude": [0.0, 0.008], "frequency": 12.0}}]
    bed = [{"radius": [0.8 * R, R], "count": 150, "fill": "hexagonal", "region": [0.0, 0.03, 0.12, 0.3]}]
    for walls, those, width in ((plates, grains, 0.2), (floor, bed, 0.12)):
        sim = simulate(those, (width, 0.5), {"kind": kind}, gravity=(0.0, -G), walls=walls, mu=0.8)
        keeps(sim, 1.0)
        del sim


@pytest.mark.parametrize("kind", SOLVERS)
def test_one_disc_is_not_crushed(kind: str) -> None:
    """A lid comes down on a disc that lies on the floor, or on a fixed disc: it is held up, and the disc stays between."""
    for fixed in (False, True):
        base = [{"positions": [[0.1, 0.02, R]], "fixed": True}] if fixed else []
        disc = Disc(0.1, 0.02 + D if fixed else R)
        lid = {"points": [[0.0, 0.06], [0.2, 0.06]], "velocity": [0.0, -0.2]}
        sim = simulate([*base, {"positions": [[disc.x, disc.y, R]]}], (0.2, 0.1), {"kind": kind}, walls=[lid])
        sim.advance(0.4)
        low, height = standing_walls(sim.world, sim.scene)[0][0, 1], sim.positions[-1, 1]
        assert any("held up" in flag for flag in sim.flags())
        assert height < low < disc.y + R and np.isfinite(sim.positions).all()
        del sim
