"""Heat: the energy that contacts take out of the motion warms the grains, and flows from grain to grain where they touch.

Booked is all that the solver takes out at contacts, to rounding (world.extras.energy_ledger): restitution, friction, rolling
resistance, torn bridges; and what bonds take: their dashpots, and all that a broken one held. Of molecular dynamics what springs hold is
no heat (but for the spring of rolling resistance, until it gives it back).
Walls and fixed grains take none. Two grains that touch even out their temperatures at the rate `conduction`: equal discs in a row
at the distance d then conduct with the diffusivity conduction d²/2, in a hexagonal packing with 3/4 conduction d²,
as long as `conduction` is well below 60/s, the rate at which it is computed.
Temperatures are those above the one that all grains start with; nothing else in the simulation depends on them.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.geometry import add, distance_to_second, mobility
from taichi_sand.world.sweep import every_pair

INTERVAL = 1 / 60


@dataclass(frozen=True, eq=False)
class Heat(Effect):
    """The effect."""

    parameters = (
        Parameter("capacity", 800.0, "specific heat; that of quartz is 800", "J/(kg K)", low=1e-3, high=1e6, decades=True),
        Parameter("conduction", 1.0, "rate at which two grains that touch even out their temperatures", "1/s", low=0.0, high=1e4),
    )
    neutral: ClassVar = {}
    interval = INTERVAL

    held: Any  # md: column of the neighbour list, elastic energy that the pair holds [J]

    @classmethod
    def misfit(cls, scene: Any) -> str:
        """Why it does not fit `scene`, or ""."""
        fits = scene.solver.kind != "md" or scene.solver.integrator == "symplectic_euler"
        return "" if fits else f'does not fit the integrator {scene.solver.integrator}, only "symplectic_euler"'

    @classmethod
    def memory(cls, values: dict[str, Any], solver: str) -> int:
        """Columns of the neighbour list that the effect needs."""
        return 1 if solver == "md" else 0

    @classmethod
    def carried(cls, values: dict[str, Any]) -> dict[str, float]:
        """Columns that follow a grain: its temperature above the start [K], and the heat [J] since that was last brought up to date."""
        return {"temperature": 0.0, "warmth": 0.0}

    @classmethod
    def build(cls, values: dict[str, Any], columns: tuple, solver: str) -> "Heat":
        """The effect for a world; `columns` are those that `memory` asked for."""
        return cls(columns[0] if columns else None)

    @ti.func
    def heat(self, w: ti.template(), i, energy):
        """Grain i is warmed by `energy` [J]."""
        add(w.carried.warmth, i, energy)

    @ti.func
    def store(self, w: ti.template(), p, energy):
        """Pair p now holds `energy` [J]; returns what it held before."""
        before = self.held[p]
        self.held[p] = energy
        return before

    def on_pause(self, world: Any, solver: Any) -> None:
        """Turns the energy booked since the last call into temperatures, and lets heat flow."""
        warm(world, solver)


@ti.kernel
def warm(w: ti.template(), s: ti.template()):
    """One pause of INTERVAL: see `Heat.on_pause`. Pair by pair, so that it is stable at any rate and nothing is lost."""
    c = s.constants[None]
    time = ti.max(1.0, ti.floor(INTERVAL / c.step)) * c.step
    share = 1.0 - ti.exp(-c.heat_conduction * time)
    temperature = ti.static(w.carried.temperature)
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        add(temperature, i, w.carried.warmth[i] * mobility(w, i).x / c.heat_capacity)
        w.carried.warmth[i] = 0.0
    every_pair(w, conduct, s, share)


@ti.func
def conduct(w: ti.template(), s: ti.template(), share: ti.template(), p, wall: ti.template()):
    """Evens out the temperatures of the two grains of pair p by `share`, if they touch."""
    if ti.static(not wall):
        temperature = ti.static(w.carried.temperature)
        i, j = w.pairs.first[p], w.pairs.second[p]
        one, two = mobility(w, i).x, mobility(w, j).x
        if one > 0.0 and two > 0.0:
            distance, _ = distance_to_second(w, p, i, False)
            if distance < w.pairs.contact_distance[p]:
                flow = share * (temperature[j] - temperature[i]) / (one + two)  # over the specific heat [kg K]
                add(temperature, i, flow * one)
                add(temperature, j, -flow * two)
