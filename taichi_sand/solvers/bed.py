"""The bed that grains will form, or form: what the tolerance has to do with."""

import math
from dataclasses import dataclass, replace

import numpy as np

from taichi_sand.scene.packing import Pack

PULLED = 0.8
"""Bridges that pull with the weight of n grains add to the overlaps so many times what n grains on top do (md, damp walls: 0.76)."""
REST, LOOKS, STIFFER, MOST_STRAIN = 0.01, 3, 1.5, 16.0
"""A bed is at rest where 99 % of its grains are slower than REST sqrt(g d). Where at LOOKS looks in turn one is found that more than 1 %
of the contacts overlap by more than the tolerance, they bear more than its depth explains, such as rows that an impact has wedged
between walls: contacts are then made STIFFER times as stiff, or twice, four or eight times that where overlaps are so many tolerances;
and again, up to MOST_STRAIN times what depth asks for."""
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
