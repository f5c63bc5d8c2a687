"""What is looked at closely while a scene is played: numbers of a grain, a ruler, plots; and rewinding."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichi_sand import Scene
from taichi_sand.measure import grain, profiles
from taichi_sand.play import numbers, recording
from taichi_sand.play.pace import Pace
from taichi_sand.play.plots import PLOTS
from taichi_sand.play.rewind import EVERY
from taichi_sand.play.session import Session

GRAVITY, RADIUS, DENSITY = 9.81, 0.01, 1000.0
MASS = DENSITY * math.pi * RADIUS**2
TOWER = {
    "size": [0.1, 0.4],
    "solver": {"kind": "md"},
    "materials": [{"name": "steel"}],
    "grains": [{"positions": [[0.05, RADIUS * (2 * k + 1)] for k in range(4)], "radius": RADIUS, "density": DENSITY, "material": "steel"}],
}
"""Four discs, one on the other."""


@pytest.fixture(scope="module")
def tower() -> Iterator[Session]:
    """Shared, at rest."""
    session = Session(Scene(**TOWER), threads=1)
    session.advance(round(2.0 / session.sim.step))
    yield session


def measured(session: Session) -> dict[str, Any]:
    """As faces measure."""
    return numbers.measure(session, {})


def test_numbers_of_a_grain(tower: Session) -> None:
    """The second disc of a tower: it bears two, and is borne by the lowest with three weights."""
    found = grain.about(tower.sim, 1)
    assert found is not None
    assert found["mass"] == pytest.approx(MASS, rel=1e-5) and found["inertia"] == pytest.approx(0.5 * MASS * RADIUS**2, rel=1e-5)
    assert found["kind"] == "steel disc" and not found["fixed"]
    assert found["position"] == pytest.approx(tower.sim.positions[1].tolist())
    assert math.hypot(*found["velocity"]) < 1e-3
    by = {one["with"]: one["force"] for one in found["contacts"]}
    assert set(by) == {"grain 0", "grain 2"}
    assert by["grain 0"] == pytest.approx([0.0, 3 * MASS * GRAVITY], rel=0.01, abs=0.01 * MASS * GRAVITY)
    assert by["grain 2"] == pytest.approx([0.0, -2 * MASS * GRAVITY], rel=0.01, abs=0.01 * MASS * GRAVITY)
    assert found["force"] == pytest.approx([0.0, MASS * GRAVITY], abs=0.03 * MASS * GRAVITY)
    lowest = grain.about(tower.sim, 0)
    assert lowest is not None and {one["with"] for one in lowest["contacts"]} == {"grain 1", "bottom"}
    assert grain.about(tower.sim, 99) is None and grain.about(tower.sim, -1) is None


def test_what_is_not_looked_at_is_not_measured(tower: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    watching, now = tower.watching, measured(tower)
    monkeypatch.setattr(grain, "about", None)
    monkeypatch.setattr(profiles, "surface_line", None)
    for name in ("stress_by_depth", "force_distribution", "crossing"):
        monkeypatch.setattr(profiles, name, None)
    seen = watching.look(tower, now, {})
    assert seen["grain"] is None and seen["line"] is None
    assert set(seen["plots"]) == {"kinetic", "floor"}
    assert seen["plots"]["floor"] == pytest.approx(1.0, abs=0.01)
    watching.plot("nothing", True)
    assert watching.plots == {"kinetic", "floor"}


def test_every_plot_has_its_numbers(tower: Session) -> None:
    watching = tower.watching
    for name in PLOTS:
        watching.plot(name, True)
    tower.watching.line = (0.02, 0.02, 0.08, 0.02)
    watching.grain = 1
    seen = watching.look(tower, measured(tower), {})
    assert set(seen["plots"]) == set(PLOTS)
    for name, plot in PLOTS.items():
        value = seen["plots"][name]
        assert len(value) == 2 and len(value[0]) == len(value[1]) if plot.along else isinstance(value, float), name
    assert dict(seen["grain"]["rows"])["contacts"] == "2" and len(seen["grain"]["contacts"]) == 2
    assert dict(seen["line"]["rows"])["length"] == "0.06 m, 3.0 d"
    tower.do(["open", Scene(**TOWER).to_json()])
    assert tower.watching.grain is None and tower.watching.line is None
    tower.do(["undo"])


def test_the_stress_grows_with_depth(tower: Session) -> None:
    """Disc k from above bears k weights and rests on k + 1: (2 k + 1) r weights on its own area, pi r^2. The third lies, pressed as it is,
    a little less than 2 d below the first, and so in the layer of the first two.
    """
    depth, stress = profiles.stress_by_depth(tower.sim)
    assert depth == [1.0, 3.0]
    weights = np.array([(1 + 3 + 5) / 3, 7.0])
    assert stress == pytest.approx(weights * MASS * GRAVITY * RADIUS / (math.pi * RADIUS**2), rel=0.02)


def test_a_slope_is_fitted() -> None:
    """A stair of discs, 20 degrees steep, held in place; and what falls through a line."""
    steps = [[0.02 + 0.012 * k, 0.02 + 0.012 * k * math.tan(math.radians(20))] for k in range(30)]
    scene = Scene(size=[0.4, 0.3], gravity=[0, 0], grains=[{"positions": steps, "radius": 0.006, "velocity": [0.0, -0.3]}])
    session = Session(scene, threads=1)
    fit = profiles.surface_line(session.sim, (0.05, 0.0, 0.35, 0.0))
    assert fit is not None
    assert fit["angle"] == pytest.approx(20.0, abs=0.3) and fit["rms"] < 0.1
    assert fit["ends"][1] == pytest.approx(0.006 + 0.02 + 0.03 * math.tan(math.radians(20)), abs=0.002)
    assert profiles.surface_line(session.sim, (0.05, 0.0, 0.06, 0.0)) is None  # too short for a fit
    through = (0.1, 0.08, 0.3, 0.08)  # from left to right: down is to its right
    beside = np.abs(session.sim.positions[:, 1] - 0.08) < session.sim.bed.diameter
    assert beside.sum() > 3
    wanted = beside.sum() * 0.3 / (2 * session.sim.bed.diameter)
    assert profiles.crossing(session.sim, through) == pytest.approx(wanted, rel=1e-4)
    assert profiles.crossing(session.sim, (*through[2:], *through[:2])) == pytest.approx(-wanted, rel=1e-4)


def test_forces_have_a_distribution(tower: Session) -> None:
    """Three contacts between grains, of 1, 2 and 3 weights: 1/2, 1 and 3/2 of their mean, each a third of all in a bin of 1/4."""
    size, density = profiles.force_distribution(tower.sim)
    filled = {round(f, 3): 10**p for f, p in zip(size, density, strict=True) if not math.isnan(p)}
    assert sum(filled.values()) * 0.25 == pytest.approx(1.0)
    assert len(filled) == 3 and all(value == pytest.approx(4 / 3) for value in filled.values())


def test_rewinding_goes_back_and_a_recording_does_so_too(tmp_path: Path) -> None:
    """Moments half a second apart; gone back to bit for bit, also when it is done again."""
    path = tmp_path / "it.record"
    session = Session(Scene(**{**TOWER, "grains": [{"radius": RADIUS, "count": 12, "fill": "lattice"}]}), threads=1)
    recorder, pace = recording.Recorder(session, path), Pace()

    def play(seconds: float) -> None:
        end = session.sim.time + seconds
        while session.sim.time < end:
            steps = pace.advance(session, 0.0, min(200, max(1, round((end - session.sim.time) / session.sim.step))))
            recorder(session.take_log(), steps)

    session.do(["back", 0.0])
    assert "switch on rewind" in session.message
    session.do(["rewinding", True])
    assert session.rewind.times() == [0.0]
    digests = {0.0: session.digest()}
    for k in range(1, 5):
        play(EVERY)
        digests[k * EVERY] = session.digest()
    times = session.rewind.times()
    assert len(times) == 5 and np.abs(np.diff(times) - EVERY).max() < 0.01
    session.do(["back", 1.1])
    assert session.sim.time == times[2] and not session.message
    play(0.2)
    assert len(session.rewind.times()) == 5  # one may go forward again
    session.do(["back", 9.0])
    assert session.sim.time == times[4]
    session.do(["undo"])
    assert session.sim.time == pytest.approx(times[2] + 0.2, abs=0.01)
    session.do(["back", 0.0])
    assert session.digest() == digests[0.0]
    play(0.6)
    assert len(session.rewind.times()) == 2  # what came later is no more
    session.do(["rewinding", False])
    play(0.6)
    assert session.rewind.times() == []
    recorder.close()
    *_, (again, _) = recording.replay(recording.read(path), path, "cpu", 1)
    assert again.digest() == session.digest()
