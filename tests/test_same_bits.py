"""The same scene gives the same bits on 1 thread, in what one before it has left, and on 2 threads with a checkpoint in the middle, over
scenes that have every effect.
"""

from pathlib import Path

import pytest
from helpers import digest, fresh_taichi

import taichi_sand as sand

SCENES = {
    "hourglass": ["scale=0.1"],
    "circles": [],
    "soft_sand": [],
    "hard_sand": [],
    "sandcastle": [],
    "jello": [],
    "drum": [],
    "hopper": ["solver.kind=md"],
    "brazil_nut": [],
    "settle": ["scale=0.3", "effects.sleeping.time=0.01", "effects.sleeping.speed=0.1", "effects.drag.wind_x=1.0"],
    "pile": ["effects.rolling.mu=0.1", "effects.heat.conduction=10.0", "solver.kind=md"],
    "billiards": ["effects.cohesion.bond_number=5.0", "effects.moisture.wetness=0.2", "effects.friction.mu=0.5", "gravity=[0.0, -9.81]"],
    "stack": ["effects.push={}"],
    "dam_break": [],
}
STEPS = 300


def covered() -> set[str]:
    """Effects that the scenes above have."""
    return {name for scene, more in SCENES.items() for name in sand.load(scene, more).effects}


def test_every_effect_is_covered() -> None:
    """A new effect needs a scene here."""
    from taichi_sand import effects

    assert set(effects.names()) - set(effects.own) <= covered()


@pytest.mark.parametrize("name", SCENES)
def test_same_bits(name: str, tmp_path: Path) -> None:
    """design.md 7."""
    scene = sand.load(name, SCENES[name])
    digests = []
    for threads in (1, 1, 2):
        fresh_taichi()
        sim = sand.Simulation(scene, arch="cpu", threads=threads)
        sim.advance_steps(STEPS // 2)
        if threads == 2:
            sim.save(tmp_path / "half.npz")
            del sim
            fresh_taichi()
            sim = sand.Simulation.resume(tmp_path / "half.npz", threads=threads)
        sim.advance_steps(STEPS - STEPS // 2)
        digests.append((digest(sim), sim.lost, sim.flags(), sim.time))
        del sim
    assert digests[0] == digests[1] == digests[2]
