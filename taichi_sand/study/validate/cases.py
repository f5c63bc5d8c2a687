"""The reference ladder: what physics says about one contact, a few grains and many, and what the solvers make of it.

Each case is a function of the kind of solver that returns rows to compare. Numbers and sources: physics.md, sections A and B; formulas
and ODEs are in `reference`, the set-ups in `setups`, and the tests look at many more variants of them (walls, angles, laws).
"""

import math
from typing import Any

import numpy as np

from taichi_sand.solvers.tolerance import TOO_SOFT
from taichi_sand.study.laboratory import INERTIA, OPEN, PERIODIC, D, Disc, G, Gallery, K, M, R, chain_forces, kinetic, simulate, unit
from taichi_sand.study.validate import orders, setups, slope
from taichi_sand.study.validate.reference import chain, first_bounce, hard_impact, impact, zeta_for
from taichi_sand.study.validate.rows import Case, Row


def free(kind: str, **keys: Any) -> dict[str, Any]:
    """Solver for collisions in free flight."""
    md = {"kind": "md", "k_r": K, "step": setups.T_C / 200}
    return {**(md if kind == "md" else {"kind": "rigid", "step": 2e-6}), **keys}


def restitution(kind: str) -> list[Row]:
    """Head-on against walls, lines and discs at four angles."""
    rows = []
    for e in (0.9, 0.5, 0.2):
        gallery = Gallery()
        gallery.simulate([(0.5, 0, 0)], 1e-4, free(kind, restitution=e)).advance(2e-3)
        found = [(after - target)[0] / 0.5 for _, _, after, target in gallery.outcome()]
        rows.append(Row(f"e = {e:g}, the worst of 12 surfaces", e, max(found, key=lambda value: abs(value - e)), 1e-3))
    return rows


def dent(kind: str) -> list[Row]:
    """Largest overlap of a linear impact at 1 m/s."""
    sim = simulate([Disc(0.1 - R - 1e-5, 0.05, 0.5), Disc(0.1 + R + 1e-5, 0.05, -0.5)], (0.2, 0.1), free(kind, restitution=1.0))
    deepest = 0.0
    for _ in range(300):
        sim.advance_steps(1)
        deepest = max(deepest, D - float(np.hypot(*np.diff(sim.positions, axis=0)[0])))
    depth = impact(M / 2, 1.0, K)["depth"]
    return [Row("largest overlap / d", depth / D, deepest / D, 2e-3 * depth / D)]


def oblique(kind: str) -> list[Row]:
    """A disc on a wall at 30 (sticks; rigid only: a spring springs back), 60 and 75 degrees (slides), mu 0.3, e 0.8."""
    rows = []
    stiff = {"k_r": 25 * K, "step": setups.T_C / 500} if kind == "md" else {}
    for degrees in (30, 60, 75) if kind == "rigid" else (60, 75):
        gallery, angle = Gallery(), math.radians(degrees)
        v_n, v_t = math.cos(angle), math.sin(angle)
        gallery.simulate([(v_n, v_t, 0.0)], 1e-4, free(kind, restitution=0.8, **stiff), mu=0.3).advance(2e-3)
        face, _, after, _ = gallery.outcome()[0]
        _, shear = hard_impact(v_n, v_t, 0.3, 0.8, 1 / M, R**2 / INERTIA)
        expected = v_t + shear / M
        rows.append(Row(f"{degrees} degrees, {face.name} wall: v_t after", expected, after[1], 0.01 if kind == "md" else 1e-3))
    return rows


def softly(kind: str) -> dict[str, Any]:
    """Solver for a disc that lies on something."""
    return setups.RESTING["linear" if kind == "md" else "rigid"]


def spin_drop(kind: str) -> list[Row]:
    """Spun at -200 rad/s on a floor, mu 0.3."""
    sim, right, _ = setups.resting(unit(90), softly(kind), 0.0, -200.0, 0.3)
    sim.advance(0.15)
    rows = [Row("v at the end / (omega0 R)", 1 / 3, sim.velocities[0] @ right / (200 * R), 1e-3)]
    return [*rows, Row("spin at the end / omega0", 1 / 3, sim.spins[0] / -200, 1e-3)]


def incline(kind: str) -> list[Row]:
    """Down 20 degrees: rolls with mu 0.3, slides with 0.1."""
    rows, theta = [], math.radians(20)
    for mu, pull in ((0.3, 2 / 3 * G * math.sin(theta)), (0.1, G * (math.sin(theta) - 0.1 * math.cos(theta)))):
        sim, right, _ = setups.resting(unit(90), softly(kind), 0.0, 0.0, mu, tilt=20.0)
        sim.advance(0.1)
        v = sim.velocities[0] @ right
        sim.advance(0.1)
        rows.append(Row(f"mu = {mu:g}: acceleration, m/s2", pull, (sim.velocities[0] @ right - v) / 0.1, 5e-3 * pull))
    return rows


def pyramid(kind: str) -> list[Row]:
    """Three discs stand above mu = tan 15 degrees and fall below it."""
    stood = setups.pyramid(softly(kind), 1.05 * setups.THRESHOLD)[0]
    fell = setups.pyramid(softly(kind), 0.95 * setups.THRESHOLD)[0]
    return [Row("mu 5 % above: sunk / d", 0.0, stood, 0.01), Row("mu 5 % below: falls (1 = yes)", 1.0, float(fell > 0.05), 0.0)]


def bounce(kind: str) -> list[Row]:
    """First bounce from 5 cm."""
    height, e = 0.05, 0.9
    step = {"step": math.pi * math.sqrt(M / K) / 150} if kind == "md" else {"step": 2e-5}
    sim = simulate([Disc(0.05, R + height)], (0.1, 0.2), free(kind, restitution=e, **step), gravity=(0, -G))
    sim.advance(math.sqrt(2 * height / G) + 1e-3)
    y, v = sim.positions[0, 1] - R, sim.velocities[0, 1]
    soft = first_bounce(height, M, K, 2 * zeta_for(e) * math.sqrt(K * M), G)
    expected = soft if kind == "md" else e**2 * height
    return [Row("height / that of the drop", expected / height, (y + v**2 / (2 * G)) / height, 0.01)]


def column(kind: str) -> list[Row]:
    """Twenty discs on one another, laid down in balance: what the lowest contact carries after 1 s."""
    count = 20
    dents = np.arange(1, count + 1) * M * G / 2e6 if kind == "md" else np.zeros(count)
    solver = {"kind": "md", "k_r": 2e6, "restitution": 0.3, "step": 1e-5} if kind == "md" else {"kind": "rigid"}
    far = 1.2 * count * D
    sim = simulate(setups.column(count, unit(270), dents, far), (setups.NARROW, far), solver, gravity=(0, -G))
    start = sim.positions[:, 0].copy()
    sim.advance(1.0)
    forces = chain_forces(sim, count) / (M * G)
    worst = max(range(count), key=lambda i: abs(forces[i] / (i + 1) - 1))
    rows = [Row(f"contact {worst + 1} of 20, the worst: force / its load", 1.0, forces[worst] / (worst + 1), 0.02)]
    return [*rows, Row("moved sideways / d", 0.0, float(abs(sim.positions[:, 0] - start).max()) / D, 1e-6)]


def cradle(kind: str) -> list[Row]:
    """Three balls in a row, the first hits: touching (md: springs share the blow) or a little apart (rigid: one impact after another)."""
    gap = 0.0 if kind == "md" else 0.05 * D
    discs = [Disc(0.05 + k * (D + gap), 0.05, 1.0 if k == 0 else 0.0) for k in range(3)]
    sim = simulate(discs, (0.2, 0.1), free(kind, restitution=1.0))
    sim.advance(3e-3)
    expected = chain(np.full(3, M), np.array([1.0, 0, 0]), np.zeros(2), K, 1.0) if kind == "md" else np.array([0.0, 0.0, 1.0])
    return [Row(f"ball {k + 1}: v", expected[k], sim.velocities[k, 0], 2e-3) for k in range(3)]


def momentum(kind: str) -> list[Row]:
    """200 discs of all sizes fly at one another, spinning, mu 0.4, f64."""
    discs = setups.implosion(200)
    sim = simulate(discs, (2.0, 2.0), setups.FREE["linear" if kind == "md" else "rigid"], edges=OPEN, mu=0.4)
    mass = np.array([disc.mass for disc in discs])
    scale = mass @ np.hypot(*sim.velocities.T)
    before, turn = setups.momenta(sim, discs)
    sim.advance_steps(4000 if kind == "md" else 1000)
    after, turned = setups.momenta(sim, discs)
    rows = [Row("momentum lost / sum |p|", 0.0, float(np.hypot(*(after - before))) / scale, 1e-13)]
    return [*rows, Row("angular momentum lost / sum |p| 1 m", 0.0, abs(turned - turn) / scale, 1e-12)]


def gas(kind: str) -> list[Row]:
    """400 elastic discs, phi 0.2, 200 collisions each: energy, springs included."""
    discs, side = setups.gas()
    solver = {"kind": "md", "k_r": K, "step": setups.T_C / 40, "tolerance": 0.01} if kind == "md" else {"kind": "rigid", "step": 2e-4}
    sim = simulate(discs, (side, side), {**solver, "restitution": 1.0, "precision": 64 if kind == "md" else 32}, edges=PERIODIC)

    def energy() -> float:
        if kind == "rigid":
            return kinetic(sim, discs)
        v, stored = sim.velocities, setups.springs(sim, side, K, 1.0)
        sim.advance_steps(1)  # velocities of symplectic Euler belong to the middle of a step
        return float(0.5 * M * (((v + sim.velocities) / 2) ** 2).sum() + stored)

    start = energy()
    sim.advance(200 * setups.COLLISIONS)
    return [Row("energy / initial", 1.0, energy() / start, 1e-3 if kind == "md" else 1e-4)]


def integrators(_: str) -> list[Row]:
    """Order of the error in the step, t_c/15 to t_c/500, 64 phases."""
    rows = []
    for column, name in enumerate(orders.INTEGRATORS):
        found = orders.measure(name)
        rows += [Row(f"{name}, {what}", problem.orders[column], found[what], 0.15) for what, problem in orders.PROBLEMS.items()]
    return rows


def invariance(kind: str) -> list[Row]:
    """One oblique frictional collision seen from five frames, f64: velocities, m/s."""
    states = setups.collision_in_frames("linear" if kind == "md" else "rigid", 64)
    plain = states.pop("plain")
    return [Row(f"{name}: largest difference", 0.0, float(abs(state - plain).max()), 1e-10) for name, state in states.items()]


def bed(kind: str, mu: float) -> Any:
    """300 discs +-20 % in a box 15 d wide, after 3 s."""
    grains = [{"radius": [0.8 * R, 1.2 * R], "count": 300, "fill": "lattice", "pitch": 1.25, "jitter": 0.1}]
    solver = {"kind": kind, "restitution": 0.1, "precision": 32}
    sim = simulate(grains, (15 * D, 40 * D), solver, gravity=(0, -G), seed=4, mu=mu)
    sim.advance(3.0)
    return sim


def weight(kind: str) -> list[Row]:
    """A bed without friction presses on the floor with its weight; the dial keeps its word."""
    sim = bed(kind, 0.0)
    report = sim.report()
    load = 2650 * math.pi * (sim.radii**2).sum() * G
    rows = [Row("force on the floor / weight", 1.0, report["floor_force_N"] / load, 0.01)]
    rows.append(Row("p99 overlap / tolerance", 0.6, report["overlap_p99"] / report["tolerance"], 0.4))
    return [*rows, Row("packing fraction", 0.84, report["packing_fraction"], 0.02)]


def packing(kind: str) -> list[Row]:
    """A rough bed is looser, and bears itself on fewer contacts."""
    report = bed(kind, 0.5).report()
    rows = [Row("packing fraction, mu = 0.5", 0.805, report["packing_fraction"], 0.025)]
    return [*rows, Row("coordination, mu = 0.5", 3.6, report["coordination"], 0.6)]


def rough_slope(kind: str) -> list[Row]:
    """Discs flow down a rough slope, three seeds each: I at mid-depth, and md beside rigid: as fast within 15 %, or warned of."""
    rows = []
    for degrees in slope.ANGLES:
        found = slope.means("rigid", degrees)
        if kind == "rigid":
            rows.append(Row(f"{degrees} degrees: I at mid-depth", slope.law(degrees), found.inertial, 0.08 * slope.law(degrees)))
        else:
            soft = slope.means("md", degrees)
            off = 0.25 if soft.warned else 0.15
            rows.append(Row(f"{degrees} degrees: mean speed / that of rigid", 1.0, soft.speed / found.speed, off))
            due = float(soft.softness > TOO_SOFT["md"])
            rows.append(Row(f"{degrees} degrees: warned (1 = yes) of a softness of {soft.softness:.3f}", due, soft.warned, 0.0))
    return rows


CASES = (
    Case("A1 restitution", "Schwager & Pöschel 2007", restitution, ("md",)),
    Case("A2 restitution", "Newton", restitution, ("rigid",)),
    Case("A3 dent", "energy balance", dent, ("md",)),
    Case("A4 oblique impact", "Walton & Braun 1986", oblique),
    Case("A5 spin drop", "rigid body", spin_drop),
    Case("A7 incline", "rigid body", incline),
    Case("A10 three-disc pyramid", "statics", pyramid),
    Case("A11 bounce", "ODE; e^2 H", bounce),
    Case("A13 column", "statics", column),
    Case("A14 Newton's cradle", "ODE; one by one", cradle),
    Case("A15 momentum", "Newton", momentum),
    Case("A16 elastic gas", "energy", gas, quick=False),
    Case("A18 order of integrators", "Danby et al. 2013", integrators, ("md",), quick=False),
    Case("A19 invariance", "Galileo", invariance),
    Case("B1 weight of a bed", "statics", weight),
    Case("B2, B3 rough bed", "Shen et al. 2014", packing),
    Case("B12 rough slope", "da Cruz et al. 2005", rough_slope, quick=False),
)
