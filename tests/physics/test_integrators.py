"""The integrators of molecular dynamics: their orders on contacts (physics.md A18), and with the memory of a friction spring."""

import math

import pytest
from helpers import Disc, Gallery, K, M, R, simulate

from taichi_sand.study.validate import orders
from taichi_sand.study.validate.reference import spring_impact, zeta_for


@pytest.mark.parametrize("integrator", orders.INTEGRATORS)
def test_orders(integrator: str) -> None:
    """A18: final velocity against the step, t_c/15 to t_c/500, 64 random phases: the slopes of the table, to 0.15."""
    column = orders.INTEGRATORS.index(integrator)
    expected = {name: problem.orders[column] for name, problem in orders.PROBLEMS.items()}
    assert orders.measure(integrator) == pytest.approx(expected, abs=0.15)


@pytest.mark.parametrize("integrator", ["velocity_verlet", "rk4"])
def test_friction_spring(integrator: str) -> None:
    """A4: a disc that arrives at 30 degrees sticks and springs back as the ODE says, whether forces are swept once a step or four times."""
    mu, e, angle = 0.3, 0.8, math.radians(30)
    gallery = Gallery()
    solver = {"kind": "md", "k_r": K, "restitution": e, "step": math.pi * math.sqrt(M / 2 / K) / 100, "integrator": integrator}
    gallery.simulate([(math.cos(angle), math.sin(angle), 0.0)], 1e-4, solver, mu=mu).advance(3e-3)
    law = {"k_r": K, "k_d": 2 * zeta_for(e) * math.sqrt(K * M), "alpha": 0.0, "beta": 1.0}
    expected = spring_impact(math.cos(angle), math.sin(angle), 0.0, mu, law, (2 / 7, 0.31), M, R) * [1, 1, R]
    for face, _, after, _ in gallery.outcome():
        if not face.target:
            assert after * [1, 1, R] == pytest.approx(expected, abs=0.01), face.name


def test_verlet_knows_the_forces_at_the_start() -> None:
    """A disc laid down in balance stays from the first step on: half of it is made with the forces at the start."""
    dent = M * 9.81 / 2e4
    solver = {"kind": "md", "k_r": 2e4, "restitution": 1.0, "step": 1e-4, "integrator": "velocity_verlet"}
    sim = simulate([Disc(0.05, R - dent)], (0.1, 0.1), solver, gravity=(0, -9.81))
    sim.advance_steps(1)
    assert abs(sim.velocities[0, 1]) < 1e-12
