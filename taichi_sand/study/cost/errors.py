"""How far a simulation is from the truth: the errors that `cost` holds against the time it took.

What is known exactly is compared with that: a bed at rest presses on what bears it with its weight, no contact changes the momentum of
the whole, and the energy of what is not driven never rises. What is not is compared with a finer run (study.cost).
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_sand.measure.grain_state import masses as mass_and_inertia
from taichi_sand.measure.loads import Loads
from taichi_sand.measure.packing import packing_fraction
from taichi_sand.measure.pairs import pairs_of
from taichi_sand.measure.report import motion
from taichi_sand.solvers.tolerance import softness
from taichi_sand.world.reading import read_columns

NAMES = {
    "overlap_mean": "mean overlap / d",
    "overlap_p99": "overlap / d, 99 % below",
    "overlap_max": "worst overlap / d",
    "energy": "energy that rose of itself / initial",
    "momentum": "momentum from nowhere, a step / Σ m|v|",
    "force": "force that bears the bed / its weight - 1",
    "trajectory": "RMS distance from the reference / d",
    "height": "bed height / that of the finest run - 1",
    "packing": "packing fraction / that of the finest run - 1",
    "flow": "mean speed of a flow / that of the finest run - 1",
}
"""The errors, and what stands at the axis of a plot."""
RESTING = 1e-3
"""A bed is at rest when a grain has less kinetic energy than this, in m g d."""


@dataclass
class Diary:
    """What is noted of one run."""

    energy: list[float] = field(default_factory=list)
    gain: list[float] = field(default_factory=list)
    overlaps: list[np.ndarray] = field(default_factory=list)
    outer: list[float] = field(default_factory=list)
    scale: float = 0.0  # of the energy [J]
    height: float = 0.0
    packing: float = 0.0
    speeds: list[float] = field(default_factory=list)
    resting: bool = False


def gravity_of(sim: Any) -> np.ndarray:
    """[m/s2]"""
    return np.array(sim.scene.gravity, float)


def masses(sim: Any) -> np.ndarray:
    """Masses of the grains that can move [kg], 0 for the others; shape (n,), in the order of the scene."""
    return mass_and_inertia(read_columns(sim.world, ("mobility",))["mobility"])[:, 0]


def energy(sim: Any, moved: dict[str, Any], overlaps: np.ndarray) -> float:
    """Kinetic, potential and, for molecular dynamics, elastic energy of the normal forces [J]."""
    total = moved["kinetic_energy_J"] + moved["potential_energy_J"]
    if sim.scene.solver.kind == "md":
        beta = sim.numbers["beta"]
        total += float((sim.numbers["stiffness"] * overlaps ** (beta + 1) / (beta + 1)).sum())
    return total


def step_gain(sim: Any, mass: np.ndarray, outer: np.ndarray) -> float:
    """Makes a step. Momentum that neither gravity nor the forces from outside account for, over Σ m|v|, at least that of a step's fall.

    `outer` [N]: force from outside in the step before. Symplectic Euler and the rigid solver act with the force of the step itself,
    the other integrators with the mean of before and after.
    """
    before = mass @ sim.velocities
    sim.advance_steps(1)
    after = mass @ sim.velocities
    now = Loads(pairs_of(sim)).outer()
    own = sim.scene.solver.kind == "rigid" or sim.scene.solver.integrator == "symplectic_euler"
    force = (now if own else 0.5 * (now + outer)) + mass.sum() * gravity_of(sim)
    scale = mass @ np.hypot(*sim.velocities.T) + mass.sum() * np.hypot(*gravity_of(sim)) * sim.step
    return float(np.hypot(*(after - before - sim.step * force)) / scale) if scale > 0 else 0.0


def begin(sim: Any) -> Diary:
    """The diary of a run that is about to start; its energies are measured against what the grains have, and can fall by."""
    moved = motion(sim)
    weight = masses(sim).sum() * np.hypot(*gravity_of(sim))
    diary = Diary(scale=moved["kinetic_energy_J"] + 0.5 * weight * moved["bed_height_m"])
    diary.energy.append(energy(sim, moved, Loads(pairs_of(sim)).overlaps))
    return diary


def note(sim: Any, diary: Diary, late: bool) -> None:
    """Notes the state; overlaps and forces only if it is `late` enough for the bed to rest, if it ever does."""
    loads, moved = Loads(pairs_of(sim)), motion(sim)
    diary.energy.append(energy(sim, moved, loads.overlaps))
    if late:
        outer = loads.outer()
        mass = masses(sim)
        weight = mass.sum() * gravity_of(sim)
        diary.overlaps.append(loads.overlaps / sim.bed.diameter)
        if weight.any():
            diary.outer.append(float(-outer @ weight / (weight @ weight)))
        diary.gain.append(step_gain(sim, mass, outer))
        diary.speeds.append(float(np.hypot(*sim.velocities.T) @ mass / max(mass.sum(), 1e-30)))
    diary.height = moved["bed_height_m"]
    rest = RESTING * masses(sim).sum() * np.hypot(*gravity_of(sim)) * sim.bed.diameter
    diary.resting = moved["kinetic_energy_J"] < rest


def close(sim: Any, diary: Diary, conservative: bool) -> dict[str, float]:
    """The errors of the run, NaN where one has no meaning; height, packing and flow are the values themselves.

    With `conservative` contacts (restitution 1, no friction) energy must neither rise nor fall.
    """
    found = dict.fromkeys(NAMES, math.nan)
    all_overlaps = np.concatenate([*diary.overlaps, [0.0]])
    touching = all_overlaps[all_overlaps > 0]
    if len(touching):
        found["overlap_mean"], found["overlap_max"] = float(touching.mean()), float(touching.max())
        found["overlap_p99"] = float(np.percentile(touching, 99))
    if diary.scale > 0:
        energies = np.array(diary.energy)
        off = abs(energies - energies[0]) if conservative else energies - np.minimum.accumulate(energies)
        found["energy"] = float(off.max() / diary.scale)
    if diary.gain:
        found["momentum"] = float(np.median(diary.gain))
    if diary.resting:
        found["force"] = abs(float(np.mean(diary.outer)) - 1)
        found["height"], found["packing"] = diary.height, packing_fraction(sim) or math.nan
    elif softness(sim.numbers, sim.bed) > 0:
        found["flow"] = float(np.mean(diary.speeds))
    return found


def apart(one: np.ndarray, other: np.ndarray, diameter: float) -> float:
    """RMS distance of two sets of places (n, 2), in diameters; infinite if they are not of the same grains."""
    return float(np.sqrt(((one - other) ** 2).sum(1).mean()) / diameter) if one.shape == other.shape else math.inf
