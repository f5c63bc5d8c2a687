"""Within a block of the sweep: a function applied to each of its pairs, and to its grains."""

from dataclasses import dataclass
from typing import Any

import taichi as ti

from taichi_sand.taichi_support.noinline import noinline


@dataclass(frozen=True, eq=False)
class Sometimes:
    """A pair function of a sweep that is left out of it unless when(w): that is found out once a block."""

    pair: Any
    when: Any


def whole(one: Any) -> Any:
    """The pair function itself."""
    return one.pair if isinstance(one, Sometimes) else one


@ti.func
def wanted(w: ti.template(), one: ti.template()):
    """Whether pair function `one` of a sweep is to be called."""
    due = True
    if ti.static(isinstance(one, Sometimes)):
        due = one.when(w)
    return due


@ti.func
def block_count(w: ti.template()):
    """Blocks of the sweep that are in use, that of the sleepers or boulders included: together they hold every pair once."""
    count = w.blocks.pair_start.shape[0]
    if ti.static(w.layout == "cells"):
        count = w.grid.columns[None] * w.grid.rows[None] + ti.static(int(w.sleeps or w.boulders > 0))
    return count


@ti.func
def each_of_block(w: ti.template(), b, one: ti.template(), wall: ti.template(), s: ti.template(), c: ti.template()):
    """one(w, s, c, row, wall) on the pairs of block b, or on its pairs with walls."""
    if ti.static(wall):
        for p in range(w.blocks.wall_start[b], w.blocks.wall_end[b]):
            one(w, s, c, p, True)
    else:
        for p in range(w.blocks.pair_start[b], w.blocks.pair_end[b]):
            one(w, s, c, p, False)


@ti.func
def sweep_block(w: ti.template(), b, pair: ti.template(), s: ti.template(), c: ti.template()):
    """pair(w, s, c, row, wall) on all pairs that belong to block b; of several functions one after the other."""
    for one in ti.static(pair):
        if wanted(w, one):
            for wall in ti.static((False, True)):
                each_of_block(w, b, ti.static(whole(one)), wall, s, c)


@noinline
def run_pairs(w: ti.template(), s: ti.template(), one: ti.template(), wall: ti.template(), b: ti.i32, step: ti.f64):
    """The same for one function, on pairs or on those with walls, with the constants of the solver and this step [s]."""
    c = s.constants[None]
    c.step = ti.cast(step, w.real)
    each_of_block(w, b, one, wall, s, c)


@ti.func
def run_block(w: ti.template(), b, pair: ti.template(), s: ti.template(), c: ti.template()):
    """The functions pair = (f, …) of a solver on all pairs of block b, each compiled by itself. If `pair` is no tuple, it finds its way
    through the block by itself: pair(w, s, c, b).
    """
    if ti.static(isinstance(pair, tuple)):
        for one in ti.static(pair):
            if wanted(w, one):
                for wall in ti.static((False, True)):
                    run_pairs(w, s, ti.static(whole(one)), wall, b, c.step)
    else:
        pair(w, s, c, b)


@ti.func
def grains_of_block(w: ti.template(), b, grain: ti.template(), s: ti.template(), c: ti.template()):
    """grain(w, s, c, start, end) on the slots of block b."""
    grain(w, s, c, w.blocks.grain_start[b], w.blocks.grain_end[b])


@ti.func
def nothing(w: ti.template(), s: ti.template(), c: ti.template(), start, end):
    """Grain function of a sweep that only looks at pairs."""


def is_nothing(grain: Any) -> bool:
    """Whether that is the grain function."""
    return grain is nothing


@ti.func
def going(w: ti.template()):
    """Whether there is anything to do before the next list build."""
    return w.pace[None].spent == 0


@ti.func
def always(w: ti.template()):
    """A sweep that asks for nothing."""
    return True
