"""Hard cases of `taichi-sand stress`: what must stand, and stand still (physics.md C). Discs of 1 cm unless said otherwise."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from taichi_sand.study.laboratory import D, Disc, G, M, R, chain_forces, listed, simulate
from taichi_sand.study.stress.gates import DOWN, UNIT, Gate, Watch, case, poured


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
    """C3: settled in 3 s; with md in 12. The dashpot of a contact has the restitution of its pair, so it goes with the light mass m, and
    a step can follow no stronger one: the heavy disc, M, rocks on light ones with a decay rate of about 0.16 sqrt(k m) / M, 0.7 / s at
    tolerance 0.05.
    """
    light = [Disc(R + k * D, R) for k in (0, 1, 2)]
    heavy = Disc(1.6 * D, R + 2 * D, radius=1.5 * R, density=1000 * M / (math.pi * (1.5 * R) ** 2))
    sim = simulate([*light, heavy], (3 * D, 8 * D), solver, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=3 * D)
    watch.run(12.0 if solver["kind"] == "md" else 3.0)
    yield from watch.bounded()
    yield Gate("overlap max / d", watch.last["overlap_max"], 0.1)
    yield Gate("speed max / sqrt(g d)", watch.last["speed_max_m_s"] / UNIT, 1e-3)


@case("rest", "a pile of 2000 discs, 60 s at rest (C15)", quick=False)
def rest(solver: dict[str, Any]) -> Iterator[Gate]:
    """C15. Rattlers are left out: as nothing resists rolling, a disc that nothing holds rolls on and on along the floor of its cage."""
    sim = poured(2000, 0.7, 0.8, solver)
    watch = Watch(sim, drop=0.8)
    watch.run(4.0)
    before, held = sim.positions, bearing(sim) > 1
    watch.run(60.0, every=1.0)
    held &= bearing(sim) > 1
    yield from watch.bounded()
    yield from watch.resting(solver["tolerance"])
    yield Gate("rattlers / grains", 1.0 - float(held.mean()), 0.1)
    yield Gate("drift in 60 s / d", float(np.hypot(*(sim.positions - before)[held].T).max()) / D, 0.01)


def bearing(sim: Any) -> np.ndarray:
    """Contacts of every grain with more than 1e-3 of the mean force; those with less than two are rattlers (physics.md B3)."""
    many, contacts = np.zeros(sim.count, int), [contact for contact in listed(sim) if contact.force[0] > 0]
    least = 1e-3 * float(np.mean([contact.force[0] for contact in contacts]))
    for contact in contacts:
        if contact.force[0] > least:
            many[contact.first] += 1
            if not contact.wall:
                many[contact.second] += 1
    return many


@case("gapped-column", "10 discs above one another, 0.1 d apart, fall and stand (C1)")
def gapped_column(solver: dict[str, Any]) -> Iterator[Gate]:
    """C1."""
    discs = [Disc(0.1, R + 1.1 * k * D) for k in range(10)]
    sim = simulate(discs, (0.2, 13 * D), {**solver, "precision": 64}, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=11 * D)
    watch.run(3.0)
    yield from watch.bounded()
    yield from watch.resting(solver["tolerance"])
    yield Gate("sideways / d", float(np.abs(sim.positions[:, 0] - 0.1).max()) / D, 1e-6)


@case("light-to-heavy", "a column of five discs, each five times as heavy as the one below (C3)")
def light_to_heavy(solver: dict[str, Any]) -> Iterator[Gate]:
    """C3."""
    density = M / (math.pi * R**2)
    discs = [Disc(0.75 * D, R + k * D, density=density * 5**k) for k in range(5)]
    sim = simulate(discs, (1.5 * D, 7 * D), {**solver, "precision": 64}, gravity=DOWN, mu=0.5)
    watch = Watch(sim, drop=5 * D)
    watch.run(3.0)
    yield from watch.bounded()
    yield Gate("overlap max / d", watch.last["overlap_max"], 0.1)
    yield Gate("speed max / sqrt(g d)", watch.last["speed_max_m_s"] / UNIT, 1e-3)


@case("asleep", "a pile of 300 discs falls asleep, does not move a bit, and wakes when gravity turns (C15)")
def asleep(solver: dict[str, Any]) -> Iterator[Gate]:
    """C15. A disc that lies loose on the floor may roll on for seconds, without rolling resistance, and keeps those around it awake."""
    sim = poured(300, 0.3, 0.4, solver, effects={"friction": {"mu": 0.5}, "sleeping": {}})
    watch = Watch(sim, drop=0.4)
    watch.run(10.0, every=0.1)
    before = sim.positions
    yield Gate("share awake", 1 - watch.last["grains_asleep"] / 300, 0.02)
    sim.advance(5.0)
    yield Gate("drift in 5 s / d", float(np.abs(sim.positions - before).max()) / D, 0.0 if watch.last["grains_asleep"] == 300 else 1e-3)
    sim.retune(sim.scene.model_copy(update={"gravity": (0.5 * G, -G)}))
    sim.advance(0.5)
    moved = float(np.abs(sim.positions - before).max()) / D
    yield Gate("share of the weight's turn not felt", 1.0 - min(1.0, moved / 0.1), 0.0)
    yield from watch.bounded()
