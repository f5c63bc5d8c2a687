"""What users write, for pyright to check: it is never run. Strict here: no signature of the public face may be unknown or partly so."""

from pathlib import Path
from typing import assert_type

import numpy as np

import taichi_sand as sand
from taichi_sand import Scene, Simulation


def of_the_readme(path: Path) -> np.ndarray:
    """Names, paths and numbers of all kinds."""
    scene = sand.load("hourglass", ["solver.kind=md"], effects=[path / "wind.py"])
    assert_type(scene, Scene)
    assert_type(sand.load(path), Scene)
    made = sand.Scene(size=np.array([1.0, 2.0]), grains=[{"radius": np.float32(0.01), "count": np.int64(3)}])
    assert_type(made.to_json(), str)
    sim = sand.Simulation(scene, arch="cpu", threads=2)
    assert_type(sim, Simulation)
    sim.advance(0.5)
    sim.save(path / "state.npz")
    assert_type(sand.Simulation.resume(str(path)), Simulation)
    assert_type(sim.count + sim.lost, int)
    assert_type(sand.Simulation("settle").flags(), list[str])
    assert_type(len(sim.ids) + len(sim.angles) + len(sim.spins), int)
    return sim.positions + sim.velocities + sim.image()


def of_steering(sim: Simulation) -> bool:
    """Lists, arrays and numbers of NumPy alike."""
    ids = sim.add([[0.1, 0.2]], radius=np.float32(0.01), velocities=(0.0, 1.0), kind="disc")
    assert_type(ids, np.ndarray)
    sim.set_state(ids, positions=np.array([[0.1, 0.2]]), spins=[1.0])
    sim.push(ids[0], force=(1.0, 0.0), torque=0.5)
    sim.remove(ids)
    handle = sim.every(0.01, lambda s: s.set("gravity", [0.0, -1.0]))
    handle.stop()
    return sim.advance_until("rest", at_most=1.0) or sim.advance_until(lambda s: s.count > 3, at_most=1)


def of_an_error() -> str:
    """What is raised."""
    try:
        sand.load("nothing")
    except sand.SandError as error:
        return error.key
    except sand.PhysicsError as error:
        return str(error)
    return sand.__version__
