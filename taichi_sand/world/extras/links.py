"""Links: which grains an effect ties together, kept by grain, since the list build moves grains from slot to slot.

Before the forces of a step are summed, the force of every link is found once, each link on its own; then every grain adds up those of
its links, in a fixed order. So links need no colours and no atomics, reach as far as they like, and pull both ends exactly alike.
What a link breaks with in its last step is an impulse, a force that stays the same in all stages of that step.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.taichi_support import field_pool
from taichi_sand.world.extras.energy_ledger import book
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.geometry import mobility, movable, velocity
from taichi_sand.world.tables import CHUNK, STRIPS, round_up, write_rows


class Links(NamedTuple):
    """A row a link, shape (links,), unless said otherwise; rows from `count` on are empty."""

    ends: Any  # ids of both grains, i32 2-vector
    rest: Any  # distance of their centres at the start [m]
    whole: Any  # 1 = holds, 0 = broken, i32
    slots: Any  # of both grains since the last list build, -1 = gone, i32 2-vector
    reach: Any  # from the first centre to the second at the last list build [m], 2-vector
    mass: Any  # effective mass along the link [kg]
    force: Any  # on the second grain, in this step [N], 2-vector
    last: Any  # 1 = this is the step in which it breaks, i32
    held: Any  # elastic energy that it held when last looked at [J]; known only where heat is booked
    gained: Any  # by how much that was more than the time before [J]
    start: Any  # links of a grain: first entry in `of`, by id, shape (ids + 1,), i32
    of: Any  # twice the number of the link, plus 1 if the grain is its second, shape (2 * links,), i32
    slot: Any  # of a grain, by id, shape (ids,), i32
    count: Any  # 0-D i32
    give: Any  # 0-D: the largest, over the links, of the summed inverse masses of both ends, each times the links it has [1/kg]
    heaviest: Any  # 0-D: largest effective mass [kg]


def build_links(ends: np.ndarray | None, grains: Any, real: Any) -> Links | None:
    """Links between the grains `ends` (n, 2) of a pack, if any; the distances are those that they start at."""
    if ends is None or not len(ends):
        return None
    count, ids = len(ends), round_up(int(ends.max()) + 2)
    rows = round_up(count)
    links = Links(
        **{
            name: field_pool.vectors(2, kind, rows)
            for name, kind in (("ends", ti.i32), ("slots", ti.i32), ("reach", real), ("force", real))
        },
        **{name: field_pool.scalars(kind, rows) for name, kind in (("rest", real), ("whole", ti.i32), ("mass", real), ("last", ti.i32))},
        **{name: field_pool.scalars(real, rows) for name in ("held", "gained")},
        start=field_pool.scalars(ti.i32, ids + 1),
        of=field_pool.scalars(ti.i32, 2 * rows),
        slot=field_pool.scalars(ti.i32, ids),
        count=field_pool.scalars(ti.i32, ()),
        **{name: field_pool.scalars(real, ()) for name in ("give", "heaviest")},
    )
    way = grains.position[ends[:, 1]] - grains.position[ends[:, 0]]
    many = np.bincount(ends.ravel(), minlength=ids)
    inverse = np.where(grains.fixed, 0.0, 1 / grains.mass)
    both = inverse[ends].sum(axis=1)
    entries = 2 * np.arange(count)[:, None] + [0, 1]
    write_rows(links.ends, ends)
    write_rows(links.rest, np.hypot(way[:, 0], way[:, 1]))
    write_rows(links.whole, np.ones(count))
    write_rows(links.start, np.concatenate([[0], np.cumsum(many)]))
    write_rows(links.of, entries.ravel()[np.argsort(ends.ravel(), kind="stable")])
    links.count[None] = count
    links.give[None] = float((many[ends] * inverse[ends]).sum(axis=1).max())
    links.heaviest[None] = float((1 / np.maximum(both, 1e-30))[both > 0].max(initial=0.0))
    return links


@ti.func
def find_links(w: ti.template()):
    """In a list build, after the sort: the slots of both ends of every link, and the way between them."""
    g, links = ti.static(w.grains, w.links)
    ti.loop_config(serialize=w.serial)
    for id in range(links.slot.shape[0]):
        links.slot[id] = -1
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        if g.id[i] < links.slot.shape[0]:
            links.slot[g.id[i]] = i
    ti.loop_config(serialize=w.serial)
    for k in range(links.count[None]):
        i, j = links.slot[links.ends[k].x], links.slot[links.ends[k].y]
        links.slots[k], links.last[k] = ti.Vector([i, j]), 0
        if i < 0 or j < 0:
            links.whole[k] = 0
        if links.whole[k] == 1:
            hop = g.site[j] - g.site[i]
            for a in ti.static(range(2)):
                if ti.static(w.periodic[a]):
                    sites = w.box[None].sites[a]
                    hop[a] -= sites * ti.cast(ti.floor(ti.cast(hop[a], w.real) / sites + 0.5), ti.i32)
            links.reach[k] = ti.cast(hop, w.real) * w.box[None].spacing + (g.offset[j] - g.offset[i])
            links.mass[k] = 1.0 / ti.max(mobility(w, i).x + mobility(w, j).x, 1e-30)


@ti.func
def link_way(w: ti.template(), k):
    """From the first centre of link k to the second [m], and the velocity of the second as seen from the first [m/s]."""
    i, j = w.links.slots[k].x, w.links.slots[k].y
    return w.links.reach[k] + (w.grains.shift[j] - w.grains.shift[i]), velocity(w, j) - velocity(w, i)


@ti.func
def pull_block(w: ti.template(), s: ti.template(), c: ti.template(), start, end, may_break):
    """Finds the forces of the links start .. end-1."""
    links = ti.static(w.links)
    for k in range(start, end):
        if may_break:
            links.last[k] = 0
            if links.whole[k] == 1:
                break_link(w, s, c, k)
        force = ti.Vector([0.0, 0.0])
        if links.last[k] == 1:
            force = links.force[k]
        elif links.whole[k] == 1:
            for effect in ti.static(s.effects):
                if ti.static(offers(effect, "link")):
                    force += effect.link(w, c, k)
        links.force[k] = force
        if ti.static(s.books):
            energy = 0.0
            if links.whole[k] == 1:
                for effect in ti.static(s.effects):
                    if ti.static(offers(effect, "kept")):
                        energy += effect.kept(w, c, k)
            links.gained[k] = energy - links.held[k]
            links.held[k] = energy


@ti.func
def break_link(w: ti.template(), s: ti.template(), c: ti.template(), k):
    """Lets the effects break link k: its force in this step is then the impulse that it breaks with, spread over the step."""
    for effect in ti.static(s.effects):
        if ti.static(offers(effect, "snap")):
            impulse = effect.snap(w, c, k)
            if w.links.whole[k] == 0 and w.links.last[k] == 0:
                w.links.last[k] = 1
                w.links.force[k] = impulse / w.pace[None].step


@ti.func
def pull_links(w: ti.template(), s: ti.template(), c: ti.template(), when: ti.template(), may_break):
    """Finds the forces of all links, if when(w): ahead of a sweep whose grain function takes them in. `may_break`: whether this is the
    first time in a step.
    """
    if ti.static(w.linked):
        if ti.static(w.layout == "one"):
            if when(w):
                pull_block(w, s, c, 0, w.links.count[None], may_break)
        elif ti.static(w.layout == "strips"):
            for k in range(STRIPS * CHUNK):
                if k % CHUNK == 0 and when(w):
                    b = k // CHUNK
                    count = w.links.count[None]
                    pull_block(w, s, c, b * count // STRIPS, (b + 1) * count // STRIPS, may_break)
        else:
            for k in range(w.links.whole.shape[0]):
                if k < w.links.count[None] and when(w):
                    pull_block(w, s, c, k, k + 1, may_break)


@ti.func
def pull_of(w: ti.template(), i):
    """What the links of grain i pull it with, as a wrench."""
    links = ti.static(w.links)
    id = w.grains.id[i]
    force = ti.Vector([0.0, 0.0])
    if id < links.slot.shape[0]:
        for q in range(links.start[id], links.start[id + 1]):
            pull = links.force[links.of[q] // 2]
            force += ti.select(links.of[q] % 2 == 1, pull, -pull)
    return ti.Vector([force.x, force.y, 0.0, 0.0])


@ti.func
def settle_links(w: ti.template(), s: ti.template(), i, time, change):
    """The links of grain i pull it for `time` in a kick that changes its twist by `change`: what that takes out of its motion is heat, but
    for its half of what they hold more than before. A link that breaks holds nothing any more. See world.extras.energy_ledger.
    """
    if ti.static(w.linked and s.books):
        links = ti.static(w.links)
        energy = -time * pull_of(w, i).dot(w.grains.twist[i] + 0.5 * change)
        id = w.grains.id[i]
        if id < links.slot.shape[0] and movable(w, i) > 0.0:
            for q in range(links.start[id], links.start[id + 1]):
                k = links.of[q] // 2
                other = links.slots[k][1 - links.of[q] % 2]
                share = 1.0
                if other >= 0:
                    share = 1.0 / (1.0 + movable(w, other))
                energy -= share * links.gained[k]
        book(w, s, i, energy)


def ends_of(world: Any, whole: int) -> np.ndarray:
    """Ids (n, 2) of the grains of the links that hold (1), or are broken (0)."""
    count = world.links.count[None]
    return world.links.ends.to_numpy()[:count][world.links.whole.to_numpy()[:count] == whole]
