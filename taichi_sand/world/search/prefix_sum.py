"""What a GPU needs to sort: prefix sums of a column, and rows put in order, both in parallel and to the same bits every time.

A loop on one thread, which on a CPU is the fastest way, takes a GPU some microsecond a row.
"""

import taichi as ti

RUN = 64
"""Rows that one thread sums."""


def levels_of(rows: int) -> tuple[tuple[int, int], ...]:
    """First row and number of the sums of each level, one level behind the other in a scratch column: of RUN rows of the column each, of
    RUN of these each, … until there is one.
    """
    levels, start = [], 0
    while not levels or rows > 1:
        rows = -(-rows // RUN)
        levels.append((start, rows))
        start += rows
    return tuple(levels)


def scratch_rows(rows: int) -> int:
    """Rows that the scratch column of a column of `rows` rows needs."""
    return sum(count for _, count in levels_of(rows))


@ti.func
def prefix_sum(column: ti.template(), sums: ti.template(), parallel: ti.template()):
    """Every row of `column` becomes the sum of the rows before it; `sums` is scratch. To be called at the top level of a kernel."""
    levels = ti.static(levels_of(column.shape[0]))
    for level in ti.static(range(len(levels))):
        ti.loop_config(serialize=not parallel)
        for k in range(ti.static(levels[level][1])):
            if ti.static(level == 0):
                sums[levels[0][0] + k] = sum_run(column, 0, k, column.shape[0])
            else:
                sums[levels[level][0] + k] = sum_run(sums, levels[level - 1][0], k, levels[level - 1][1])
    for back in ti.static(range(len(levels))):
        ti.loop_config(serialize=not parallel)
        for k in range(ti.static(levels[len(levels) - 1 - back][1])):
            level = ti.static(len(levels) - 1 - back)
            before = sums[levels[level][0] + k] if ti.static(back > 0) else 0
            if ti.static(level == 0):
                add_up(column, 0, k, column.shape[0], before)
            else:
                add_up(sums, levels[level - 1][0], k, levels[level - 1][1], before)


@ti.func
def sum_run(column: ti.template(), start: ti.template(), k, rows: ti.template()):
    """Sum of run k of the `rows` rows from `start` on."""
    total = 0
    for row in range(k * RUN, ti.min((k + 1) * RUN, rows)):
        total += column[start + row]
    return total


@ti.func
def add_up(column: ti.template(), start: ti.template(), k, rows: ti.template(), before):
    """Every row of run k becomes `before` and the sum of the rows of the run before it."""
    total = before
    for row in range(k * RUN, ti.min((k + 1) * RUN, rows)):
        value = column[start + row]
        column[start + row] = total
        total += value


@ti.func
def put_in_order(column: ti.template(), start, end):
    """Rows start .. end-1 in rising order: few, or nearly so already."""
    for k in range(start + 1, end):
        value = column[k]
        row = k
        while row > start and column[ti.max(row - 1, start)] > value:
            column[row] = column[row - 1]
            row -= 1
        column[row] = value
