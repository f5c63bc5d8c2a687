"""From the tolerance (overlap allowed at rest / d) to stiffness, damping and step, for both solvers (physics.md D1-D3)."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taichi_sand.scene.packing import Pack

CONTACT_STEPS = 20
"""Steps of molecular dynamics in a collision."""
STEP_LIMIT = 0.18
"""Largest stable step over the collision time, for the densest packings with tangential springs (physics.md D1)."""
MOST_DAMPING = 1.25
"""Largest damping ratio: with a force that never pulls it means a restitution of 0.1, and less would cost smaller steps."""
SAG = 1.11
"""Soft step: h = SAG sqrt(x d / (n g)) lets a column of n grains sag to the overlap x d (physics.md D3)."""
MD_CHAINS = 2.3
"""A bed bears its weight on chains of contacts, not evenly: its worst hundredth of overlaps is so many times that of a column of its
depth (1.2 to 2.2, the more the stiffer; settle, 25 and 58 grains deep)."""
RIGID_LOAD = 0.85
"""The same for the rigid solver, times what the slow reference impulse leaves of the sag: a bed that has come to rest keeps half of the
tolerance at its worst hundredth, a column a fifth of it; before the reference has followed it is 1.5 times the tolerance."""
PULLED = 0.8
"""Bridges that pull with the weight of n grains add to the overlaps so many times what n grains on top do (md, damp walls: 0.76)."""
REST, LOOKS, STIFFER, MOST_STRAIN = 0.01, 3, 1.5, 16.0
"""A bed is at rest where 99 % of its grains are slower than REST sqrt(g d). Where at LOOKS looks in turn one is found that more than 1 %
of the contacts overlap by more than the tolerance, they bear more than its depth explains, such as rows that an impact has wedged
between walls: contacts are then made STIFFER times as stiff, or twice, four or eight times that where overlaps are so many tolerances;
and again, up to MOST_STRAIN times what depth asks for."""
SOFT_HERTZ = 0.25
"""Frequency of the soft contact times h; stiffer contacts jitter (physics.md D4)."""
SOFT_DAMPING, CLUMP_DAMPING = 20.0, 5.0
"""Damping ratio of the soft contact, of discs and of grains of several discs. The overlap answers a force in 2 ratio / omega, and an answer
that comes late feeds a swing: with 20 pyramids of clumps that are 100 rows high shake themselves apart, at any step. With 5 columns of
100 discs ring for minutes."""
LONGEST_STEP = 1 / 240
"""No step of the rigid solver is longer [s]."""
REFERENCE_STEPS, LEAST_REFERENCE_STEPS = 0.03, 40.0
"""The slow reference impulse follows in REFERENCE_STEPS n^2 steps: as slowly as the slowest swing of a pile n deep dies out, as what
follows a force with a delay feeds a swing. (1D columns of 5 to 300 discs: a quarter of it still rests, but rings longer; four times as
much only rests later.) In a frictional bed ten deep, after 10 steps a twelfth shakes for good at tolerance 0.01, after 20 nobody."""
CLUMPS_SLOWER = 8.0
"""Clumps swing, and die out, so many times as slowly: they roll on one another like gears, and a contact moves what turns them less than
what shifts them (pyramids of squares shake after 14 steps with 20 rows, after 80 with 40; arches of 17 wedges after 40)."""
LONGEST_FALL = 0.5
"""Rigid: no step is longer than this, in sqrt(d / g): at 0.7 grains of a pile are found outside the box, and have to be put back."""
FASTEST = 0.95
"""Rigid: speed cap in diameters a step. Two grains then approach by less in a step than a search can foresee, MOST_SLACK diameters."""
FALL = 0.9
"""Share of the speed cap that a falling grain may reach."""
PUSH, IMPACT = 0.5, 0.3
"""Rigid: fastest separation of two overlapping grains, and slowest impact, in sqrt(g d) (physics.md D5). Of ten in one place those at the
ends of a row part nearly twice as fast."""
YIELD, GROW = 0.4, 0.12
"""Md: an overlap that would part two grains faster than YIELD sqrt(g d), that the weight of the bed does not explain, and that they were
not seen to come to, is taken out by and by: they touch where they are, and their surfaces grow to the radii they have with GROW sqrt(g d)
(physics.md C6). Of ten that start in one place those at the ends of a row part seven times as fast."""
MEANT = 0.25
"""Md: who gives the stiffness of contacts means what is pressed together at the start by less than this, in d (physics.md A12)."""
SOFTEST = 1.0  # md: least stiffness over the mass of a mean grain [1/s2]
EARTH = 9.81  # m/s2, where a scene has no gravity to measure speeds by
WINDOW = 16
"""Diameters across which the depth of a bed is averaged."""
PACKING = 0.84
"""Packing fraction of the bed that grains will form."""


@dataclass(frozen=True)
class Bed:
    """What the tolerance has to do with: grains and their load."""

    diameter: float  # mean, of discs of the same area [m]
    mass: float  # mean [kg]
    least_mass: float  # that a contact may have to move, levers included [kg]
    depth: float  # of the pile, in grains: most weight that lies on a grain, over its own
    load: float  # most mass that lies on a grain [kg]
    gravity: float  # [m/s2]
    speed: float  # fastest grain at the start, or wall [m/s]
    longest_step: float = math.inf  # that the effects allow [s]
    drop: float = 0.0  # that a grain can fall at most [m]
    clumps: bool = False  # whether there are grains of several discs
    pull: float = 0.0  # of effects that hold grains together, in weights of a mean grain
    push: float = 0.0  # of effects that press grains against others, as weight does [N]
    strain: float = 1.0  # by how much more contacts have been found to bear than all that explains
    late: int = 0  # looks in turn that have found so

    def seen(self, moving: float, deep: np.ndarray) -> "Bed":
        """After a look that found this share of the grains in motion, and these of the contacts deeper than 1, 2, 4 … tolerances."""
        level = int((deep > 0.01).sum())
        if moving > 0.01 or not level:
            return replace(self, late=0)
        if self.late + 1 < LOOKS:
            return replace(self, late=self.late + 1)
        return replace(self, late=0, strain=min(MOST_STRAIN, STIFFER * 2 ** (level - 1) * self.strain))

    @property
    def pressing(self) -> float:
        """What a grain presses with on those below or behind it, over its mass [m/s2]."""
        return self.gravity + self.push / self.mass

    @property
    def squeeze(self) -> float:
        """Force that presses grains together besides the load, over the mass of a mean grain [m/s2]."""
        return PULLED * self.pull * (self.gravity or EARTH)


def bed_of(pack: Pack, gravity: tuple[float, float], size: tuple[float, float], wall_speed: float = 0.0) -> Bed:
    """Bed that the grains of `pack` will form where they fall straight down.

    `size` [m] is that of the box, `wall_speed` [m/s] that of the fastest wall.
    """
    if not len(pack.radius):
        return Bed(1.0, 1.0, 1.0, 1.0, 1.0, float(np.hypot(*gravity)), wall_speed)
    free = ~pack.fixed if (~pack.fixed).any() else np.ones_like(pack.fixed)
    radius, mass = pack.size[free], pack.mass[free]
    diameter = 2 * float(radius.mean())
    speed = max(wall_speed, float(np.hypot(*pack.velocity.T).max()))
    least = float((mass / pack.lightness[free]).min())
    depth, load = depth_of(pack.position[free], radius, mass, gravity)
    down = np.array(gravity) / max(float(np.hypot(*gravity)), 1e-12)
    drop = float(np.maximum(down * np.array(size), 0.0).sum() - (pack.position[free] @ down).min())
    strength, clumps = float(np.hypot(*gravity)), bool(pack.lightness.max() > 1.0)
    return Bed(diameter, float(mass.mean()), least, depth, load, strength, speed, drop=max(drop, 0.0), clumps=clumps)


def depth_of(position: np.ndarray, radius: np.ndarray, mass: np.ndarray, gravity: tuple[float, float]) -> tuple[float, float]:
    """Most weight that lies on a grain of the bed, over its own, and most mass that does [kg].

    Grains at `position`, shape (n, 2), of the areas of discs of `radius` [m], fall straight down to the packing fraction PACKING. The
    bed is looked at through windows of WINDOW diameters, counting only the parts of one that hold grains: a slender column is as deep
    as it has grains, a loose lattice as deep as it will be when it has settled. What lies on light grains is all that starts above
    the lowest of them: what falls between them later is found by the next look.
    """
    diameter, area = 2 * float(radius.mean()), math.pi * radius**2
    axis = 1 if abs(gravity[1]) >= abs(gravity[0]) else 0
    across, height = position[:, 1 - axis], -math.copysign(1.0, gravity[axis]) * position[:, axis]
    column = np.floor((across - across.min()) / diameter).astype(int)
    columns = column.max() + 1
    ones = np.ones(min(WINDOW, columns))
    held = np.maximum(np.convolve(np.bincount(column, minlength=columns) > 0, ones, "valid"), 1)
    density = mass / area
    octave = np.floor(np.log2(density / density.min()) + 1e-3)
    depth, heaviest = 1.0, 0.0
    for kind in np.unique(octave):
        floor = np.full(columns, np.inf)
        np.minimum.at(floor, column[octave == kind], height[octave == kind])
        reach = np.pad(floor, WINDOW, constant_values=np.inf)
        floor = np.lib.stride_tricks.sliding_window_view(reach, 2 * WINDOW + 1).min(axis=1)
        above = np.bincount(column, mass * (height >= floor[column]), columns)
        load = float((np.convolve(above, ones, "valid") / held).max())
        depth = max(depth, load / (PACKING * diameter**2 * float(density[octave == kind].min())))
        heaviest = max(heaviest, load)
    whole = heaviest / (PACKING * diameter**2) * float(area.sum() / mass.sum()) * float(mass.mean())
    return depth, max(whole, float(mass.mean()))


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
    """χ such that k_d = χ sqrt(k_r m_eff) gives `restitution` at any speed, for α = (β - 1)/2; bounded by MOST_DAMPING."""
    if beta == 1.0:
        low, high = 0.0, 2 * MOST_DAMPING
        measure = lambda chi: collision_restitution(chi / 2)  # noqa: E731
    else:
        low, high = 0.0, 2 * MOST_DAMPING * math.sqrt(beta)
        measure = lambda chi: impact_restitution(chi, beta)  # noqa: E731
    if restitution >= 1.0:
        return 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if measure(middle) > restitution else (low, middle)
    return high


def follows_tolerance(solver: Any) -> bool:
    """Whether stiffness and step follow from the tolerance, not from numbers of their own in the [solver] table."""
    return not any((solver.step, solver.substeps, solver.stiffness, solver.k_r, solver.hertz))


def md_numbers(scene: Any, bed: Bed) -> dict[str, float]:
    """Numbers of solvers.md.constants_type, and the speed cap [m/s]. SandError if the scene asks for an unstable step."""
    solver = scene.solver
    alpha, beta = {"linear": (0.0, 1.0), "hertz": (0.25, 1.5)}.get(solver.law, (solver.alpha, solver.beta))
    overlap = solver.tolerance * bed.diameter
    pressed = MD_CHAINS * (bed.load * bed.pressing + bed.mass * bed.squeeze) * bed.strain
    rest = pressed / overlap
    impact = 0.5 * bed.mass * (bed.speed / (math.sqrt(solver.tolerance) * bed.diameter)) ** 2
    stiffness = solver.stiffness or (max(rest, impact, SOFTEST * bed.mass) if rest or impact else 1e4 * bed.mass)
    k_r = solver.k_r if solver.k_r is not None else stiffness * overlap ** (1 - beta)
    stiffness = k_r * overlap ** (beta - 1)
    weighted = solver.k_d is None
    damping = damping_for(solver.restitution, beta) * math.sqrt(k_r) if weighted else solver.k_d
    reduced = 0.5 * bed.least_mass
    k_d = damping * (math.sqrt(reduced) if weighted else 1.0) * overlap**alpha
    ratio = k_d / (2 * math.sqrt(beta * stiffness * reduced))
    contact_time = math.pi * math.sqrt(reduced / (beta * stiffness))
    limit = STEP_LIMIT * contact_time * (math.sqrt(1 + ratio**2) - ratio)
    step = solver.step or min(contact_time / CONTACT_STEPS, limit, bed.longest_step)
    if step > limit:
        raise scene.error(
            "solver.step",
            f"{step:g} s is beyond the stability limit of {limit:.3g} s for these contacts; "
            "take a smaller step, a larger tolerance or a softer contact",
        )
    _check_step(scene, "step", step, bed)
    cap = 0.5 * bed.diameter * math.pi / contact_time
    unit = math.sqrt((bed.gravity or EARTH) * bed.diameter)
    meant = MEANT * bed.diameter if solver.stiffness or solver.k_r is not None else 0.0
    borne = (pressed / k_r) ** (1 / beta)
    return {
        "step": step,
        "stiffness": k_r,
        "damping": damping,
        "alpha": alpha,
        "beta": beta,
        "speed_cap": cap,
        "deep": max(YIELD * unit * math.sqrt(beta) * contact_time / math.pi, borne, meant),
        "growth": GROW * unit,
    }


def _check_step(scene: Any, key: str, step: float, bed: Bed) -> None:
    if step > bed.longest_step * (1 + 1e-6):
        raise scene.error(
            f"solver.{key}",
            f"a step of {step:g} s is beyond what the effects of this scene allow, {bed.longest_step:.3g} s; leave it out, or take "
            "a smaller one",
        )


def rigid_numbers(scene: Any, bed: Bed) -> dict[str, float]:
    """Numbers of solvers.rigid.constants_type, and the speed cap [m/s]. SandError if the scene asks for an unstable step."""
    solver = scene.solver
    weight = max(RIGID_LOAD * (bed.depth * bed.pressing + bed.squeeze) * bed.strain, 1e-12)
    flight = math.sqrt(solver.tolerance) * bed.diameter / max(bed.speed, 1e-12)
    followed = FALL * FASTEST * bed.diameter / max(math.sqrt(bed.speed**2 + 2 * bed.gravity * bed.drop), 1e-12)
    step = min(SAG * math.sqrt(solver.tolerance * bed.diameter / weight), flight, followed, LONGEST_STEP, bed.longest_step)
    if solver.substeps:
        step = 1 / (60 * solver.substeps)
    step = solver.step or step
    key, limit = "substeps" if solver.substeps else "step", LONGEST_FALL * math.sqrt(bed.diameter / max(bed.gravity, 1e-12))
    if step > limit:
        raise scene.error(
            f"solver.{key}",
            f"a step of {step:g} s is beyond the limit of {limit:.3g} s, in which a grain falls by "
            f"{0.5 * LONGEST_FALL**2:.2g} of its diameter; take a smaller one",
        )
    _check_step(scene, key, step, bed)
    hertz = solver.hertz or SOFT_HERTZ / step
    omega = 2 * math.pi * hertz
    a1 = 2 * (CLUMP_DAMPING if bed.clumps else SOFT_DAMPING) + step * omega
    a2 = step * omega * a1
    unit = math.sqrt(max(bed.gravity, 0.0) * bed.diameter)
    reference_steps = max(REFERENCE_STEPS * bed.depth**2, LEAST_REFERENCE_STEPS) * (CLUMPS_SLOWER if bed.clumps else 1.0)
    return {
        "step": step,
        "rate": 1 / step,
        "mass_scale": a2 / (1 + a2),
        "impulse_scale": 1 / (1 + a2),
        "bias_rate": omega / a1,
        "push_cap": max(PUSH * math.sqrt(bed.pressing * bed.diameter), 0.0 if bed.gravity else bed.diameter),
        "restitution": solver.restitution,
        "threshold": max(IMPACT * unit, 4 * bed.gravity * step),
        "reference_rate": 1 / reference_steps,
        "speed_cap": FASTEST * bed.diameter / step,
    }
