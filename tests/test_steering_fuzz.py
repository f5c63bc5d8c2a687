"""Whatever is added, taken out, set and pushed, in any order: counts, ids, masses and momentum add up, and nothing breaks."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import R, fresh_taichi
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import taichi_sand as sand
from taichi_sand.play.snapshot import restore, take

G, RHO, SIDE = 9.81, 2000.0, 36 * R
GRAINS = [
    {"radius": R, "density": RHO, "positions": [[(3 * k + 2) * R, 3 * R] for k in range(6)]},
    {"radius": R, "density": RHO, "shape": "triangle", "positions": [[6 * R, 9 * R], [14 * R, 9 * R]]},
]
AROUND = dict.fromkeys(("left", "right", "bottom", "top"), "periodic")
CASES: dict[str, dict[str, Any]] = {
    "without gravity": {"gravity": (0.0, 0.0), "edges": AROUND, "effects": {"friction": {"mu": 0.3}, "push": {}}},
    "asleep": {"effects": {"friction": {"mu": 0.3}, "push": {}, "sleeping": {"time": 0.05, "speed": 0.02}}},
    "wet": {"effects": {"friction": {"mu": 0.3}, "push": {}, "cohesion": {"bond_number": 1.0}, "moisture": {}}},
}
NUMBER = st.floats(0.0, 1.0, allow_nan=False)
ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("add"), st.sampled_from(["disc", "triangle"]), NUMBER, NUMBER, NUMBER, NUMBER),
        st.tuples(st.just("remove"), st.lists(NUMBER, max_size=3)),
        st.tuples(st.just("set"), NUMBER, NUMBER, NUMBER, NUMBER, NUMBER),
        st.tuples(st.just("push"), NUMBER, NUMBER, NUMBER, NUMBER),
        st.tuples(st.just("advance"), st.integers(1, 60)),
    ),
    min_size=3,
    max_size=12,
)
built: dict[tuple[str, str], tuple[sand.Simulation, Any]] = {}


def ready(case: str, kind: str) -> sand.Simulation:
    """A simulation of the case at its start: one structure for all examples."""
    if (case, kind) not in built:
        built.clear()
        fresh_taichi()
        scene = sand.Scene(**{"size": [SIDE, SIDE], "gravity": (0.0, -G), "solver": {"kind": kind}, "grains": GRAINS, **CASES[case]})
        sim = sand.Simulation(scene, threads=1)
        built[case, kind] = sim, take(sim)
    restore(*built[case, kind])
    return built[case, kind][0]


class Books:
    """What there should be, kept beside."""

    def __init__(self, sim: sand.Simulation) -> None:
        self.sim = sim
        self.mass = dict(zip(sim.ids.tolist(), masses(sim), strict=True))
        self.force = {grain: np.zeros(2) for grain in self.mass}
        self.momentum = np.zeros(2)

    def do(self, action: tuple) -> None:
        """Does one action; what may not be is refused, and has changed nothing."""
        verb, *given = action
        now = momentum(self.sim)
        try:
            {"add": self.add, "remove": self.remove, "set": self.set, "push": self.push, "advance": self.advance}[verb](*given)
        except sand.SandError as error:
            assert "would overlap" in str(error) or "there is no grain" in str(error), error
        if verb != "advance":
            self.momentum += momentum(self.sim) - now

    def add(self, kind: str, x: float, y: float, vx: float, size: float) -> None:
        ids = self.sim.add(
            [[SIDE * x, SIDE * y]], radius=(0.6 + 0.4 * size) * R, velocities=(vx - 0.5, 0.2), angles=6 * x, spins=vx, kind=kind
        )
        self.mass[int(ids[0])] = float(masses(self.sim)[self.sim.ids.tolist().index(ids[0])])
        self.force[int(ids[0])] = np.zeros(2)

    def some(self, share: float) -> int:
        return int(self.sim.ids[min(int(share * self.sim.count), self.sim.count - 1)]) if self.sim.count else 0

    def remove(self, shares: list[float]) -> None:
        ids = sorted({self.some(share) for share in shares})
        self.sim.remove(ids)
        for grain in ids:
            del self.mass[grain], self.force[grain]

    def set(self, which: float, x: float, y: float, vx: float, spin: float) -> None:
        grain = self.some(which)
        self.sim.set_state(grain, positions=[[SIDE * x, SIDE * y]], velocities=(vx - 0.5, 0.0), spins=[10 * spin])
        row = self.sim.ids.tolist().index(grain)
        assert self.sim.positions[row] == pytest.approx([SIDE * x % SIDE, SIDE * y % SIDE], abs=1e-6 * SIDE)

    def push(self, which: float, fx: float, fy: float, torque: float) -> None:
        weight = RHO * math.pi * R**2 * G
        force = np.array([fx - 0.5, fy - 0.5]) * 2 * weight
        grain = self.some(which)
        self.sim.push(grain, force=force, torque=(torque - 0.5) * weight * R)
        self.force[grain] = force

    def advance(self, steps: int) -> None:
        start = self.sim.time
        self.sim.advance_steps(steps)
        self.momentum += (self.sim.time - start) * sum(self.force.values(), np.zeros(2))

    def check(self, conserved: bool) -> None:
        """All adds up."""
        sim = self.sim
        assert sim.count == len(self.mass) and sim.ids.tolist() == sorted(self.mass) and sim.lost == 0
        assert masses(sim) == pytest.approx([self.mass[grain] for grain in sorted(self.mass)], rel=1e-5)
        for values in (sim.positions, sim.velocities, sim.angles, sim.spins):
            assert np.isfinite(values).all()
        assert sim.flags() == []
        if conserved:
            scale = sum(self.mass.values(), 0.0) + 1e-9
            assert momentum(sim) == pytest.approx(self.momentum, abs=2e-5 * scale)


def masses(sim: sand.Simulation) -> np.ndarray:
    """Of the grains, by id [kg]."""
    areas = np.array([sim.scene.form_of(table).area * table.density for table in sim.scene.grains])
    world = sim.world
    ids, kinds = (column.to_numpy()[: sim.count] for column in (world.grains.id, world.grains.kind))
    return areas[kinds[np.argsort(ids)]] * sim.radii**2


def momentum(sim: sand.Simulation) -> np.ndarray:
    """Of all grains [N s]."""
    return masses(sim) @ sim.velocities if sim.count else np.zeros(2)


def play(case: str, kind: str, actions: list[tuple]) -> None:
    books = Books(ready(case, kind))
    for action in actions:
        books.do(action)
        books.check(case == "without gravity")


@pytest.mark.parametrize(
    ("case", "kind"),
    [
        ("without gravity", "rigid"),
        pytest.param("without gravity", "md", marks=pytest.mark.slow),
        *(pytest.param(case, kind, marks=pytest.mark.slow) for case in ("asleep", "wet") for kind in ("md", "rigid")),
    ],
)
@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(actions=ACTIONS)
def test_any_order_adds_up(case: str, kind: str, actions: list[tuple]) -> None:
    play(case, kind, actions)
