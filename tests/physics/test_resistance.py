"""What slows grains down: rolling resistance (physics.md A7, A8), drag."""

import math

import pytest
from helpers import D, Disc, G, M, R, simulate

K_SOFT = 2e6
T_SOFT = math.pi * math.sqrt(M / 2 / K_SOFT)
SOLVERS = {
    "md": {"kind": "md", "k_r": K_SOFT, "restitution": 0.3, "step": T_SOFT / 30},
    "rigid": {"kind": "rigid", "restitution": 0.0, "step": 5e-4, "tolerance": 0.001},
}


@pytest.mark.parametrize("name", SOLVERS)
def test_rolling_resistance(name: str) -> None:
    """A8: on a floor a rolling disc slows down by (2/3) mu_r g and stops after 3 v0²/(4 mu_r g), both within 1 %, and then rests."""
    mu, v0 = 0.05, 0.2
    effects = {"friction": {"mu": 0.5}, "rolling": {"mu": mu}}
    rolling = [Disc(0.2, R, v0, spin=-v0 / R)]
    sim = simulate(rolling, (1.0, 0.1), SOLVERS[name], gravity=(0, -G), effects=effects)
    sim.advance(0.3)
    assert (v0 - sim.velocities[0, 0]) / 0.3 == pytest.approx(2 / 3 * mu * G, rel=0.01)
    sim.advance(0.7)
    assert sim.positions[0, 0] - 0.2 == pytest.approx(3 * v0**2 / (4 * mu * G), rel=0.01)
    assert abs(sim.spins[0]) < 1e-3


@pytest.mark.parametrize("name", SOLVERS)
def test_rolling_threshold(name: str) -> None:
    """A7, A8: a disc stands on a slope if tan θ < mu_r and rolls off if tan θ > mu_r, bracketed within 1 %."""
    mu = 0.05
    effects = {"friction": {"mu": 0.5}, "rolling": {"mu": mu}}
    for share, rolls in ((0.99, False), (1.01, True)):
        lean = math.atan(share * mu)
        pull = (G * math.sin(lean), -G * math.cos(lean))
        sim = simulate([Disc(0.3, R - 1e-7)], (1.0, 0.1), SOLVERS[name], gravity=pull, effects=effects)
        sim.advance(0.5)
        before = sim.positions[0, 0]
        sim.advance(0.5)
        moved = sim.positions[0, 0] - before
        fall = 2 / 3 * G * (math.sin(lean) - mu * math.cos(lean))
        if rolls:
            assert moved > 0.9 * fall * (1.0**2 - 0.5**2) / 2 and abs(sim.spins[0]) > 0.1
        else:
            assert abs(moved) < 1e-3 * D and abs(sim.spins[0]) < 1e-3
        del sim


@pytest.mark.parametrize("name", SOLVERS)
def test_drag(name: str) -> None:
    """A falling disc follows v = v_t tanh(g t / v_t), one in a wind gains on it as v = w² k t / (1 + w k t), k = ρ C r / m: 0.5 %."""
    density, wind = 200.0, 5.0
    drag = {"density": density, "coefficient": 0.8, "wind_x": 0.0}
    k = density * 0.8 * R / M
    terminal = math.sqrt(G / k)
    step = {**SOLVERS[name], "step": min(SOLVERS[name]["step"], 1e-4)}
    sim = simulate([Disc(0.5, 1.9)], (1.0, 2.0), step, gravity=(0, -G), effects={"drag": drag})
    for time in (0.1, 0.3, 0.8):
        sim.advance(time - sim.time)
        assert sim.velocities[0, 1] == pytest.approx(-terminal * math.tanh(G * time / terminal), rel=5e-3)
    del sim
    sim = simulate([Disc(0.1, 0.5)], (1.0, 2.0), step, effects={"drag": {**drag, "wind_x": wind}})
    sim.advance(0.1)
    assert sim.velocities[0, 0] == pytest.approx(wind**2 * k * 0.1 / (1 + wind * k * 0.1), rel=5e-3)
