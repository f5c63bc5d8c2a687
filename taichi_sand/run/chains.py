"""Whether the rows of tables that are linked one to the next are so as they can be: kernels follow them until they end."""

from collections.abc import Iterator

import numpy as np

from taichi_sand.world.tables import World


def chains(world: World, of: dict[str, np.ndarray]) -> Iterator[str]:
    """What is wrong with those of the tables `of` a checkpoint."""
    if "pairs.driven" in of:
        yield _driven(world, of["pairs.driven"], int(of["movers.first"]))
    if "movers.next" in of:
        yield _entries(of["movers.site"][: int(of["movers.count"])], of["movers.head"], of["movers.next"])
    for name in ("strays.next", "strays.wall_next", "strays.next_partner"):
        if name in of:
            halves = of[name].reshape(2, -1)
            if (halves > np.arange(halves.shape[1])).any():
                yield f"{name} leads on to a row that was listed later"


def _entries(site: np.ndarray, head: np.ndarray, following: np.ndarray) -> str:
    """Whether the moving walls listed at each lattice site are those that lie there, from the last to the first, in words, or ""."""
    order = np.argsort(site, kind="stable")
    first = np.diff(site[order], prepend=-1) != 0
    wanted, last = np.empty(len(site), np.int64), np.full(len(head), -1)
    wanted[order] = np.where(first, -1, np.roll(order, 1))
    last[site[order]] = order  # of several the last
    if (following[: len(site)] != wanted).any() or (head != last).any():
        return "movers.head and movers.next do not list what movers.site holds"
    return ""


def _driven(world: World, following: np.ndarray, row: int) -> str:
    """Whether the rows of walls with force, linked from the last one to the first, leave those of walls or run in a circle, or ""."""
    last = int(world.pairs.first.shape[0])
    while row >= 0:
        part, place = divmod(row, world.half)
        if row >= last:
            return "pairs.driven runs in a circle"
        if place < world.wall_base:
            return "pairs.driven leads to a row that is about no wall"
        last, row = row, int(following[part * world.wall_half + place - world.wall_base])
    return ""
