"""What holds up walls that move without a `force`: grains wedged between them and what they close on.

How deep grains are pressed does not tell: a box that is shaken carries its grains, and throws and catches them, which presses them as
deep as a jam does. But nothing else bears against it. So a wall is held up by the lesser of two overlaps: the deepest at which it drives
against grains, and the deepest at which another wall, an edge or a fixed grain that it closes on bears against them.
"""

import taichi as ti

from taichi_sand.world.extras.energy_ledger import drive
from taichi_sand.world.geometry import at_least, carried_along, movable, perp, point_velocity, position, wall_velocity

SPREAD, RUB = 3.0, 0.75
"""What bears against a wall is pressed a third as deep, or more, as grains spread forces. Friction counts for less. (A floor shaken with
4.6 g between still sides, mu 0.8, md: held up with 3, at 0.9 of what holds it up with 1. Yet a long channel jams by friction alone, and
pressure in it has no bound: 48 diameters of grains, 4 wide, mu 0.8, at 0.3 m/s, overlap by 0.5 d with 0.5, by 0.26 with 1.)"""


@ti.func
def holds(w: ti.template(), p, wall: ti.template()):
    """Whether pair p is with a wall, or with a fixed grain."""
    return True if ti.static(wall) else movable(w, w.pairs.first[p]) * movable(w, w.pairs.second[p]) == 0.0


@ti.func
def feel(w: ti.template(), s: ti.template(), c: ti.template(), p, distance, normal, force, press, wall: ti.template()):
    """Notes how deep, `press` [m], contact p is pressed by walls that move without a force, and what a wall does with `force` [N]
    (normal, tangential) on it.

    That counts as far as the wall drives against the grain: one that slides along below a heavy bed is not held up by it.
    """
    drive(w, s, p, distance, normal, force * c.step, wall)
    if ti.static(w.moves):
        movers = ti.static(w.movers)
        if force.x > 0.0 and 2.0 * SPREAD * press > movers.jam[None]:
            if holds(w, p, wall):
                i = w.pairs.first[p]
                m, own, back = -1, ti.Vector([0.0, 0.0]), 1.0
                if ti.static(not wall):
                    back = 2.0 * movable(w, i) - 1.0
                else:
                    m = movers.wall[w.pairs.second[p]]
                    own = wall_velocity(w, p, i, distance, normal)
                    if m >= 0:
                        to = carried_along(w, p, i, m, distance, normal, movers.course[m])
                        ti.atomic_max(movers.press[m], press * at_least(0.0, -to.dot(normal)) / at_least(1e-9, to.norm()))
                push = force.x * normal + force.y * perp(normal)
                bear_against(w, m, position(w, i) + distance * normal, SPREAD * back * normal, RUB * back * push.normalized(), own, press)


@ti.func
def bear_against(w: ti.template(), m, point, way, rub, own, press):
    """Notes for all walls but m that something which moves with `own` [m/s] is pressed at `point`, `press` [m] deep, that way, and
    rubbed that way. It counts as far as a wall moves that way as seen from it, and closes on it.
    """
    movers = ti.static(w.movers)
    for k in range(movers.walls[None]):
        if k != m:
            to = point_velocity(movers.course[k].xy, movers.course[k].z, point - movers.hinge[k] - movers.pose[k].zw) - own
            closing = ti.max(way.dot(to), rub.dot(to)) / at_least(1e-9, (to + own).norm() + own.norm())
            ti.atomic_max(movers.brace[k], press * closing)
