"""Friction and rotation: physics.md A5-A7 and A10. Every friction model, every wall."""

import math

import numpy as np
import pytest
import taichi as ti
from helpers import INERTIA, D, Disc, G, K, M, R, perp, simulate, unit

from taichi_sand.study.validate.reference import slip_on_disc
from taichi_sand.study.validate.setups import FLOOR_THRESHOLD, T_C, THRESHOLD, pyramid, resting
from taichi_sand.study.validate.setups import RESTING as SOLVERS


@pytest.mark.parametrize("angle", [0.0, 90.0, 180.0, 270.0, 17.0, 45.0])
@pytest.mark.parametrize("name", SOLVERS)
def test_spin_drop(name: str, angle: float) -> None:
    """A5: spin -200 rad/s on a floor, mu 0.3, ends rolling at +0.3333 m/s and -66.67 rad/s, on any wall; slips 0.1133 s until then."""
    sim, right, _ = resting(unit(angle), SOLVERS[name], 0.0, -200.0, 0.3)
    sim.advance(0.05)
    assert sim.velocities[0] @ right == pytest.approx(0.3 * G * 0.05, rel=5e-3)
    sim.advance(0.1)
    assert sim.velocities[0] @ right == pytest.approx(200 * R / 3, rel=2e-3)
    assert sim.spins[0] == pytest.approx(-200 / 3, rel=2e-3)


@pytest.mark.parametrize("name", SOLVERS)
def test_slip_to_roll(name: str) -> None:
    """A5: v0 = 1 m/s without spin rolls at 2/3 m/s after v0 / (3 mu g) and 5 v0^2 / (18 mu g)."""
    mu = 0.5
    sim, right, start = resting(unit(90), SOLVERS[name], 1.0, 0.0, mu)
    slip_time = 1 / (3 * mu * G)
    sim.advance(0.98 * slip_time)
    assert sim.velocities[0] @ right > (2 / 3) * 1.005
    sim.advance(0.02 * slip_time)
    assert (sim.positions[0] - start) @ right == pytest.approx(5 / (18 * mu * G), rel=5e-3)
    sim.advance(0.02)
    assert sim.velocities[0] @ right == pytest.approx(2 / 3, rel=2e-3)


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("turn", [0.0, 17.0, 45.0, 90.0])
def test_spin_drop_on_disc(name: str, turn: float) -> None:
    """A5, disc on disc: spun at -200 rad/s on top of a fixed one, gravity along the line of centres, against the ODE after 20 ms."""
    normal, time = unit(90 - turn), 0.02
    base = np.array([0.1, 0.1])
    dent = 0.0 if name == "rigid" else 1e-4 * D
    discs = [Disc(*base, fixed=True), Disc(*(base + (D - dent) * normal), spin=-200.0)]
    solver = {**SOLVERS[name], "step": min(SOLVERS[name]["step"], time / 400)}  # place is first order in the step
    sim = simulate(discs, (0.2, 0.2), solver, gravity=(-G * normal).tolist(), mu=0.3)
    sim.advance(time)
    place, speed, spin = slip_on_disc(-200.0, 0.3, R, R, G, time)
    arm = sim.positions[1] - sim.positions[0]
    clockwise = -perp(normal)
    assert math.atan2(arm @ clockwise, arm @ normal) == pytest.approx(place, rel=0.02)
    assert np.hypot(*sim.velocities[1]) == pytest.approx(speed, rel=0.01)
    assert sim.spins[1] == pytest.approx(spin, rel=1e-3)
    assert sim.spins[0] == 0 and (sim.velocities[0] == 0).all()


def test_point_velocity() -> None:
    """A6: u(p) = v + omega x r at the four cardinal points."""
    sim = simulate([Disc(0.05, 0.05)], (0.1, 0.1), SOLVERS["linear"])
    assert sim.steps == 0
    from taichi_sand.world.geometry import point_velocity

    @ti.kernel
    def at(vx: ti.f64, vy: ti.f64, spin: ti.f64, x: ti.f64, y: ti.f64) -> ti.types.vector(2, ti.f64):
        return point_velocity(ti.Vector([vx, vy]), spin, ti.Vector([x, y]))

    for arm, expected in (((0, -R), (R, 0)), ((R, 0), (0, R)), ((0, R), (-R, 0)), ((-R, 0), (0, -R))):
        assert list(at(0.0, 0.0, 1.0, *arm)) == pytest.approx(expected, abs=1e-12)
        assert list(at(2.0, 3.0, 1.0, *arm)) == pytest.approx((2 + expected[0], 3 + expected[1]), rel=1e-9)


def marker_slip(before: dict, after: dict, h: float) -> tuple[float, np.ndarray]:
    """Slip [m/s] of body 2 on body 1 along (-n_y, n_x), and n, from where body-fixed markers at the contact went in one step."""
    centre, moved = before["x"], after["x"]
    normal = (centre[1] - centre[0]) / np.hypot(*(centre[1] - centre[0]))
    went = []
    for k, arm in ((0, R * normal), (1, -R * normal)):
        turn = after["angle"][k] - before["angle"][k]
        turn -= 2 * math.pi * round(turn / (2 * math.pi))
        turned = np.array([arm[0] * math.cos(turn) - arm[1] * math.sin(turn), arm[0] * math.sin(turn) + arm[1] * math.cos(turn)])
        went.append(moved[k] + turned - centre[k] - arm)
    return float((went[1] - went[0]) @ perp(normal)) / h, normal


@pytest.mark.parametrize("model", ["sign", "viscous", "spring", "rigid"])
def test_friction_power(model: str) -> None:
    """A6: friction takes energy in every step; a spring may give back what it took, never more.

    Measured from outside: the slip by markers fixed to the bodies, in the step before the force; the force by the change of the velocities.
    """
    rigid = model == "rigid"
    md = {"kind": "md", "law": "linear", "k_r": K, "restitution": 0.5, "step": T_C / 100}
    solver = {"kind": "rigid", "step": 1e-5, "restitution": 0.5} if rigid else md
    h, normal, middle = solver["step"], unit(17), np.array([0.05, 0.05])
    push = 0.5 * normal + 0.4 * perp(normal)
    start = [middle + side * ((R + 1.25 * h) * normal + 2.5 * h * 0.4 * perp(normal)) for side in (-1, 1)]
    discs = [Disc(*start[0], *push, spin=-30.0), Disc(*start[1], *-push, spin=70.0)]
    sim = simulate(discs, (0.1, 0.1), solver, mu=0.3, friction={} if rigid else {"model": model})
    now = {"x": sim.positions.copy(), "angle": sim.angles.copy(), "v": sim.velocities.copy()}
    slip, powers = None, []
    for _ in range(150):
        sim.advance_steps(1)
        then, now = now, {"x": sim.positions.copy(), "angle": sim.angles.copy(), "v": sim.velocities.copy()}
        last, (slip, n) = slip, marker_slip(then, now, h)
        if last is not None:
            powers.append(M * (now["v"][1] - then["v"][1]) @ perp(n) / h * last)
    scale = max(abs(np.array(powers)))
    assert scale > 0 and sum(powers) < -0.9 * scale
    if model != "spring":
        assert max(powers) < 1e-3 * scale


@pytest.mark.parametrize("angle", [90.0, 70.0, 180.0])
@pytest.mark.parametrize("name", SOLVERS)
def test_incline(name: str, angle: float) -> None:
    """A7: down 20 degrees, mu 0.3 rolls with (2/3) g sin; mu 0.1 slides with g (sin - mu cos) and spins up by 2 mu g cos / R; 0.5 %.

    Floor and left-hand wall with gravity leaning, and (70 degrees) a line that slopes by 20 degrees.
    """
    theta, time = math.radians(20), 0.2
    for mu, pull, spin_up in (
        (0.3, 2 / 3 * G * math.sin(theta), 2 / 3 * G * math.sin(theta) / R),
        (0.1, G * (math.sin(theta) - 0.1 * math.cos(theta)), 2 * 0.1 * G * math.cos(theta) / R),
    ):
        sim, right, start = resting(unit(angle), SOLVERS[name], 0.0, 0.0, mu, tilt=20.0)
        sim.advance(0.1)
        v, spin = sim.velocities[0] @ right, sim.spins[0]
        sim.advance(time - 0.1)
        assert (sim.velocities[0] @ right - v) / (time - 0.1) == pytest.approx(pull, rel=5e-3), mu
        assert -(sim.spins[0] - spin) / (time - 0.1) == pytest.approx(spin_up, rel=5e-3), mu
        assert (sim.positions[0] - start) @ right == pytest.approx(pull * time**2 / 2, rel=0.01), mu


@pytest.mark.parametrize("name", SOLVERS)
def test_pyramid(name: str) -> None:
    """A10: three discs stand if mu > tan 15 degrees and fall below it, bracketed within 5 %; what stands does not move."""
    sunk, crept, speed = pyramid(SOLVERS[name], 1.05 * THRESHOLD)
    assert sunk < 0.01 and abs(crept) < 1e-4 and speed < 1e-4
    sunk, _, _ = pyramid(SOLVERS[name], 0.95 * THRESHOLD)
    assert sunk > 0.05


@pytest.mark.parametrize("name", SOLVERS)
def test_pyramid_floor(name: str) -> None:
    """A10: with rough discs the floor decides: mu_floor > 0.0893, bracketed within 5 %."""
    sunk, crept, speed = pyramid(SOLVERS[name], 0.5, 1.05 * FLOOR_THRESHOLD)
    assert sunk < 0.01 and abs(crept) < 1e-4 and speed < 1e-4
    sunk, _, _ = pyramid(SOLVERS[name], 0.5, 0.95 * FLOOR_THRESHOLD)
    assert sunk > 0.05


@pytest.mark.parametrize("model", ["sign", "viscous"])
def test_pyramid_creeps(model: str) -> None:
    """A10: the models without a static state do not stand still, however rough: the student report's piles flattened."""
    stiff = {**SOLVERS["linear"], "k_r": K, "step": T_C / 20}
    _, held, _ = pyramid(stiff, 0.5)
    _, crept, speed = pyramid(stiff, 0.5, model=model)
    assert speed > 1e-5
    assert crept > max(2e-4, 10 * abs(held))


def test_inertia_is_that_of_a_disc() -> None:
    """The constants above: I = m R^2 / 2 of the standard disc (physics.md, units)."""
    assert pytest.approx((0.2081, 2.602e-6), rel=1e-3) == (M, INERTIA)
