"""How grains are dealt to the faces around them, and what they find there: a quadratic spline, at walls folded back into the box."""

import taichi as ti

from taichi_sand.effects.water.boulders import node_inside
from taichi_sand.effects.water.grid import mirror
from taichi_sand.world.geometry import add, at_least


@ti.func
def spline(f: ti.template(), x):
    """The first node that a grain at x reaches, and its weights on that and the next ones, which sum up to 1."""
    middle = ti.floor(x + 0.5, ti.i32)
    weights = ti.Vector([0.0 for _ in range(ti.static(2 * f.reach + 1))])
    if ti.static(f.reach == 1):  # as wide as a cell
        d = x - middle
        weights[0], weights[1], weights[2] = 0.5 * (0.5 - d) * (0.5 - d), 0.75 - d * d, 0.5 * (0.5 + d) * (0.5 + d)
    else:
        for k in ti.static(range(2 * f.reach + 1)):
            away = ti.abs(middle + (k - f.reach) - x) / f.now[None].spread
            weights[k] = ti.select(away < 0.5, 0.75 - away * away, 0.5 * at_least(0.0, 1.5 - away) ** 2)
        weights /= weights.sum()
    return middle - f.reach, weights


@ti.func
def reach_of(f: ti.template(), c: ti.template(), p):
    """The nodes of component c that a grain at p reaches, which are rows[0][k] + rows[1][q], their weights, which are weights[0][k] *
    weights[1][q], and weights[2][k] that stand for weights[c][k] in dealing: the volume of a node in an edge is half a cell.
    """
    now = f.now[None]
    i, across = spline(f, p.x + ti.static(0.5 if c == 0 else 0.0))
    j, up = spline(f, p.y + ti.static(0.5 if c == 1 else 0.0))
    nodes = ti.static(2 * f.reach + 1)
    stride = now.rows + 2
    columns, rows = ti.Vector([(i + k) * stride for k in range(nodes)]), ti.Vector([j + k for k in range(nodes)])
    dealt = across if ti.static(c == 0) else up
    if i < 2 or j < 2 or i + nodes > now.columns or j + nodes > now.rows:  # it reaches an edge
        for k in ti.static(range(nodes)):
            a = node_inside(mirror(i + k, now.columns, ti.static(c == 0), f.wraps[0]), now.columns + ti.static(int(c == 0)))
            b = node_inside(mirror(j + k, now.rows, ti.static(c == 1), f.wraps[1]), now.rows + ti.static(int(c == 1)))
            columns[k], rows[k] = a * stride, b
            at, last = (a, now.columns + 1) if ti.static(c == 0) else (b, now.rows + 1)
            if ti.static(not f.wraps[c]):
                dealt[k] *= ti.select(at == 1 or at == last, 2.0, 1.0)
    return columns, rows, across, up, dealt


@ti.func
def deal_to(f: ti.template(), c: ti.template(), table: ti.template(), reach: ti.template(), what):
    """Deals `what` to the nodes that a grain reaches."""
    columns, rows, across, up, dealt = reach
    one, two = (dealt, up) if ti.static(c == 0) else (across, dealt)
    for k in ti.static(range(2 * f.reach + 1)):
        for q in ti.static(range(2 * f.reach + 1)):
            add(table, columns[k] + rows[q], one[k] * two[q] * what)


@ti.func
def around(f: ti.template(), faces: ti.template(), reach: ti.template(), share):
    """Speed of the faces that a grain reaches, their solid fraction, and what of that the grain itself makes."""
    columns, rows, across, up, _dealt = reach
    speed, crowd = 0.0, 0.0
    for k in ti.static(range(2 * f.reach + 1)):
        for q in ti.static(range(2 * f.reach + 1)):
            row, weight = columns[k] + rows[q], across[k] * up[q]
            speed += weight * faces.speed[row]
            crowd += weight * faces.solid[row][0]
    return speed, crowd, share * across.dot(across) * up.dot(up)
