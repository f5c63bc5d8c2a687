"""The brush: what the tools of the mouse work with."""

from dataclasses import dataclass, field, replace

import numpy as np

from taichi_sand.play.knobs import Knob
from taichi_sand.run.simulation import Simulation
from taichi_sand.scene.shapes import BUILT_IN, form
from taichi_sand.scene.sizes import limits
from taichi_sand.world import edit

DENSITY = 2650.0


@dataclass
class Brush:
    """What the tools work with; the numbers have sliders."""

    size: float  # radius of the brush [m]
    low: float  # smallest and largest radius of a grain made [d / 2]
    high: float
    spin: float  # largest spin of a grain made, either way [rad/s]
    strength: float  # of stir, attract, repel, wet and dry
    grip: float  # largest force of grab, in weights of the grain
    kind: int = 0  # which [[grains]] table the grains made belong to
    first: dict[str, float] = field(default_factory=dict)  # what the sliders go back to

    @classmethod
    def of(cls, sim: Simulation) -> "Brush":
        """What suits a simulation."""
        brush = cls(max(2.5 * sim.bed.diameter, 0.03 * min(sim.scene.size)), 1.0, 1.0, 0.0, 1.0, 100.0)
        free = [number for number, table in enumerate(sim.scene.grains) if not table.fixed]
        brush.first = {name: getattr(brush, name) for name in ("size", "spin", "strength", "grip")}
        brush.next_kind(sim, free[0] if free else 0)
        return brush

    def next_kind(self, sim: Simulation, step: int) -> None:
        """Makes grains as those of the next table, in its sizes."""
        tables = sim.scene.grains
        self.kind = (self.kind + step) % max(1, len(tables))
        radii = _radii(sim)
        reach = sim.scene.form_of(tables[self.kind]).reach if tables else 1.0
        if tables and (asked := tables[self.kind].radius):
            low, high = limits(asked)
            radii = (reach * low, reach * high)
        elif tables and (rows := tables[self.kind].positions):
            own = [reach * row[2] for row in rows if len(row) > 2]
            radii = (min(own), max(own)) if own else radii
        unit, (_, most) = 0.5 * sim.bed.diameter, _limits(sim)
        self.low, self.high = (min(most, radius / unit) for radius in radii)
        self.first |= {"low": self.low, "high": self.high}

    def knobs(self, sim: Simulation) -> list[Knob]:
        """Their sliders."""
        side = min(sim.scene.size)
        least, most = _limits(sim)
        small = 0.5 * sim.bed.diameter
        found = [
            Knob("tool.size", "brush", "tools", "m", "radius of the brush; the wheel changes it", 0.5 * small, 0.5 * side, log=True),
            Knob("tool.low", "smallest", "tools", "d", "smallest grain that create and pour make, over the mean diameter", least, most),
            Knob("tool.high", "largest", "tools", "d", "largest grain that they make", least, most),
            Knob("tool.spin", "spin", "tools", "rad/s", "grains are made with a random spin up to this, either way", 0.0, 100.0),
            Knob("tool.strength", "strength", "tools", "x", "of stir, attract, repel, wet and dry", 0.1, 10.0, log=True),
            Knob("tool.grip", "grip", "tools", "weights", "largest force of grab, in weights of the grain", 1.0, 1000.0, log=True),
        ]
        return [replace(knob, home=self.first[knob.key[5:]]) for knob in found]

    def masses(self, sim: Simulation, radius: np.ndarray, kind: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass [kg] and inertia [kg m2] of grains with these radii [m], of these kinds."""
        tables = (*sim.scene.grains, *sim.scene.sources)
        densities = np.array([table.density for table in tables] or [DENSITY])[kind]
        forms = [sim.scene.form_of(table) for table in tables] or [form("disc", BUILT_IN["disc"])]
        mass = densities * np.array([one.area for one in forms])[kind] * radius**2
        return mass, mass * radius**2 * np.array([one.inertia for one in forms])[kind]


def _radii(sim: Simulation) -> tuple[float, float]:
    """Smallest and largest radius there is [m]."""
    places, _ = edit.places(sim.world)
    radius = places[:, 2]
    return (float(radius.min()), float(radius.max())) if len(radius) else (0.5 * sim.bed.diameter, 0.5 * sim.bed.diameter)


def _limits(sim: Simulation) -> tuple[float, float]:
    """Diameters of the smallest and largest grain that the world has tables for, over the mean one."""
    largest = float(sim.world.box[None].largest)
    return 0.3 * min(1.0, largest / sim.bed.diameter), largest / sim.bed.diameter
