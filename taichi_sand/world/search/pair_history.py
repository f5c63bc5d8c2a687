"""Memory of pairs: what a pair carried before the list build, found again by its grains."""

import taichi as ti

from taichi_sand.world.clumps import MOST
from taichi_sand.world.geometry import add, at_least, at_most, distance_to_second, velocity, wall_row

STILL = 4.0
"""A pair settles if its grains move at, or from, one another less than so many times as fast as it does."""
WEAK = 0.1
"""Dashpot of a contact that has yet to grow into place, over that of another one."""
BEYOND, ALIKE = 1e29, 0.99
"""A part of a wall is farther away than this [m] when it does not face the disc; parts whose normals have at least this product, where a
disc slides from one to the other, are one surface to it."""


@ti.func
def discs_of(w: ti.template(), row):
    """Which discs of its grains a row is about."""
    discs = 0
    if ti.static(w.clumps):
        discs = w.pairs.discs[row]
    return discs


@ti.func
def remember(w: ti.template(), row, i, j):
    """Gives the pair of i and j the memory it had before the list build; none if it is new."""
    discs = discs_of(w, row)
    old = recall(w, w.pairs.row_start, w.pairs.row_count, w.grid.source[i], w.grid.source[j], discs, w.lanes)
    if old < 0:
        discs = discs % MOST * MOST + discs // MOST
        old = recall(w, w.pairs.row_start, w.pairs.row_count, w.grid.source[j], w.grid.source[i], discs, w.lanes)
    carry(w, row, old)
    yield_deep(w, row, old, w.pairs.gap[row])


@ti.func
def remember_wall(w: ti.template(), row, i, part, two_sided):
    """Gives a wall pair the memory it had before the list build; a grain also remembers on which side of a line it was. Returns the row
    it was in, or -1.
    """
    old = recall(w, w.pairs.wall_row_start, w.pairs.wall_row_count, w.grid.source[i], part, discs_of(w, row), 1)
    if old >= 0 and two_sided:
        w.pairs.side[wall_row(w, row)] = w.pairs.side[wall_row(w, old)]
    carry(w, row, old)
    return old


@ti.func
def recall(w: ti.template(), row_start: ti.template(), row_count: ti.template(), first, second, discs, apart: ti.template()):
    """Row of the list build before that held these discs of (first, second), slots of that list build; -1 if there is none."""
    found = -1
    slot = (1 - w.pace[None].half) * w.capacity + first
    step = apart
    if ti.static(w.sleeps):
        step = 1 if row_start[slot] >= 2 * w.half else apart  # frozen pairs follow one another
    if ti.static(w.boulders > 0):
        step = 1 if row_start[slot] % w.half >= w.wall_base - w.boulders else apart  # so do those of boulders
    for k in range(row_count[slot]):
        row = row_start[slot] + k * step
        if w.pairs.second[row] == second and discs_of(w, row) == discs:
            found = row
    return found


@ti.func
def carry(w: ti.template(), row, old):
    """Copies the memory of row `old` to `row`; zeros if old < 0."""
    for column in ti.static(w.pairs.memory):
        column[row] = column[ti.max(old, 0)] if old >= 0 else ti.zero(column[row])  # both sides are read


@ti.func
def hand_on(w: ti.template(), p, i, distance, normal, take: ti.template()):
    """A disc that slides over a joint, or around a corner, takes along what its contact carries: from wall pair p, whose part it has just
    left, to the one it has come to; or, to `take`, to p from the one it is about to leave.
    """
    pairs = ti.static(w.pairs)
    left = distance > BEYOND and pairs.force[p].x != 0.0
    come = ti.static(take) and distance < pairs.contact_distance[p] and pairs.force[p].x == 0.0
    if left or come:
        slot = w.pace[None].half * w.capacity + i
        for r in range(pairs.wall_row_start[slot], pairs.wall_row_start[slot] + pairs.wall_row_count[slot]):
            if (left or come) and r != p and discs_of(w, r) == discs_of(w, p):
                other, way = distance_to_second(w, r, i, True)
                carries = pairs.force[r].x != 0.0
                if way.dot(normal) > ALIKE:
                    if left and not carries and other < pairs.contact_distance[r]:
                        move_memory(w, p, r)
                        left = False
                    elif come and carries and other > BEYOND:
                        move_memory(w, r, p)
                        come = False


@ti.func
def move_memory(w: ti.template(), old, row):
    """Pair `row` carries what pair `old` did, and that nothing."""
    for column in ti.static(w.pairs.memory):
        column[row] = column[old]
        column[old] = ti.zero(column[old])


@ti.func
def yield_deep(w: ti.template(), row, old, gap):
    """Parts gently what did not come where it is by itself: pairs that are deep in one another when they are first listed.

    Every pair is listed before it touches, so these have been put there. A soft contact would throw them apart with all the energy of
    their overlap. They touch where they are instead, and that distance grows to the sum of the radii while they part (physics.md C6).
    A grain in a heap of these has many contacts at once: their dashpots are weak, as the step is made for those of six.
    Pairs whose stiffness has changed (solvers.tighten) touch elsewhere than at the sum of the radii, too. `gap` is that of the surfaces
    as they are.
    """
    if ti.static(w.yields):
        pairs, pace = ti.static(w.pairs, w.pace)
        short = -gap if -gap > pace[None].deep else 0.0
        weak = short > 0.0
        if old >= 0:
            before = pairs.contact_distance[row] - pairs.contact_distance[old]
            weak = pairs.root_mass[old] < 0.5 * pairs.root_mass[row]
            if weak:
                short = at_least(0.0, at_most(-gap, before - pace[None].grown))
            else:
                short = settle_in(w, row, gap, before)
        if weak and short > 0.0:
            pairs.root_mass[row] = pairs.root_mass[row] * WEAK
            ti.atomic_max(pace[None].short, 2)
        add(pairs.contact_distance, row, -short)


@ti.func
def settle_in(w: ti.template(), row, gap, before):
    """By how much the contact distance of a pair whose stiffness has changed is still less than the sum of the radii, or more (below 0),
    after it was by `before`; where it does not touch any more it is not more. It waits while the two move: work done on a collision
    would be energy from nowhere. Contacts that are stiffer than the bed needs, as something falls or flows, stay as deep as it needs.
    """
    pairs = ti.static(w.pairs)
    speed = -velocity(w, pairs.first[row]).dot(pairs.normal[row])
    if row % w.half < w.wall_base:
        speed += velocity(w, pairs.second[row]).dot(pairs.normal[row])
    settled = ti.select(ti.abs(speed) < STILL * w.pace[None].settling, w.pace[None].settled, 0.0)
    meant = at_most(at_least(0.0, before), w.pace[None].spare * at_least(0.0, -gap - before))
    short = at_least(meant, before - settled)
    if before < 0.0:
        short = at_most(0.0, before + settled) if gap < -before else 0.0
    if short != meant:
        ti.atomic_max(w.pace[None].short, 1)
    return at_most(short, at_least(0.0, -gap))
