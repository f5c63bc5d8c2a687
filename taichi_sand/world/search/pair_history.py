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


ROWS_AT_ONCE = 8
"""Rows of a grain that are looked through together: few have more, and a loop that always ends at once costs a processor no guess."""


@ti.func
def discs_of(w: ti.template(), row):
    """Which discs of its grains a row is about."""
    discs = 0
    if ti.static(w.clumps):
        discs = w.pairs.discs[row]
    return discs


@ti.func
def other_way(discs):
    """Which discs a row is about if it lists the grains the other way round."""
    return discs % MOST * MOST + discs // MOST


@ti.func
def remember(w: ti.template(), row, i, j, stray: ti.template()):
    """Gives the pair of i and j the memory it had before the list build; none if it is new, as it is where a `stray` is listed later on.

    It was listed with the grain of the lower slot first, as cells are looked at in the order of the slots; but for those across a periodic
    edge, of boulders and of sleepers.
    """
    old = -1
    if not later(w, stray):
        old = row_of(w, 1 - w.pace[None].half, w.grid.source[i], w.grid.source[j], discs_of(w, row))
    carry(w, row, old)
    yield_deep(w, row, old, w.pairs.gap[row])


@ti.func
def later(w: ti.template(), stray: ti.template()):
    """Whether there has been a step since the list build: what is listed now, of a `stray`, has not been listed before."""
    after = False
    if ti.static(stray):
        after = w.pace[None].since > 0
    return after


@ti.func
def row_of(w: ti.template(), half, i, j, discs):
    """Row of the pair of slots i and j in this half of the neighbour list; -1 if there is none."""
    one, two, these = i, j, discs
    if one > two:
        one, two, these = j, i, other_way(discs)
    row = recall(w, half, w.pairs.row_start, w.pairs.row_count, one, two, these, w.lanes)
    if ti.static(w.periodic[0] or w.periodic[1] or (w.boulders > 0 and not w.relists) or w.sleeps):
        if row < 0:
            row = recall(w, half, w.pairs.row_start, w.pairs.row_count, two, one, other_way(these), w.lanes)
    if ti.static(w.relists):
        if row < 0:
            row = row_of_stray(w, half, i, j, False)
        if row < 0:
            row = row_of_stray(w, half, j, i, False)
    return row


@ti.func
def is_listed(w: ti.template(), i, j):
    """Whether grains i and j are listed already."""
    return row_of(w, w.pace[None].half, i, j, 0) >= 0


@ti.func
def first_row(w: ti.template(), half, wall: ti.template()):
    """First of the rows of strays in a half of the neighbour list."""
    return (half + 1) * w.half - w.boulder_walls if ti.static(wall) else half * w.half + w.wall_base - w.boulders


@ti.func
def is_listed_with(w: ti.template(), i, part, stray: ti.template()):
    """Whether grain i, a `stray`, is listed with this part of a wall already."""
    listed = False
    if ti.static(stray):
        listed = wall_row_of(w, w.pace[None].half, i, part, 0) >= 0
    return listed


@ti.func
def horizon_of(w: ti.template(), i, stray: ti.template()):
    """For how long from now on grain i is foreseen, which may be a `stray` [s]."""
    horizon = w.pace[None].horizon
    if ti.static(stray):
        horizon = w.strays.until[w.strays.number[i] - 1] - w.pace[None].since * w.pace[None].step
    return horizon


@ti.func
def clear_links(w: ti.template(), slot):
    """No row is listed for the grain in a slot, counted through both halves, as a stray."""
    w.strays.first[slot], w.strays.partner[slot], w.strays.wall_first[slot] = 0, 0, 0


@ti.func
def link_row(w: ti.template(), row, i, wall: ti.template()):
    """This row is the last one that has been listed for stray i."""
    strays = ti.static(w.strays)
    half = w.pace[None].half
    k, slot = row - first_row(w, half, wall), half * w.capacity + i
    if ti.static(wall):
        strays.wall_next[half * w.boulder_walls + k], strays.wall_first[slot] = strays.wall_first[slot], k + 1
    else:
        partner = half * w.capacity + w.pairs.second[row]
        strays.next_partner[half * w.boulders + k], strays.partner[partner] = strays.partner[partner], k + 1
        strays.next[half * w.boulders + k], strays.first[slot] = strays.first[slot], k + 1


@ti.func
def next_row(w: ti.template(), half, link, wall: ti.template()):
    """Row that a link of a stray leads to, and the link that it has to the next."""
    row = first_row(w, half, wall) + link - 1
    following = 0
    if ti.static(wall):
        following = w.strays.wall_next[half * w.boulder_walls + link - 1]
    else:
        following = w.strays.next[half * w.boulders + link - 1]
    return row, following


@ti.func
def row_of_stray(w: ti.template(), half, i, second, wall: ti.template()):
    """Row that was listed for stray i with a second grain, or a part of a wall, in this half; -1 if there is none."""
    found, slot = -1, half * w.capacity + i
    link = w.strays.wall_first[slot] if ti.static(wall) else w.strays.first[slot]
    while link > 0:
        row, following = next_row(w, half, link, wall)
        if w.pairs.second[row] == second:
            found = row
        link = following
    return found


@ti.func
def remember_wall(w: ti.template(), row, i, part, two_sided, stray: ti.template()):
    """Gives a wall pair the memory it had before the list build, see `remember`; a grain also remembers on which side of a line it was.
    Returns the row it was in, or -1.
    """
    old = -1
    if not later(w, stray):
        old = wall_row_of(w, 1 - w.pace[None].half, w.grid.source[i], part, discs_of(w, row))
    if old >= 0 and two_sided:
        w.pairs.side[wall_row(w, row)] = w.pairs.side[wall_row(w, old)]
    carry(w, row, old)
    return old


@ti.func
def wall_row_of(w: ti.template(), half, i, part, discs):
    """Row of slot i and a part of a wall in this half of the neighbour list; -1 if there is none."""
    row = recall(w, half, w.pairs.wall_row_start, w.pairs.wall_row_count, i, part, discs, 1)
    if ti.static(w.relists):
        if row < 0:
            row = row_of_stray(w, half, i, part, True)
    return row


@ti.func
def recall(w: ti.template(), half, row_start: ti.template(), row_count: ti.template(), first, second, discs, apart: ti.template()):
    """Row of this half that holds these discs of (first, second), slots of its list build; -1 if there is none."""
    found = -1
    slot = half * w.capacity + first
    step = apart
    if ti.static(w.sleeps):
        step = 1 if row_start[slot] >= 2 * w.half else apart  # frozen pairs follow one another
    if ti.static(w.boulders > 0):
        step = 1 if row_start[slot] % w.half >= w.wall_base - w.boulders else apart  # so do those of boulders
    start, last = row_start[slot], row_count[slot] - 1
    for group in range((last + ROWS_AT_ONCE) // ROWS_AT_ONCE):
        for k in ti.static(range(ROWS_AT_ONCE)):
            row = start + ti.min(group * ROWS_AT_ONCE + k, last) * step
            fits = w.pairs.second[row] == second
            if ti.static(w.clumps):
                fits = fits and w.pairs.discs[row] == discs
            found = ti.select(fits, row, found)
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
        half = w.pace[None].half
        slot = half * w.capacity + i
        r, following, end = pairs.wall_row_start[slot], 0, pairs.wall_row_start[slot] + pairs.wall_row_count[slot]
        if ti.static(w.relists):
            following = w.strays.wall_first[slot]
        while r < end or following > 0:
            row = r
            r += 1
            if ti.static(w.relists):
                if row >= end:  # then those that it has got as a stray
                    row, following = next_row(w, half, following, True)
            if (left or come) and row != p and discs_of(w, row) == discs_of(w, p):
                other, way = distance_to_second(w, row, i, True)
                carries = pairs.force[row].x != 0.0
                if way.dot(normal) > ALIKE:
                    if left and not carries and other < pairs.contact_distance[row]:
                        move_memory(w, p, row)
                        left = False
                    elif come and carries and other > BEYOND:
                        move_memory(w, row, p)
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
