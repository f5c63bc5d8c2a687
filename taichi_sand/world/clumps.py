"""Grains of several discs: the shape of each kind of grain, and where the discs of a grain are.

A world of discs only has none of this: `w.clumps` is False, and what stands behind it is not compiled.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.scene.shapes import Form
from taichi_sand.taichi_support import field_pool
from taichi_sand.world.tables import round_up, write_rows

MOST = 64
"""More discs than this a grain cannot have: a pair keeps the numbers of both its discs in one whole number."""


class Shapes(NamedTuple):
    """Shape of the grains of each kind; lengths in units of a grain's radius, arms in the frame of the grain."""

    start: Any  # first disc of each kind, shape (more than kinds + 1,), i32
    disc: Any  # arm x, y and radius, 3-vector
    span: Any  # longest arm, shape (more than kinds,)


def build_shapes(forms: Sequence[Form], real: Any) -> Shapes:
    """The table of the shapes of all kinds."""
    discs = np.concatenate([form.discs for form in forms])
    rows = round_up(len(forms) + 1)
    table = Shapes(field_pool.scalars(ti.i32, rows), field_pool.vectors(3, real, round_up(len(discs))), field_pool.scalars(real, rows))
    write_rows(table.start, np.cumsum([0] + [len(form.discs) for form in forms]))
    write_rows(table.disc, discs)
    write_rows(table.span, np.array([form.span for form in forms]))
    return table


@ti.func
def disc_count(w: ti.template(), i):
    """Number of discs of grain i."""
    return w.shapes.start[w.grains.kind[i] + 1] - w.shapes.start[w.grains.kind[i]]


@ti.func
def disc_of(w: ti.template(), i, k):
    """Disc k of grain i: arm x, y in the frame of the grain, and radius [m]."""
    return w.shapes.disc[w.shapes.start[w.grains.kind[i]] + k] * w.grains.radius[i]


@ti.func
def discs_around(w: ti.template(), i):
    """Number of discs of grain i, in any world."""
    count = 1
    if ti.static(w.clumps):
        count = disc_count(w, i)
    return count


@ti.func
def disc_around(w: ti.template(), i, k):
    """Disc k of grain i, in any world: x, y from the centre of the grain as it stands now, and radius [m]."""
    disc = ti.Vector([0.0, 0.0, w.grains.radius[i]])
    if ti.static(w.clumps):
        own = disc_of(w, i, k)
        arm = turned(w, i, own.xy)
        disc = ti.Vector([arm.x, arm.y, own.z])
    return disc


@ti.func
def span(w: ti.template(), i):
    """Longest arm of grain i [m]."""
    return w.shapes.span[w.grains.kind[i]] * w.grains.radius[i]


@ti.func
def turned(w: ti.template(), i, arm):
    """An arm in the frame of grain i as it stands now [m]."""
    heading = w.grains.heading[i]
    return ti.Vector([heading.x * arm.x - heading.y * arm.y, heading.y * arm.x + heading.x * arm.y])


@ti.func
def head(w: ti.template(), i):
    """Brings the heading of grain i up to date with its angle."""
    angle = w.grains.angle[i] + w.grains.turn[i]
    w.grains.heading[i] = ti.Vector([ti.cos(angle), ti.sin(angle)])


@ti.func
def off_arc(w: ti.template(), i, time):
    """How far the discs of grain i are at most off the straight paths, `time` after the list build, on which it foresaw them to turn.

    A disc at the arm a was foreseen to fly with spin x a; |R(turn) a - a - spin t perp(a)| <= |a| (|turn - spin t| + (spin t)^2 / 2).
    """
    foreseen = w.grains.start_spin[i] * time
    return span(w, i) * (ti.abs(w.grains.turn[i] - foreseen) + 0.5 * foreseen * foreseen)


@ti.func
def rim(w: ti.template(), p, i):
    """Radius of the disc of grain i, first of pair p."""
    radius = w.grains.radius[i]
    if ti.static(w.clumps):
        radius = w.pairs.rims[p].x
    return radius


@ti.func
def levers(w: ti.template(), p, i, j, normal, rim_i, rim_j, wall: ti.template()):
    """Levers of both grains of pair p at the contact: of a tangential push on i and on j, of a normal one on i and on j [m].

    rim_i and rim_j: from the centres of the two discs to the contact point. With the slip as the solvers have it,
    slip = motion . t - x spin_i - y spin_j, and the speed of approach is -(motion . n + w spin_j - z spin_i).
    """
    arms = w.pairs.arms[p]
    arm_i = turned(w, i, arms.xy)
    lever = ti.Vector([rim_i + arm_i.dot(normal), 0.0, arm_i.cross(normal), 0.0])
    if ti.static(not wall):
        arm_j = turned(w, j, arms.zw)
        lever.y = rim_j - arm_j.dot(normal)
        lever.w = arm_j.cross(normal)
    return lever


@ti.func
def tilt(w: ti.template(), i, j, lever, wall: ti.template()):
    """What the spins add to the speed at which the discs of a pair part along the normal [m/s]."""
    speed = -lever.z * w.grains.twist[i].z
    if ti.static(not wall):
        speed += lever.w * w.grains.twist[j].z
    return speed


@ti.func
def torques(w: ti.template(), push, arm_i, arm_j, lever):
    """Torques of a push (normal, tangential) on the second grain: its own, and the one that is taken from the first."""
    taken, given = arm_i * push.y, -arm_j * push.y
    if ti.static(w.clumps):
        taken += lever.z * push.x
        given += lever.w * push.x
    return taken, given
