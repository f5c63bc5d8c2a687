"""Grains that come, go, are held or let go while the simulation runs.

Every change leaves the neighbour list as it is and asks for a list build: the pairs that stay find their memory again.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.world.blocks import block_count
from taichi_sand.world.extras.grain_rows import beside, new_rows, put_row
from taichi_sand.world.geometry import distance_to_second, mobility, motion_of, movable, position, velocity
from taichi_sand.world.motion import speed_squared
from taichi_sand.world.search.images import folded
from taichi_sand.world.sleep.fall_asleep import wake
from taichi_sand.world.tables import World
from taichi_sand.world.walls.motion import held_up

LEVELS = 4
"""Overlaps are told apart by powers of two."""


@ti.kernel
def put(w: ti.template(), numbers: ti.types.ndarray(), whole: ti.types.ndarray()):
    """Writes new grains behind those there are."""
    ti.loop_config(serialize=True)
    for k in range(whole.shape[0]):
        i = w.count[None] + k
        put_row(w, whole, numbers, k, i)
        for half in ti.static(range(2)):  # nobody remembers a pair of a grain that was not there
            w.pairs.row_count[half * w.capacity + i], w.pairs.wall_row_count[half * w.capacity + i] = 0, 0


@ti.kernel
def rewrite(w: ti.template(), slots: ti.types.ndarray(), numbers: ti.types.ndarray(), sites: ti.types.ndarray(), given: ti.i32):
    """Writes those of the numbers offset x, y, velocity x, y, angle, spin whose bits are set in `given`: 1, 2, 4, 8."""
    g = ti.static(w.grains)
    ti.loop_config(serialize=True)
    for k in range(slots.shape[0]):
        i = slots[k]
        twist = g.twist[i]
        if given & 1:
            g.site[i], g.shift[i] = ti.Vector([sites[k, 0], sites[k, 1]]), ti.Vector([0.0, 0.0])
            g.offset[i] = ti.Vector([numbers[k, 0], numbers[k, 1]])
        if given & 2:
            twist.x, twist.y = numbers[k, 2], numbers[k, 3]
        if given & 4:
            g.angle[i], g.turn[i] = numbers[k, 4], 0.0
        if given & 8:
            twist.z = numbers[k, 5]
        g.twist[i], g.start_velocity[i] = twist, twist.xy


@ti.kernel
def forget_pairs(w: ti.template(), gone: ti.types.ndarray()):
    """The next list build recalls no pair of a grain for whose slot `gone` is 1: it meets others anew."""
    ti.loop_config(serialize=True)
    for _run in range(1):
        for b in range(block_count(w)):
            for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
                if gone[w.pairs.first[p]] == 1 or gone[w.pairs.second[p]] == 1:
                    w.pairs.second[p] = w.capacity - 1
            for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
                if gone[w.pairs.first[p]] == 1:
                    w.pairs.second[p] = -1


@ti.kernel
def drop(w: ti.template(), slots: ti.types.ndarray()):
    """The next list build takes these out."""
    ti.loop_config(serialize=True)
    for k in range(slots.shape[0]):
        w.grains.id[slots[k]] = -1


@ti.kernel
def set_mobility(w: ti.template(), slots: ti.types.ndarray(), mobility: ti.types.ndarray()):
    """New inverse mass and inertia; what is held stops."""
    g = ti.static(w.grains)
    ti.loop_config(serialize=True)
    for k in range(slots.shape[0]):
        i = slots[k]
        m = ti.cast(mobility[k, 0], w.real)
        g.mobility[i] = ti.Vector([m, m, ti.cast(mobility[k, 1], w.real), 0.0])
        if m == 0.0:
            g.twist[i] = ti.Vector([0.0, 0.0, 0.0, 0.0])


@ti.kernel
def read_places(w: ti.template(), numbers: ti.types.ndarray(), whole: ti.types.ndarray()):
    """See `places`."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        p = position(w, i)
        numbers[i, 0], numbers[i, 1], numbers[i, 2] = p.x, p.y, w.grains.radius[i]
        numbers[i, 3] = mobility(w, i).x
        whole[i, 0], whole[i, 1] = w.grains.id[i], w.grains.kind[i]
        whole[i, 2] = ti.cast(movable(w, i) == 0.0, ti.i32)


def real_of(world: World) -> Any:
    """The NumPy type of the world's numbers."""
    return np.float64 if world.real == ti.f64 else np.float32


def places(world: World) -> tuple[np.ndarray, np.ndarray]:
    """By slot: x, y, radius [m], 1/mass [1/kg] (n, 4), within the box where it is periodic; id, kind, whether it is fixed (n, 3) int32."""
    count = world.count[None]
    numbers, whole = np.zeros((max(count, 1), 4), real_of(world)), np.zeros((max(count, 1), 3), np.int32)
    read_places(world, numbers, whole)
    numbers = numbers[:count].astype(float)
    if any(world.periodic):
        numbers[:, :2] = folded(numbers[:, :2], world, world.box[None].size)
    return numbers, whole[:count]


@ti.func
def overlap_of(w: ti.template(), p, wall: ti.template()):
    """Overlap of pair p [m]; below 0 apart."""
    distance, _ = distance_to_second(w, p, w.pairs.first[p], wall)
    return w.pairs.contact_distance[p] - distance


@ti.kernel
def count_strained(w: ti.template(), deep: float, fast: float, found: ti.types.ndarray(), squares: ti.types.ndarray()):
    """See `strained`; a row a block."""
    for b in range(block_count(w)):
        moving, touching, over, square = 0, 0, ti.Vector([0] * LEVELS), ti.cast(0.0, w.real)
        for i in range(w.blocks.grain_start[b], w.blocks.grain_end[b]):
            moving += ti.cast(velocity(w, i).dot(velocity(w, i)) > fast * fast, ti.i32)
            square = ti.max(square, speed_squared(w, i))
        squares[b] = square
        for wall in ti.static((False, True)):
            rows = ti.static((w.blocks.wall_start, w.blocks.wall_end) if wall else (w.blocks.pair_start, w.blocks.pair_end))
            for p in range(rows[0][b], rows[1][b]):
                overlap = overlap_of(w, p, wall)
                touching += ti.cast(overlap > 0.0, ti.i32)
                for k in ti.static(range(LEVELS)):
                    over[k] += ti.cast(overlap > deep * 2**k, ti.i32)
        found[b, 0], found[b, 1] = ti.select(held_up(w), w.blocks.grain_end[b] - w.blocks.grain_start[b], moving), touching
        for k in ti.static(range(LEVELS)):
            found[b, 2 + k] = over[k]


def strained(world: World, deep: float, fast: float) -> tuple[float, np.ndarray, float]:
    """Share of the grains that are faster than `fast` [m/s]; shares of the contacts that overlap by more than `deep` times 1, 2, 4 … [m],
    shape (LEVELS,); speed of the fastest grain [m/s]. All count as fast where a wall waits that nothing can stop: it presses harder the
    stiffer they get.
    """
    blocks = world.blocks.pair_start.shape[0]
    found, squares = np.zeros((blocks, 2 + LEVELS), np.int32), np.zeros(blocks, real_of(world))
    count_strained(world, deep, fast, found, squares)
    moving, touching, *over = found.sum(axis=0)
    return float(moving / max(1, world.count[None])), np.array(over) / max(1, touching), float(np.sqrt(squares.max()))


@ti.kernel
def read_contact_speeds(w: ti.template(), speeds: ti.types.ndarray()):
    """See `contact_speeds`."""
    for b in range(block_count(w) - ti.static(int(w.sleeps))):
        base = w.pace[None].half * w.half
        for wall in ti.static((False, True)):
            rows = ti.static((w.blocks.wall_start, w.blocks.wall_end) if wall else (w.blocks.pair_start, w.blocks.pair_end))
            for p in range(rows[0][b], rows[1][b]):
                i = w.pairs.first[p]
                distance, normal = distance_to_second(w, p, i, wall)
                speed = ti.cast(-1.0, w.real)
                if distance < w.pairs.contact_distance[p]:
                    speed = motion_of(w, p, i, i if ti.static(wall) else w.pairs.second[p], distance, normal, wall).norm()
                speeds[p - base] = speed


def contact_speeds(world: World) -> np.ndarray:
    """How fast the two sides of every contact of grains that are awake move past or at one another [m/s], shape (contacts,): grains by
    their centres.
    """
    speeds = np.full(world.half, -1.0, real_of(world))
    read_contact_speeds(world, speeds)
    return speeds[speeds >= 0].astype(float)


def flow(world: World, dense: float) -> float:
    """Speed that 99 % of the contacts of a flow stay below [m/s]; 0 where grains have fewer than `dense` contacts each."""
    speeds = contact_speeds(world)
    return float(np.percentile(speeds, 99)) if len(speeds) > dense * max(1, world.count[None]) else 0.0


def all_listed(world: World) -> bool:
    """In cells: whether every cell has listed its pairs in the half of the table that is in use. Drivers were seen that leave some out
    (Mesa's llvmpipe, of 2022).
    """
    cells = world.grid.columns[None] * world.grid.rows[None]
    start, end = (getattr(world.blocks, name).to_numpy()[:cells] for name in ("pair_start", "pair_end"))
    low = world.pace[None].half * world.half
    return bool(((low <= start) & (start <= end)).all())


def link_lines(world: World) -> tuple[np.ndarray, np.ndarray]:
    """The links that hold: their numbers (n,), and where they run, x, y of one end, x, y of the other [m], (n, 4).

    Over a periodic edge the second end lies outside the box, where the first one sees it.
    """
    if not world.linked:
        return np.empty(0, int), np.empty((0, 4))
    numbers, whole = places(world)
    ends = world.links.ends.to_numpy()
    slot = np.full(max(int(whole[:, 0].max(initial=0)), int(ends.max())) + 1, -1)
    slot[whole[:, 0]] = np.arange(len(whole))
    rows = np.flatnonzero((world.links.whole.to_numpy() == 1) & (slot[ends] >= 0).all(axis=1))
    first, second = numbers[slot[ends[rows, 0]], :2], numbers[slot[ends[rows, 1]], :2]
    for axis, wraps in enumerate(world.periodic):
        if wraps:
            side = float(world.box[None].size[axis])
            second[:, axis] -= side * np.round((second[:, axis] - first[:, axis]) / side)
    return rows, np.concatenate([first, second], axis=1)


def room(world: World) -> int:
    """Grains that can still be added; the last slot stays empty."""
    return world.capacity - 1 - world.count[None]


def add(world: World, grains: dict[str, np.ndarray], first_id: int) -> None:
    """Adds grains with the ids first_id, first_id + 1, …; there must be `room`. The caller keeps them off others.

    Args:
        world: where to.
        grains: as for extras.grain_rows.new_rows.
        first_id: an id that was never given before, and all above it.
    """
    wake(world)
    count = len(grains["radius"])
    rows = new_rows(grains, first_id, np.array(world.box[None].spacing.to_list()))
    put(world, beside(rows, False).astype(real_of(world)), beside(rows, True).astype(np.int32))
    world.count[None] += count
    if world.sleeps:
        world.sleep.state[None].awake += count
    world.pace[None].spent = 1


def change(world: World, slots: np.ndarray, values: dict[str, np.ndarray]) -> None:
    """Gives the grains in these slots (n,), all awake, another `position` (n, 2), `velocity` (n, 2), `angle` (n,) or `spin` (n,); SI. One
    in another place forgets its contacts.
    """
    count, names = len(slots), ("position", "velocity", "angle", "spin")
    spacing = np.array(world.box[None].spacing.to_list())
    numbers, site = np.zeros((count, 6)), np.zeros((count, 2), np.int32)
    if "position" in values:
        site = np.floor(values["position"] / spacing).astype(np.int32)
        numbers[:, :2] = values["position"] - (site + 0.5) * spacing
        gone = np.zeros(world.capacity, np.int32)
        gone[slots] = 1
        forget_pairs(world, gone)
    for name, columns in (("velocity", slice(2, 4)), ("angle", 4), ("spin", 5)):
        if name in values:
            numbers[:, columns] = values[name]
    given = sum(1 << k for k, name in enumerate(names) if name in values)
    rewrite(world, np.ascontiguousarray(slots, np.int32), numbers.astype(real_of(world)), site, given)
    world.pace[None].spent = 1


def remove(world: World, slots: np.ndarray) -> None:
    """Takes the grains in these slots (n,) out, with the next list build."""
    if len(slots):
        drop(world, np.ascontiguousarray(slots, np.int32))
        world.pace[None].spent = 1


def hold(world: World, slots: np.ndarray, mobility: np.ndarray) -> None:
    """Gives the grains in these slots (n,) an inverse mass and inertia (n, 2) [1/kg, 1/(kg m2)]; zeros hold them in place."""
    if len(slots):
        set_mobility(world, np.ascontiguousarray(slots, np.int32), np.ascontiguousarray(mobility, real_of(world)))
        world.pace[None].spent = 1
