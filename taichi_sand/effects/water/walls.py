"""Walls in the water, still ones and those that move: the faces that they block, and the lines that markers keep to.

A wall blocks a face if it passes between the middles of the cells on both sides: however it bends, no way is left from cell to cell. What
a moving wall does to the water is its speed along its normal: water slips along it. Markers keep to the wall itself: each square between
four middles knows the line from where the wall enters it to where it leaves, a marker counts for the middles on its own side, and none
passes the line, also while that moves. So every middle has room for another number of markers beside a wall, and a wall moves on from cell
to cell without a jump.
"""

import taichi as ti

from taichi_sand.effects.water.grid import EDGE, INSIDE, node
from taichi_sand.taichi_support.noinline import noinline
from taichi_sand.world.geometry import add
from taichi_sand.world.walls.motion import motion_at, pivot_at, turn_at

ASIDE = 0.00137
"""All walls are so far off where they are [cells]: many lie exactly on middles, where rounding would choose a side anew in every row."""
LONGER = 1e-3
"""Pieces of a wall overlap by so much [cells]: rounding leaves no gap."""
RIM, OFF = 0.02, 0.06
"""Markers stay so far from the edges of the box, and from walls inside it [cells]: the line in a square shifts by some hundredths of a cell
in a step where a bend of a wall passes."""
SHORTEST, DONE = 1e-3, 5
"""Crossings of a wall with two sides of a square make a line if they are so far apart [cells]; `Cells.met` once they have."""
SAMPLES = 4
"""Places each way in a square that it is found by how many markers a middle has room for."""


@noinline
def clear_walls(f: ti.template()):
    """No walls but the edges of the box."""
    now = f.now[None]
    stride = now.rows + 2
    for i in range(now.columns + 2):
        for j in range(now.rows + 2):
            row = i * stride + j
            f.u.block[row], f.u.wall[row] = edge(f, 0, i, now.columns + 1), 0.0
            f.v.block[row], f.v.wall[row] = edge(f, 1, j, now.rows + 1), 0.0
            f.cells.room[row], f.cells.met[row], f.lines[row] = 1.0, 0, ti.Vector([0.0, 0.0, 0.0, 0.0])


@ti.func
def edge(f: ti.template(), c: ti.template(), k, last):
    """EDGE if the k-th face along component c lies in an edge of the box that is a wall, else 0."""
    found = False
    if ti.static(not f.wraps[c] and not f.opens[2 * c]):
        found = found or k == 1
    if ti.static(not f.wraps[c] and not f.opens[2 * c + 1]):
        found = found or k == last
    return ti.select(found, EDGE, 0)


@ti.func
def wrapped(k, count, wraps: ti.template()):
    """Number k along a way of 1 .. count, or in a periodic box the one that it is."""
    found = k
    if ti.static(wraps):
        found = (k - 1 + 64 * count) % count + 1
    return found


@ti.func
def lay_line(f: ti.template(), i, j, link, point, velocity, normal, ahead: ti.template()):
    """A wall with this `normal` crosses the `link` (1 … 4) of the square whose lower left middle is (i, j) at `point` [cells], where it
    moves with `velocity` [cells/s]: the line there goes on to where it crosses another one. Where it only gets to `ahead`, as it is.
    """
    now = f.now[None]
    for a in ti.static(range(-1, 2) if f.wraps[0] else range(1)):
        for b in ti.static(range(-1, 2) if f.wraps[1] else range(1)):
            x, y = i + a * now.columns, j + b * now.rows
            if 0 <= x and x <= now.columns and 0 <= y and y <= now.rows:
                row = x * (now.rows + 2) + y
                place = ti.Vector([point.x + a * now.columns, point.y + b * now.rows])
                met = f.cells.met[row]
                if met == 0:
                    f.lines[row] = ti.Vector([normal.x, normal.y, normal.dot(place), normal.dot(velocity)])
                    f.hits[row] = ti.Vector([place.x, place.y, velocity.x, velocity.y])
                    f.cells.met[row] = ti.static(0 if ahead else 1) * link
                elif met < DONE and met != link and ti.static(not ahead):
                    way = place - f.hits[row].xy
                    if way.norm() > SHORTEST:
                        across = ti.Vector([-way.y, way.x]).normalized()
                        f.lines[row] = ti.Vector([across.x, across.y, across.dot(place), 0.5 * across.dot(velocity + f.hits[row].zw)])
                        f.cells.met[row] = DONE


@ti.func
def cross(f: ti.template(), c: ti.template(), one, two, shift, motion: ti.template(), ahead: ti.template()):
    """A piece of a wall from `one` to `two` [cells], with this `motion`, passes between middles that lie along component c: notes the line
    there, and its speed in the faces between them; or, if it will be `ahead` by `shift`, only the line.
    """
    now = f.now[None]
    faces, o = ti.static((f.u, f.v)[c], 1 - c)
    a, b = one + shift, two + shift
    counts = ti.Vector([now.columns, now.rows])
    normal = ti.Vector([one.y - two.y, two.x - one.x]).normalized()
    low, high = ti.min(a[o], b[o]), ti.max(a[o], b[o])
    first, last = ti.max(ti.ceil(low, ti.i32), -counts[o]), ti.min(ti.floor(high, ti.i32), 2 * counts[o])
    for j in range(first, last + 1):
        if high - low > 1e-9:
            point = a + (j - a[o]) / (b[o] - a[o]) * (b - a)
            k = ti.floor(point[c], ti.i32) + 1
            if -counts[c] <= k and k <= 2 * counts[c]:
                velocity = velocity_of(f, motion, point - shift)
                if ti.static(c == 0):
                    lay_line(f, k - 1, j, 1, point - shift, velocity, normal, ahead)
                    lay_line(f, k - 1, j - 1, 2, point - shift, velocity, normal, ahead)
                else:
                    lay_line(f, j, k - 1, 3, point - shift, velocity, normal, ahead)
                    lay_line(f, j - 1, k - 1, 4, point - shift, velocity, normal, ahead)
                if ti.static(not ahead):
                    face, along = wrapped(k, counts[c], f.wraps[c]), wrapped(j, counts[o], f.wraps[o])
                    if 1 <= face and face <= counts[c] + 1 and 1 <= along and along <= counts[o]:
                        row = face * (now.rows + 2) + along if ti.static(c == 0) else along * (now.rows + 2) + face
                        if faces.block[row] != EDGE:
                            size = ti.Vector([now.width, now.height])
                            faces.block[row], faces.wall[row] = INSIDE, normal[c] * normal.dot(velocity) * size[c]


@ti.func
def velocity_of(f: ti.template(), motion: ti.template(), place):
    """Of a wall at a place [cells/s]: `motion` is its pivot [m], the velocity of that [m/s] and its spin [rad/s]."""
    pivot, twist = motion
    size = ti.Vector([f.now[None].width, f.now[None].height])
    arm = (place - (0.5 + ASIDE)) * size - pivot
    return ti.Vector([twist.x - twist.z * arm.y, twist.y + twist.z * arm.x]) / size


@ti.func
def lay_piece(f: ti.template(), start, end, motion: ti.template(), time, ahead: ti.template()):
    """A straight piece of a wall [m] where it is now or, if `ahead`, where it will be within `time` [s]."""
    size = ti.Vector([f.now[None].width, f.now[None].height])
    one, two = start / size + (0.5 + ASIDE), end / size + (0.5 + ASIDE)
    length = (two - one).norm()
    if length > 1e-9:
        along = (two - one) / length
        one, two = one - LONGER * along, two + LONGER * along
        shift = 0.0 * along
        if ti.static(ahead):
            shift = time * velocity_of(f, motion, 0.5 * (one + two))
        for c in ti.static(range(2)):
            cross(f, c, one, two, shift, motion, ahead)


@noinline
def lay_still(w: ti.template(), f: ti.template()):
    """Walls that stand still, site by site of the lattice that they are listed by: of each what lies in the cell of the site."""
    box = w.box[None]
    walls = ti.static(w.walls)
    for site in range(box.sites.x * box.sites.y):
        for e in range(walls.start[site], walls.start[site + 1]):
            if walls.side[e] == 0:
                middle = (ti.Vector([site // box.sites.y, site % box.sites.y]) + 0.5) * box.spacing
                point, along, low, high = walls.point[e], walls.along[e], walls.bounds[e].x, walls.bounds[e].y
                apart = False
                for a in ti.static(range(2)):
                    half = 0.5 * box.spacing[a]
                    if ti.abs(along[a]) > 1e-9:
                        one, two = (-half - point[a]) / along[a], (half - point[a]) / along[a]
                        low, high = ti.max(low, ti.min(one, two)), ti.min(high, ti.max(one, two))
                    else:
                        apart = apart or ti.abs(point[a]) > half
                if low < high and not apart:
                    start, still = middle + point, (0.0 * along, ti.Vector([0.0, 0.0, 0.0, 0.0]))
                    lay_piece(f, start + low * along, start + high * along, still, 0.0, False)


@noinline
def lay_moving(w: ti.template(), f: ti.template(), ahead: ti.template()):
    """Walls that move, where they are now, or `ahead`: with what they will pass within the step."""
    movers = ti.static(w.movers)
    time = f.now[None].next
    for k in range(movers.parts[None]):
        m = movers.wall[movers.part[k]]
        if m >= 0 and movers.side[k] == 0:
            age = movers.age[m] + movers.since[m]
            turn, phase, tilt = turn_at(movers, m, age), movers.omega[m] * age, movers.beat[m] * age
            cos, sin = ti.cos(turn), ti.sin(turn)
            home, bounds, pivot = movers.home[k], movers.bounds[k], pivot_at(movers, m, age, phase)
            arm = ti.Vector([cos * home.x - sin * home.y, sin * home.x + cos * home.y])
            along = ti.Vector([cos * home.z - sin * home.w, sin * home.z + cos * home.w])
            start, end = pivot + arm + bounds.x * along, pivot + arm + bounds.y * along
            motion = (ti.cast(pivot, w.real), ti.cast(movers.rate[m] * motion_at(movers, m, phase, tilt), w.real))
            lay_piece(f, ti.cast(start, w.real), ti.cast(end, w.real), motion, time, ahead)


@ti.func
def fastest_mover(w: ti.template()):
    """No wall moves faster [m/s]."""
    found = 0.0
    if ti.static(w.moves):
        m_ = ti.static(w.movers)
        for m in range(m_.walls[None]):
            swing = m_.omega[m] * ti.sqrt(m_.amplitude[m].norm_sqr() + m_.swing[m].norm_sqr())
            swing += (ti.abs(m_.spin[m]) + m_.beat[m] * ti.abs(m_.rock[m])) * m_.lever[m]
            found = ti.max(found, ti.cast(m_.velocity[m].norm() + swing, w.real))
    return found


@ti.func
def line_at(f: ti.template(), p):
    """The line through the square that place p lies in; zeros if there is none."""
    now = f.now[None]
    i, j = ti.max(0, ti.min(now.columns, ti.floor(p.x, ti.i32))), ti.max(0, ti.min(now.rows, ti.floor(p.y, ti.i32)))
    return f.lines[i * (now.rows + 2) + j]


@ti.func
def own_side(f: ti.template(), p, shares):
    """The four `shares` in a square for a marker at p, only of those middles that lie on its side of a wall."""
    line = line_at(f, p)
    found = shares
    if line.x != 0.0 or line.y != 0.0:
        i, j = ti.floor(p.x), ti.floor(p.y)
        side = line.x * p.x + line.y * p.y - line.z
        for q in ti.static(range(4)):
            if (line.x * (i + q % 2) + line.y * (j + q // 2) - line.z) * side < 0.0:
                found[q] = 0.0
        total = found.sum()
        found = found / total if total > 1e-3 else shares
    return found


@ti.func
def kept_off(f: ti.template(), start, place, time):
    """Where a marker gets that wants from `start` to `place` within `time` [s] where there are walls, which move on meanwhile."""
    found = place
    for part in ti.static((0.5, 1.0, 1.0)):  # nor through one that it only passes on the way; in a corner off one, then off the other
        line = line_at(f, start + part * (found - start))
        if line.x != 0.0 or line.y != 0.0:
            before = line.x * start.x + line.y * start.y - line.z
            after = line.x * found.x + line.y * found.y - (line.z + line.w * time)
            side = ti.select(before < 0.0, -1.0, 1.0)
            if after * side < OFF:
                found -= (after - side * OFF) * line.xy
    return found


@noinline
def make_room(f: ti.template()):
    """How many markers the middles of cells beside walls have room for, over those of a cell."""
    now = f.now[None]
    for i in range(now.columns + 1):
        for j in range(now.rows + 1):
            line = f.lines[i * (now.rows + 2) + j]
            if line.x != 0.0 or line.y != 0.0:
                for n in range(SAMPLES * SAMPLES):
                    t = ti.Vector([n // SAMPLES + 0.5, n % SAMPLES + 0.5]) / SAMPLES
                    p = ti.Vector([i + t.x, j + t.y])
                    if 0.5 < p.x and p.x < now.columns + 0.5 and 0.5 < p.y and p.y < now.rows + 0.5:
                        whole = quarters(t)
                        shares = own_side(f, p, whole)
                        for q in ti.static(range(4)):
                            a = node(i + q % 2, now.columns, now.columns, f.wraps[0])
                            b = node(j + q // 2, now.rows, now.rows, f.wraps[1])
                            add(f.cells.room, a * (now.rows + 2) + b, (shares[q] - whole[q]) / SAMPLES**2)


@ti.func
def quarters(t):
    """Bilinear shares of the four corners of a square: lower left, right, upper left, right."""
    return ti.Vector([(1.0 - t.x) * (1.0 - t.y), t.x * (1.0 - t.y), (1.0 - t.x) * t.y, t.x * t.y])


@ti.func
def lay_walls(w: ti.template(), f: ti.template()):
    """Finds all of it, for the step that begins."""
    clear_walls(f)
    lay_still(w, f)
    if ti.static(w.moves):
        lay_moving(w, f, False)
        lay_moving(w, f, True)
    make_room(f)
    f.now[None].fenced = ti.cast(fenced(f), ti.i32)


@ti.func
def fenced(f: ti.template()):
    """Whether there is any wall but the edges."""
    now, found = f.now[None], False
    for row in range((now.columns + 2) * (now.rows + 2)):
        found = found or f.u.block[row] == INSIDE or f.v.block[row] == INSIDE
    return found
