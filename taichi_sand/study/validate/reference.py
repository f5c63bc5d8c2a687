"""What physics says: formulas and ODEs of the cases of physics.md section A, independent of the engine. SI units, areal masses."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq


def clipped_restitution(zeta: float) -> float:
    """e of a linear spring-dashpot whose force is never attractive (A1, Schwager & Poeschel 2007)."""
    root = np.sqrt(1 - zeta**2)
    return float(np.exp(-zeta / root * (np.pi - np.arctan2(2 * zeta * root, 1 - 2 * zeta**2))))


def zeta_for(restitution: float) -> float:
    """Damping ratio that gives `restitution` with the clipped linear law."""
    return float(brentq(lambda z: clipped_restitution(z) - restitution, 1e-9, 1 - 1e-9))  # type: ignore[arg-type]


def impact(mass: float, speed: float, k_r: float, k_d: float = 0.0, alpha: float = 0.0, beta: float = 1.0) -> dict[str, float]:
    """Head-on impact under f = max(0, k_r z^beta + k_d z^alpha z'): e, largest overlap [m], duration until the gap opens [s] (A3)."""
    depth = ((beta + 1) * mass * speed**2 / (2 * k_r)) ** (1 / (beta + 1))
    unit = depth / speed  # dimensionless: overlap in `depth`, time in `unit`
    a_r = k_r * depth**beta * unit**2 / (mass * depth)
    a_d = k_d * depth ** (alpha + 1) / unit * unit**2 / (mass * depth)

    def rate(_: float, y: np.ndarray) -> list[float]:
        z = max(y[0], 0.0)
        return [y[1], -max(0.0, a_r * z**beta + a_d * z**alpha * y[1])]

    def apart(t: float, y: np.ndarray) -> float:
        return y[0] if t > 1e-6 else 1.0

    apart.terminal = True
    apart.direction = -1
    done = solve_ivp(rate, (0, 1e3), [0.0, 1.0], events=apart, rtol=1e-10, atol=1e-12, max_step=0.02)
    return {"e": -float(done.y[1, -1]), "depth": depth * float(done.y[0].max()), "time": unit * float(done.t[-1])}


def hard_impact(v_n: float, v_s: float, mu: float, e: float, weight: float, turning: float, beta0: float = 0.0) -> tuple[float, float]:
    """Normal and tangential impulse of Walton's hard impact (A4), both as they act on the striker, along the normal and the tangent.

    v_n: speed of approach, v_s: slip of the contact points, weight: 1/m_i + 1/m_j, turning: R_i^2/I_i + R_j^2/I_j, beta0: tangential
    restitution of a contact that sticks.
    """
    normal = (1 + e) * v_n / weight
    stick = -(1 + beta0) * v_s / (weight + turning)
    return normal, float(np.clip(stick, -mu * normal, mu * normal))


def spring_impact(
    v_n: float, v_t: float, spin: float, mu: float, law: dict[str, float], shear: tuple[float, float], m: float, r: float
) -> np.ndarray:
    """Disc (m, r) on a wall with a Cundall-Strack spring: final (v_n, v_t, spin) in the frame of normal and tangent.

    law: k_r, k_d, alpha, beta; shear: tangential over normal stiffness (force over overlap) and tangential over normal damping.
    Integrated with steps of 1/20000 of the contact time, the force cut at mu f_n.
    """
    touch = impact(m, v_n, **law)
    h = touch["time"] / 20000
    z, dz, slip, turn = v_n * h, v_n, v_t, spin
    xi = 0.0
    while True:
        f_n = max(0.0, law["k_r"] * z ** law["beta"] + law["k_d"] * z ** law["alpha"] * dz) if z > 0 else 0.0
        k_t = shear[0] * law["k_r"] * max(z, 1e-15) ** (law["beta"] - 1)
        c_t = shear[1] * law["k_d"] * max(z, 1e-15) ** law["alpha"]
        arm = r - max(z, 0.0)  # to the wall, not to the undeformed rim: so angular momentum about the contact is kept (A15)
        v_s = slip + turn * arm
        pull = float(np.clip(-k_t * (xi + v_s * h), -mu * f_n, mu * f_n))
        f_t = float(np.clip(pull - c_t * v_s, -mu * f_n, mu * f_n))
        xi = -pull / k_t  # the spring alone slides at the bound: else a dashpot at the bound would stretch it backwards
        dz -= f_n / m * h
        slip += f_t / m * h
        turn += f_t * arm / (0.5 * m * r * r) * h
        z += dz * h
        if z <= 0:
            return np.array([-dz, slip, turn])


def chain(masses: np.ndarray, speeds: np.ndarray, gaps: np.ndarray, k_r: float, beta: float) -> np.ndarray:
    """Final velocities of a row of elastic balls, f = k_r z^beta (A14); gaps [m] between neighbours at the start."""
    n = len(masses)

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        z = np.maximum(y[: n - 1] - y[1:n] - gaps, 0.0)
        force = k_r * z**beta
        net = np.zeros(n)
        net[:-1] -= force
        net[1:] += force
        return np.concatenate([y[n:], net / masses])

    span = 40 * np.sqrt(masses.max() / k_r) if beta == 1 else 40 * (masses.max() ** 2 / (k_r**2 * abs(speeds).max())) ** 0.2
    span += 2 * gaps.sum() / abs(speeds).max()
    done = solve_ivp(rate, (0, span), np.concatenate([np.zeros(n), speeds]), rtol=1e-10, atol=1e-14, max_step=span / 4000)
    return done.y[n:, -1]


def first_bounce(height: float, m: float, k_r: float, k_d: float, g: float) -> float:
    """Height [m] of the surface of a disc above the floor after its first bounce from `height`: linear clipped contact, gravity (A11)."""
    v = np.sqrt(2 * g * height)

    def rate(_: float, y: np.ndarray) -> list[float]:
        return [y[1], g - max(0.0, k_r * y[0] + k_d * y[1]) / m]

    def apart(t: float, y: np.ndarray) -> float:
        return y[0] if t > 0 else 1.0

    apart.terminal = True
    apart.direction = -1
    t_c = np.pi * np.sqrt(m / k_r)
    done = solve_ivp(rate, (0, 10 * t_c), [0.0, v], events=apart, rtol=1e-10, atol=1e-13, max_step=t_c / 100)
    return float(done.y[1, -1] ** 2 / (2 * g))


def slip_on_disc(spin: float, mu: float, r: float, r_base: float, g: float, time: float) -> tuple[float, float, float]:
    """A disc of radius r at rest, spinning, on top of a fixed one: angle of its place from the top [rad], its speed along the rim
    [m/s] and its spin [rad/s] after `time`, as long as it slips (A5, disc on disc). Clockwise places are positive, spin is
    counter-clockwise, so a negative spin drives the disc clockwise.
    """
    path = r + r_base

    def rate(_: float, y: np.ndarray) -> list[float]:
        place, speed, turn = y
        press = g * np.cos(place) - speed**2 / path  # per mass
        # Slip of the rim at the contact along the clockwise tangent: the centre moves with `speed`, the rim below it with spin * r.
        direction = np.sign(speed + turn * r)
        push = -mu * press * direction
        return [speed / path, g * np.sin(place) + push, 2 * push / r]

    done = solve_ivp(rate, (0, time), [0.0, 0.0, spin], rtol=1e-10, atol=1e-12, max_step=time / 500)
    place, speed, turn = (float(v) for v in done.y[:, -1])
    return place, speed, turn
