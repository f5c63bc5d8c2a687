"""The sweep: a function applied to every pair, block by block, colour by colour, then one applied to every grain.

Two blocks of one colour share no grain, so whatever a pair function does to its two grains it may do with plain writes, in a fixed
order. A block is the whole world ("one": a serial loop at the speed of C), a strip of columns ("strips": 2 colours), or a cell
("cells": 3 x 2 colours). The layout follows from the size of the world and the backend, never from the number of threads.

On a GPU every loop of a step is a launch. A step of md has 9, one of rigid 32, of about 15 and 10 microseconds on an NVIDIA H200, most
of it waiting for memory: the cells of a colour are worked on at once, but the pairs of a cell one after the other. So a step takes as
long whatever the number of grains, up to some 100000.
"""

from typing import Any

import taichi as ti

from taichi_sand.world.blocks import always, block_count, going, grains_of_block, is_nothing, nothing, run_block, sweep_block
from taichi_sand.world.geometry import present
from taichi_sand.world.tables import CHUNK, STRIPS

CELL_COLOURS = 6
CELL_THREADS = 32
"""Threads of a group on a GPU, where each has a cell: small groups spread over all of it, and a thread mostly waits for memory."""


@ti.func
def sweep(w: ti.template(), pair: ti.template(), grain: ti.template(), s: ti.template(), c: ti.template(), when: ti.template()):
    """The functions pair = (f, …), f(w, s, c, row, wall), on all pairs, then grain(w, s, c, start, end) on all grains, if when(w).

    To be called at the top level of a kernel (its loops are then the parallel ones), or, for the layout "one", inside a serial loop.
    """
    if ti.static(w.boulders > 0):
        sweep_boulders(w, pair, run_block, grain, s, c, when)
    if ti.static(w.layout == "one"):
        if when(w):
            run_block(w, 0, pair, s, c)
            grains_of_block(w, 0, grain, s, c)
    elif ti.static(w.layout == "strips"):
        sweep_strips(w, pair, grain, s, c, when)
    else:
        sweep_cells(w, pair, run_block, s, c, when)
        if ti.static(not is_nothing(grain)):
            each_grain(w, grain, s, c)


@ti.func
def sweep_boulders(
    w: ti.template(), pair: ti.template(), run: ti.template(), grain: ti.template(), s: ti.template(), c: ti.template(), when: ti.template()
):
    """The block of the boulders, by itself before all others; in cells the grain function comes later, with everybody's. `run` is
    `run_block` for functions of a solver, `sweep_block` for others.
    """
    ti.loop_config(serialize=True)
    for _run in range(1):
        if when(w):
            b = block_count(w) - 1
            run(w, b, pair, s, c)
            if ti.static(w.layout != "cells"):
                grains_of_block(w, b, grain, s, c)


@ti.func
def dealt(k):
    """Strip of one colour that task k works on: threads take halves, quarters, … of the tasks, and get every second, fourth, … strip."""
    half = ti.static(STRIPS // 4)
    return k % half * 2 + k // half


@ti.func
def starts_chunk(k):
    """Whether index k of a loop over blocks is the one that does the work. (All others cost as much as to find that out: by bits, a third
    of what the remainder of a number that may be negative costs, 20 us a loop.)
    """
    return k & ti.static(CHUNK - 1) == 0


@ti.func
def chunk_of(k):
    """Task of index k."""
    return k >> ti.static(CHUNK.bit_length() - 1)


@ti.func
def sweep_strips(w: ti.template(), pair: ti.template(), grain: ti.template(), s: ti.template(), c: ti.template(), when: ti.template()):
    """A strip's pairs reach into its own grains and the next strip's: after the even strips, an odd strip completes its own grains
    and those of the even strip that follows it, so that the grain function needs no loop of its own.
    """
    for k in range(STRIPS // 2 * CHUNK):
        if starts_chunk(k):
            b = 2 * dealt(chunk_of(k))
            if when(w):
                run_block(w, b, pair, s, c)
    for k in range(STRIPS // 2 * CHUNK):
        if starts_chunk(k):
            b = 2 * dealt(chunk_of(k)) + 1
            if when(w):
                run_block(w, b, pair, s, c)
                grains_of_block(w, b, grain, s, c)
                grains_of_block(w, (b + 1) % STRIPS, grain, s, c)


def sweeps_join(world: Any) -> bool:
    """Whether `sweep_twice` can take the place of two sweeps: in strips, unless a boulder's pairs reach across them, or walls move."""
    return world.layout == "strips" and not world.moves and world.boulders == 0


@ti.func
def sweep_twice(
    w: ti.template(),
    start: ti.template(),
    first: ti.template(),
    grain: ti.template(),
    second: ti.template(),
    s: ti.template(),
    when: ti.template(),
):
    """The grain function `start`, a sweep of `first` and `grain`, and a sweep of `second`, in three loops instead of five.

    A strip whose grains are complete goes on with `second` while it is in the caches: the odd strips so come first in that sweep.
    The constants are read once a strip: Taichi would read those of the kernel from memory for every pair.
    """
    for k in range(STRIPS // 2 * CHUNK):
        if starts_chunk(k):
            b = 2 * dealt(chunk_of(k))
            if when(w):
                c = s.constants[None]
                grains_of_block(w, b, start, s, c)
                grains_of_block(w, b + 1, start, s, c)
                run_block(w, b, first, s, c)
    for k in range(STRIPS // 2 * CHUNK):
        if starts_chunk(k):
            b = 2 * dealt(chunk_of(k)) + 1
            if when(w):
                c = s.constants[None]
                run_block(w, b, first, s, c)
                grains_of_block(w, b, grain, s, c)
                grains_of_block(w, (b + 1) % STRIPS, grain, s, c)
                run_block(w, b, second, s, c)
    for k in range(STRIPS // 2 * CHUNK):
        if starts_chunk(k):
            b = 2 * dealt(chunk_of(k))
            if when(w):
                c = s.constants[None]
                run_block(w, b, second, s, c)


@ti.func
def sweep_cells(w: ti.template(), pair: ti.template(), run: ti.template(), s: ti.template(), c: ti.template(), when: ti.template()):
    """Six colours of cells; colours are dealt so that neither the E nor the N, NE, SE neighbours of two cells of one colour meet.
    `run`: see `sweep_boulders`.

    The ranges do not depend on what is in the world: a GPU then starts no more threads than there can be work for, and needs no launch
    to find out how many.
    """
    for colour in ti.static(range(CELL_COLOURS)):
        ti.loop_config(block_dim=CELL_THREADS)
        for k in range(w.colour_cells):
            columns, rows = w.grid.columns[None], w.grid.rows[None]
            column, row = k // (rows // 3 + 1) * 2 + ti.static(colour // 3), k % (rows // 3 + 1) * 3 + ti.static(colour % 3)
            if column < columns and row < rows and when(w):
                run(w, column * rows + row, pair, s, c)


@ti.func
def pairs_awake(w: ti.template(), pair: ti.template(), s: ti.template(), c: ti.template()):
    """pair(w, s, c, row, wall) on all pairs but those among sleepers, between launches: block by block, or in colours of cells."""
    if ti.static(w.layout == "cells"):
        if ti.static(w.boulders > 0):
            sweep_boulders(w, (pair,), sweep_block, nothing, s, c, always)
        sweep_cells(w, (pair,), sweep_block, s, c, always)
    else:
        ti.loop_config(serialize=True)
        for b in range(block_count(w) - ti.static(int(w.sleeps))):
            sweep_block(w, b, (pair,), s, c)


@ti.func
def every_pair(w: ti.template(), pair: ti.template(), s: ti.template(), c: ti.template()):
    """pair(w, s, c, row, wall) on all pairs: those among sleepers, which know no colours, come last, one after the other."""
    pairs_awake(w, pair, s, c)
    if ti.static(w.sleeps):
        ti.loop_config(serialize=True)
        for _run in range(1):
            sweep_block(w, block_count(w) - 1, (pair,), s, c)


@ti.func
def each_pair(w: ti.template(), pair: ti.template(), s: ti.template(), c: ti.template(), when: ti.template()):
    """The functions pair = (f, …), f(w, s, c, row, wall), which write to nothing but their row, on all pairs but those among sleepers, if
    when(w): in cells, which need no colours for that.
    """
    for b in range(w.blocks.pair_start.shape[0]):
        if b < block_count(w) - ti.static(int(w.sleeps)) and when(w):
            sweep_block(w, b, pair, s, c)


@ti.func
def each_grain(w: ti.template(), grain: ti.template(), s: ti.template(), c: ti.template()):
    """grain(w, s, c, start, end) on all grains, in the chunks that suit the layout."""
    if ti.static(w.boulders > 0):
        sweep_boulders(w, (), run_block, grain, s, c, going)
    if ti.static(w.layout == "one"):
        grains_of_block(w, 0, grain, s, c)
    elif ti.static(w.layout == "strips"):
        for k in range(STRIPS * CHUNK):
            if starts_chunk(k) and going(w):
                grains_of_block(w, chunk_of(k), grain, s, c)
    else:
        for i in range(w.capacity):
            if i < present(w) and going(w):
                grain(w, s, c, i, i + 1)
