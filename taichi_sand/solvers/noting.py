"""All that a rigid contact passes on in a step: what it carries at the end of it, along its normal there, is not the whole.

In a step a contact passes on the impulse P1 along the normal n0 before the grains move, P2 - P1 along n1 after that, and what impacts
there were. What it is said to carry is P2 along n1. The rest is noted, in the last step of a march only: a step with notes takes half as
long again, and nobody can look between the others.
"""

import taichi as ti

from taichi_sand.world.blocks import Sometimes
from taichi_sand.world.geometry import add, perp


@ti.func
def noting(w: ti.template()):
    """Whether this step is noted."""
    return w.pace[None].noted == 1


@ti.func
def noting_anew(w: ti.template()):
    """Whether it is, and has had no impacts."""
    return noting(w) and w.pace[None].warm_start == 0


@ti.func
def note(w: ti.template(), s: ti.template(), p, push):
    """Adds what pair p has passed on to its second grain, x and y [N]."""
    add(s.passed[0], p, push.x)
    add(s.passed[1], p, push.y)


@ti.func
def carried(w: ti.template(), p):
    """Force of pair p along its present normal, on the second grain, x and y [N]."""
    force, normal = w.pairs.force[p], w.pairs.normal[p]
    return force.x * normal + force.y * perp(normal)


@ti.func
def wipe(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Nothing is noted of pair p yet."""
    s.passed[0][p] = s.passed[1][p] = 0.0


@ti.func
def note_before(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Notes what pair p has passed on before the grains moved."""
    note(w, s, p, carried(w, p))


@ti.func
def note_after(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Takes out of the notes what pair p carries on along its new normal. From now on they are along and across that, as its force is: so
    they stay true when a list build lists the pair the other way round.
    """
    more, normal = ti.Vector([s.passed[0][p], s.passed[1][p]]) - carried(w, p), w.pairs.normal[p]
    s.passed[0][p], s.passed[1][p] = more.dot(normal), more.dot(perp(normal))


WIPE, BEFORE, AFTER = (Sometimes(pair, noting) for pair in (wipe, note_before, note_after))
WIPE_UNLESS_HIT = Sometimes(wipe, noting_anew)
"""As pair functions of a sweep."""
