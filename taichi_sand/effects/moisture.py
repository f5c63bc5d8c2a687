"""Moisture: water that grains carry, that runs down, evens out and evaporates, and on which the pull of liquid bridges depends.

Every grain has a wetness, the share of the pores around it that is full of water. What exceeds 15 % runs down to the grains below until
these are full; the rest is held, and evens out where grains touch. It evaporates where there is air: a grain without contacts loses
`evaporation` of its water a second, one with six contacts nothing. With `cohesion` on, bridges pull fully from 0.5 % to 15 % and lose
their pull up to 30 % (world.water), so that a castle stands damp, crumbles dry and slumps flooded. Water has no weight and is no liquid
here: this is a field on the grains, not a flow.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.extras.wetness import MOIST, bond_share, soaked
from taichi_sand.world.geometry import add, at_least, at_most, distance_to_second
from taichi_sand.world.sleep.state import call
from taichi_sand.world.sweep import every_pair

INTERVAL = 1 / 30
SHIELD = 6
"""Contacts around which no air is left."""
WAKING = 0.02
"""Sleepers are woken when the share of the pull that their bridges have has changed by so much."""


@dataclass(frozen=True)
class Moisture(Effect):
    """The effect: all it does lies between the launches, and in the pull of `cohesion`."""

    parameters = (
        Parameter("wetness", 0.1, "share of the pores that is full of water at the start", low=0.0, high=1.0, live=False),
        Parameter("drain", 2.0, "rate at which the water that grains do not hold runs down to the next", "1/s", low=0.0, high=1e3),
        Parameter("spread", 0.5, "rate at which the wetness of two grains that touch evens out", "1/s", low=0.0, high=1e3),
        Parameter("evaporation", 0.0, "share of its water that a free grain loses in a second", "1/s", low=0.0, high=1e3),
    )
    neutral: ClassVar = {"wetness": 0.1, "drain": 0.0, "spread": 0.0, "evaporation": 0.0}
    interval = INTERVAL

    @classmethod
    def carried(cls, values: dict[str, Any]) -> dict[str, float]:
        """Columns that follow a grain: its wetness, its contacts, and the share of the pull of its bridges when it was last awake."""
        return {"wetness": values["wetness"], "contacts": 0.0, "bonded": 1.0}

    def on_pause(self, world: Any, solver: Any) -> None:
        """Moves the water, and wakes sleepers whose bridges have changed."""
        flow(world, solver)


@ti.kernel
def flow(w: ti.template(), s: ti.template()):
    """One pause of INTERVAL. Pair by pair, so that it is stable at any rate and no water is lost."""
    c = s.constants[None]
    time = ti.max(1.0, ti.floor(INTERVAL / c.step)) * c.step
    water = ti.static(w.carried)
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        water.contacts[i] = 0.0
    every_pair(w, exchange, s, ti.Vector([1.0 - ti.exp(-c.moisture_drain * time), 1.0 - ti.exp(-c.moisture_spread * time)]))
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        air = at_least(0.0, 1.0 - water.contacts[i] / SHIELD)
        if ti.static(hasattr(w.carried, "water_wet")):
            air *= 1.0 - at_least(0.0, water.water_wet[i])
        water.wetness[i] = water.wetness[i] * ti.exp(-c.moisture_evaporation * air * time)
        share = bond_share(soaked(w, i))
        if ti.static(w.sleeps):
            if i >= w.sleep.state[None].awake and ti.abs(share - water.bonded[i]) > WAKING:
                call(w, i)
            elif i < w.sleep.state[None].awake:
                water.bonded[i] = share


@ti.func
def exchange(w: ti.template(), s: ti.template(), shares: ti.template(), p, wall: ti.template()):
    """Counts pair p as a contact of its grains, if they touch, and moves water between them: of what could run down, and of what would
    even them out, those shares.
    """
    i = w.pairs.first[p]
    water = ti.static(w.carried)
    distance, normal = distance_to_second(w, p, i, wall)
    if distance < w.pairs.contact_distance[p]:
        add(water.contacts, i, 1.0)
        if ti.static(not wall):
            j = w.pairs.second[p]
            add(water.contacts, j, 1.0)
            room_i, room_j = w.grains.radius[i] ** 2, w.grains.radius[j] ** 2
            moved = shares.y * (water.wetness[i] - water.wetness[j]) * room_i * room_j / (room_i + room_j)
            gravity = w.box[None].gravity
            slope = normal.dot(gravity) / (gravity.norm() + 1e-30)
            if slope > 0.0:
                moved += runoff(water.wetness[i], room_i, water.wetness[j], room_j, shares.x * slope)
            else:
                moved -= runoff(water.wetness[j], room_j, water.wetness[i], room_i, -shares.x * slope)
            add(water.wetness, i, -moved / room_i)
            add(water.wetness, j, moved / room_j)


@ti.func
def runoff(upper, room, lower, room_below, share):
    """Water that runs from a grain to the one below [m2]: the share of what the upper one does not hold, if there is room."""
    return at_most(at_least(0.0, upper - MOIST) * room * share, at_least(0.0, 1.0 - lower) * room_below)
