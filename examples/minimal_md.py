"""A whole discrete element method in one file, to learn from: soft discs in a box, with friction, on Taichi.

    python minimal_md.py                                     # 500 discs fall for two seconds; writes minimal_md.png
    python minimal_md.py --discs 2000 --seconds 1 -o bed.png

Each step sorts the discs into cells, sums the forces of all that touch, and moves the discs. SI units, +y is up. Left out on purpose:
rolling resistance, a memory of friction (so heaps creep), and a neighbour list that lasts for many steps.
"""

import argparse

import numpy as np
import taichi as ti

ti.init(arch=ti.cpu, log_level=ti.WARN)

RADIUS, DENSITY = 0.01, 1000.0  # of the largest disc [m]; mass / area [kg/m2]
STIFFNESS = 3e5  # force / overlap [N/m]: under 20 discs a contact gives by 0.01 of a diameter
DAMPING = 0.3  # ratio of the dashpot: a collision keeps 0.45 of its speed
FRICTION, SLOPE = 0.5, 0.5  # Coulomb's coefficient; tangential over normal dashpot, up to Coulomb's bound
GRAVITY = ti.Vector([0.0, -9.81])
STEP = 1e-4  # [s]: a twentieth of a collision, π √(m*/k)
ROOM = 8  # discs in a cell at most: it is as wide as the largest disc, and they are of similar size


@ti.data_oriented
class Discs:
    """Discs in a box: places x, velocities v, spins w, radii r, and the forces and torques of the moment."""

    def __init__(self, count: int, width: float = 0.5, height: float = 0.8):
        self.count, self.width, self.height = count, width, height
        self.x, self.v, self.force = (ti.Vector.field(2, ti.f32, count) for _ in range(3))
        self.w, self.torque, self.r = (ti.field(ti.f32, count) for _ in range(3))
        self.cells = (int(width / (2 * RADIUS)) + 1, int(height / (2 * RADIUS)) + 1)
        self.held, self.cell = ti.field(ti.i32, self.cells), ti.field(ti.i32, (*self.cells, ROOM))
        rng, across, pitch = np.random.default_rng(1), int(width / (2.2 * RADIUS)), 2.2 * RADIUS
        lattice = np.stack([np.arange(count) % across, np.arange(count) // across], axis=1) + 0.5
        self.x.from_numpy(((lattice + rng.uniform(-0.04, 0.04, (count, 2))) * pitch).astype(np.float32))
        self.r.from_numpy((RADIUS * rng.uniform(0.8, 1.0, count)).astype(np.float32))

    @ti.func
    def mass(self, i):
        return DENSITY * ti.math.pi * self.r[i] ** 2

    @ti.func
    def home(self, i):
        """Cell of disc i."""
        last = ti.Vector([self.cells[0] - 1, self.cells[1] - 1])
        return ti.min(ti.max(ti.cast(self.x[i] / (2 * RADIUS), ti.i32), 0), last)

    @ti.func
    def push(self, i, normal, overlap, motion, mass):
        """What disc i feels where something overlaps it. `normal` points at it, `motion` is that of its surface, `mass` effective."""
        dashpot = 2.0 * DAMPING * ti.sqrt(STIFFNESS * mass)
        speed = motion.dot(normal)
        pressing = ti.max(0.0, STIFFNESS * overlap - dashpot * speed)  # it never pulls
        slip = motion - speed * normal
        size = slip.norm() + 1e-12
        rubbing = -ti.min(FRICTION * pressing, SLOPE * dashpot * size) * slip / size
        self.force[i] += pressing * normal + rubbing
        self.torque[i] -= (self.r[i] - 0.5 * overlap) * normal.cross(rubbing)

    @ti.func
    def meet(self, i, j):
        """Disc j pushes disc i if they overlap; each pair is met twice, once from either side."""
        way = self.x[i] - self.x[j]
        distance, reach = way.norm(), self.r[i] + self.r[j]
        if i != j and distance < reach:
            normal = way / ti.max(distance, 1e-9)
            rolling = (self.w[i] * self.r[i] + self.w[j] * self.r[j]) * ti.Vector([-normal.y, normal.x])
            mass = self.mass(i) * self.mass(j) / (self.mass(i) + self.mass(j))
            self.push(i, normal, reach - distance, self.v[i] - self.v[j] - rolling, mass)

    @ti.func
    def wall(self, i, normal, gap):
        """An edge of the box, `gap` from the centre of disc i."""
        if gap < self.r[i]:
            rolling = self.w[i] * self.r[i] * ti.Vector([-normal.y, normal.x])
            self.push(i, normal, self.r[i] - gap, self.v[i] - rolling, self.mass(i))

    @ti.kernel
    def steps(self, count: ti.i32):
        """So many steps, one thread: forces are summed in a fixed order, so the same start gives the same bits."""
        ti.loop_config(serialize=True)
        for _ in range(count):
            for a, b in ti.ndrange(*self.cells):  # the cell list
                self.held[a, b] = 0
            for i in range(self.count):
                a, b = self.home(i)
                self.cell[a, b, ti.min(self.held[a, b], ROOM - 1)] = i
                self.held[a, b] = ti.min(self.held[a, b] + 1, ROOM)
            for i in range(self.count):
                self.force[i], self.torque[i] = self.mass(i) * GRAVITY, 0.0
                a, b = self.home(i)
                for p in range(ti.max(a - 1, 0), ti.min(a + 2, self.cells[0])):
                    for q in range(ti.max(b - 1, 0), ti.min(b + 2, self.cells[1])):
                        for k in range(self.held[p, q]):
                            self.meet(i, self.cell[p, q, k])
                self.wall(i, ti.Vector([1.0, 0.0]), self.x[i].x)
                self.wall(i, ti.Vector([-1.0, 0.0]), self.width - self.x[i].x)
                self.wall(i, ti.Vector([0.0, 1.0]), self.x[i].y)
            for i in range(self.count):  # symplectic Euler: the new velocity moves the disc
                self.v[i] += STEP * self.force[i] / self.mass(i)
                self.w[i] += STEP * self.torque[i] / (0.5 * self.mass(i) * self.r[i] ** 2)
                self.x[i] += STEP * self.v[i]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--discs", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("-o", "--out", default="minimal_md.png")
    given = parser.parse_args()
    discs = Discs(given.discs)
    discs.steps(round(given.seconds / STEP))
    gui = ti.GUI("minimal_md", (500, 800), background_color=0x14161A, show_gui=False)
    gui.circles(discs.x.to_numpy() / (discs.width, discs.height), discs.r.to_numpy() * 500 / discs.width, 0xE8C98A)
    gui.show(given.out)
