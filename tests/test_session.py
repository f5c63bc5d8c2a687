"""What the window does, done without a window."""

import numpy as np

from taichi_sand import Scene
from taichi_sand.play.session import Session


def free(session: Session) -> int:
    """Grains that can move."""
    return int((session.sim.world.grains.mobility.to_numpy()[: session.sim.count, 0] > 0).sum())


def test_whoever_slept_moves_on_when_effects_come_and_go() -> None:
    """C26: nobody is lost, frozen or thrown when sleeping and heat are switched off, undone and switched on again on a heap that sleeps."""
    grains = [{"radius": 0.01, "count": 60, "fill": "lattice", "region": [0.0, 0.0, 0.4, 0.4]}]
    session = Session(Scene(size=[0.4, 0.6], grains=grains, effects={"friction": {}, "sleeping": {}}), threads=1)
    session.advance(round(4 / session.sim.step))
    naps = session.sim.world.naps.state
    assert naps[None].asleep == 60
    before = session.sim.positions
    session.do(["effect", "sleeping", False])
    session.advance(50)
    assert free(session) == 60
    assert np.abs(session.sim.positions - before).max() < 0.02 * 0.02  # the tolerance, in d
    session.do(["choose", "destroy"])
    session.do(["stroke", "press", 0.2, 0.02, 0.0, 0.0])
    session.do(["stroke", "release", 0.2, 0.02, 0.0, 0.0])
    left = session.sim.count
    session.do(["effect", "sleeping", True])
    session.advance(round(4 / session.sim.step))
    assert left < 60 and session.sim.count == left and naps[None].asleep == left
    assert session.sim.radii.min() == np.float32(0.01)
    session.do(["effect", "heat", True])
    session.do(["look", "color", "temperature"])
    session.do(["undo"])  # there is no temperature before
    assert session.look["color"] == "kind" and not session.message
