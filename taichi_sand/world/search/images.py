"""Images of the grains beyond periodic edges, where they slide: with `edges.shear_rate` those above a box run to the right as they are, by
γ̇ times its height, and those below to the left (Lees and Edwards 1972). This is the one place that knows how far they are.

A grain that leaves upwards comes in below, shifted and slower by what its image above is ahead and faster. Pairs that reach over the lower
or the upper edge know that (`pairs.over`): the second is its own image `over` boxes above.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.taichi_support import field_pool


def shear_type(real: Any) -> Any:
    """Struct of what images above the box do."""
    return ti.types.struct(
        speed=real,  # by which they are faster [m/s]
        offset=real,  # how far they were to the right at the last list build, less whole boxes [m]
        slid=real,  # how far they have run since [m]
    )


def lay_images(scene: Any, real: Any) -> dict[str, Any]:
    """How images slide, as members of a world."""
    rate = scene.edges.shear_rate
    if not rate:
        return {"sheared": False, "shear": None}
    shear = field_pool.record(shear_type(real))
    shear[None] = {"speed": rate * scene.size[1], "offset": 0.0, "slid": 0.0}
    return {"sheared": True, "shear": shear}


def offset_of(world: Any) -> float:
    """How far the images above the box are to the right now [m]."""
    return float(world.shear[None].offset + world.shear[None].slid) if world.sheared else 0.0


def nearest(way: np.ndarray, world: Any, size: Any) -> np.ndarray:
    """Ways (n, 2) between two grains of a box of `size`, by the shortest image [m]."""
    way = np.array(way, float)
    turns = np.round(way[:, 1] / size[1]) * world.periodic[1]
    way -= np.stack([turns * offset_of(world), turns * size[1]], axis=1)
    way[:, 0] -= np.round(way[:, 0] / size[0]) * size[0] * world.periodic[0]
    return way


def folded(place: np.ndarray, world: Any, size: Any) -> np.ndarray:
    """Places (n, 2), within the box where it is periodic [m]."""
    turns = np.floor(place[:, 1] / size[1]) * world.periodic[1]
    found = place - np.stack([turns * offset_of(world), turns * size[1]], axis=1)
    found[:, 0] -= np.floor(found[:, 0] / size[0]) * size[0] * world.periodic[0]
    return found


@ti.func
def fold(w: ti.template(), place, size):
    """A place within the box where it is periodic [m]; `size` of the box in the type to compute in."""
    found = place
    if ti.static(w.periodic[1]):
        turns = ti.floor(found.y / size.y)
        found.y -= turns * size.y
        if ti.static(w.sheared):
            found.x -= turns * (w.shear[None].offset + w.shear[None].slid)
    if ti.static(w.periodic[0]):
        found.x -= ti.floor(found.x / size.x) * size.x
    return found


@ti.func
def seen(w: ti.template(), x, y, u):
    """Way along x, and speed along it, to the image of what is (x, y) off and moves by u along x that is nearest along y. Of numbers, or
    of vectors of them; the way along x may be whole boxes too long.
    """
    turns = ti.floor(y / w.box[None].size.y + 0.5)
    return x - turns * w.shear[None].offset, u - turns * w.shear[None].speed


@ti.func
def slide(w: ti.template(), ahead):
    """Images are where they are `ahead` of this step, 0 … 1."""
    if ti.static(w.sheared):
        if w.pace[None].spent == 0:
            w.shear[None].slid = w.shear[None].speed * (ti.cast(w.pace[None].since, w.real) + ahead) * w.pace[None].step


@ti.func
def start_images(w: ti.template()):
    """In a list build: where the images are is where they start from now."""
    if ti.static(w.sheared):
        shear, width = w.shear[None], w.box[None].size.x
        offset = shear.offset + shear.slid
        w.shear[None].offset = offset - ti.floor(offset / width) * width
        w.shear[None].slid = 0.0


@ti.func
def moved_over(w: ti.template(), i, place, hop):
    """Takes grain i, whose offset would be `place` and which is `hop` sites on, over the lower or upper edge if it is beyond: its image
    goes on. Returns both anew.
    """
    box, shear = w.box[None], w.shear[None]
    turns = ti.floor((ti.cast(w.grains.site[i].y, w.real) + hop.y) / box.sites.y)
    here, sites = place, hop
    if turns != 0.0:
        here.x -= turns * shear.offset
        sites.x = ti.floor(here.x / box.spacing.x + 0.5)
        w.grains.twist[i].x -= turns * shear.speed
    return here, sites


@ti.func
def ahead_of(w: ti.template(), p):
    """How far the second of pair p of two grains has been run ahead by its image since the list build [m], and how fast that runs [m/s]."""
    return w.pairs.over[p] * w.shear[None].slid, w.pairs.over[p] * w.shear[None].speed


@ti.func
def column_over(w: ti.template(), column, far):
    """Of the images above, the first of the columns of cells whose grains may be met from this column; with the next three."""
    return column - 2 - columns_slid(w) + far


@ti.func
def column_below(w: ti.template(), column, far):
    """Of the top row, the first of the columns of cells whose grains list those of this column of the lowest row; with the next three."""
    return column - 1 + columns_slid(w) + far


@ti.func
def columns_slid(w: ti.template()):
    """Whole columns of cells by which the images above are to the right."""
    return ti.cast(ti.floor(w.shear[None].offset / w.grid.cell_size[None].x), ti.i32)
