"""Where things are: positions, the vector between the members of a pair, velocities at a contact."""

import taichi as ti

from taichi_sand.world.clumps import levers, turned
from taichi_sand.world.search.images import ahead_of


@ti.func
def add(column: ti.template(), i, x):
    """column[i] += x with a plain read and write: in a parallel loop, and in all that is compiled by itself (taichi_support.noinline), +=
    would be an atomic, which costs ten times as much.
    """
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
        count = w.sleep.state[None].awake
    return count


@ti.func
def mobility(w: ti.template(), i):
    """1/mass, 1/mass, 1/moment of inertia, 0 of grain i; of a sleeper, which answers to nothing, those it has awake."""
    own = w.grains.mobility[i]
    if ti.static(w.sleeps):
        if i >= w.sleep.state[None].awake and w.sleep.state[None].asleep > 0:
            own = w.sleep.mobility[i]
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
def motion_of(w: ti.template(), p, i, j, distance, normal, wall: ti.template()):
    """Velocity of the second of pair p as seen from the first [m/s]: of the grains' centres; of a wall at the contact."""
    motion = -velocity(w, i) if ti.static(wall) else velocity(w, j) - velocity(w, i)
    if ti.static(w.sheared and not wall):
        _way, speed = ahead_of(w, p)
        motion.x += speed
    if ti.static(wall and w.moves):
        motion += wall_velocity(w, p, i, distance, normal)
    if ti.static(wall and w.walls.belts):
        motion += belt_velocity(w, p, normal)
    return motion


@ti.func
def belt_velocity(w: ti.template(), p, normal):
    """Velocity of the surface of a wall, as seen from the wall, where pair p touches it [m/s]."""
    surface = w.walls.surface[w.pairs.second[p]]
    return surface - surface.dot(normal) * normal


@ti.func
def wall_velocity(w: ti.template(), p, i, distance, normal):
    """Velocity of a wall that may move where pair p touches it [m/s]."""
    v = ti.Vector([0.0, 0.0])
    m = w.movers.wall[w.pairs.second[p]]
    if m >= 0:
        v = carried_along(w, p, i, m, distance, normal, w.movers.twist[m])
    return v


@ti.func
def carried_along(w: ti.template(), p, i, m, distance, normal, twist):
    """Velocity of moving wall m where pair p touches it, if it moves like this: velocity of its pivot, and spin [m/s]."""
    touch = moved(w, p, i, False) + at_most(w.pairs.contact_distance[p], distance) * normal
    return point_velocity(twist.xy, twist.z, touch - w.pairs.hinge[wall_row(w, p)] - w.movers.pose[m].zw)


@ti.func
def rolling(w: ti.template(), p, i, j, wall: ti.template()):
    """Spin of the second grain as seen from the first [rad/s]; the radius that rolling goes with [m], that of the grain on a wall,
    R_i R_j / (R_i + R_j) between two grains; and the effective moment of inertia against it [kg m2].
    """
    roll, radius, give = -spin(w, i), w.grains.radius[i], w.grains.mobility[i].z
    if ti.static(wall and w.moves):
        m = w.movers.wall[w.pairs.second[p]]
        if m >= 0:
            roll += w.movers.twist[m].z
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
def radii(w: ti.template(), p, wall: ti.template()):
    """Sum of the radii of the discs of pair p, of a wall pair that of its disc [m], however far its contact has yet to grow."""
    total = w.pairs.contact_distance[p]
    if ti.static(w.yields):
        if ti.static(w.clumps):
            total = w.pairs.rims[p].x + w.pairs.rims[p].y
        else:
            total = w.grains.radius[w.pairs.first[p]]
            if ti.static(not wall):
                total += w.grains.radius[w.pairs.second[p]]
    return total


@ti.func
def moved(w: ti.template(), p, i, second: ti.template()):
    """Shift of grain i of pair p since the list build; of a clump plus the arm of its disc."""
    shift = w.grains.shift[i]
    if ti.static(w.clumps):
        shift += turned(w, i, w.pairs.arms[p].zw if ti.static(second) else w.pairs.arms[p].xy)
    return shift


@ti.func
def turned_by(pose, a):
    """a turned by the angle of which `pose` has cosine and sine."""
    return ti.Vector([pose.x * a.x - pose.y * a.y, pose.y * a.x + pose.x * a.y])


@ti.func
def wall_now(w: ti.template(), p, q, side):
    """Point, `along` and `bounds` of wall pair p, row q of the wall-only columns, where the wall is now; the point from where the
    grain was at the list build [m].
    """
    pairs = ti.static(w.pairs)
    reach, along, bounds = pairs.reach[p], pairs.along[q], pairs.bounds[q]
    if ti.static(w.moves):
        m = w.movers.wall[pairs.second[p]]
        if m >= 0:
            pose = w.movers.pose[m]
            reach = pairs.hinge[q] + pose.zw + turned_by(pose, reach - pairs.hinge[q])
            along = turned_by(pose, along)
            if side == 0.0:
                bounds = turned_by(pose, bounds)
    return reach, along, bounds


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
        side = pairs.side[q]
        reach, along, bounds = wall_now(w, p, q, side)
        shift = moved(w, p, i, False)
        rest = reach - shift
        if side == 0.0:
            distance = ti.sqrt(rest.dot(rest)) + 1e-30
            normal = rest / distance
            if rest.dot(along) > 0.0 or rest.dot(bounds) > 0.0:
                distance = 1e30
        else:
            slid = along.dot(shift)
            if ti.static(w.moves):  # along the wall as it stands now
                slid = pairs.along[q].dot(pairs.reach[p]) - along.dot(rest)
            normal = -side * perp(along)
            distance = rest.dot(normal)
            bounds += side * distance * pairs.slopes[q]
            if slid < bounds.x or slid >= bounds.y:  # where one line ends, the next one begins
                distance = 1e30
                pairs.side[q] = ti.select(rest.dot(perp(along)) < 0.0, 1.0, -1.0)
    else:
        rest = pairs.reach[p] + (moved(w, p, pairs.second[p], True) - moved(w, p, i, False))
        if ti.static(w.sheared):
            way, _speed = ahead_of(w, p)
            rest.x += way
        square = rest.dot(rest) + 1e-30
        inverse = 1.0 / ti.sqrt(square)
        normal = rest * inverse
        distance = square * inverse
    return distance, normal


@ti.func
def weigh_clumps(w: ti.template(), p, i, j, wall: ti.template()):
    """Levers and effective masses of pair p of clumps at its present normal."""
    pairs = ti.static(w.pairs)
    lever = levers(w, p, i, j, pairs.normal[p], pairs.rims[p].x, pairs.rims[p].y, wall)
    give = mobility(w, i)
    weight, turning, tilting = give.x, give.z * lever.x**2, give.z * lever.z**2
    if ti.static(not wall):
        give = mobility(w, j)
        weight += give.x
        turning += give.z * lever.y**2
        tilting += give.z * lever.w**2
    pairs.levers[p] = lever
    pairs.mass[p], pairs.mass_t[p] = 1.0 / (weight + tilting + 1e-30), 1.0 / (weight + turning + 1e-30)
    pairs.root_mass[p] = ti.sqrt(pairs.mass[p])
