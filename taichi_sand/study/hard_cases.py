"""The hard cases of `taichi-sand stress` (physics.md C): discs of 1 cm unless said otherwise."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from taichi_sand.study.laboratory import OPEN, D, Disc, G, M, R, chain_forces, simulate
from taichi_sand.study.stress import EXPLOSION, Gate, Watch, case, inside

DOWN = (0.0, -G)
UNIT = math.sqrt(G * D)
"""Speed sqrt(g d) [m/s]."""


def poured(count: int, width: float, height: float, solver: dict[str, Any], **keys: Any) -> Any:
    """`count` discs of 8 to 12 mm, loosely placed, about to fall."""
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": count, "fill": "lattice", "pitch": 1.3, "jitter": 0.2}]
    return simulate(grains, (width, height), solver, gravity=keys.pop("gravity", DOWN), mu=keys.pop("mu", 0.5), **keys)


def column_of(count: int, solver: dict[str, Any], settle: float) -> Iterator[Gate]:
    """An exactly vertical column of touching discs."""
    discs = [Disc(0.1, R + k * D) for k in range(count)]
    sim = simulate(list(reversed(discs)), (0.2, (count + 2) * D), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=count * D)
    watch.run(settle, every=settle / 20)
    yield from watch.bounded()
    yield Gate("sideways / d", float(np.abs(sim.positions[:, 0] - 0.1).max()) / D, 1e-6)
    yield Gate("overlap max / tolerance", watch.last["overlap_max"] / solver["tolerance"], 1.0)
    carried = chain_forces(sim, count)
    yield Gate("force / weight above - 1", float(np.abs(carried / (M * G * np.arange(1, count + 1)) - 1).max()), 0.01)


@case("column", "10 discs exactly above one another (C1, A13)")
def column(solver: dict[str, Any]) -> Iterator[Gate]:
    """C1."""
    yield from column_of(10, {**solver, "precision": 64}, 3.0)


@case("tall-column", "100 discs exactly above one another, 60 s (C1)", quick=False)
def tall_column(solver: dict[str, Any]) -> Iterator[Gate]:
    """C1."""
    yield from column_of(100, {**solver, "precision": 64}, 60.0)


@case("tower", "1000 discs exactly above one another: bounded, if not at rest (C1)", quick=False)
def tower(solver: dict[str, Any]) -> Iterator[Gate]:
    """C1."""
    discs = [Disc(0.1, R + k * D) for k in range(1000)]
    watch = Watch(simulate(discs, (0.2, 1010 * D), solver, gravity=DOWN, mu=0.5), drop=1000 * D)
    watch.run(1.0, every=0.1)
    yield from watch.bounded()


@case("heavy-on-light", "a disc 1000 times as heavy falls on three that fill the floor (C3)")
def heavy_on_light(solver: dict[str, Any]) -> Iterator[Gate]:
    """C3."""
    light = [Disc(R + k * D, R) for k in (0, 1, 2)]
    heavy = Disc(1.5 * D, R + 2 * D, radius=1.5 * R, density=1000 * M / (math.pi * (1.5 * R) ** 2))
    sim = simulate([*light, heavy], (3 * D, 8 * D), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=3 * D)
    watch.run(3.0)
    yield from watch.bounded()
    yield Gate("overlap max / d", watch.last["overlap_max"], 0.1)
    yield Gate("speed max / sqrt(g d)", watch.last["speed_max_m_s"] / UNIT, 1e-3)


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
    pile = {"radius": R, "count": 300, "fill": "hexagonal", "region": [0.0, 0.0, 0.3, 0.2]}
    bullet = {"positions": [[0.15, 0.35, R, 5.0, -60.0]]}
    sim = simulate([pile, bullet], (0.3, 0.4), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=0.4, speed=60.0)
    watch.run(1.5)
    yield from watch.bounded()


def overlapping_rows(share: float) -> list[Disc]:
    """A pyramid of four rows whose discs overlap by this share of d, on a floor."""
    pitch = D * (1 - share)
    tall = pitch * math.sqrt(0.75)
    return [Disc(0.15 + (k - 0.5 * (3 - row)) * pitch, R + row * tall) for row in range(4) for k in range(4 - row)]


@case("recovery", "pyramids of four rows that overlap by 25, 50 and 90 % (C6)")
def recovery(solver: dict[str, Any]) -> Iterator[Gate]:
    """C6."""
    for share in (0.25, 0.5, 0.9):
        sim = simulate(overlapping_rows(share), (0.3, 0.2), solver, gravity=DOWN, mu=0.5)
        top = 0.0
        for _ in range(100):
            sim.advance(0.005)
            top = max(top, sim.report()["speed_max_m_s"])
        yield Gate(f"speed out of {100 * share:.0f} % / sqrt(g d)", top / UNIT, 1.05)
        yield Gate(f"overlap left of {100 * share:.0f} % / d", sim.report()["overlap_max"], 0.05)


@case("swallowed", "a small disc wholly inside a big one (C6)")
def swallowed(solver: dict[str, Any]) -> Iterator[Gate]:
    """C6."""
    discs = [Disc(10.0, 10.0, radius=4 * R), Disc(10.0 + 0.8 * R, 10.0 + 0.3 * R, radius=R)]
    sim = simulate(discs, (20.0, 20.0), solver, gravity=(0.0, 0.0), mu=0.5)
    top, mass = 0.0, np.array([disc.mass for disc in discs])
    for _ in range(400):
        sim.advance(0.005)
        top = max(top, sim.report()["speed_max_m_s"])
    push = float(np.abs(mass @ sim.velocities).max())
    yield Gate("speed / sqrt(g d)", top / UNIT, 1.05 * math.sqrt(4))
    yield Gate("overlap left / d", sim.report()["overlap_max"], 0.05)
    yield Gate("momentum out of nothing / (m sqrt(g d))", push / (M * UNIT), 1e-4)


@case("coincident", "2, 3 and 10 discs in one place on a floor (C7)")
def coincident(solver: dict[str, Any]) -> Iterator[Gate]:
    """C7."""
    for count in (2, 3, 10):
        digests = []
        for _ in range(2):
            sim = simulate([Disc(0.15, R)] * count, (0.3, 0.3), solver, gravity=DOWN, mu=0.5)
            top = 0.0
            for _ in range(50):
                sim.advance(0.02)
                top = max(top, sim.report()["speed_max_m_s"])
            digests.append(sim.positions.tobytes())
        yield Gate(f"speed of {count} / sqrt(g d)", top / UNIT, 1.05)
        yield Gate(f"overlap left of {count} / d", sim.report()["overlap_max"], 0.05)
        yield Gate(f"different results of {count}", float(digests[0] != digests[1]), 0.0)


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


@case("rest", "a pile of 2000 discs, 60 s at rest (C15)", quick=False)
def rest(solver: dict[str, Any]) -> Iterator[Gate]:
    """C15."""
    sim = poured(2000, 0.7, 0.8, solver)
    watch = Watch(sim, drop=0.8)
    watch.run(4.0)
    before = sim.positions
    watch.run(60.0, every=1.0)
    yield from watch.bounded()
    yield from watch.resting(solver["tolerance"])
    yield Gate("drift in 60 s / d", float(np.hypot(*(sim.positions - before).T).max()) / D, 0.01)


@case("pieces", "0.5 s in pieces of 0.001 to 0.2 s gives the bits of one piece (C17)")
def pieces(solver: dict[str, Any]) -> Iterator[Gate]:
    """C17."""
    whole, parts = [], np.random.default_rng(1).dirichlet(np.ones(12) * 0.4) * 0.5
    for cuts in ([0.5], parts):
        sim = poured(200, 0.3, 0.3, solver)
        done = 0
        for end in np.cumsum(cuts):
            count = round(end / sim.step) - done
            sim.advance_steps(count)
            done += count
        whole.append((sim.positions.tobytes(), sim.velocities.tobytes()))
    yield Gate("different bits", float(whole[0] != whole[1]), 0.0)


@case("flips", "gravity turned every quarter of a second, made tenfold, and taken away (C18)")
def flips(solver: dict[str, Any]) -> Iterator[Gate]:
    """C18."""
    sim = poured(300, 0.3, 0.4, solver)
    for k in range(24):
        angle = k * 2.4
        strength = 10 * G if k % 8 == 7 else 0.0 if k % 8 == 3 else G
        sim.retune(sim.scene.model_copy(update={"gravity": (strength * math.sin(angle), -strength * math.cos(angle))}))
        sim.advance(0.25)
        yield Gate("grains lost", 300 - inside(sim), 0.0)
    sim.retune(sim.scene.model_copy(update={"gravity": DOWN}))
    sim.advance(2.0)
    watch = Watch(sim, drop=0.4)
    watch.run(1.0)
    yield from watch.bounded()
    yield Gate("rms speed / sqrt(g d)", float(np.sqrt((sim.velocities**2).sum(1).mean())) / UNIT, 0.02)


@case("not-a-number", "one disc in free flight among 300 gets a velocity that is no number (C19)")
def not_a_number(solver: dict[str, Any]) -> Iterator[Gate]:
    """C19."""
    results = []
    for bad in (False, True):
        pile = {"radius": R, "count": 300, "fill": "hexagonal", "region": [0.0, 0.0, 0.3, 0.2]}
        sim = simulate([pile, {"positions": [[0.15, 5.0, R, 0.0, 0.0]]}], (0.3, 6.0), solver, gravity=DOWN, mu=0.5)
        sim.advance(0.05)
        if bad:
            twist = sim.world.grains.twist
            slot = int(np.flatnonzero(sim.world.grains.id.to_numpy()[:301] == 300)[0])
            twist[slot] = [math.nan, math.nan, math.nan, 0.0]
        sim.advance(0.2)
        results.append(sim.positions[:300])
        finite = np.isfinite(sim.positions).all() and np.isfinite(sim.velocities).all()
        yield Gate("numbers that are not finite", 0.0 if finite else EXPLOSION, 0.0)
        yield Gate("bad grain not named", float(bad and not any("grain 300" in flag for flag in sim.flags())), 0.0)
    apart = float(np.abs(results[0] - results[1]).max())
    yield Gate("others moved / d", apart / D, 1e-4)  # the search comes at other times, so the last bits differ


@case("few", "no grain, one, two (C20)")
def few(solver: dict[str, Any]) -> Iterator[Gate]:
    """C20."""
    for count in (0, 1, 2):
        sim = simulate([Disc(0.1 + k * D, 0.05) for k in range(count)], (0.3, 0.2), solver, gravity=DOWN, mu=0.5)
        sim.advance(0.5)
        yield Gate("grains lost", count - inside(sim), 0.0)


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
    """C23."""
    small = {"radius": R, "count": 1000, "fill": "lattice", "pitch": 1.2, "jitter": 0.1, "region": [0.0, 0.0, 1.2, 0.4]}
    big = {"positions": [[0.15 + 0.22 * k, 0.55, 20 * R] for k in range(5)]}
    sim = simulate([small, big], (1.2, 0.8), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=0.7)
    watch.run(2.0)
    yield from watch.bounded()


@case("open", "grains that leave through open edges are counted (C20)")
def leaving(solver: dict[str, Any]) -> Iterator[Gate]:
    """C20."""
    discs = [Disc(0.05 + 0.02 * k, 0.1, vx=20.0 * (-1) ** k, vy=7.0 * k) for k in range(8)]
    sim = simulate(discs, (0.3, 0.3), solver, edges=OPEN)
    sim.advance(0.5)
    yield Gate("grains not counted as lost", 8 - sim.lost, 0.0)
