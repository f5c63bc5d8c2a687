"""Hard cases of `taichi-sand stress`: walls that move (physics.md C24, C25). Discs of 1 cm unless said otherwise."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from taichi_sand.study.laboratory import OPEN, D, G, R, listed, simulate
from taichi_sand.study.stress.gates import DOWN, Gate, case
from taichi_sand.world.walls.build import standing_walls

PISTON = 0
"""Its number."""


@case("squeeze", "a rough piston sweeps a box of 150 discs until it is jammed, at constant speed and with 20 N at most (C24)")
def squeeze(solver: dict[str, Any]) -> Iterator[Gate]:
    """C24: the one is held up and says so, the other stands where the grains bear its force. What is squeezed by a wall that cannot be
    stopped overlaps for a moment; by half of d grains would pass through one another.
    """
    grains = [{"radius": [0.9 * R, R], "count": 150, "region": [0.02, 0.0, 0.3, 0.1]}]
    for force in (None, 20.0):
        piston = {"points": [[0.001, 0.0], [0.001, 0.1]], "velocity": [0.2, 0.0], "friction": 0.8, "force": force}
        sim = simulate(grains, (0.3, 0.1), solver, walls=[piston], mu=0.3, gravity=DOWN)
        deepest = 0.0
        for _ in range(200):
            sim.advance(0.02)
            deepest = max(deepest, sim.report()["overlap_max"])
        stood = piston_at(sim)
        sim.advance(0.5)
        yield Gate("overlap max / d", deepest, 0.5)
        yield Gate("grains lost, or behind the piston", 150 - int((sim.positions[:, 0] > piston_at(sim)).sum()), 0.0)
        yield Gate("piston went on / d", (piston_at(sim) - stood) / D, 0.01)
        if force:
            pushes = [-c.force[0] * c.normal[0] + c.force[1] * c.normal[1] for c in listed(sim) if c.wall and c.second == PISTON]
            yield Gate("force on the piston off its own", abs(sum(pushes) / force - 1), 0.02)
        else:
            yield Gate("stall not told", float(not any("held up" in flag for flag in sim.flags())), 0.0)
        del sim


def piston_at(sim: Any) -> float:
    """Where the first wall is, along x [m]."""
    return float(standing_walls(sim.world, sim.scene)[0][0, 0])


@case("shaken", "200 discs in a trough that is shaken up and down with 0.8 g at most (C25)")
def shaken(solver: dict[str, Any]) -> Iterator[Gate]:
    """C25: below 1 g the bed stays on the floor, and moves as that does but for its overlaps, which breathe as its weight comes and goes:
    were each of these the tolerance at 1 g, the bed halfway up would breathe at gamma omega times half of their sum.

    2 Hz are far below what a bed at tolerance 0.05 swings with by itself, some 14 Hz.
    """
    frequency, gamma, layers = 2.0, 0.8, 15
    omega = math.tau * frequency
    amplitude = gamma * G / omega**2
    shake = {"amplitude": [0.0, amplitude], "frequency": frequency}
    trough = {"points": [[0.02, 0.5], [0.02, 0.08], [0.18, 0.08], [0.18, 0.5]], "shake": shake}
    grains = [{"radius": [0.8 * R, R], "count": 200, "fill": "hexagonal", "region": [0.02, 0.08, 0.18, 0.3]}]
    sim = simulate(grains, (0.2, 0.6), solver, gravity=DOWN, walls=[trough], mu=0.5)
    sim.advance(2.0)
    gap = slip = 0.0
    phases = 100
    for _ in range(phases):
        sim.advance(0.02 / frequency)
        phase = omega * sim.time
        gap = max(gap, float((sim.positions[:, 1] - sim.radii).min()) - 0.08 - amplitude * math.sin(phase))
        beside = sim.velocities - [0.0, amplitude * omega * math.cos(phase)]
        slip += float((beside**2).sum(1).mean()) / phases
    breathing = gamma * omega * solver["tolerance"] * D * layers / 2
    yield Gate("grains lost", 200 - int(((sim.positions[:, 0] > 0.02) & (sim.positions[:, 0] < 0.18)).sum()), 0.0)
    yield Gate("lift-off / d", gap / D, 0.01)
    yield Gate("trough held up", float(any("held up" in flag for flag in sim.flags())), 0.0)
    yield Gate("rms speed beside the trough / breathing", math.sqrt(2 * slip) / breathing, 1.0)


@case("belt", "a disc and a bar of two discs are set down on a belt (C25, A5)")
def belt(solver: dict[str, Any]) -> Iterator[Gate]:
    """C25: the disc slides until it rolls, at a third of the belt's speed V, more by what the overlap takes off its lever; the bar ends
    at V.
    """
    speed, mu = 0.6, 0.3
    walls = [{"points": [[0.1, 0.1], [1.4, 0.1]], "velocity": [speed, 0.0]}]
    grains = [{"positions": [[0.6, 0.1 + R, R]]}, {"shape": "2x1", "positions": [[0.8, 0.1 + R, R]]}]
    sim = simulate(grains, (2.0, 0.2), solver, gravity=DOWN, walls=walls, edges=OPEN, mu=mu)
    sim.advance(1.2 * speed / (mu * G))
    yield Gate("disc off V / 3", abs(sim.velocities[0, 0] / (speed / 3) - 1), 0.01 + 8 / 3 * solver["tolerance"])
    yield Gate("bar off V", abs(sim.velocities[1, 0] / speed - 1), 0.02)
    yield Gate("hop / (0.01 d + tolerance)", float(np.abs(sim.positions[:, 1] - 0.1 - R).max()) / D / (0.01 + solver["tolerance"]), 1.0)


@case("storm", "a light disc and a bar of two discs are blown against a wall at 1000 m/s")
def storm(solver: dict[str, Any]) -> Iterator[Gate]:
    """Found by fuzzing, md: a wall that was as soft as without wind let them through. At rest they overlap it as the tolerance says."""
    grains = [{"positions": [[0.08, 0.1, R]], "density": 1.0}, {"shape": "2x1", "positions": [[0.08, 0.2, R]], "density": 1.0}]
    sim = simulate(grains, (0.3, 0.3), solver, effects={"drag": {"wind_x": -1000.0}})
    beyond = 0.0
    for _ in range(100):
        sim.advance_steps(40)
        beyond = max(beyond, float(-sim.positions[:, 0].min()))
    yield Gate("centre beyond the wall / d", beyond / D, 0.5)
    yield Gate("grains lost", 2 - sim.report()["grains"], 0.0)
    yield Gate("overlap max / tolerance", sim.report()["overlap_max"] / solver["tolerance"], 1.0)


@case("faint", "a bar of two discs in a breeze, and with a gravity, that 32 bits cannot tell from none")
def faint(solver: dict[str, Any]) -> Iterator[Gate]:
    """Found by fuzzing, md: contacts as soft as what presses is weak asked for steps without end."""
    for gravity, wind in ((0.0, 1e-45), (1e-300, 0.0)):
        grains = [{"shape": "2x1", "positions": [[0.1, 0.1, R]]}]
        sim = simulate(grains, (0.2, 0.2), solver, gravity=(0.0, -gravity), effects={"drag": {"wind_x": wind}})
        sim.advance_steps(100)
        report = sim.report()
        yield Gate("numbers that are not finite", float(not np.isfinite([sim.time, report["potential_energy_J"]]).all()), 0.0)
        yield Gate("moved / d", float(np.abs(sim.positions[0] - 0.1).max()) / D, 1e-6)
        del sim
