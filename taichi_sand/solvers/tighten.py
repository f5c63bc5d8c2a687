"""Md: contacts that are pressed together go on where the stiffness of all contacts changes, and no energy is made.

A stiffer contact of the same overlap would push harder, and hold more energy: a bed at rest would be thrown up. A softer one would give
way. So the distance at which the surfaces of a pair touch is changed too, and goes back to the sum of the radii slowly (world.memory).
A pair that hardly moves keeps its force: a bed stays in balance. One
that collides keeps its energy: it rebounds as it would have. (A slow collision at its deepest is taken for one that rests. It loses energy
where contacts become stiffer; where they become softer it would gain some, so there only beds at rest keep their forces.)
"""

import math
from typing import Any

import taichi as ti

from taichi_sand.solvers.bed import EARTH, REST
from taichi_sand.world.edit import strained
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.geometry import distance_to_second, motion_of
from taichi_sand.world.sweep import every_pair

QUIET = 0.1
"""A pair collides if it moves faster than this share of the speed that its contact could give it."""
MORE = 3.0
"""A pair collides, too, if it presses with so many times the force that the bed asks for: a collision at its deepest hardly moves."""


@ti.func
def retighten(w: ti.template(), s: ti.template(), change: ti.template(), p, wall: ti.template()):
    """Pair p: `change` says how many times its coefficient of stiffness was what it is now, and how much of a collision's speed, and what
    force [N], a pair may have at most that keeps its force.
    """
    pairs = ti.static(w.pairs)
    share = change.x
    c = s.constants[None]
    i = pairs.first[p]
    j = i if ti.static(wall) else pairs.second[p]
    distance, normal = distance_to_second(w, p, i, wall)
    overlap = pairs.contact_distance[p] - distance
    if overlap > 0.0 and share != 1.0:
        speed = motion_of(w, p, i, j, distance, normal, wall).dot(normal)
        before = share * c.stiffness * overlap ** (c.beta - 1.0)  # force over overlap [N/m]
        quiet = speed * speed * pairs.mass[p] < change.y * change.y * c.beta * before * overlap * overlap
        quiet = quiet and before * overlap < change.z
        pressed = overlap * share ** (1.0 / (c.beta + ti.select(quiet, 0.0, 1.0)))
        pairs.contact_distance[p] += pressed - overlap
        ti.atomic_max(w.pace[None].short, 1)
        stiffness = c.stiffness * pressed ** (c.beta - 1.0)
        force = ti.select(quiet, 1.0, ti.sqrt(stiffness / before))
        energy = stiffness * pressed * pressed / (c.beta + 1.0)
        for effect in ti.static(s.effects):
            if ti.static(offers(effect, "tighten")):
                effect.tighten(w, p, force * before / stiffness, force)
            if ti.static(s.books and offers(effect, "stored")):
                energy += effect.stored(w, c, p, pressed, stiffness)
        for effect in ti.static(s.effects):
            if ti.static(s.books and offers(effect, "store")):
                effect.store(w, p, energy)


@ti.kernel
def tighten(w: ti.template(), s: ti.template(), share: ti.f32, quiet: ti.f32, most: ti.f32):
    """After the stiffness has changed, to 1 / `share` times what it was, and a list build."""
    change = ti.Vector([share, quiet, most])
    every_pair(w, retighten, s, change)


def follow(world: Any, solver: Any, before: dict[str, float], after: dict[str, float]) -> None:
    """Has the contacts of `world` go on from the numbers `before` with those `after`."""
    if "stiffness" not in before:
        return  # those of the other solver, whose contacts are hard
    share = before["stiffness"] / after["stiffness"]
    quiet = QUIET
    if share > 1.0:
        box = world.box[None]
        strength = math.hypot(*box.gravity) or EARTH
        moving, *_ = strained(world, 0.0, REST * math.sqrt(strength * box.diameter))
        quiet = QUIET if moving <= 0.01 else 0.0
    tighten(world, solver, share, quiet, MORE * before["borne"])
