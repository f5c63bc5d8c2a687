"""Dashpots that give a restitution, and how long steps may be with them: md's law of a collision (physics.md A1-A3)."""

import math

CONTACT_STEPS = 20
"""Steps of molecular dynamics in a collision."""
STEP_LIMIT = 0.18
"""Largest stable step over the collision time, for the densest packings with tangential springs (physics.md D1)."""
MOST_DAMPING = 5.0
"""Largest damping ratio that a restitution may need: with a force that never pulls 5 mean 0.0095."""
EXACT, LEAST_RESTITUTION = 0.1, 0.01
"""Below EXACT the dashpot stops most of an approach in a few steps, and restitution depends on how deep the first of them finds the
contact: in explicit steps that take a share a of the speed it is that of the law times 1 - a to 1. The middle of that is aimed at, with
steps that take TAKEN, or more where it then still keeps within OFF; 0 stands for LEAST_RESTITUTION, as less would only cost steps.
From EXACT on steps are longer, and restitution is a little off. (Asked for 0, 0.02, 0.05, 0.1, the linear law gives 0.011, 0.022, 0.053
and 0.086 in the mean, in 2.3, 1.6, 2.0 and 1 times the steps.)"""
TAKEN, OFF = 0.28, 0.008


def collision_restitution(zeta: float) -> float:
    """Restitution of a linear spring and dashpot that never pulls, damping ratio `zeta` (Schwager & Pöschel 2007; physics.md A1)."""
    if zeta < 1e-9:
        return 1.0
    if abs(zeta - 1) < 1e-6:
        return math.exp(-2.0)
    if zeta < 1:
        root = math.sqrt(1 - zeta * zeta)
        return math.exp(-zeta / root * (math.pi - math.atan2(2 * zeta * root, 1 - 2 * zeta * zeta)))
    root = math.sqrt(zeta * zeta - 1)
    return math.exp(-zeta / root * math.log((zeta + root) / (zeta - root)))


def impact_restitution(chi: float, beta: float, steps: int = 2000) -> float:
    """Restitution of f = max(0, χ ζ^((β-1)/2) ζ' + ζ^β) for unit mass and speed, by integration (RK4)."""
    alpha = (beta - 1) / 2
    x, v = 0.0, 1.0
    h = 8.0 / steps

    def acceleration(x: float, v: float) -> float:
        x = max(x, 0.0)
        return -max(0.0, chi * x**alpha * v + x**beta)

    while x >= 0.0 and (v > 0 or acceleration(x, v) < 0):
        a1 = acceleration(x, v)
        a2 = acceleration(x + h / 2 * v, v + h / 2 * a1)
        a3 = acceleration(x + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2)
        a4 = acceleration(x + h * v + h * h / 2 * a2, v + h * a3)
        x += h * v + h * h / 6 * (a1 + a2 + a3)
        v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return -v


def damping_for(restitution: float, beta: float) -> float:
    """χ such that k_d = χ sqrt(k_r m_eff) gives `restitution` at any speed, for α = (β - 1)/2; the damping ratio is χ / (2 sqrt β), and
    bounded by MOST_DAMPING.
    """
    if beta == 1.0:
        low, high = 0.0, 2 * MOST_DAMPING
        measure = lambda chi: collision_restitution(chi / 2)  # noqa: E731
    else:
        low, high = 0.0, 2 * MOST_DAMPING * math.sqrt(beta)
        measure = lambda chi: impact_restitution(chi, beta)  # noqa: E731
    if restitution >= 1.0:
        return 0.0
    for _ in range(62):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if measure(middle) > restitution else (low, middle)
    return high


def stable_step(ratio: float) -> float:
    """Longest stable step of contacts of this damping ratio, over the collision time."""
    return STEP_LIMIT * (math.sqrt(1 + ratio**2) - ratio)


def law_for(restitution: float, beta: float, step: float | None) -> tuple[float, float]:
    """χ of `damping_for`, and the longest step over the collision time with which `restitution` comes out (see EXACT).

    `step` is the one that the scene asks for, over the collision time, if it does.
    """
    if restitution >= EXACT:
        return damping_for(restitution, beta), math.inf
    asked = max(restitution, LEAST_RESTITUTION)
    turns = math.pi / math.sqrt(beta)  # χ times a step over the collision time times this is the share of the speed it takes
    chi = damping_for(asked, beta)
    longest = min(1 / CONTACT_STEPS, stable_step(chi / (2 * math.sqrt(beta))))
    share = min(chi * turns * longest, max(TAKEN, 2 * OFF / (OFF + asked))) if step is None else min(chi * turns * step, 1.0)
    chi = damping_for(asked / (1 - share / 2), beta)
    return chi, share / (chi * turns)
