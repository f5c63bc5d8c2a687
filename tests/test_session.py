"""What the window does, done without a window."""

import numpy as np
import pytest

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
    sleep = session.sim.world.sleep.state
    assert sleep[None].asleep == 60
    before = session.sim.positions
    session.do(["effect", "sleeping", False])
    session.advance(50)
    assert free(session) == 60
    assert np.abs(session.sim.positions - before).max() < 0.02 * 0.02  # the tolerance, in d
    session.do(["choose", "destroy"])
    session.do(["stroke", "press", 0.2, 0.02, 0.0, 0.0])
    session.do(["stroke", "release", 0.2, 0.02, 0.0, 0.0])
    left = session.sim.count
    session.do(["choose", "wet"])
    session.do(["stroke", "press", 0.2, 0.02, 0.0, 0.0])
    assert session.message == "switch on moisture to wet grains"
    session.do(["stroke", "release", 0.2, 0.02, 0.0, 0.0])
    session.do(["effect", "sleeping", True])
    session.advance(round(4 / session.sim.step))
    assert left < 60 and session.sim.count == left and sleep[None].asleep == left
    assert session.sim.radii.min() == np.float32(0.01)
    session.do(["effect", "heat", True])
    session.do(["look", "color", "temperature"])
    session.do(["undo"])  # there is no temperature before
    assert session.look["color"] == "kind" and not session.message


def test_water_is_poured_and_taken_out_and_undone() -> None:
    """The left button wets what is under the brush and nothing else, the right one dries it; both are undone."""
    grains = [{"radius": 0.01, "count": 40, "fill": "lattice", "region": [0.0, 0.0, 0.2, 0.2]}]
    effects = {"cohesion": {}, "moisture": {"wetness": 0.1, "drain": 0.0, "spread": 0.0}}
    session = Session(Scene(size=[0.2, 0.3], grains=grains, gravity=[0, 0], effects=effects), threads=1)
    session.brush.size = 0.03
    under = np.hypot(*(session.sim.positions - (0.05, 0.05)).T) <= 0.03

    def wetness() -> np.ndarray:
        order = np.argsort(session.sim.world.grains.id.to_numpy()[:40])
        return session.sim.world.carried.wetness.to_numpy()[:40][order]

    session.do(["choose", "wet"])
    for other, sign in ((False, 1), (True, -1)):
        for phase in ("press", "move", "release"):
            session.do(["stroke", phase, 0.05, 0.05, 0.0, 0.0, other])
        assert not session.message and 0 < under.sum() < 40
        assert (np.abs(wetness()[~under] - 0.1) < 1e-6).all() and np.ptp(wetness()[under]) < 1e-6
        assert sign * (wetness()[under][0] - 0.1) > 0.03
        session.do(["undo"])
        assert wetness() == pytest.approx(0.1)
