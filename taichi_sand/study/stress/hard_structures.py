"""Hard cases of `taichi-sand stress`: what is built of clumps, or held together by bonds (physics.md C)."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import taichi_sand as sand
from taichi_sand.study.laboratory import D, G, R, simulate
from taichi_sand.study.stress.gates import DOWN, Gate, Watch, case, sound
from taichi_sand.world.extras.links import ends_of

FLAT = {"name": "flat", "discs": [[x, y, 1.0] for x in (-3, -1, 1, 3) for y in (-3, -1, 1, 3) if 3 in (abs(x), abs(y))]}
"""A square of twelve discs along its rim: two of them bear on two of the square below, so that it cannot roll on it."""


def squares(base: int, size: tuple[float, float], solver: dict[str, Any], flat: bool) -> Any:
    """A pyramid of squares of 4 R, of four discs or with flat sides, `base` of them in the lowest row.

    Squares of four discs meet in one disc on one disc: each row can roll on the one below, all turning by and against, as gears do. A row
    sinks by R phi^2 under the weight of those above as it turns by phi, while the overlaps resist with R times what phi changes from row
    to row. The sum is stable (as a column under its own weight, Greenhill) while they overlap by less than about 9 R / base^2 if the
    sides help nothing, and by experiment 18 R / base^2: 20 rows stand at an overlap of 0.01 d and not at 0.05 d, 100 at none of these.
    """
    side = 4 * R
    rows = [[size[0] / 2 + (k - 0.5 * (base - 1 - row)) * side, side * (row + 0.5)] for row in range(base) for k in range(base - row)]
    if flat:
        grains = {"shape": "flat", "positions": [[*place, R / 2] for place in rows]}
        return simulate([grains], size, solver, gravity=DOWN, mu=0.6, shapes=[FLAT])
    return simulate([{"shape": "square", "radius": R, "positions": rows}], size, solver, gravity=DOWN, mu=0.6)


@case("pyramid", "a pyramid of squares of four discs, 6 in the lowest row (C2)")
def pyramid(solver: dict[str, Any]) -> Iterator[Gate]:
    """C2."""
    yield from stands(squares(6, (0.2, 0.14), solver, flat=False), solver, 4 * R * 6, 3.0, 4.0)


@case("large-pyramid", "a pyramid of squares with flat sides, 20 in the lowest row, 60 s (C2)", quick=False)
def large_pyramid(solver: dict[str, Any]) -> Iterator[Gate]:
    """C2."""
    yield from stands(squares(20, (0.5, 0.44), solver, flat=True), solver, 4 * R * 20, 10.0, 60.0)


def stands(sim: Any, solver: dict[str, Any], height: float, joints: float, seconds: float, still: bool = True) -> Iterator[Gate]:
    """What was built with care, `height` [m] high, sinks by no more than 0.5 % of that, and by what so many joints of it may close: the
    tolerance each. `still`: that it has come to rest by then, too.
    """
    before = sim.positions
    watch = Watch(sim, drop=height)
    watch.run(seconds, every=seconds / 60)
    yield from watch.bounded()
    overlap, speed = watch.resting(solver["tolerance"])
    yield from (overlap, speed) if still else (overlap,)
    sunk = before[:, 1].max() - sim.positions[np.argmax(before[:, 1]), 1]
    allowed = 0.005 * height + joints * solver["tolerance"] * sim.bed.diameter
    yield Gate("top sank / (0.5 % H + joints closed)", float(sunk / allowed), 1.0)


@case("arch", "an arch of 17 wedges of four discs each, mu = 0.6, 60 s (C13)")
def arch(solver: dict[str, Any]) -> Iterator[Gate]:
    """C13: discs whose radii grow with the distance from the middle touch the joints of the wedges; the ends stand on the floor."""
    inner, wedge = 0.1, math.pi / 17
    rim = math.sin(wedge / 2)
    discs = [[1.0 + 0.1 * k, 0.0, (1.0 + 0.1 * k) * rim] for k in range(4)]
    form = sand.Scene(size=[1, 1], shapes=[{"name": "wedge", "discs": discs}]).form("wedge")
    centre = 1.0 - form.discs[0, 0] * form.reach
    rows = []
    for k in range(17):
        angle = (k + 0.5) * wedge
        place = inner * centre * np.array([math.cos(angle), math.sin(angle)])
        rows.append([0.16 + place[0], place[1], inner, 0.0, 0.0, angle])
    grains = [{"shape": "wedge", "positions": rows}]
    sim = simulate(grains, (0.32, 0.2), solver, gravity=DOWN, mu=0.6, shapes=[{"name": "wedge", "discs": discs}])
    yield from stands(sim, solver, inner * 1.42, 17 * 2 / math.pi, 60.0)  # a half-circle is lower by 2 / pi of what it is shorter


@case("huge-pyramid", "a pyramid of squares with flat sides, 100 in the lowest row, 1 s: stands, if not at rest (C2)", quick=False)
def huge_pyramid(solver: dict[str, Any]) -> Iterator[Gate]:
    """C2: with 5050 squares 60 s would take an hour. A hundred rows swing for longer than that after they were let go."""
    yield from stands(squares(100, (2.2, 2.2), solver, flat=True), solver, 4 * R * 100, 50.0, 1.0, still=False)


@case("cards", "two pairs of bars of three discs, leaning by 25 degrees on one another, and a bar of seven across, mu = 0.7 (C14)")
def cards(solver: dict[str, Any]) -> Iterator[Gate]:
    """C14: the bar across bears on the tops alone, straight down."""
    lean = math.radians(25.0)
    rise, out = 4 * R * math.cos(lean), 4 * R * math.sin(lean)
    rows = []
    for middle in (0.1 - 5 * R, 0.1 + 5 * R):
        for side in (-1, 1):
            rows.append([middle + side * (R + out / 2), R + rise / 2, R, 0.0, 0.0, math.pi / 2 + side * lean])
    across = {"name": "across", "discs": [[2.0 * k, 0.0, 1.0] for k in range(-3, 4)]}
    grains = [{"shape": "3x1", "positions": rows}, {"shape": "across", "positions": [[0.1, 3 * R + rise, R]]}]
    sim = simulate(grains, (0.2, 0.1), solver, gravity=DOWN, mu=0.7, shapes=[across])
    yield from stands(sim, solver, rise + 4 * R, 3.0, 10.0)


@case("bonds", "triangles of bonded discs so stiff that the step of the contacts would be 2.5 / omega (C12)")
def bonds(solver: dict[str, Any]) -> Iterator[Gate]:
    """C12: a step of one's own beyond the limit is refused; without one the step follows the bonds, and they stay what they are."""
    grains = [{"shape": "triangle", "radius": R, "count": 12, "region": [0.0, 0.0, 0.2, 0.2], "angle": "random", "bonded": True}]
    plain = simulate([{**grains[0], "bonded": False}], (0.2, 0.2), solver, gravity=DOWN, mu=0.5).step
    weights = (2.5 / plain) ** 2 * D / (2 * G)  # of a pair: omega^2 = 2 k / m
    effects = {"friction": {"mu": 0.5}, "bonds": {"stiffness": weights}}
    yield Gate("too long a step not refused", float(not refused(grains, {**solver, "step": plain}, effects)), 0.0)
    sim = simulate(grains, (0.2, 0.2), solver, gravity=DOWN, effects=effects)
    watch = Watch(sim, drop=0.2)
    watch.run(2.0)
    yield from watch.bounded()
    yield Gate("step times omega", sim.step * 2.5 / plain, 2.0)
    ends = ends_of(sim.world, 1)
    yield Gate("bonds broken", 36 - len(ends), 0.0)
    stretch = np.hypot(*(sim.positions[ends[:, 1]] - sim.positions[ends[:, 0]]).T) / D - 1
    yield Gate("bond stretched / (12 weights + tolerance)", float(np.abs(stretch).max() / (12 / weights + solver["tolerance"])), 1.0)


def refused(grains: list[dict[str, Any]], solver: dict[str, Any], effects: dict[str, Any]) -> bool:
    """Whether the step of `solver` is said to be more than the bonds allow."""
    try:
        simulate(grains, (0.2, 0.2), solver, gravity=DOWN, effects=effects)
    except sand.SandError as error:
        return "beyond what the effects of this scene allow" in str(error)
    return False


@case("whirl", "seven triangles in zero gravity, so fast that they turn by nearly half a turn a step, mu = 10, e = 0.95")
def whirl(solver: dict[str, Any]) -> Iterator[Gate]:
    """Found by fuzzing, rigid: where an impact is answered from afar, friction turned the slip around six times as fast."""
    grains = [
        {"shape": "triangle", "radius": [0.9921875, 1.0], "density": 1.0, "count": 7, "spin": 1000.0, "speed": [0, 0], "angle": "random"}
    ]
    rise = 0.0
    for seed in (17551407977, 1, 2):
        sim = simulate(grains, (16.0, 27.4375), solver | {"restitution": 0.95}, mu=10.0, seed=seed)
        least = first = sim.report()["kinetic_energy_J"]
        for _ in range(30):
            sim.advance(0.01)
            energy = sim.report()["kinetic_energy_J"]
            rise, least = max(rise, (energy - least) / first), min(least, energy)
        yield from sound(sim, 7)
        del sim
    yield Gate("rise of kinetic energy / that of the start", rise, 1e-3)
