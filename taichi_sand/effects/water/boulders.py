"""Grains as large as a cell, or larger: boulders. They are dealt to the faces over their own width, not over that of a cell.

So none fills a cell with more than it holds, and buoyancy and drag are means over all of the boulder. Water goes through it, slowed down by
the drag that a sphere of its size has: the flow around one is not resolved.
"""

import math

import taichi as ti

from taichi_sand.effects.water.grid import mirror
from taichi_sand.world.geometry import add, at_least, at_most

WIDTH = 0.75
"""Of the kernel, over the diameter: the middle of a boulder is then as dense as a bed, 0.5."""


@ti.func
def node_inside(i, last):
    """Node i, or the nearest there is: of a grain far outside."""
    return ti.max(1, ti.min(last, i))


@ti.func
def width_of(f: ti.template(), diameter):
    """Width of the kernel of a grain, over that of a cell: of a small one that of all."""
    return ti.max(f.now[None].spread, WIDTH * diameter / ti.min(f.now[None].width, f.now[None].height))


@ti.func
def spline(away):
    """Quadratic spline at a distance, over its width."""
    return ti.select(away < 0.5, 0.75 - away * away, 0.5 * at_least(0.0, 1.5 - away) ** 2)


@ti.func
def extent(x, width):
    """The first node that a kernel of this width at x reaches, how many more, and the sum of its weights."""
    first = ti.ceil(x - 1.5 * width, ti.i32)
    count = ti.floor(x + 1.5 * width, ti.i32) - first
    total = 0.0
    for k in range(count + 1):
        total += spline(ti.abs(first + k - x) / width)
    return first, count, total


@ti.func
def place_in(f: ti.template(), c: ti.template(), p):
    """Where a place is among the nodes of component c (2: middles of cells)."""
    return p.x + ti.static(0.5 if c == 0 else 0.0), p.y + ti.static(0.5 if c == 1 else 0.0)


@ti.func
def row_of_node(f: ti.template(), c: ti.template(), i, j):
    """Row of the node of component c that bears what falls on (i, j), and its volume, over a cell: half of one in an edge."""
    now = f.now[None]
    last_x, last_y = now.columns + ti.static(int(c == 0)), now.rows + ti.static(int(c == 1))
    a = node_inside(mirror(i, now.columns, ti.static(c == 0), f.wraps[0]), last_x)
    b = node_inside(mirror(j, now.rows, ti.static(c == 1), f.wraps[1]), last_y)
    volume = 1.0
    if ti.static(c < 2 and not f.wraps[c % 2]):
        at, last = (a, last_x) if ti.static(c == 0) else (b, last_y)
        volume = ti.select(at == 1 or at == last, 0.5, 1.0)
    return a * (now.rows + 2) + b, volume


@ti.func
def deal_wide(f: ti.template(), c: ti.template(), table: ti.template(), p, width, what):
    """Deals `what` to the nodes that a boulder at p reaches."""
    x, y = place_in(f, c, p)
    i, across, total_x = extent(x, width)
    j, up, total_y = extent(y, width)
    for a in range(across + 1):
        for b in range(up + 1):
            row, volume = row_of_node(f, c, i + a, j + b)
            weight = spline(ti.abs(i + a - x) / width) * spline(ti.abs(j + b - y) / width) / (total_x * total_y)
            add(table, row, weight / volume * what)


@ti.func
def gather_wide(f: ti.template(), c: ti.template(), table: ti.template(), p, width):
    """Mean of a table of 4-vectors over the nodes that a boulder at p reaches, and the sum of the squares of the weights."""
    x, y = place_in(f, c, p)
    i, across, total_x = extent(x, width)
    j, up, total_y = extent(y, width)
    found, squares = ti.Vector([0.0, 0.0, 0.0, 0.0]), 0.0
    for a in range(across + 1):
        for b in range(up + 1):
            row, _volume = row_of_node(f, c, i + a, j + b)
            weight = spline(ti.abs(i + a - x) / width) * spline(ti.abs(j + b - y) / width) / (total_x * total_y)
            found += weight * table[row]
            squares += weight * weight
    return found, squares


@ti.func
def mean_speed(f: ti.template(), c: ti.template(), speed: ti.template(), p, width):
    """Mean of the speeds of the faces that a boulder at p reaches."""
    x, y = place_in(f, c, p)
    i, across, total_x = extent(x, width)
    j, up, total_y = extent(y, width)
    found = 0.0
    for a in range(across + 1):
        for b in range(up + 1):
            row, _volume = row_of_node(f, c, i + a, j + b)
            found += spline(ti.abs(i + a - x) / width) * spline(ti.abs(j + b - y) / width) / (total_x * total_y) * speed[row]
    return found


@ti.func
def depth_for(diameter, wet):
    """How deep the middle of a disc lies of which `wet` is under a flat surface: Newton's way back from `drag.under` [m]."""
    x = at_least(-0.99, at_most(0.99, 2.0 * wet - 1.0))
    for _turn in ti.static(range(4)):
        part = 1.0 - (ti.acos(x) - x * ti.sqrt(1.0 - x * x)) / math.pi
        x = at_least(-0.999, at_most(0.999, x - (part - wet) * math.pi / (2.0 * ti.sqrt(1.0 - x * x))))
    far = ti.select(wet > 0.999, 1.0, ti.select(wet < 0.001, -1.0, 0.0))
    return 0.5 * diameter * (x + far)
