"""The hand: what a user in front of the window does to the grains, as a body force of every step.

It looks to the solver like an effect with the hook `body`; a simulation that nobody plays with does not have it.
"""

from dataclasses import dataclass
from typing import Any

import taichi as ti

from taichi_sand.world.geometry import position, velocity
from taichi_sand.world.tables import fill_struct

IDLE, GRAB, STIR, ATTRACT = range(4)
"""What the hand does: nothing; pull one grain by a spring; drag those in reach along with it; pull them towards it, or push them off."""

REST = dict.fromkeys(("reach", "rate", "drag", "limit"), 0.0) | {"work": IDLE, "grain": -1}
REST |= dict.fromkeys(("place", "velocity", "given"), (0.0, 0.0))
"""A hand that does nothing."""


@dataclass(frozen=True, eq=False)
class Hand:
    """The hand as kernels see it."""

    now: Any  # 0-D struct of hand_type

    @ti.func
    def body(self, w: ti.template(), c: ti.template(), i):
        """Force on grain i [N, N, N m, 0]."""
        force = ti.Vector([0.0, 0.0])
        if self.now[None].work == GRAB:
            if w.grains.id[i] == self.now[None].grain:
                force = self.spring(w, i)
                self.now[None].given += force * c.step  # of one grain only, so no two threads write it
        elif self.now[None].work != IDLE:
            force = self.field(w, c, i)
        return ti.Vector([force.x, force.y, 0.0, 0.0])

    @ti.func
    def spring(self, w: ti.template(), i):
        """A damped spring from the grain to the hand, no stronger than `limit` [N]."""
        n = self.now[None]
        pull = n.rate * (self.away(w, i)) + n.drag * (n.velocity - velocity(w, i))
        if w.grains.mobility[i].x > 0.0:
            pull /= w.grains.mobility[i].x
        size = pull.norm()
        if size > n.limit:
            pull *= n.limit / size
        return pull

    @ti.func
    def field(self, w: ti.template(), c: ti.template(), i):
        """STIR and ATTRACT: full at the hand, fading out to nothing at `reach`."""
        n = self.now[None]
        way = self.away(w, i)
        distance = way.norm()
        force = ti.Vector([0.0, 0.0])
        if distance < n.reach and w.grains.mobility[i].x > 0.0:
            share = 1.0 - (distance / n.reach) ** 2
            if n.work == STIR:
                force = n.drag / (1.0 + n.drag * c.step) * share * (n.velocity - velocity(w, i))  # stable at any step
            else:
                force = n.rate * share * way / (distance + 0.05 * n.reach) - n.drag * share * velocity(w, i)
            force /= w.grains.mobility[i].x
        return force

    @ti.func
    def away(self, w: ti.template(), i):
        """From the grain to the hand, the short way where the box is periodic [m]."""
        way = self.now[None].place - position(w, i)
        for k in ti.static(range(2)):
            if ti.static(w.periodic[k]):
                size = w.box[None].size[k]
                way[k] -= size * ti.floor(way[k] / size + 0.5)
        return way


def hand_type(real: Any) -> Any:
    """Struct of what the hand does at the moment; all of it may change between launches."""
    pair = ti.types.vector(2, real)
    return ti.types.struct(
        work=ti.i32,  # IDLE, GRAB, STIR, ATTRACT
        grain=ti.i32,  # id of the grain that is held
        place=pair,  # of the hand [m]
        velocity=pair,  # of the hand [m/s]
        reach=real,  # [m]
        rate=real,  # GRAB: spring constant / mass [1/s2]; ATTRACT: acceleration [m/s2], < 0 pushes off
        drag=real,  # dashpot / mass [1/s]
        limit=real,  # GRAB: largest force [N]
        given=pair,  # GRAB: impulse given since the grain was taken [N s]
    )


def allocate(real: Any) -> Hand:
    """An idle hand."""
    return Hand(fill_struct(hand_type(real), dict(REST)))
