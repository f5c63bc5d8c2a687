"""Hard cases of `taichi-sand stress`: contacts that are fast, deep, many or in odd places (physics.md C). Discs of 1 cm."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from taichi_sand.solvers.tolerance import MD_CHAINS, RIGID_LOAD, SAG
from taichi_sand.study.laboratory import OPEN, D, Disc, G, M, R, listed, simulate
from taichi_sand.study.stress.gates import DOWN, PILE, TOP_SPEED, UNIT, Gate, Watch, case, inside, poured, rms_speed, sound
from taichi_sand.world.extras.hand import ATTRACT


@case("bullet-wall", "a disc at 100 d in 1/60 s against a line (C5)")
def bullet_wall(solver: dict[str, Any]) -> Iterator[Gate]:
    """C5."""
    discs = [Disc(0.1, 0.1 + 3 * D * k, vx=60.0 * (1 - 0.07 * k), vy=3.0 * k) for k in range(8)]
    sim = simulate(discs, (1.0, 0.5), solver, walls=[{"points": [[0.5, 0.0], [0.5, 0.5]]}], mu=0.5)
    watch = Watch(sim, drop=0.0, speed=60.0)
    watch.run(0.5)
    yield from watch.bounded()
    yield Gate("discs beyond the line", int((sim.positions[:, 0] > 0.5).sum()), 0.0)


@case("bullet-pile", "a disc at 100 d in 1/60 s into a pile of 300 (C5)")
def bullet_pile(solver: dict[str, Any]) -> Iterator[Gate]:
    """C5."""
    bullet = {"positions": [[0.15, 0.35, R, 5.0, -60.0]]}
    sim = simulate([PILE, bullet], (0.3, 0.4), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=0.4, speed=60.0)
    watch.run(1.5)
    yield from watch.bounded()


@case("recovery", "pyramids of four rows that overlap by 25, 50 and 90 % (C6)")
def recovery(solver: dict[str, Any]) -> Iterator[Gate]:
    """C6."""
    discs = []
    for middle, share in ((0.15, 0.25), (0.45, 0.5), (0.75, 0.9)):
        pitch = D * (1 - share)
        places = [((k - 0.5 * (3 - row)) * pitch, R + row * pitch * math.sqrt(0.75)) for row in range(4) for k in range(4 - row)]
        discs += [Disc(middle + x, y) for x, y in places]
    sim = simulate(discs, (0.9, 0.2), solver, gravity=DOWN, mu=0.5)
    watch, parting = Watch(sim, drop=4 * D, speed=UNIT), 0.0
    for _ in range(400):
        watch.run(0.0025, every=0.0025)
        parting = max(parting, parting_speed(sim))
    yield from watch.bounded(parting=math.sqrt(0.75) * (0.25 + 0.5 + 0.9) / 3)  # the mean row of such a pyramid is the second
    yield Gate("parting / sqrt(g d)", parting / UNIT, 1.05)
    yield Gate("overlap left / d", sim.report()["overlap_max"], 0.05)


def parting_speed(sim: Any) -> float:
    """Fastest motion apart of two discs that overlap [m/s]; of a disc falling elsewhere nothing."""
    x, v, r = sim.positions, sim.velocities, sim.radii
    first, second = np.triu_indices(len(x), 1)
    way, motion = x[second] - x[first], v[second] - v[first]
    distance = np.hypot(*way.T) + 1e-30
    parting = (motion * way).sum(1) / distance
    return float(np.max(parting, initial=0.0, where=distance < r[first] + r[second]))


@case("swallowed", "a small disc wholly inside a big one (C6)")
def swallowed(solver: dict[str, Any]) -> Iterator[Gate]:
    """C6."""
    discs = [Disc(10.0, 10.0, radius=4 * R), Disc(10.0 + 0.8 * R, 10.0 + 0.3 * R, radius=R)]
    sim = simulate(discs, (20.0, 20.0), solver, gravity=(0.0, 0.0), mu=0.5)
    top, mass = 0.0, np.array([disc.mass for disc in discs])
    for _ in range(400):
        sim.advance(0.005)
        top = max(top, parting_speed(sim))
    push = float(np.abs(mass @ sim.velocities).max())
    yield Gate("parting / sqrt(g d)", top / UNIT, 1.05)
    yield Gate("overlap left / d", sim.report()["overlap_max"], 0.05)
    yield Gate("momentum out of nothing / (m sqrt(g d))", push / (M * UNIT), 1e-4)


@case("coincident", "2, 3 and 10 discs in one place each on a floor (C7)")
def coincident(solver: dict[str, Any]) -> Iterator[Gate]:
    """C7."""
    digests = []
    for _ in range(2):
        sim = simulate(
            [Disc(0.15 + 0.3 * k, R) for k, count in enumerate((2, 3, 10)) for _ in range(count)], (0.9, 0.3), solver, gravity=DOWN, mu=0.5
        )
        watch, parting = Watch(sim, drop=2 * D, speed=UNIT), 0.0
        for _ in range(100):
            watch.run(0.01, every=0.01)
            parting = max(parting, parting_speed(sim))
        digests.append(sim.positions.tobytes())
    undone = math.sqrt(0.75) * (1 + 10) / 15  # a triangle of 3, a pyramid of 10
    yield from watch.bounded(parting=undone)
    yield Gate("parting / sqrt(g d)", parting / UNIT, 1.05)
    yield Gate("overlap left / d", sim.report()["overlap_max"], 0.05)
    yield Gate("different results", float(digests[0] != digests[1]), 0.0)


@case("elastic", "300 discs poured at restitution 1, then 0.99 (C10)")
def elastic(solver: dict[str, Any]) -> Iterator[Gate]:
    """C10."""
    for restitution in (1.0, 0.99):
        sim = poured(300, 0.3, 0.4, {**solver, "restitution": restitution}, mu=0.0)
        watch = Watch(sim, drop=0.4)
        watch.run(2.0)
        yield from watch.bounded()


@case("collapse", "inelastic collapse: 3 discs at e = 0.05, 88 at 0.95, on a line (C11)")
def collapse(solver: dict[str, Any]) -> Iterator[Gate]:
    """C11 (McNamara & Young 1992)."""
    for count, restitution in ((3, 0.05), (88, 0.95)):
        pitch = 1.5 * D
        discs = [Disc(0.1 + k * pitch, 0.05, vx=1.0 if k == 0 else 0.0) for k in range(count)]
        sim = simulate(
            [*discs, Disc(0.1 + count * pitch, 0.05, fixed=True)], (0.2 + count * pitch, 0.1), {**solver, "restitution": restitution}
        )
        watch = Watch(sim, drop=0.0, speed=1.0)
        watch.run(2.0)
        yield from watch.bounded()
        del sim, watch


@case("few", "no grain, one, two (C20)")
def few(solver: dict[str, Any]) -> Iterator[Gate]:
    """C20."""
    for count in (0, 1, 2):
        sim = simulate([Disc(0.1 + k * D, 0.05) for k in range(count)], (0.3, 0.2), solver, gravity=DOWN, mu=0.5)
        sim.advance(0.5)
        yield Gate("grains lost", count - inside(sim), 0.0)
        del sim


@case("corners", "discs in the corners and on the edges, half outside (C21)")
def corners(solver: dict[str, Any]) -> Iterator[Gate]:
    """C21."""
    spots = [(x, y) for x in (0.0, 0.1, 0.2) for y in (0.0, 0.1, 0.2)]
    sim = simulate([Disc(*spot) for spot in spots], (0.2, 0.2), solver, gravity=(0.0, 0.0), mu=0.5)
    sim.advance(1.0)
    at = sim.positions
    beyond = float(np.maximum(np.maximum(R - at, at - (0.2 - R)), 0.0).max())
    yield Gate("grains lost", 9 - inside(sim), 0.0)
    yield Gate("still in a wall / d", beyond / D, 0.05)


@case("far", "a pile 100000 d from the origin, in 32 bits (C21)")
def far(solver: dict[str, Any]) -> Iterator[Gate]:
    """C21."""
    width = 1e5 * D
    walls = [{"points": [[width - 0.3, 0.0], [width - 0.3, 0.4]]}]
    grains = [{"radius": R, "count": 200, "fill": "hexagonal", "pitch": 1.1, "region": [width - 0.29, 0.0, width, 0.4]}]
    sim = simulate(grains, (width, 0.4), solver, gravity=DOWN, mu=0.5, walls=walls)
    watch = Watch(sim, drop=0.4)
    watch.run(2.0)
    yield from watch.bounded()
    yield from watch.resting(solver["tolerance"])


@case("sizes", "five discs of 20 d in 1000 of d (C23)")
def sizes(solver: dict[str, Any]) -> Iterator[Gate]:
    """C23. The large ones, 400 times as heavy, fall by 0.35 m onto the small; who is between is thrown off at up to twice that speed, on
    top of its own (f64 and finer tolerances: 3.9 m/s with rigid at 0.002, 5.4 with md at 0.004).
    """
    small = {"radius": R, "count": 1000, "fill": "lattice", "pitch": 1.2, "jitter": 0.1, "region": [0.0, 0.0, 1.2, 0.4]}
    big = {"positions": [[0.15 + 0.22 * k, 0.55, 20 * R] for k in range(5)]}
    sim = simulate([small, big], (1.2, 0.8), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=0.7, speed=math.sqrt(2 * G * 0.35))
    watch.run(2.0)
    yield from watch.bounded()


@case("open", "grains that leave through open edges are counted (C20)")
def leaving(solver: dict[str, Any]) -> Iterator[Gate]:
    """C20."""
    discs = [Disc(0.05 + 0.02 * k, 0.1, vx=20.0 * (-1) ** k, vy=7.0 * k) for k in range(8)]
    sim = simulate(discs, (0.3, 0.3), solver, edges=OPEN)
    sim.advance(0.5)
    yield Gate("grains not counted as lost", 8 - sim.lost, 0.0)


@case("bullet-grain", "a disc at 100 d in 1/60 s at a disc at rest, head on (C5)")
def bullet_grain(solver: dict[str, Any]) -> Iterator[Gate]:
    """C5."""
    speed = 100 * D * 60
    sim = simulate([Disc(0.1, 0.1, vx=speed), Disc(0.1 + 4.3 * D, 0.1)], (20.0, 0.2), solver)
    watch = Watch(sim, drop=0.0, speed=speed)
    watch.run(0.2)
    yield from watch.bounded()
    yield Gate("went through", float(sim.positions[0, 0] > sim.positions[1, 0]), 0.0)
    yield Gate("momentum changed", abs(float(sim.velocities[:, 0].sum()) / speed - 1), 1e-4)


@case("clumps-overlap", "bars of two discs laid into one another by a quarter of a disc (C6)")
def clumps_overlap(solver: dict[str, Any]) -> Iterator[Gate]:
    """C6, for clumps."""
    rows = [[0.1 + 3.5 * R * k, R + 1.5 * R * row] for row in range(3) for k in range(4)]
    sim = simulate([{"shape": "2x1", "radius": R, "positions": rows}], (0.25, 0.2), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=3 * D, speed=UNIT)
    watch.run(2.0, every=0.005)
    yield from watch.bounded(parting=0.25)  # rows 2 R apart instead of 1.5 R
    yield Gate("overlap left / d", watch.last["overlap_max"], 0.05)


@case("crowd", "40 discs in one place: more pairs than there is room for (C20)")
def crowd(solver: dict[str, Any]) -> Iterator[Gate]:
    """C20: the table of pairs grows, no contact is missed, and nothing breaks."""
    sim = simulate([Disc(0.5, 0.2)] * 40, (1.0, 0.4), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=0.4, speed=UNIT)
    watch.run(0.1)
    x, radius = sim.positions, sim.radii
    gap = np.hypot(*np.moveaxis(x[:, None] - x[None], -1, 0)) - radius[:, None] - radius[None]
    touching = {(int(i), int(j)) for i, j in np.argwhere(np.triu(gap < 0, 1))}
    pairs = {(min(pair.first, pair.second), max(pair.first, pair.second)) for pair in listed(sim) if not pair.wall}
    yield Gate("contacts missed", len(touching - pairs), 0.0)
    watch.run(3.0)
    yield from watch.bounded(parting=math.sqrt(0.75) * 2.5)  # a pyramid of eight rows, and some
    yield Gate("overlap left / d", watch.last["overlap_max"], 0.1)


@case("full", "63, 64 and 65 discs: tables full to the last place (C20)")
def full(solver: dict[str, Any]) -> Iterator[Gate]:
    """C20."""
    for count in (63, 64, 65):
        sim = poured(count, 0.2, 0.2, solver)
        watch = Watch(sim, drop=0.2)
        watch.run(1.0)
        yield from watch.bounded()


@case("rush", "400 discs are pulled to their centre of mass, with g at most, and form a raft (C9)")
def rush(solver: dict[str, Any]) -> Iterator[Gate]:
    """C9 (Solver2D): stiffness and step are made for a bed of 12 grains, as the dial knows nothing of a pull by hand. A heap that starts
    beside the point would swing about it for ever.
    """
    random, k = np.random.default_rng(9), np.arange(400)
    radius = R * random.uniform(0.8, 1.2, 400)
    place = 1.45 * D * (np.stack([k % 20, k // 20], 1) - 9.5) + D * random.uniform(-0.1, 0.1, (400, 2))
    place += 0.3 - radius**2 @ place / (radius**2).sum()
    sim = simulate([{"positions": np.column_stack([place, radius]).tolist()}], (0.6, 0.6), solver | expert(solver, 12), mu=0.2, hand=True)
    now = sim.hand.now[None]
    now.work, now.place, now.reach, now.rate, now.drag = ATTRACT, (0.3, 0.3), 10.0, G, 0.0
    watch = Watch(sim, drop=0.0, speed=0.21 * math.sqrt(G / 0.5))  # the pull grows as G r / 0.5 m at first
    watch.run(4.0)
    yield from sound(sim, 400)
    yield Gate(TOP_SPEED, watch.top_speed / watch.fastest, 1.0)
    yield Gate("overlap p99 / tolerance", watch.last["overlap_p99"] / solver["tolerance"], 1.0)
    yield Gate("rms speed / sqrt(g d)", rms_speed(sim), 1e-2)


def expert(solver: dict[str, Any], depth: float) -> dict[str, float]:
    """Keys of [solver] for a bed of standard discs `depth` grains deep, where gravity does not say so."""
    if solver["kind"] == "md":
        return {"stiffness": MD_CHAINS * depth * M * G / (solver["tolerance"] * D)}
    return {"step": SAG * math.sqrt(solver["tolerance"] * D / (RIGID_LOAD * depth * G))}
