"""Hard cases of `taichi-sand stress`: what changes, or breaks, on the way (physics.md C). Discs of 1 cm unless said otherwise."""

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

import taichi_sand as sand
from taichi_sand.study.laboratory import D, G, M, R, listed, simulate
from taichi_sand.study.stress.gates import DOWN, PILE, Gate, Watch, at_rest, case, inside, poured, rms_speed, sound
from taichi_sand.world.extras.hand import GRAB, IDLE


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
    yield Gate("rms speed / sqrt(g d)", rms_speed(sim), 0.02)


@case("not-a-number", "one disc in free flight among 300 gets a velocity that is no number (C19)")
def not_a_number(solver: dict[str, Any]) -> Iterator[Gate]:
    """C19."""
    results = []
    for bad in (False, True):
        sim = simulate([PILE, {"positions": [[0.15, 5.0, R, 0.0, 0.0]]}], (0.3, 6.0), solver, gravity=DOWN, mu=0.5)
        sim.advance(0.05)
        kick = float(np.float32(sim.step) * np.float32(G))
        set_twist(sim, 300, [math.nan] * 3 + [0.0] if bad else [0.0, kick, 0.0, 0.0])  # either way it stands still after the next kick
        sim.advance(0.2)
        results.append((sim.positions.tobytes(), sim.velocities.tobytes()))
        yield from sound(sim, 301)
        yield Gate("bad grain not named", float(bad and not any("grain 300" in flag for flag in sim.flags())), 0.0)
        del sim
    yield Gate("other bits than where it is stopped by hand", float(results[0] != results[1]), 0.0)


@case("bad-in-pile", "one disc deep in a pile of 300 gets a velocity that is no number, another a force of 1e18 N (C19)")
def bad_in_pile(solver: dict[str, Any]) -> Iterator[Gate]:
    """C19."""
    sim = simulate([PILE], (0.3, 0.3), solver, gravity=DOWN, mu=0.5, hand=True)
    watch = Watch(sim, drop=0.3)
    watch.run(0.5)
    set_twist(sim, 40, [math.nan, math.nan, math.nan, 0.0])
    watch.run(0.2)
    named = [flag for flag in sim.flags() if "grain 40 " in flag]
    yield Gate("bad grain not named, or others were", float(len(named) != 1 or "1 times" not in named[0]), 0.0)
    now = sim.hand.now[None]
    now.work, now.grain, now.place, now.reach, now.rate, now.limit = GRAB, 20, (0.15, 5.0), 10.0, 1e18, 1e18
    sim.advance(0.1)
    now.work = IDLE
    yield Gate("force not told", float(not any("grain 20 " in flag for flag in sim.flags())), 0.0)
    sim.advance(4.0)
    yield from sound(sim, 300)
    yield Gate("rms speed / sqrt(g d)", rms_speed(sim), 1e-2)


def set_twist(sim: Any, grain: int, twist: list[float]) -> None:
    """Gives a grain this motion."""
    slot = int(np.flatnonzero(sim.world.grains.id.to_numpy()[: sim.count] == grain)[0])
    sim.world.grains.twist[slot] = twist


@case("long-step", "a step of 0.1 s is refused; a pile at the longest step allowed, in frames of 0.5 s (C17)")
def long_step(solver: dict[str, Any]) -> Iterator[Gate]:
    """C17."""
    limit = limit_of(solver)
    yield Gate("refused without the limit", float(not limit), 0.0)
    sim = poured(300, 0.3, 0.4, {**solver, "step": 0.99 * limit})
    watch = Watch(sim, drop=0.4)
    watch.run(5.0, every=0.5)
    yield from watch.bounded()


def limit_of(solver: dict[str, Any]) -> float:
    """Longest step for that pile [s], as the sentence says that refuses a longer one; 0 if none does."""
    try:
        poured(300, 0.3, 0.4, {**solver, "step": 0.1})
    except sand.SandError as error:
        found = re.search(r"limit of (\S+) s", str(error))
        return float(found[1]) if found else 0.0
    return 0.0


@case("reversals", "gravity is reversed twice a second, 100 times (C18)", quick=False)
def reversals(solver: dict[str, Any]) -> Iterator[Gate]:
    """C18."""
    sim = poured(200, 0.3, 0.3, solver)
    for k in range(100):
        sim.retune(sim.scene.model_copy(update={"gravity": (0.0, G if k % 2 == 0 else -G)}))
        sim.advance(0.5)
    yield Gate("grains lost", 200 - inside(sim), 0.0)
    sim.advance(2.0)
    yield from at_rest(sim, 0.3, 1.0, solver["tolerance"])


WILD = {"rigid": 1.5, "md": 100.0}
"""Restitution of contacts that give energy; of soft ones that is a dashpot that pushes, with a damping ratio of -0.83."""


@case("unphysical", "friction and damping below 0, restitution above 1; then back (C22)")
def unphysical(solver: dict[str, Any]) -> Iterator[Gate]:
    """C22: energy grows by design, caps keep it finite, and afterwards all comes to rest. In the wild a wall holds with an overlap of up to
    a radius at the speed cap, and more where damping drives: no centre is farther outside.
    """
    sim = poured(300, 0.3, 0.4, solver)
    sim.advance(0.5)
    usual = {key: sim.get(key) for key in ("solver.restitution", "effects.friction.mu")}
    for key, value in (("solver.restitution", WILD[solver["kind"]]), ("effects.friction.mu", -0.5)):
        sim.set(key, value, unphysical=True)
    sim.advance(2.0)
    yield from sound(sim, 300, beyond=1.2 * R)
    for key, value in usual.items():
        sim.set(key, value)
    sim.advance(5.0)
    yield from at_rest(sim, 0.4, 0.5, solver["tolerance"])


@case("toggles", "wet to dry and back, friction taken away and given, the other solver, in a pile at rest (C26)")
def toggles(solver: dict[str, Any]) -> Iterator[Gate]:
    """C26: no change makes a jump of more than 1e-2 m g d a grain."""
    effects = {"friction": {"mu": 0.5}, "cohesion": {"bond_number": 5.0}}
    sim = poured(200, 0.3, 0.3, solver, effects=effects)
    sim.advance(3.0)
    for name, value in (("cohesion.bond_number", 0.0), ("cohesion.bond_number", 5.0), ("friction.mu", 0.0), ("friction.mu", 1.0)):
        before = energy(sim), undone(sim)
        sim.set(f"effects.{name}", value)
        yield from no_jump(sim, f"{name} {value:g}", *before)
    before, rows = (energy(sim), undone(sim)), np.hstack([sim.positions, sim.radii[:, None], sim.velocities])
    other = {"kind": "md" if solver["kind"] == "rigid" else "rigid", "tolerance": solver["tolerance"]}
    sim = simulate([{"positions": rows.tolist()}], (0.3, 0.3), other, gravity=DOWN, mu=0.5)
    yield from sound(sim, 200)
    yield from no_jump(sim, "other solver", *before)


def no_jump(sim: Any, what: str, before: float, overlaps: float) -> Iterator[Gate]:
    """Energy in the next half second against that `before`, of which `overlaps` [J] may come back: grains that are pressed less deep
    into one another than the tolerance allows lift those above them, which is no jump.
    """
    top = -math.inf
    for _ in range(50):
        sim.advance(0.01)
        top = max(top, energy(sim))
    yield Gate(f"{what}: energy / m g d a grain", (top - before - overlaps) / (200 * M * G * D), 1e-2)


def energy(sim: Any) -> float:
    """Kinetic and potential energy [J]."""
    report = sim.report()
    return float(report["kinetic_energy_J"] + report["potential_energy_J"])


def undone(sim: Any) -> float:
    """What it takes to undo all overlaps of discs at rest [J]: by virtual work the sum of normal force times overlap over all contacts,
    the weight times the way that it is lifted.
    """
    place, radius, size = sim.positions, sim.radii, np.array(sim.scene.size)
    total = 0.0
    for contact in listed(sim):
        i, j = contact.first, contact.second
        if contact.wall:
            edge = np.array([place[i, 0], size[0] - place[i, 0], place[i, 1], size[1] - place[i, 1]])[j]
            overlap = radius[i] - edge
        else:
            overlap = radius[i] + radius[j] - np.hypot(*(place[j] - place[i]))
        total += max(overlap, 0.0) * max(contact.force[0], 0.0)
    return float(total)
