"""What can be said of each grain: motion, load, and the order of its neighbourhood. One row a slot, in slot order.

Each measure fills the first `count` rows of a NumPy array (f32) that the caller keeps: nothing is allocated on the device, and
nothing is copied on a CPU.
"""

import numpy as np
import taichi as ti

from taichi_sand.measure.pairs import gap_now
from taichi_sand.world.clumps import turned
from taichi_sand.world.extras.wetness import soaked
from taichi_sand.world.geometry import add, mobility, movable, perp, position, spin, velocity
from taichi_sand.world.search.images import fold
from taichi_sand.world.search.pair_history import BEYOND
from taichi_sand.world.sweep import every_pair
from taichi_sand.world.tables import World

NEAR = 1.3
"""Neighbours, for psi6: centres closer than this many sums of the radii. It lies between the first and second ring of a square
lattice (1 and 1.41) and of a hexagonal one (1 and 1.73)."""
FEWEST_NEIGHBOURS = 3
"""With fewer neighbours than this psi6 is 0: |exp(6 i theta)| of a single one is 1 and says nothing."""

Rows = ti.types.ndarray(dtype=ti.f32, ndim=1)
Integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
Points = ti.types.ndarray(dtype=ti.f32, ndim=2)


def speed(world: World, out: np.ndarray) -> None:
    """|v| [m/s]."""
    fill_speed(world, out)


def energy(world: World, out: np.ndarray) -> None:
    """Kinetic energy, spin included [J]; 0 of a fixed grain."""
    fill_energy(world, out)


def orientation(world: World, out: np.ndarray) -> None:
    """Angle in whole turns, 0 .. 1."""
    fill_orientation(world, out)


def force(world: World, out: np.ndarray) -> None:
    """Sum of the normal forces that push on the grain, walls included [N]."""
    fill_force(world, out)


def pressure(world: World, out: np.ndarray) -> None:
    """Half the trace of the grain's mean stress, sum(f_n r) / (2 pi r^2) [N/m]."""
    fill_force(world, out)
    force_to_pressure(world, out)


def stress(world: World, out: np.ndarray) -> None:
    """Half the trace of the grain's mean stress, friction and walls included; compression is positive [N/m]."""
    tensors = np.zeros((len(out), 3), np.float32)
    fill_stress(world, tensors)
    out[:] = 0.5 * (tensors[:, 0] + tensors[:, 2])


def deviator(world: World, out: np.ndarray) -> None:
    """Half the difference of the principal values of that stress: the largest shear stress [N/m]."""
    tensors = np.zeros((len(out), 3), np.float32)
    fill_stress(world, tensors)
    out[:] = np.hypot(0.5 * (tensors[:, 0] - tensors[:, 2]), tensors[:, 1])


def temperature(world: World, out: np.ndarray) -> None:
    """Temperature above that of the start [K]."""
    fill_carried(world, world.carried.temperature, out)


def moisture(world: World, out: np.ndarray) -> None:
    """Wetness of the grain, with the water around it, 0 .. 1."""
    fill_saturation(world, out)


def saturation(world: World, out: np.ndarray) -> None:
    """How much of the pores around the grain is full of water, 0 .. 1: of its own, and of that which flows."""
    fill_saturation(world, out)


def order(world: World, out: np.ndarray) -> None:
    """psi6 = |mean of exp(6 i theta) over the neighbours| (physics.md B13): 1 in a hexagonal crystal, 0.37 at random places.

    Neighbours are found afresh from the places, not from the neighbour list: that one depends on when it was made.
    """
    count = world.count[None]
    places = np.empty((max(count, 1), 3), np.float32)
    fill_places(world, places)
    places = places[:count]
    size = np.array(world.box[None].size, float)
    width = 2.0 * NEAR * float(places[:, 2].max(initial=0.0)) or size.max()
    cells = np.maximum(np.floor(size / width), 1).astype(np.int32)
    at = np.clip(np.floor(places[:, :2] * (cells / size)).astype(np.int32), 0, cells - 1)
    cell = at[:, 0] * cells[1] + at[:, 1]
    members = np.argsort(cell, kind="stable").astype(np.int32)
    start = np.searchsorted(cell[members], np.arange(cells[0] * cells[1] + 1)).astype(np.int32)
    fill_order(world, places, cell, members, start, cells[0], cells[1], out)


@ti.kernel
def fill_speed(w: ti.template(), out: Rows):
    """See `speed`."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        out[i] = ti.cast(velocity(w, i).norm(), ti.f32)


@ti.kernel
def fill_carried(w: ti.template(), column: ti.template(), out: Rows):
    """A column that grains carry."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        out[i] = ti.cast(column[i], ti.f32)


@ti.kernel
def fill_saturation(w: ti.template(), out: Rows):
    """Share of the pores that is full."""
    for i in range(w.count[None]):
        share = ti.cast(0.0, w.real)
        if ti.static(hasattr(w.carried, "wetness")):
            share = soaked(w, i)
        else:
            share = ti.max(0.0, w.carried.water_wet[i])
        out[i] = ti.cast(share, ti.f32)


@ti.kernel
def fill_energy(w: ti.template(), out: Rows):
    """See `energy`."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        energy = 0.0
        if movable(w, i) > 0.0:
            energy += ti.cast(0.5 * velocity(w, i).norm_sqr() / mobility(w, i).x, ti.f32)
        if ti.static(w.turns):
            if mobility(w, i).z > 0.0:
                energy += ti.cast(0.5 * spin(w, i) ** 2 / mobility(w, i).z, ti.f32)
        out[i] = energy


@ti.kernel
def fill_orientation(w: ti.template(), out: Rows):
    """See `orientation`."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        out[i] = 0.0
        if ti.static(w.turns):
            turns = ti.cast((w.grains.angle[i] + w.grains.turn[i]) / (2.0 * ti.math.pi), ti.f32)
            out[i] = turns - ti.floor(turns)


@ti.kernel
def fill_force(w: ti.template(), out: Rows):
    """See `force`. Every pair once, in the order of the sweep."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        out[i] = 0.0
    every_pair(w, push_both, out, out)


@ti.func
def push_both(w: ti.template(), out: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Adds the normal force of pair p to those on its grains."""
    push = ti.cast(ti.max(w.pairs.force[p].x, 0.0), ti.f32)
    add(out, w.pairs.first[p], push)
    if ti.static(not wall):
        add(out, w.pairs.second[p], push)


@ti.kernel
def fill_stress(w: ti.template(), out: Points):
    """Love-Weber stress of every grain: xx, xy made symmetric, yy; over the area of the circle that holds it."""
    every_pair(w, stress_both, out, out)
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        for k in ti.static(range(3)):
            out[i, k] /= ti.cast(ti.math.pi * w.grains.radius[i] ** 2, ti.f32)


@ti.func
def stress_both(w: ti.template(), out: ti.template(), c: ti.template(), p, wall: ti.template()):
    """Adds what pair p makes of the stress of its grains, times their areas."""
    i = w.pairs.first[p]
    gap, normal = gap_now(w, p, wall)
    push = w.pairs.force[p].x * normal + w.pairs.force[p].y * perp(normal)
    if w.pairs.force[p].x != 0.0 and gap < BEYOND:
        reach, arm = w.grains.radius[i], ti.Vector([0.0, 0.0])
        if ti.static(w.clumps):
            reach, arm = w.pairs.rims[p].x, turned(w, i, w.pairs.arms[p].xy)
        add_dyad(out, i, push, arm + (reach + (gap if ti.static(wall) else 0.5 * gap)) * normal)
        if ti.static(not wall):
            j = w.pairs.second[p]
            reach, arm = w.grains.radius[j], ti.Vector([0.0, 0.0])
            if ti.static(w.clumps):
                reach, arm = w.pairs.rims[p].y, turned(w, j, w.pairs.arms[p].zw)
            add_dyad(out, j, -push, arm - (reach + 0.5 * gap) * normal)


@ti.func
def add_dyad(out: ti.template(), i, push, branch):
    """Adds push times branch, made symmetric, to row i."""
    out[i, 0] = out[i, 0] + ti.cast(push.x * branch.x, ti.f32)
    out[i, 1] = out[i, 1] + ti.cast(0.5 * (push.x * branch.y + push.y * branch.x), ti.f32)
    out[i, 2] = out[i, 2] + ti.cast(push.y * branch.y, ti.f32)


@ti.kernel
def force_to_pressure(w: ti.template(), out: Rows):
    """See `pressure`; `out` holds the forces."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        out[i] = out[i] / ti.cast(2.0 * ti.math.pi * w.grains.radius[i], ti.f32)


@ti.kernel
def fill_places(w: ti.template(), places: Points):
    """x, y and radius of every grain; within the box where it is periodic."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        place = fold(w, position(w, i), w.box[None].size)
        for k in ti.static(range(2)):
            places[i, k] = ti.cast(place[k], ti.f32)
        places[i, 2] = ti.cast(w.grains.radius[i], ti.f32)


@ti.kernel
def fill_order(
    w: ti.template(), places: Points, cell: Integers, members: Integers, start: Integers, columns: ti.i32, rows: ti.i32, out: Rows
):
    """See `order`. Grains are looked up by cell: those of cell c are members[start[c]], … members[start[c + 1] - 1]."""
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        total, neighbours = ti.Vector([0.0, 0.0]), 0
        column, row = cell[i] // rows, cell[i] % rows
        for across in range(-1, 2):
            for up in range(-1, 2):
                x, y = column + across, row + up
                seen = True
                if ti.static(w.periodic[0]):
                    seen = seen and (columns > 2 or across >= 0) and (columns > 1 or across == 0)
                    x = (x + columns) % columns
                if ti.static(w.periodic[1]):
                    seen = seen and (rows > 2 or up >= 0) and (rows > 1 or up == 0)
                    y = (y + rows) % rows
                if seen and x >= 0 and x < columns and y >= 0 and y < rows:
                    for m in range(start[x * rows + y], start[x * rows + y + 1]):
                        sixth = sixth_power(w, places, i, members[m])
                        total += sixth
                        neighbours += ti.cast(sixth.norm_sqr() > 0.0, ti.i32)
        out[i] = total.norm() / neighbours if neighbours >= FEWEST_NEIGHBOURS else 0.0


@ti.func
def sixth_power(w: ti.template(), places: ti.template(), i, j):
    """exp(6 i theta) of the direction from grain i to grain j as (cos, sin); 0 unless they are neighbours."""
    way = ti.Vector([places[j, 0] - places[i, 0], places[j, 1] - places[i, 1]])
    for k in ti.static(range(2)):
        if ti.static(w.periodic[k]):
            size = ti.cast(w.box[None].size[k], ti.f32)
            way[k] -= size * ti.floor(way[k] / size + 0.5)
    square, near = way.norm_sqr(), NEAR * (places[i, 2] + places[j, 2])
    power = ti.Vector([0.0, 0.0])
    if i != j and square > 0.0 and square < near * near:
        cube = ti.Vector([way.x * (way.x * way.x - 3.0 * way.y * way.y), way.y * (3.0 * way.x * way.x - way.y * way.y)])
        power = ti.Vector([cube.x * cube.x - cube.y * cube.y, 2.0 * cube.x * cube.y]) / (square * square * square)
    return power
