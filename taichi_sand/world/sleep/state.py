"""Sleep: grains that have been still lie behind the others in the grain table, and no loop of a step or a list build runs over them.

Slots 0 .. awake-1 are awake, the next `asleep` sleep, sorted by lattice site. The pairs among sleepers, and of sleepers with walls, are
frozen in a third part of the neighbour list, with what they carry. A pair of a grain that is awake with a sleeper is listed as any other,
first the one awake: the sleeper holds still, but with the mass that it has awake, so that neither its force nor its overlap changes.

Falling asleep and waking are rare, and go through a list build of all, after which who sleeps is chosen afresh (world.sleep.fall_asleep).
`origin` tells the list build which slot a grain had when the pairs before were listed.
"""

from typing import Any, NamedTuple

import taichi as ti

from taichi_sand.taichi_support import field_pool
from taichi_sand.world.blocks import block_count
from taichi_sand.world.geometry import perp, spin, velocity
from taichi_sand.world.sweep import pairs_awake
from taichi_sand.world.tables import site_rows

ASLEEP = 1e9
"""`still` of a sleeper [s]."""
PRICE, LAST = 8.0, 100
"""Laying grains down costs as much as PRICE steps of all there are; that nobody is awake spares as much as LAST grains. It is done when
those who could have slept have cost as much: so it never costs more than what it could have spared, however long they will sleep."""
MOST_PRICE = 64.0
"""Where it lays nobody down, as all are restless around those who are still, it is tried half as often the next time, but not less than
every so many times its price."""


class SleepState(NamedTuple):
    """What sleeping needs. Columns by slot, shape (capacity,), unless said otherwise."""

    still: Any  # for how long the grain has been still [s]; ASLEEP for sleepers
    mobility: Any  # of a sleeper, what it gets back when it wakes; a 4-vector as in Grains
    origin: Any  # slot before the last rearrangement, i32
    slot: Any  # scratch: slot after it, -1 = stays awake, i32
    row_start: Any  # frozen pairs of a sleeper: first row, the others follow, i32
    row_count: Any
    wall_row_start: Any
    wall_row_count: Any
    balance: Any  # weight and frozen contact forces of a sleeper [N], 2-vector
    load: Any  # sum of their sizes [N]
    push: Any  # scratch: all forces on it [N], 2-vector
    start: Any  # first sleeper at each lattice site, shape (sites + 2,), i32
    restless: Any  # 1 = a grain at the site is not still; shape (sites,), i32
    woken: Any  # 1 = sleepers at the site are to wake; shape (sites,), i32
    state: Any  # 0-D struct of state_type


def state_type(real: Any) -> Any:
    """Struct of the numbers of sleep."""
    return ti.types.struct(
        awake=ti.i32,
        asleep=ti.i32,
        moved=ti.i32,  # 1 = slots have been rearranged since the last list build
        due=ti.i32,  # 1 = somebody must wake, or a slot has fallen empty, before the next step
        seen=ti.i32,  # steps done when it was looked last
        owed=real,  # steps of single grains that those who could have slept have cost
        price=real,  # how much of that laying grains down is worth now, over PRICE steps of all
        impact=real,  # approach that wakes a sleeper before it is hit [m/s]
    )


def allocate_sleep_state(real: Any, capacity: int, sites: tuple[int, int]) -> SleepState:
    """Empty tables: everybody is awake."""
    whole = {
        name: field_pool.scalars(ti.i32, capacity)
        for name in ("origin", "slot", "row_start", "row_count", "wall_row_start", "wall_row_count")
    }
    count = site_rows(sites)
    return SleepState(
        still=field_pool.scalars(real, capacity),
        mobility=field_pool.vectors(4, real, capacity),
        balance=field_pool.vectors(2, real, capacity),
        load=field_pool.scalars(real, capacity),
        push=field_pool.vectors(2, real, capacity),
        start=field_pool.scalars(ti.i32, count),
        restless=field_pool.scalars(ti.i32, count),
        woken=field_pool.scalars(ti.i32, count),
        state=field_pool.record(state_type(real)),
        **whole,
    )


def start_awake(sleep: SleepState, count: int) -> None:
    """The `count` grains there are have come from elsewhere: none of them sleeps, or has been still."""
    sleep.state.fill(0)
    sleep.state[None].awake, sleep.state[None].price = count, 1.0
    sleep.still.fill(0.0)
    sleep.woken.fill(0)


@ti.func
def site_of(w: ti.template(), x, y):
    """Number of lattice site (x, y), the nearest one of the box, or the one that it is where the box is periodic."""
    sites = w.box[None].sites
    at = ti.Vector([x, y])
    for k in ti.static(range(2)):
        if ti.static(w.periodic[k]):
            at[k] = (at[k] + sites[k]) % sites[k]
        else:
            at[k] = ti.min(ti.max(at[k], 0), sites[k] - 1)
    return at.x * sites.y + at.y


@ti.func
def home(w: ti.template(), i):
    """Lattice site of grain i."""
    return site_of(w, w.grains.site[i].x, w.grains.site[i].y)


@ti.func
def call(w: ti.template(), j):
    """The sleepers at the site of j and around it are to wake."""
    site = w.grains.site[j]
    for x in range(site.x - 1, site.x + 2):
        for y in range(site.y - 1, site.y + 2):
            w.sleep.woken[site_of(w, x, y)] = 1
    w.sleep.state[None].due = 1


@ti.func
def shake(w: ti.template()):
    """No grain falls asleep where a wall that moves may meet it before the next list build."""
    ti.loop_config(serialize=True)
    for e in range(w.movers.count[None]):
        if moves_on(w, e):
            w.sleep.restless[w.movers.site[e]] = 1


@ti.func
def call_by_walls(w: ti.template()):
    """Marks sites where a wall that moves may meet sleepers: they are to wake."""
    sleep = ti.static(w.sleep)
    if sleep.state[None].asleep > 0:
        for e in range(w.movers.count[None]):
            site = w.movers.site[e]
            if moves_on(w, e) and sleep.start[site + 1] > sleep.start[site]:
                sleep.woken[site] = 1
                sleep.state[None].due = 1


@ti.func
def moves_on(w: ti.template(), e):
    """Whether the wall of entry e of those that can move does, or may at any time."""
    m = w.movers.wall[w.walls.part[w.walls.room + e]]
    return w.movers.rate[m] != 0.0 or w.movers.force[m] > 0.0


@ti.func
def on_step(w: ti.template(), s: ti.template()):
    """Looks who is still, and which sleepers are no longer held in balance: somebody may then be due to wake or to fall asleep."""
    sleep = ti.static(w.sleep)
    c = s.constants[None]
    unit = ti.sqrt(w.box[None].gravity.norm() * w.box[None].diameter)
    sleep.state[None].impact = c.sleeping_impact * unit
    awake = sleep.state[None].awake
    steps = w.pace[None].done - sleep.state[None].seen
    time = steps * w.pace[None].step
    sleep.state[None].seen = w.pace[None].done
    ready = 0
    ti.loop_config(serialize=w.serial)
    for i in range(awake):
        v = velocity(w, i)
        turning = w.grains.radius[i] * spin(w, i)
        calm = v.dot(v) + turning * turning < (c.sleeping_speed * unit) ** 2
        sleep.still[i] = sleep.still[i] + time if calm else 0.0
        ready += ti.cast(sleep.still[i] >= c.sleeping_time, ti.i32)
    weigh(w, s, c)
    if ready > 0:
        sleep.state[None].owed += (ready + (LAST if ready == awake else 0)) * steps
    if sleep_pays(w):
        sleep.state[None].due = 1


@ti.func
def sleep_pays(w: ti.template()):
    """Whether those who could sleep have cost as much as laying them down does."""
    state = ti.static(w.sleep.state)
    return state[None].owed > state[None].price * PRICE * (state[None].awake + state[None].asleep)


@ti.func
def weigh(w: ti.template(), s: ti.template(), c: ti.template()):
    """Calls the sleepers on which forces no longer balance."""
    sleep = ti.static(w.sleep)
    last = w.count[None]
    first = last - (sleep.state[None].asleep if sleep.state[None].awake > 0 else 0)
    ti.loop_config(serialize=w.serial)
    for j in range(first, last):
        sleep.push[j] = sleep.balance[j]
    pairs_awake(w, push_sleeper, s, c)
    ti.loop_config(serialize=w.serial)
    for j in range(first, last):
        if sleep.mobility[j].x > 0.0:
            bound = c.sleeping_share * (sleep.load[j] + w.box[None].gravity.norm() / sleep.mobility[j].x)
            if sleep.push[j].dot(sleep.push[j]) > bound * bound:
                call(w, j)


@ti.func
def push_sleeper(w: ti.template(), s: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Adds the force of pair p to those on its second grain, if that sleeps."""
    if ti.static(not wall):
        sleep = ti.static(w.sleep)
        j = w.pairs.second[p]
        if j >= w.count[None] - sleep.state[None].asleep and j < w.count[None]:
            force, normal = w.pairs.force[p], w.pairs.normal[p]
            sleep.push[j] = sleep.push[j] + force.x * normal + force.y * perp(normal)


@ti.func
def sleeper_block(w: ti.template()):
    """Block of the sleepers: the one behind those that a sweep runs over."""
    return block_count(w) - 1


@ti.func
def translate(w: ti.template()):
    """In a list build, after the sort: `source` is the slot of each grain when the pairs before were listed."""
    sleep, grid = ti.static(w.sleep, w.grid)
    awake, count = sleep.state[None].awake, 0
    if sleep.state[None].moved == 1:
        count = awake + sleep.state[None].asleep
    ti.loop_config(serialize=w.serial)
    for i in range(count):
        grid.source[i] = sleep.origin[grid.source[i]] if i < awake else sleep.origin[i]


@ti.func
def settle(w: ti.template()):
    """At the end of a list build: the frozen pairs are found by the slots of the sleepers, in either half, and make up a block."""
    sleep, pairs = ti.static(w.sleep, w.pairs)
    asleep, moved = sleep.state[None].asleep, sleep.state[None].moved
    first = w.count[None] - asleep
    if w.pace[None].lacking != 0:  # pairs will be listed again, and remembered as before
        moved = 0
    ti.loop_config(serialize=w.serial)
    for j in range(first, first + asleep * moved):
        w.grid.source[j] = j
        for half in ti.static(range(2)):
            at = half * w.capacity + j
            pairs.row_start[at], pairs.row_count[at] = sleep.row_start[j], sleep.row_count[j]
            pairs.wall_row_start[at], pairs.wall_row_count[at] = sleep.wall_row_start[j], sleep.wall_row_count[j]
    sleep.state[None].moved -= moved
    b = sleeper_block(w)
    last, wall_last = 2 * w.half, 2 * w.half + w.wall_base
    if asleep > 0:
        j = first + asleep - 1
        last, wall_last = sleep.row_start[j] + sleep.row_count[j], sleep.wall_row_start[j] + sleep.wall_row_count[j]
    w.blocks.grain_start[b], w.blocks.grain_end[b] = first, first + asleep
    w.blocks.pair_start[b], w.blocks.pair_end[b] = 2 * w.half, last
    w.blocks.wall_start[b], w.blocks.wall_end[b] = 2 * w.half + w.wall_base, wall_last


@ti.func
def called(w: ti.template()):
    """Whether somebody is to wake or to fall asleep before the next step."""
    due = False
    if ti.static(w.sleeps):
        due = w.sleep.state[None].due == 1
    return due


@ti.func
def due_to_sleep(w: ti.template()):
    """Whether somebody is to fall asleep before the next step."""
    due = called(w)
    if ti.static(w.sleeps):
        due = due and sleep_pays(w)
    return due
