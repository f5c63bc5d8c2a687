"""The order of the integrators of molecular dynamics on contacts (physics.md A18): how their error falls with the step.

A contact that opens and closes is not smooth where it opens: no scheme is better than second order on it, and none better than first
where the force jumps at the first touch, as a dashpot's does (Danby, Shrimpton & Palmer 2013).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand.scene.packing import pack
from taichi_sand.study.laboratory import OPEN, Disc, K, M, R, simulate
from taichi_sand.study.validate.reference import clipped_restitution, impact
from taichi_sand.world.build import fill

SPEED = 0.5
PHASES = 64
STEPS = (15.5, 50.5, 150.5, 500.5)
"""Steps in a collision. With whole numbers the errors made where a contact opens undo those made where it closed."""
PITCH = 3 * R
K_HERTZ = 2.5 * M * SPEED**2 / 2 / 7e-5**2.5
"""Dents a disc that hits a floor at SPEED by 0.07 mm [N/m^1.5]."""
K_BOND, G_BOND = 2e4, 10.0
"""A floor as soft as this dents by 0.01 d under a disc at rest: it may swing by half of that and never leaves."""


@dataclass(frozen=True)
class Problem:
    """64 discs on a floor under f = max(0, k_d ζ^α ζ' + k_r ζ^β), and the orders that the integrators must show."""

    k_r: float
    k_d: float
    alpha: float
    beta: float
    orders: tuple[float, float, float]  # symplectic Euler, velocity Verlet, RK4
    bonded: bool = False  # pressed on by gravity so that contact is never lost


ZETA = 0.1
PROBLEMS = {
    "bonded spring": Problem(K_BOND, 0.0, 0.0, 1.0, (1.0, 2.0, 4.0), bonded=True),
    "bonded spring and dashpot": Problem(K_BOND, 2 * ZETA * math.sqrt(K_BOND * M), 0.0, 1.0, (1.0, 1.0, 4.0), bonded=True),
    "elastic linear collision": Problem(K, 0.0, 0.0, 1.0, (2.0, 2.0, 2.0)),
    "damped linear collision": Problem(K, 2 * ZETA * math.sqrt(K * M), 0.0, 1.0, (1.0, 1.0, 1.0)),
    "elastic Hertz collision": Problem(K_HERTZ, 0.0, 0.5, 1.5, (2.4, 2.4, 2.4)),
    "damped Hertz collision": Problem(K_HERTZ, 0.3 * math.sqrt(M) * math.sqrt(K_HERTZ) * 7e-5**-0.25, 0.5, 1.5, (1.0, 1.1, 1.5)),
}
"""Orders as tabled in A18."""
INTEGRATORS = ("symplectic_euler", "velocity_verlet", "rk4")


class Trial:
    """One integrator; its kernels are compiled once for all problems and steps."""

    def __init__(self, integrator: str) -> None:
        law = {"law": "custom", "alpha": 0.0, "beta": 1.0, "k_r": K, "k_d": 0.0}
        solver = {"kind": "md", "step": 1e-6, "tolerance": 0.01, "integrator": integrator, **law}
        discs = [Disc(PITCH * (k + 1), 2 * R) for k in range(PHASES)]
        self.sim = simulate(discs, (PITCH * (PHASES + 1), 0.1), solver, edges={**OPEN, "bottom": "wall"})

    def error(self, problem: Problem, steps: float) -> float:
        """RMS error of the final velocity, over that of the exact one, with so many steps in a collision."""
        time = collision_time(problem)
        y, v, end, exact = bonded(problem, time, time / steps) if problem.bonded else thrown(problem, time)
        self._start(problem, time / steps, y, v)
        self.sim.advance(end)
        found = self.sim.velocities[:, 1]
        return float(np.sqrt(((found - exact) ** 2).mean() / (exact**2).mean()))

    def _start(self, problem: Problem, step: float, y: np.ndarray, v: np.ndarray) -> None:
        """Lays the discs at heights y with velocities v and starts anew, with this law and step."""
        sim, world = self.sim, self.sim.world
        grains = pack(sim.scene)
        grains.position[:, 1], grains.velocity[:, 1] = y, v
        fill(world, grains)
        for name in ("shift", "turn", "wrench"):
            getattr(world.grains, name).fill(0)
        constants, pace = sim.solver.constants, world.pace
        constants[None].step = pace[None].step = sim.numbers["step"] = step
        constants[None].stiffness, constants[None].damping = problem.k_r, problem.k_d
        constants[None].alpha, constants[None].beta = problem.alpha, problem.beta
        world.box[None].gravity = [0.0, -G_BOND if problem.bonded else 0.0]
        pace[None].spent, pace[None].done, sim.steps, sim.owed = 1, 0, 0, 0.0
        pace[None].speed_cap = pace[None].alert = 10 * SPEED


def collision_time(problem: Problem) -> float:
    """[s]"""
    return math.pi * math.sqrt(M / problem.k_r) if problem.beta == 1 else impact(M, SPEED, problem.k_r, beta=problem.beta)["time"]


def thrown(problem: Problem, time: float) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Heights, velocities, duration and exact final velocities of discs thrown at the floor; their phases are random."""
    gap = SPEED * time * np.random.default_rng(1).uniform(0.2, 0.2 + 4 / STEPS[0], PHASES)
    e = 1.0
    if problem.k_d and problem.beta == 1:
        e = clipped_restitution(problem.k_d / (2 * math.sqrt(problem.k_r * M)))
    elif problem.k_d:
        e = impact(M, SPEED, problem.k_r, problem.k_d, problem.alpha, problem.beta)["e"]
    return R + gap, np.full(PHASES, -SPEED), 2.5 * time, np.full(PHASES, e * SPEED)


def bonded(problem: Problem, time: float, step: float) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Heights, velocities, duration and exact final velocities of discs that swing about their rest on the floor, with
    random phases, for 2.7 swings in whole steps [s]: after whole ones the velocity that symplectic Euler started half a step late would
    seem right.
    """
    rest = M * G_BOND / problem.k_r
    decay = problem.k_d / (2 * M)
    omega = math.sqrt(problem.k_r / M - decay**2)
    phase = np.random.default_rng(1).uniform(0, 2 * math.pi, PHASES)
    end = round(5.4 * time / step) * step
    turn = phase + omega * end
    swing = lambda angle: 0.5 * rest * np.cos(angle)  # noqa: E731
    velocity = lambda angle: -0.5 * rest * (omega * np.sin(angle) + decay * np.cos(angle))  # noqa: E731
    return R - rest + swing(phase), velocity(phase), end, math.exp(-decay * end) * velocity(turn)


def order(errors: dict[float, float]) -> float:
    """Slope of the error over the step, in logarithms, fitted to errors by the number of steps in a collision."""
    return float(-np.polyfit(np.log(list(errors)), np.log(list(errors.values())), 1)[0])


def measure(integrator: str) -> dict[str, Any]:
    """Order of `integrator` on every problem."""
    trial = Trial(integrator)
    return {name: order({steps: trial.error(problem, steps) for steps in STEPS}) for name, problem in PROBLEMS.items()}
