"""The bed that grains will form, or form: what the tolerance has to do with."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taichi_sand.scene.grains import Pack

PULLED = 0.8
"""Bridges that pull with the weight of n grains add to the overlaps so many times what n grains on top do (md, damp walls: 0.76)."""
REST, LOOKS, STIFFER, MOST_STRAIN = 0.01, 3, 1.5, 16.0
"""A bed is at rest where 99 % of its grains are slower than REST sqrt(g d). Where at LOOKS looks in turn one is found that more than 1 %
of the contacts overlap by more than the tolerance, they bear more than its depth explains, such as rows that an impact has wedged
between walls: contacts are then made STIFFER times as stiff, or twice, four or eight times that where overlaps are so many tolerances;
and again, up to MOST_STRAIN times what depth asks for."""
EARTH = 9.81  # m/s2, where a scene has no gravity to measure speeds by
MARGIN, SLOWER, CALM = 1.5, 0.6, 3
"""Where a grain gets faster than contacts (md) or steps (rigid) are made for, they are made for MARGIN times its speed. Where at CALM looks
in turn SLOWER times what they are made for was enough, they are made for that: a fall that is over costs no more."""
MOST_SPEED = 2.0
"""They follow speeds up to so many times what walls, sources, the wind, the start and a fall through the whole box can give a grain
(a heavy one that hits a light one doubles its speed); faster ones are slowed down, so that what is not physical stays bounded."""
LASTING, PAUSE, SWIFTER = 3, 12, 1.1
"""The speed of a flow is the middle one of those found at LASTING looks in turn: an impact, or a bed that settles, is no flow. Contacts of
md are made for one SWIFTER than it, and for a slower one once there was none swifter at PAUSE looks: a flow that only pauses finds them
stiff."""
DENSE = 0.3
"""Less than so many contacts a grain are no dense flow: collisions of a gas are short against the time between them. (Stiff discs on a
slope of 23 degrees have 0.6.)"""
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
    speed: float  # fastest grain at the start, source or wall [m/s]
    longest_step: float = math.inf  # that the effects allow [s]
    drop: float = 0.0  # that a grain can fall at most [m]
    clumps: bool = False  # whether there are grains of several discs
    pull: float = 0.0  # of effects that hold grains together, in weights of a mean grain
    push: float = 0.0  # of effects that press grains against others, as weight does [N]
    rough: bool = False  # whether contacts resist sliding
    thrust: float = 0.0  # of walls with force on a column of grains [N]
    steady: float = 0.0  # largest force of an effect on a single grain [N]
    ram: float = 0.0  # energy of walls with force and mass for each grain that they may run into [J]
    lift: float = 0.0  # by how much of their weight effects make all grains lighter
    strain: float = 1.0  # by how much more contacts have been found to bear than all that explains
    late: int = 0  # looks in turn that have found so
    height: float = 0.0  # of the box, along gravity; its longer side without any [m]
    wind: float = 0.0  # fastest that effects blow a grain [m/s]
    drive: float = 0.0  # fastest wall or source [m/s]
    shaking: float = math.inf  # shortest period of a wall that is shaken [s]
    solid: float = 0.0  # of all grains the largest mass over its diameter squared [kg/m2]
    fast: float = 0.0  # fastest grain that contacts and steps are made for [m/s]
    flow: float = 0.0  # 99 % of the contacts of a flow that they are made for move more slowly than this [m/s]
    fasts: tuple[float, ...] = ()  # fastest grain at the last looks, since they last followed one [m/s]
    flows: tuple[float, ...] = ()  # speed of a dense flow at the last looks, as `flow` [m/s]

    def __post_init__(self) -> None:
        for name in ("fasts", "flows"):  # JSON knows no tuples
            object.__setattr__(self, name, tuple(getattr(self, name)))

    def seen(self, moving: float, deep: np.ndarray) -> "Bed":
        """After a look that found this share of the grains in motion, and these of the contacts deeper than 1, 2, 4 … tolerances."""
        level = int((deep > 0.01).sum())
        if moving > 0.01 or not level:
            return replace(self, late=0)
        if self.late + 1 < LOOKS:
            return replace(self, late=self.late + 1)
        return replace(self, late=0, strain=min(MOST_STRAIN, STIFFER * 2 ** (level - 1) * self.strain))

    def outrun(self, fastest: float) -> "Bed":
        """After a grain was found to be as fast as this [m/s]."""
        return replace(self, fast=min(MARGIN * fastest, self.limit), fasts=())

    def moving(self, fastest: float, flow: float) -> "Bed":
        """After a look that found the fastest grain this fast, and a dense flow of this speed, 0 if none [m/s]."""
        fasts, flows = (*self.fasts, fastest)[-CALM:], (*self.flows, flow)[-PAUSE:]
        fast, made_for = self.fast, self.flow
        if len(fasts) == CALM and MARGIN * max(fasts) < SLOWER * fast:
            fast = MARGIN * max(fasts)
        if lasting(flows) > made_for:
            made_for = SWIFTER * lasting(flows)
        elif len(flows) == PAUSE and max(flows) < SLOWER * made_for:
            made_for = max(flows)
        return replace(self, fasts=fasts, flows=flows, fast=fast, flow=made_for)

    @property
    def limit(self) -> float:
        """Contacts and steps follow grains up to this speed [m/s]."""
        pull = max(self.pressing, EARTH) + self.steady / self.least_mass
        given = max(self.speed, self.wind) ** 2 + 2 * pull * self.height
        return MOST_SPEED * math.sqrt(given)

    @property
    def moment(self) -> float:
        """Time in which a grain falls by half its diameter [s]: what goes on among grains takes as long, whatever their size."""
        return math.sqrt(self.diameter / (self.gravity or EARTH))

    @property
    def pressing(self) -> float:
        """What a grain presses with on those below or behind it, over its mass [m/s2]."""
        return self.gravity * (1.0 - self.lift) + self.push / self.mass

    @property
    def squeeze(self) -> float:
        """Force that presses grains together besides the load, over the mass of a mean grain [m/s2]."""
        return PULLED * self.pull * (self.gravity or EARTH) + (self.thrust + self.steady) / self.mass


def lasting(flows: tuple[float, ...]) -> float:
    """Speed of a flow by those found at the last looks [m/s]; 0 if there were not enough."""
    return sorted(flows[-LASTING:])[LASTING // 2] if len(flows) >= LASTING else 0.0


def height_of(gravity: tuple[float, float], size: tuple[float, float]) -> float:
    """How far a grain can fall in a box of this size [m]; its longer side where nothing falls."""
    strength = float(np.hypot(*gravity))
    return float(np.abs(gravity) @ np.array(size)) / strength if strength else max(size)


def bed_of(pack: Pack, gravity: tuple[float, float], size: tuple[float, float], drive: float = 0.0, shaking: float = math.inf) -> Bed:
    """Bed that the grains of `pack` will form where they fall straight down.

    `size` [m] is that of the box, `drive` [m/s] the speed of the fastest wall or source, `shaking` [s] the shortest period of a wall.
    """
    walls: dict[str, Any] = {"height": height_of(gravity, size), "drive": drive, "shaking": shaking}
    if not len(pack.radius):
        return Bed(1.0, 1.0, 1.0, 1.0, 1.0, float(np.hypot(*gravity)), drive, fast=drive, **walls)
    free = ~pack.fixed if (~pack.fixed).any() else np.ones_like(pack.fixed)
    radius, mass = pack.size[free], pack.mass[free]
    diameter = 2 * float(radius.mean())
    speed = max(drive, float(np.hypot(*pack.velocity.T).max()))
    least = float((mass / pack.lightness[free]).min())
    depth, load = depth_of(pack.position[free], radius, mass, gravity)
    down = np.array(gravity) / max(float(np.hypot(*gravity)), 1e-12)
    drop = float(np.maximum(down * np.array(size), 0.0).sum() - (pack.position[free] @ down).min())
    strength, clumps = float(np.hypot(*gravity)), bool(pack.lightness.max() > 1.0)
    walls |= {"solid": float((mass / (2 * radius) ** 2).max()), "drop": max(drop, 0.0), "fast": speed}
    return Bed(diameter, float(mass.mean()), least, depth, load, strength, speed, clumps=clumps, **walls)


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
    kinds = np.unique(octave)
    for kind in kinds:
        counted = mass
        if len(kinds) > 1:
            floor = np.full(columns, np.inf)
            np.minimum.at(floor, column[octave == kind], height[octave == kind])
            reach = np.pad(floor, WINDOW, constant_values=np.inf)
            floor = np.lib.stride_tricks.sliding_window_view(reach, 2 * WINDOW + 1).min(axis=1)
            counted = mass * (height >= floor[column])
        above = np.bincount(column, counted, columns)
        load = float((np.convolve(above, ones, "valid") / held).max())
        depth = max(depth, load / (PACKING * diameter**2 * float(density[octave == kind].min())))
        heaviest = max(heaviest, load)
    whole = heaviest / (PACKING * diameter**2) * float(area.sum() / mass.sum()) * float(mass.mean())
    return depth, max(whole, float(mass.mean()))
