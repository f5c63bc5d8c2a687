"""The ledger of energy: what contacts take out of the motion of the grains, kept only where an effect has the hook `heat`.

An impulse W on a grain changes its kinetic energy by W . (u + u')/2, u and u' its twists before and after: that is exact, and booked
grain by grain. Velocities are those of the middle between two places: what the rigid solver does before the grains move in a step, or
after, meets them with half a step's gravity less, or more, and so the sum is that of kinetic energy and m g h. But of two grains in
contact one may give to the other what is no heat yet. So what the load of a pair is about to do on either is set off against one
another, and what is left, the work on both together, is booked half to each; walls and fixed grains take none. Sums over all grains are
exact whatever is set off.
"""

import taichi as ti

from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.geometry import belt_velocity, movable, perp, wall_velocity, wrench


@ti.func
def book(w: ti.template(), s: ti.template(), i, energy):
    """Contacts have turned `energy` [J] of motion into heat of grain i."""
    for effect in ti.static(s.effects):
        if ti.static(offers(effect, "heat")):
            effect.heat(w, i, energy)


@ti.func
def split(w: ti.template(), s: ti.template(), i, j, energy, wall: ti.template()):
    """The pair of i and j has turned `energy` [J] into heat: half to each that can move."""
    if ti.static(wall):
        book(w, s, i, energy)
    else:
        one, two = movable(w, i), movable(w, j)
        share = energy / (one + two + 1e-30)  # rows that only fill up a lane have no grain that can move
        book(w, s, i, share * one)
        book(w, s, j, share * two)


@ti.func
def settle_work(w: ti.template(), s: ti.template(), i, impulse, change):
    """The impulses of contacts (x, y [N s], torque [N m s], 0) on grain i act in a kick that changes its twist by `change`."""
    if ti.static(s.books):
        book(w, s, i, -impulse.dot(w.grains.twist[i] + 0.5 * change))


@ti.func
def set_off(w: ti.template(), s: ti.template(), i, j, first, second, wall: ti.template()):
    """The pair of i and j stores the impulses `first` on i and `second` on j, which `settle_work` will book grain by grain."""
    if ti.static(s.books and not wall):
        one, two = first.dot(w.grains.twist[i]), second.dot(w.grains.twist[j])
        book(w, s, i, one)
        book(w, s, j, two)
        split(w, s, i, j, -one - two, wall)


@ti.func
def drive(w: ti.template(), s: ti.template(), p, distance, normal, impulse, wall: ti.template()):
    """Pair p gives an impulse (normal, tangential) [N s] to its second. What a wall that moves does against it is no heat lost."""
    if ti.static(s.books and wall and (w.moves or w.walls.belts)):
        i = w.pairs.first[p]
        v = ti.Vector([0.0, 0.0])
        if ti.static(w.moves):
            v += wall_velocity(w, p, i, distance, normal)
        if ti.static(w.walls.belts):
            v += belt_velocity(w, p, normal)
        book(w, s, i, -(impulse.x * v.dot(normal) + impulse.y * v.dot(perp(normal))))


@ti.func
def strike(w: ti.template(), s: ti.template(), i, j, first, second, moved: ti.template(), wall: ti.template()):
    """Applies the impulses `first` to grain i and `second` to grain j at once, and books what that costs: before they have `moved` in this
    step, or after.
    """
    g = ti.static(w.grains)
    if ti.static(s.books):
        half = (0.5 if ti.static(moved) else -0.5) * w.pace[None].step * wrench(w.box[None].gravity, 0.0)
        work = first.dot(g.twist[i] + half + 0.5 * first * g.mobility[i])
        if ti.static(not wall):
            work += second.dot(g.twist[j] + half + 0.5 * second * g.mobility[j])
        split(w, s, i, j, -work, wall)
    for k in ti.static(range(3)):  # LLVM shuffles a 4-vector together lane by lane, on the way from pair to pair: 12 % of a bed at rest
        g.twist[i][k] = g.twist[i][k] + first[k] * g.mobility[i][k]
        if ti.static(not wall):
            g.twist[j][k] = g.twist[j][k] + second[k] * g.mobility[j][k]
