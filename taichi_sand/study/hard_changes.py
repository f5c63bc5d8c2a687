"""Hard cases of `taichi-sand stress`: what changes, or breaks, on the way (physics.md C). Discs of 1 cm unless said otherwise."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import taichi_sand as sand
from taichi_sand.study.laboratory import D, G, M, R, simulate
from taichi_sand.study.stress import DOWN, EXPLOSION, UNIT, Gate, Watch, case, inside, poured, rms_speed
from taichi_sand.world.hand import GRAB, IDLE


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
        kick = float(np.float32(sim.step) * np.float32(G))
        set_twist(sim, 300, [math.nan] * 3 + [0.0] if bad else [0.0, kick, 0.0, 0.0])  # either way it stands still after the next kick
        sim.advance(0.2)
        results.append((sim.positions.tobytes(), sim.velocities.tobytes()))
        finite = np.isfinite(sim.positions).all() and np.isfinite(sim.velocities).all()
        yield Gate("numbers that are not finite", 0.0 if finite else EXPLOSION, 0.0)
        yield Gate("bad grain not named", float(bad and not any("grain 300" in flag for flag in sim.flags())), 0.0)
    yield Gate("other bits than where it is stopped by hand", float(results[0] != results[1]), 0.0)


@case("bad-in-pile", "one disc deep in a pile of 300 gets a velocity that is no number, another a force of 1e18 N (C19)")
def bad_in_pile(solver: dict[str, Any]) -> Iterator[Gate]:
    """C19."""
    pile = {"radius": R, "count": 300, "fill": "hexagonal", "region": [0.0, 0.0, 0.3, 0.2]}
    sim = simulate([pile], (0.3, 0.3), solver, gravity=DOWN, mu=0.5, hand=True)
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
    finite = np.isfinite(sim.positions).all() and np.isfinite(sim.velocities).all()
    yield Gate("numbers that are not finite", 0.0 if finite else EXPLOSION, 0.0)
    yield Gate("grains lost", 300 - inside(sim), 0.0)
    yield Gate("rms speed / sqrt(g d)", rms_speed(sim), 1e-2)


def set_twist(sim: Any, grain: int, twist: list[float]) -> None:
    """Gives a grain this motion."""
    slot = int(np.flatnonzero(sim.world.grains.id.to_numpy()[: sim.count] == grain)[0])
    sim.world.grains.twist[slot] = twist


@case("long-step", "steps of a tenth of a second: what rigid does with them, and that md refuses them (C17)")
def long_step(solver: dict[str, Any]) -> Iterator[Gate]:
    """C17."""
    try:
        sim = poured(300, 0.3, 0.4, {**solver, "step": 0.1})
    except sand.SandError as error:
        yield Gate("refused without the limit", float("stability limit" not in str(error)), 0.0)
        return
    yield Gate("md took it", float(solver["kind"] == "md"), 0.0)
    watch = Watch(sim, drop=0.4)
    watch.run(5.0, every=0.1)
    yield from watch.bounded()


@case("reversals", "gravity is reversed twice a second, 100 times (C18)", quick=False)
def reversals(solver: dict[str, Any]) -> Iterator[Gate]:
    """C18."""
    sim = poured(200, 0.3, 0.3, solver)
    for k in range(100):
        sim.retune(sim.scene.model_copy(update={"gravity": (0.0, G if k % 2 == 0 else -G)}))
        sim.advance(0.5)
    yield Gate("grains lost", 200 - inside(sim), 0.0)
    sim.advance(2.0)
    watch = Watch(sim, drop=0.3)
    watch.run(1.0)
    yield from watch.bounded()
    yield from watch.resting(solver["tolerance"])


@case("unphysical", "friction and damping below 0, restitution above 1; then back (C22)")
def unphysical(solver: dict[str, Any]) -> Iterator[Gate]:
    """C22: energy grows by design, caps keep it finite, and afterwards all comes to rest."""
    sim = poured(300, 0.3, 0.4, solver)
    sim.advance(0.5)
    usual = {"damping": sim.numbers.get("damping", 0.0), "restitution": sim.numbers.get("restitution", 0.0), "friction_mu": 0.5}
    sim.set_numbers({"damping": -usual["damping"], "restitution": 1.5, "friction_mu": -0.5})
    sim.advance(2.0)
    finite = np.isfinite(sim.positions).all() and np.isfinite(sim.velocities).all()
    yield Gate("numbers that are not finite", 0.0 if finite else EXPLOSION, 0.0)
    yield Gate("grains lost", 300 - inside(sim), 0.0)
    sim.set_numbers(usual)
    sim.advance(5.0)
    watch = Watch(sim, drop=0.4)
    watch.run(0.5)
    yield from watch.bounded()
    yield from watch.resting(solver["tolerance"])


@case("toggles", "wet to dry and back, friction taken away and given, the other solver, in a pile at rest (C26)")
def toggles(solver: dict[str, Any]) -> Iterator[Gate]:
    """C26: no change makes more than 1e-2 m g d a grain."""
    effects = {"friction": {"mu": 0.5}, "cohesion": {"bond": 5.0}}
    sim = poured(200, 0.3, 0.3, solver, effects=effects)
    sim.advance(3.0)
    for values in ({"cohesion_bond": 0.0}, {"cohesion_bond": 5.0}, {"friction_mu": 0.0}, {"friction_mu": 1.0}):
        before = energy(sim)
        sim.set_numbers(values)
        sim.advance(0.2)
        name, value = next(iter(values.items()))
        yield Gate(f"{name} {value:g}: energy / m g d", (energy(sim) - before) / (200 * M * G * D), 1e-2)
    before, rows, radii = energy(sim), np.hstack([sim.positions, sim.radii[:, None], sim.velocities]), sim.radii
    other = {"kind": "md" if solver["kind"] == "rigid" else "rigid", "tolerance": solver["tolerance"]}
    sim = simulate([{"positions": rows.tolist()}], (0.3, 0.3), other, gravity=DOWN, mu=0.5)
    sim.advance(1.0)
    yield Gate("other solver: energy / m g d", (energy(sim) - before) / (200 * M * G * D), 1e-2)
    yield Gate("grains lost", len(radii) - inside(sim), 0.0)


def energy(sim: Any) -> float:
    """Kinetic and potential energy [J]."""
    report = sim.report()
    return float(report["kinetic_energy_J"] + report["potential_energy_J"])
