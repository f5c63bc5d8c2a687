"""Where things are: positions, the vector between the members of a pair, velocities at a contact."""

import taichi as ti

from taichi_sand.world.clumps import turned


@ti.func
def add(column: ti.template(), i, x):
    """column[i] += x with a plain read and write: in a parallel loop += would be an atomic, which costs ten times as much."""
    column[i] = column[i] + x


@ti.func
def position(w: ti.template(), i):
    """Centre of grain i [m]."""
    return (w.grains.site[i] + 0.5) * w.box[None].spacing + w.grains.offset[i] + w.grains.shift[i]


@ti.func
def velocity(w: ti.template(), i):
    """Velocity of grain i [m/s]."""
    return w.grains.twist[i].xy


@ti.func
def spin(w: ti.template(), i):
    """Angular velocity of grain i [rad/s]."""
    return w.grains.twist[i].z


@ti.func
def present(w: ti.template()):
    """Slots in use, but for those of sleepers, which lie behind."""
    count = w.count[None]
    if ti.static(w.sleeps):
        count = w.naps.state[None].awake
    return count


@ti.func
def mobility(w: ti.template(), i):
    """1/mass, 1/mass, 1/moment of inertia, 0 of grain i; of a sleeper, which answers to nothing, those it has awake."""
    own = w.grains.mobility[i]
    if ti.static(w.sleeps):
        if i >= w.naps.state[None].awake and w.naps.state[None].asleep > 0:
            own = w.naps.mobility[i]
    return own


@ti.func
def movable(w: ti.template(), i):
    """1 if grain i can be accelerated, 0 if it is fixed."""
    return ti.select(mobility(w, i).x > 0.0, 1.0, 0.0)


@ti.func
def wrench(force, arm_torque):
    """Force and torque as one 4-vector."""
    return ti.Vector([force.x, force.y, arm_torque, 0.0])


@ti.func
def couple(torque):
    """A torque alone, as a 4-vector."""
    return ti.Vector([0.0, 0.0, torque, 0.0])


@ti.func
def at_least(low, x):
    """The larger of both. ti.max also looks for NaN, which costs three instructions where this costs one."""
    return ti.select(x > low, x, low)


@ti.func
def at_most(high, x):
    """The smaller of both."""
    return ti.select(x < high, x, high)


@ti.func
def within(bound, x):
    """x, cut to -bound … bound."""
    cut = ti.select(x < bound, x, bound)
    return ti.select(cut > -bound, cut, -bound)


@ti.func
def perp(a):
    """a turned by +90 degrees."""
    return ti.Vector([-a.y, a.x])


@ti.func
def point_velocity(velocity, spin, arm):
    """Velocity of the point at `arm` from the centre: v + spin x arm (physics.md A6)."""
    return velocity + spin * perp(arm)


@ti.func
def rolling(w: ti.template(), i, j, wall: ti.template()):
    """Spin of the second grain as seen from the first [rad/s]; the radius that rolling goes with [m], that of the grain on a wall,
    R_i R_j / (R_i + R_j) between two grains; and the effective moment of inertia against it [kg m2].
    """
    roll, radius, give = -spin(w, i), w.grains.radius[i], w.grains.mobility[i].z
    if ti.static(not wall):
        roll += spin(w, j)
        radius *= w.grains.radius[j] / (radius + w.grains.radius[j])
        give += w.grains.mobility[j].z
    return roll, radius, 1.0 / give


@ti.func
def wall_row(w: ti.template(), p):
    """Row of wall pair p in the wall-only columns."""
    half = ti.cast(p >= w.half, ti.i32)
    if ti.static(w.sleeps):
        half += ti.cast(p >= 2 * w.half, ti.i32)
    return p - half * w.half - w.wall_base + half * w.wall_half


@ti.func
def moved(w: ti.template(), p, i, second: ti.template()):
    """Shift of grain i of pair p since the search; of a clump plus the arm of its disc."""
    shift = w.grains.shift[i]
    if ti.static(w.clumps):
        shift += turned(w, i, w.pairs.arms[p].zw if ti.static(second) else w.pairs.arms[p].xy)
    return shift


@ti.func
def distance_to_second(w: ti.template(), p, i, wall: ti.template()):
    """Distance [m] from the centre of the disc of grain i, first of pair p, to the second: a centre, or the nearest point of a wall.

    Returns the distance and the unit normal towards the second. A grain whose centre has crossed a wall gets a negative distance
    and is still pushed back to its side. A wall that does not face the grain is far away, and its side is wherever the grain is.
    """
    pairs = ti.static(w.pairs)
    normal = ti.Vector([0.0, 0.0])
    distance = 0.0
    if ti.static(wall):
        q = wall_row(w, p)
        along, side, bounds = pairs.along[q], pairs.side[q], pairs.bounds[q]
        shift = moved(w, p, i, False)
        rest = pairs.reach[p] - shift
        if side == 0.0:
            distance = ti.sqrt(rest.dot(rest)) + 1e-30
            normal = rest / distance
            if rest.dot(along) > 0.0 or rest.dot(bounds) > 0.0:
                distance = 1e30
        else:
            slid = along.dot(shift)
            normal = -side * perp(along)
            distance = rest.dot(normal)
            if slid < bounds.x or slid > bounds.y:
                distance = 1e30
                pairs.side[q] = ti.select(rest.dot(perp(along)) < 0.0, 1.0, -1.0)
    else:
        rest = pairs.reach[p] + (moved(w, p, pairs.second[p], True) - moved(w, p, i, False))
        square = rest.dot(rest) + 1e-30
        inverse = 1.0 / ti.sqrt(square)
        normal = rest * inverse
        distance = square * inverse
    return distance, normal
