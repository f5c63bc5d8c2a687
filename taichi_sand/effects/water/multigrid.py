"""Conjugate gradients, with a multigrid as preconditioner: 6 to 8 iterations whatever the size.

The multigrid joins 2 x 2 cells to one without smoothing (aggregation), makes up for that by weaker coarse matrices (Braess 1995: over
1.8), and smooths by red-black Gauss-Seidel, forwards on the way down and backwards on the way up, so that it is symmetric.
"""

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.geometry import add

WEAKER = 1.8
MOST_ROUNDS = 100
LAST_SWEEPS = 4
"""Sweeps each way on the coarsest grid."""


@ti.func
def applied(f: ti.template(), x: ti.template(), row, stride):
    """The off-diagonal part of the matrix times x, with the sign that makes it positive."""
    cells = ti.static(f.cells)
    sides = cells.left[row] * x[row - stride] + cells.left[row + stride] * x[row + stride]
    return sides + cells.below[row] * x[row - 1] + cells.below[row + 1] * x[row + 1]


@ti.func
def wrap(f: ti.template(), x: ti.template(), level):
    """In a periodic box what lies beyond the edges of a grid is what lies on the other side."""
    if ti.static(f.wraps[0] or f.wraps[1]):
        columns, rows, first = level[0], level[1], level[2]
        stride = rows + 2
        if ti.static(f.wraps[0]):
            for j in range(1, rows + 1):
                x[first + j] = x[first + columns * stride + j]
                x[first + (columns + 1) * stride + j] = x[first + stride + j]
        if ti.static(f.wraps[1]):
            for i in range(1, columns + 1):
                x[first + i * stride] = x[first + i * stride + rows]
                x[first + i * stride + rows + 1] = x[first + i * stride + 1]


@ti.func
def close_matrix(f: ti.template(), level):
    """The coupling across a periodic edge belongs to the cells on both sides of it."""
    columns, rows, first = level[0], level[1], level[2]
    stride = rows + 2
    if ti.static(f.wraps[0]):
        for j in range(1, rows + 1):
            f.cells.left[first + (columns + 1) * stride + j] = f.cells.left[first + stride + j]
    if ti.static(f.wraps[1]):
        for i in range(1, columns + 1):
            f.cells.below[first + i * stride + rows + 1] = f.cells.below[first + i * stride + 1]


@ti.func
def smooth(f: ti.template(), level, forwards):
    """One sweep of red-black Gauss-Seidel over a grid."""
    cells = ti.static(f.cells)
    columns, rows, first = level[0], level[1], level[2]
    stride = rows + 2
    for turn in range(2):
        colour = turn if forwards else 1 - turn
        for i in range(1, columns + 1):
            for k in range((rows + 1) // 2):
                j = 1 + 2 * k + (i + colour) % 2
                row = first + i * stride + j
                if j <= rows and cells.middle[row] > 0.0:
                    cells.answer[row] = (cells.rest[row] + applied(f, cells.answer, row, stride)) / cells.middle[row]
        wrap(f, cells.answer, level)


@noinline
def coarsen(f: ti.template()):
    """The matrices of the coarser grids."""
    cells = ti.static(f.cells)
    for n in range(1, f.now[None].levels):
        fine, coarse = f.levels[n - 1], f.levels[n]
        stride, wide = fine[1] + 2, coarse[1] + 2
        for row in range(coarse[2], coarse[2] + (coarse[0] + 2) * wide):
            cells.middle[row], cells.left[row], cells.below[row] = 0.0, 0.0, 0.0
        for i in range(1, fine[0] + 1):
            for j in range(1, fine[1] + 1):
                row, to = fine[2] + i * stride + j, coarse[2] + (i + 1) // 2 * wide + (j + 1) // 2
                whole = cells.middle[row]
                if i % 2 == 0:
                    whole -= 2.0 * cells.left[row]
                else:
                    add(cells.left, to, cells.left[row] / WEAKER)
                if j % 2 == 0:
                    whole -= 2.0 * cells.below[row]
                else:
                    add(cells.below, to, cells.below[row] / WEAKER)
                add(cells.middle, to, whole / WEAKER)
        close_matrix(f, coarse)


@noinline
def descend(f: ti.template()):
    """From the finest grid to the coarsest: smooths, and hands what is left to the next one."""
    cells = ti.static(f.cells)
    levels = f.now[None].levels
    for n in range(levels):
        fine = f.levels[n]
        stride = fine[1] + 2
        for row in range(fine[2], fine[2] + (fine[0] + 2) * stride):
            cells.answer[row] = 0.0
        smooth(f, fine, True)
        if n < levels - 1:
            coarse = f.levels[n + 1]
            wide = coarse[1] + 2
            for row in range(coarse[2], coarse[2] + (coarse[0] + 2) * wide):
                cells.rest[row] = 0.0
            for i in range(1, fine[0] + 1):
                for j in range(1, fine[1] + 1):
                    row = fine[2] + i * stride + j
                    if cells.middle[row] > 0.0:
                        left = cells.rest[row] - cells.middle[row] * cells.answer[row] + applied(f, cells.answer, row, stride)
                        add(cells.rest, coarse[2] + (i + 1) // 2 * wide + (j + 1) // 2, left)


@noinline
def ascend(f: ti.template()):
    """Back to the finest grid: takes over what the coarser one has found, and smooths."""
    cells = ti.static(f.cells)
    last = f.now[None].levels - 1
    for turn in range(2 * LAST_SWEEPS - 1):
        smooth(f, f.levels[last], turn % 2 == 1)
    for k in range(last):
        fine, coarse = f.levels[last - 1 - k], f.levels[last - k]
        stride, wide = fine[1] + 2, coarse[1] + 2
        for i in range(1, fine[0] + 1):
            for j in range(1, fine[1] + 1):
                row = fine[2] + i * stride + j
                if cells.middle[row] > 0.0:
                    add(cells.answer, row, cells.answer[coarse[2] + (i + 1) // 2 * wide + (j + 1) // 2])
        wrap(f, cells.answer, fine)
        smooth(f, fine, False)


@ti.func
def residual(f: ti.template()):
    """Right-hand side less the matrix times the pressure, in place; the largest of it [1/s]."""
    cells = ti.static(f.cells)
    level = f.levels[0]
    stride, worst = level[1] + 2, 0.0
    wrap(f, cells.pressure, level)
    for i in range(1, level[0] + 1):
        for j in range(1, level[1] + 1):
            row = i * stride + j
            if cells.middle[row] > 0.0:
                left = cells.rest[row] - cells.middle[row] * cells.pressure[row] + applied(f, cells.pressure, row, stride)
                cells.rest[row] = left
                worst = ti.max(worst, ti.abs(left))
    return worst


@ti.func
def turn(f: ti.template(), before):
    """The next direction of the conjugate gradients, and r·z; `before` is the r·z of the last one, 0 at the start."""
    cells = ti.static(f.cells)
    level = f.levels[0]
    total = 0.0
    for row in range((level[0] + 2) * (level[1] + 2)):
        if cells.middle[row] > 0.0:
            total += cells.answer[row] * cells.rest[row]
    keep = total / before if before != 0.0 else 0.0
    for row in range((level[0] + 2) * (level[1] + 2)):
        cells.way[row] = ti.select(cells.middle[row] > 0.0, cells.answer[row] + keep * cells.way[row], 0.0)
    wrap(f, cells.way, level)
    return total


@ti.func
def march(f: ti.template(), product):
    """A step along the direction; the largest residual after it [1/s]."""
    cells = ti.static(f.cells)
    level = f.levels[0]
    stride, bend, worst = level[1] + 2, 0.0, 0.0
    for i in range(1, level[0] + 1):
        for j in range(1, level[1] + 1):
            row = i * stride + j
            if cells.middle[row] > 0.0:
                cells.image[row] = cells.middle[row] * cells.way[row] - applied(f, cells.way, row, stride)
                bend += cells.image[row] * cells.way[row]
    length = product / bend if bend > 0.0 else 0.0
    for row in range((level[0] + 2) * stride):
        if cells.middle[row] > 0.0:
            add(cells.pressure, row, length * cells.way[row])
            add(cells.rest, row, -length * cells.image[row])
            worst = ti.max(worst, ti.abs(cells.rest[row]))
    return worst


@ti.func
def solve(f: ti.template(), accuracy):
    """Finds the pressure whose residual is nowhere larger than `accuracy` [1/s]."""
    close_matrix(f, f.levels[0])
    left, product, rounds = residual(f), 0.0, 0
    if left > accuracy:
        coarsen(f)
    while left > accuracy and rounds < MOST_ROUNDS:
        descend(f)
        ascend(f)
        product = turn(f, product)
        left = march(f, product)
        rounds += 1
    wrap(f, f.cells.pressure, f.levels[0])
    f.now[None].rounds, f.now[None].left = rounds, left
