"""From the tolerance (overlap allowed at rest / d) to stiffness, damping and step, for both solvers (physics.md D1-D3)."""

import math
from typing import Any

import numpy as np

from taichi_sand.scene.materials import restitutions
from taichi_sand.solvers.bed import EARTH, Bed, lasting
from taichi_sand.solvers.restitution import CONTACT_STEPS, law_for, stable_step

ELASTIC, ELASTIC_STEPS = 0.995, 50
"""Steps of a collision at restitutions above ELASTIC. The step in which two meet costs or gives up to (pi h / t_c)^2 / 4
of their energy by chance, 0.6 % with 20 steps: as much as such a contact is to take."""
SAG = 1.11
"""Soft step: h = SAG sqrt(x d / (n g)) lets a column of n grains sag to the overlap x d (physics.md D3)."""
MD_CHAINS = 2.3
"""A bed bears its weight on chains of contacts, not evenly: its worst hundredth of overlaps is so many times that of a column of its
depth (1.2 to 2.2, the more the stiffer; settle, 25 and 58 grains deep)."""
RIGID_LOAD = 0.85
"""Rigid solver: load of the worst hundredth over that of a column, times what the slow reference impulse leaves of the sag: a bed that has
come to rest keeps half of the tolerance at its worst hundredth, a column a fifth of it; before the reference has followed it is 1.5 times
the tolerance."""
SOFT_HERTZ = 0.25
"""Frequency of the soft contact times h; stiffer contacts jitter (physics.md D4)."""
SOFT_DAMPING, CLUMP_DAMPING = 20.0, 5.0
"""Damping ratio of the soft contact, of discs and of grains of several discs. The overlap answers a force in 2 ratio / omega, and an answer
that comes late feeds a swing: with 20 pyramids of clumps that are 100 rows high shake themselves apart, at any step. With 5 columns of
100 discs ring for minutes."""
DEEP_DAMPING, MOST_DAMPED = 0.25, 60.0
"""Discs: the ratio is at least this times the depth in grains, up to MOST_DAMPED: what swings in a deep pile is slower still. (Settle
116 deep: kinetic energy after 2 s, in m g r, 4e-4 with 20, 3e-5 with 30, 9e-5 with 60; 234 deep 3e-2 with 20, 2e-3 with 30, 9e-4 with
60. Shallow ones rest later with 30 than with 20.)"""
LONGEST_STEP = 1 / 240 / math.sqrt(0.01 / EARTH)
"""Rigid: no step is longer than this, in sqrt(d / g); 1/240 s for grains of 1 cm."""
CLUMPS_SHORTER = 0.65
"""Clumps: nor than this share of it, as they are larger than the discs by which they touch (squares 2.1 times; an arch of 17 wedges at
tolerance 0.05 stands with a step of 0.095 sqrt(d / g), and falls in with one of 0.1)."""
SHAKE_STEPS = 16
"""Rigid: nor has a wall that is shaken fewer steps in a period."""
REFERENCE_STEPS, LEAST_REFERENCE_STEPS = 0.03, 40.0
"""The slow reference impulse follows in REFERENCE_STEPS n^2 steps: as slowly as the slowest swing of a pile n deep dies out, as what
follows a force with a delay feeds a swing. (1D columns of 5 to 300 discs: a quarter of it still rests, but rings longer; four times as
much only rests later.) In a frictional bed ten deep, after 10 steps a twelfth shakes for good at tolerance 0.01, after 20 nobody."""
REFERENCE_SHARE, SLIPPERY_SHARE = 0.83, 0.4
"""The reference takes over this share of the carried impulse at most: the sag falls to the rest of it, and the soft contact keeps enough of
the load to damp. With 0.95 piles 45 grains deep shake. Without friction grains swing sideways with nothing but the softness of their
contacts to hold them: with 0.83 beds of 200, 1000 and 5000 discs never rest (2, 7 and 3 % of sqrt(g d)), with 0.6 those of 1000 do not,
with 0.3 to 0.45 all do, to rounding; a hundredth of their contacts overlaps by 0.8 to 0.97 of the tolerance. (mu = 0.01 is friction
enough.)"""
CLUMPS_SLOWER = 8.0
"""Clumps swing, and die out, so many times as slowly: they roll on one another like gears, and a contact moves what turns them less than
what shifts them (pyramids of squares shake after 14 steps with 20 rows, after 80 with 40; arches of 17 wedges after 40)."""
LONGEST_FALL = 0.5
"""Rigid: no step is longer than this, in sqrt(d / g): at 0.7 grains of a pile are found outside the box, and have to be put back."""
FASTEST = 0.95
"""Rigid: speed cap in diameters a step. Two grains then approach by less in a step than a list build can foresee, MOST_SLACK diameters."""
FALL = 0.9
"""Rigid: share of the speed cap that a grain may reach before steps become shorter."""
BELOW, ABOVE = 1 - 1e-6, 1.05
"""Where stiffness and step follow speeds to this share of the limit, they do not follow any farther. Md: they follow one that is ABOVE
times what they are made for, as what rebounds may be a little faster than it came."""
MOST_DENT = 0.45
"""Md: stiffness is such that no grain that flies at a wall comes closer to crossing it than so many of its diameters, whatever the
tolerance; the tolerance x asks for dents of sqrt(2 x) d at most (physics.md D2)."""
FLOW_SOFTNESS = 2.0
"""Md: contacts of a dense flow are so stiff that its softness is at most this many tolerances."""
TOO_SOFT = {"md": 0.03, "rigid": 0.08}
"""Softness of a flow: duration of a contact (md: of a collision; rigid: a step) times the speed that 99 % of the contacts keep below, over
d. Above these numbers a slope of discs is some 10 % too fast with md (3.5 to 4 times the softness) or too slow with rigid
(study.validate.slope)."""
PUSH, IMPACT = 0.5, 0.3
"""Rigid: fastest separation of two overlapping grains, and slowest impact, in sqrt(g d) (physics.md D5). Of ten in one place those at the
ends of a row part nearly twice as fast."""
PRESS = 3.0
"""Rigid: but no slower than an overlap of PRESS tolerances asks for: a contact pushes in proportion to that, and what is capped bears no
more. (A disc on one 1e6 times as light sank in for good.)"""
YIELD, GROW = 0.4, 0.12
"""Md: an overlap that would part two grains faster than YIELD sqrt(g d), that the weight of the bed does not explain, and that they were
not seen to come to, is taken out by and by: they touch where they are, and their surfaces grow to the radii they have with GROW sqrt(g d)
(physics.md C6). Of ten that start in one place those at the ends of a row part seven times as fast."""
SETTLE = 0.03
"""Md: contacts of a new stiffness go back to where the surfaces are so slowly that the top of a bed moves with SETTLE sqrt(g d)."""
MEANT = 0.25
"""Md: who gives the stiffness of contacts means what is pressed together at the start by less than this, in d (physics.md A12)."""
MOST_SPARE = 1e9  # where next to nothing presses; more is no number of 32 bits
SOFTEST = 1.0  # md: least stiffness over the mass of a mean grain [1/s2]


def laws_for(scene: Any, beta: float, step: float | None) -> tuple[float, float, float]:
    """χ of `solver.restitution`, the largest χ of all contacts, and the longest step that all of them allow, as `law_for`."""
    laws = [law_for(restitution, beta, step) for restitution in restitutions(scene)]
    return laws[0][0], max(chi for chi, _ in laws), min(longest for _, longest in laws)


def follows_tolerance(solver: Any) -> bool:
    """Whether stiffness and step follow from the tolerance, not from numbers of their own in the [solver] table."""
    return not any((solver.step, solver.substeps, solver.stiffness, solver.k_r, solver.hertz))


def dent(tolerance: float, bed: Bed) -> float:
    """How deep two grains that meet may overlap [m] (physics.md D2)."""
    return min(math.sqrt(tolerance), MOST_DENT / math.sqrt(2)) * bed.diameter


def stiffness_for(tolerance: float, bed: Bed, pressed: float) -> float:
    """Md: force over overlap [N/m] for the bed at rest, in which contacts bear `pressed` [N], for its fastest grains, and for its flow."""
    overlap, fast = tolerance * bed.diameter, max(bed.fast, bed.drive)
    rest = pressed / overlap
    energy = max(0.5 * bed.mass * fast**2, bed.ram)
    impact = max(energy / dent(tolerance, bed) ** 2, bed.solid * (fast / MOST_DENT) ** 2)
    flow = 0.5 * bed.mass * (math.pi * bed.flow / (FLOW_SOFTNESS * overlap)) ** 2
    return max(rest, impact, flow, SOFTEST * bed.mass) if rest or impact else 1e4 * bed.mass


def speed_for(tolerance: float, bed: Bed, stiffness: float) -> float:
    """Md: up to which speed [m/s] contacts of this stiffness [N/m] dent no deeper than they may."""
    through = MOST_DENT * math.sqrt(stiffness / max(bed.solid, 1e-30))
    return min(dent(tolerance, bed) * math.sqrt(2 * stiffness / bed.mass), through)


def softness(numbers: dict[str, float], bed: Bed) -> float:
    """Softness of the flow that the last looks have found, with these numbers of the solver; 0 if there is none."""
    return lasting(bed.flows) * numbers["contact_time"] / bed.diameter


def md_numbers(scene: Any, bed: Bed) -> dict[str, float]:
    """Numbers of solvers.md.constants_type, the speed cap and the speed that they are made for [m/s], and how long two mean grains touch
    [s]. SandError if the scene asks for an unstable step.
    """
    solver = scene.solver
    alpha, beta = {"linear": (0.0, 1.0), "hertz": (0.25, 1.5)}.get(solver.law, (solver.alpha, solver.beta))
    overlap = solver.tolerance * bed.diameter
    pressed = MD_CHAINS * (bed.load * bed.pressing + bed.mass * bed.squeeze) * bed.strain
    stiffness = solver.stiffness or stiffness_for(solver.tolerance, bed, pressed)
    k_r = solver.k_r if solver.k_r is not None else stiffness * overlap ** (1 - beta)
    stiffness = k_r * overlap ** (beta - 1)
    weighted = solver.k_d is None
    reduced = 0.5 * bed.least_mass
    contact_time = math.pi * math.sqrt(reduced / (beta * stiffness))
    chi, strongest, exact = laws_for(scene, beta, solver.step and solver.step / contact_time) if weighted else (0.0, 0.0, math.inf)
    damping = chi * math.sqrt(k_r) if weighted else solver.k_d
    k_d = (strongest * math.sqrt(k_r) if weighted else damping) * (math.sqrt(reduced) if weighted else 1.0) * overlap**alpha
    ratio = k_d / (2 * math.sqrt(beta * stiffness * reduced))
    limit = contact_time * stable_step(ratio)
    steps = ELASTIC_STEPS if weighted and max(restitutions(scene)) > ELASTIC else CONTACT_STEPS
    step = solver.step or min(contact_time / steps, limit, exact * contact_time, bed.longest_step)
    if step > limit:
        raise scene.error(
            "solver.step",
            f"{step:g} s is beyond the stability limit of {limit:.3g} s for these contacts; "
            "take a smaller step, a larger tolerance or a softer contact",
        )
    _check_step(scene, "step", step, bed)
    cap = 0.5 * bed.diameter * math.pi / contact_time
    made_for = speed_for(solver.tolerance, bed, stiffness)
    unit = math.sqrt((bed.gravity or EARTH) * bed.diameter)
    meant = MEANT * bed.diameter if solver.stiffness or solver.k_r is not None else 0.0
    borne = (pressed / k_r) ** (1 / beta)
    spare = min(max(1.0, stiffness * overlap / pressed) ** (1 / beta) - 1, MOST_SPARE) if pressed else 0.0
    return {
        "step": step,
        "stiffness": k_r,
        "damping": damping,
        "alpha": alpha,
        "beta": beta,
        "borne": pressed,
        "contact_time": contact_time * math.sqrt(bed.mass / bed.least_mass),
        "speed_cap": cap,
        "alert": ABOVE * made_for if follows_tolerance(solver) and made_for < BELOW * bed.limit else cap,
        "deep": max(YIELD * unit * math.sqrt(beta) * contact_time / math.pi, borne, meant),
        "growth": GROW * unit,
        "settling": SETTLE * unit / bed.depth,
        "spare": 0.0 if solver.stiffness else spare,
    }


def md_damping(scene: Any, numbers: dict[str, float], bed: Bed, restitution: np.ndarray) -> np.ndarray:
    """χ of `law_for`, for restitutions of any shape, with these numbers of the solver."""
    contact_time = numbers["contact_time"] / math.sqrt(bed.mass / bed.least_mass)
    given = scene.solver.step and scene.solver.step / contact_time
    known, place = np.unique(restitution, return_inverse=True)
    return np.array([law_for(float(one), numbers["beta"], given)[0] for one in known])[place].reshape(restitution.shape)


def _check_step(scene: Any, key: str, step: float, bed: Bed) -> None:
    if step > bed.longest_step * (1 + 1e-6):
        raise scene.error(
            f"solver.{key}",
            f"a step of {step:g} s is beyond what the effects of this scene allow, {bed.longest_step:.3g} s; leave it out, or take "
            "a smaller one",
        )


def rigid_numbers(scene: Any, bed: Bed) -> dict[str, float]:
    """Numbers of solvers.rigid.constants_type, the speed cap and the speed that they are made for [m/s], and how long it takes to solve a
    contact [s]. SandError if the scene asks for an unstable step.
    """
    solver = scene.solver
    weight = max(RIGID_LOAD * (bed.depth * bed.pressing + bed.squeeze) * bed.strain, 1e-12)
    flight = math.sqrt(solver.tolerance) * bed.diameter / max(bed.speed, 1e-12)
    falling = math.sqrt(bed.speed**2 + 2 * bed.gravity * bed.drop)
    followed = FALL * FASTEST * bed.diameter / max(falling, bed.fast, 1e-12)
    longest = min(LONGEST_STEP * bed.moment * (CLUMPS_SHORTER if bed.clumps else 1.0), bed.shaking / SHAKE_STEPS, bed.longest_step)
    step = min(SAG * math.sqrt(solver.tolerance * bed.diameter / weight), flight, followed, longest)
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
    deep = min(DEEP_DAMPING * bed.depth, MOST_DAMPED)
    a1 = 2 * (CLUMP_DAMPING if bed.clumps else max(SOFT_DAMPING, deep)) + step * omega
    a2 = step * omega * a1
    unit = math.sqrt(max(bed.gravity, 0.0) * bed.diameter)
    cap = FASTEST * bed.diameter / step
    reference_steps = max(REFERENCE_STEPS * bed.depth**2, LEAST_REFERENCE_STEPS) * (CLUMPS_SLOWER if bed.clumps else 1.0)
    return {
        "step": step,
        "rate": 1 / step,
        "mass_scale": a2 / (1 + a2),
        "impulse_scale": 1 / (1 + a2),
        "bias_rate": omega / a1,
        "push_cap": max(
            PUSH * math.sqrt(bed.pressing * bed.diameter),
            PRESS * omega / a1 * solver.tolerance * bed.diameter,
            0.0 if bed.gravity else bed.diameter,
        ),
        "restitution": solver.restitution,
        "threshold": max(IMPACT * unit, 4 * bed.gravity * step),
        "reference_rate": 1 / reference_steps,
        "reference_share": REFERENCE_SHARE if bed.rough else SLIPPERY_SHARE,
        "contact_time": step,
        "speed_cap": cap,
        "alert": FALL * cap if follows_tolerance(solver) and FALL * cap < BELOW * bed.limit else cap,
    }
