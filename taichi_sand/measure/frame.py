"""What a frame of a trajectory holds, in the chunks of the GSD schema hoomd (gsd.readthedocs.io): a particle a disc.

Particles come in the order of the ids of their grains, the discs of a clump one after the other. `log/particles/id` is the id of the
grain; `particles/body` is that too for the discs of a clump, and -1 for grains that are one disc. The schema's central particles, which
have a mass and no size, are left out: every particle is a disc that can be seen. The mass of a clump is shared among its discs by area,
velocities are those of the discs, moments of inertia are of each disc about its own centre: so momentum and kinetic energy of the
particles are those of the clump wherever its discs do not overlap.

Contacts of grains (measure/pairs.py) are bonds between the two discs that touch; bonds of the type `bridge` have a liquid bridge, which
may also pull without touching. `log/particles/force` is the sum of the contact forces on a disc, those of walls included;
`log/walls/NAME` is what grains exert on a wall, or an edge that is one: force along x and y, and torque about its pivot.

The box is the scene's, with its centre as the origin: a place in the scene is the position plus `log/shift`. Over a periodic edge
positions are folded into the box. Angles are the quaternion (cos a/2, 0, 0, sin a/2). Fixed grains have the mass that their density
gives. Units are SI with areal density, so masses are kg and forces N.
"""

import json
from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.measure.contacts import as_contacts, sort_by_ids
from taichi_sand.measure.discs import Kinds
from taichi_sand.measure.grain_state import there, wall_forces
from taichi_sand.measure.pairs import (
    BRIDGE,
    DISCS,
    MORE,
    NORMAL,
    ONE,
    OVERLAP,
    PART,
    PUSH,
    ROW,
    SLIDE,
    STATE,
    TWO,
    Exacts,
    Found,
    Wholes,
    pairs_of,
    place,
    real_of,
)
from taichi_sand.scene.sizes import Sizes, spread
from taichi_sand.taichi_support.host_access import reader
from taichi_sand.world.clumps import disc_around, discs_around
from taichi_sand.world.geometry import mobility, perp, spin, velocity
from taichi_sand.world.search.images import fold

Integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
Couples, Names, Turns, Vectors, Energies = (
    ti.types.ndarray(dtype=ti.types.vector(width, kind), ndim=1)
    for width, kind in ((2, ti.i32), (3, ti.i32), (2, ti.f32), (3, ti.f32), (2, None))
)
SHARES = 1000
"""Shares of the grains by which a distribution is summed up."""
TYPE, BODY, ID = range(3)
"""Names of a particle."""


def words(lines: list[str]) -> np.ndarray:
    """Words as the schema has them: a row of bytes each, zeros behind."""
    longest = max((len(line.encode()) for line in lines), default=0) + 1
    rows = np.array([line.encode() for line in lines], dtype=np.dtype((bytes, longest)))
    return rows.view(np.int8).reshape(len(lines), longest)


def mean_radius(table: Any) -> float:
    """Of the discs of a table of grains or sources [m]; 0 if it has none."""
    if isinstance(table.radius, Sizes):
        return float(spread(table.radius, (np.arange(SHARES) + 0.5) / SHARES).mean())
    return float(np.mean(table.radius or [row[2] for row in table.positions if len(row) > 2] or [0.0]))


def chunks_of_scene(scene: Any) -> dict[str, np.ndarray]:
    """The chunks that are the same in all frames."""
    tables = (*scene.grains, *scene.sources)
    names = [f"grains[{k}]" for k in range(len(scene.grains))] + [f"sources[{k}]" for k in range(len(scene.sources))]
    shapes = [json.dumps({"type": "Sphere", "diameter": 2 * mean_radius(table)}) for table in tables]
    return {
        "configuration/dimensions": np.array([2], np.uint8),
        "configuration/box": np.array([*scene.size, 0, 0, 0, 0], np.float32),
        "bonds/types": words(["contact", "bridge"]),
        "particles/types": words(names or ["A"]),
        "particles/type_shapes": words(shapes or ["{}"]),
    }


@ti.func
def centred(x, size, wraps: ti.template()):
    """A place from the centre of the box, along one axis, f32; over a periodic edge it is folded into the box."""
    shifted = x
    if ti.static(wraps):
        shifted -= ti.floor(x / size) * size
    found = ti.cast(shifted - 0.5 * size, ti.f32)
    if ti.static(wraps):
        if found >= ti.cast(0.5 * size, ti.f32):  # rounded up
            found = ti.cast(-0.5 * size, ti.f32)
    return found


@ti.kernel
def lay_grains(
    w: ti.template(),
    first: Integers,
    numbers: ti.types.ndarray(ndim=1),
    names: Names,
    slots: Integers,
    masses: Vectors,
    positions: Vectors,
    velocities: Vectors,
    turns: Turns,
    energies: Energies,
    real: ti.template(),
):
    """The discs of all grains, a row each, those of a grain from row first[id] on: names, see TYPE; the grain's slot; mass, diameter and
    moment of inertia; position; velocity; half the angle, and spin; kinetic and potential energy, with the first disc of each grain.

    `numbers`: size of the box, gravity, then mass / radius² of each kind.
    """
    ti.loop_config(serialize=w.serial)
    for i in range(w.count[None]):
        id = w.grains.id[i]
        if id >= 0:
            x, v, turning, give, kind = place(w, i, real), velocity(w, i), spin(w, i), mobility(w, i), w.grains.kind[i]
            mass, free, inertia = numbers[4 + kind] * ti.cast(w.grains.radius[i], real) ** 2, ti.cast(0.0, real), ti.cast(0.0, real)
            if give.x > 0.0:
                mass = 1.0 / ti.cast(give.x, real)
                free = mass
            if give.z > 0.0:
                inertia = 1.0 / ti.cast(give.z, real)
            if ti.static(w.sheared):
                x = fold(w, x, ti.Vector([numbers[0], numbers[1]]))
            half = 0.5 * (ti.cast(w.grains.angle[i], real) + ti.cast(w.grains.turn[i], real))
            many, area, nothing = discs_around(w, i), ti.cast(0.0, real), ti.cast(0.0, real)
            for k in range(many):
                area += ti.cast(disc_around(w, i, k).z, real) ** 2
            for k in range(many):
                row, disc = first[id] + k, disc_around(w, i, k)
                own, reach = v + turning * perp(disc.xy), ti.cast(disc.z, real)
                share = mass * reach * reach / area
                names[row] = ti.Vector([kind, id if many > 1 else -1, id])
                slots[row] = i
                across = centred(x.x + disc.x, numbers[0], ti.static(w.periodic[0]))
                up = centred(x.y + disc.y, numbers[1], ti.static(w.periodic[1]))
                positions[row] = ti.Vector([across, up, ti.cast(0.0, ti.f32)])
                velocities[row] = ti.cast(ti.Vector([own.x, own.y, 0.0]), ti.f32)
                turns[row] = ti.cast(ti.Vector([half, turning]), ti.f32)
                masses[row] = ti.cast(ti.Vector([share, 2.0 * reach, 0.5 * share * reach * reach]), ti.f32)
                energies[row] = ti.Vector([nothing, nothing])
            speed, turned = ti.cast(v, real), ti.cast(turning, real)
            kinetic = 0.5 * (free * speed.dot(speed) + inertia * turned * turned)
            energies[first[id]] = ti.Vector([kinetic, -free * (x.x * numbers[2] + x.y * numbers[3])])


@ti.func
def push_on(force: ti.template(), row, push, alone: ti.template()):
    """Adds a force to those on a particle."""
    for c in ti.static(range(2)):
        if ti.static(alone):
            force[row][c] = force[row][c] + ti.cast(push[c], ti.f32)
        else:
            ti.atomic_add(force[row][c], ti.cast(push[c], ti.f32))


@ti.kernel
def lay_bonds(
    whole: Wholes,
    exact: Exacts,
    particles: Integers,
    first: Integers,
    order: Integers,
    group: Couples,
    bridges: Integers,
    numbers: ti.types.ndarray(dtype=ti.f32, ndim=2),
    force: Vectors,
    alone: ti.template(),
):
    """Contacts of grains as bonds, in the order of `contacts`: group (n, 2), bridges (n,) and numbers (3, n): normal and tangential force,
    and overlap; there are first[-2] of them. `force` (n, 3): the sum of the forces on each, those of walls included. The particles
    of a grain begin at particles[id].
    """
    sort_by_ids(whole, exact, order, exact, first, order, False, alone)
    ti.loop_config(serialize=alone)
    for k in range(whole.shape[0]):
        row, x = whole[k], exact[k]
        along = ti.Vector([x[NORMAL], x[NORMAL + 1]])
        size = ti.Vector([x[PUSH] + x[MORE], x[SLIDE] + x[MORE + 1]])
        push = size.x * along + size.y * perp(along)
        if row[TWO] >= 0:
            m = row[ROW]
            one, two = particles[row[ONE]] + row[DISCS] // PART, particles[row[TWO]] + row[DISCS] % PART
            group[m] = ti.Vector([one, two])
            bridges[m] = row[STATE] & BRIDGE
            numbers[0, m], numbers[1, m], numbers[2, m] = ti.cast(size.x, ti.f32), ti.cast(size.y, ti.f32), ti.cast(x[OVERLAP], ti.f32)
            push_on(force, one, -push, alone)
            push_on(force, two, push, alone)
        else:
            push_on(force, particles[row[ONE]] + row[DISCS] // PART, -push, alone)


class Frames:
    """Makes the frames of a simulation."""

    def __init__(self, sim: Any) -> None:
        self.kinds, self.chunks = Kinds(sim.scene), chunks_of_scene(sim.scene)
        self.world: Any = None
        self.ids, self.first, self.many = np.empty(0, np.int32), np.zeros(1, np.int32), 0
        self.seen: list[np.ndarray] = []
        self.last: dict[str, np.ndarray] = {}

    def find_rows(self, sim: Any) -> None:
        """Where the particles of each grain begin, by id, and how many there are."""
        if sim.world is not self.world:  # tables that have grown are others
            self.world = sim.world
            self.read_ids, self.read_kinds = reader(sim.world.grains.id), reader(sim.world.grains.kind)
            carried = sim.world.carried._asdict() if sim.world.carried else {}
            self.carried = {f"log/particles/{name}": reader(column) for name, column in carried.items()}
        count = sim.count
        ids = self.read_ids()[:count]
        if len(self.first) == sim.made + 1 and np.array_equal(ids, self.ids):
            return
        self.ids = ids.copy()
        there = ids >= 0
        many = np.zeros(sim.made + 1, np.int32)
        many[ids[there]] = self.kinds.many[self.read_kinds()[:count][there]] if self.kinds.clumps else 1
        total = np.cumsum(many, dtype=np.int32)
        self.first, self.many = total - many, int(total[-1])

    def of(self, sim: Any) -> dict[str, np.ndarray]:
        """The chunks of this moment, by name. Those that are the same arrays as in another frame have not changed."""
        self.find_rows(sim)
        n, scene, (real, kind) = self.many, sim.scene, real_of(sim)
        names, slots = np.empty((n, 3), np.int32), np.empty(n, np.int32)
        masses, position, velocities, turns, orientation, force = (np.empty((n, width), np.float32) for width in (3, 3, 3, 2, 4, 3))
        energy = np.empty((n, 2), kind)
        numbers = np.array([*scene.size, *scene.gravity, *self.kinds.dense], kind)
        lay_grains(sim.world, self.first, numbers, names, slots, masses, position, velocities, turns, energy, real)
        half = turns[:, 0].copy()  # sines of what lies apart take ten times as long
        orientation[:, 0], orientation[:, 1], orientation[:, 2], orientation[:, 3] = np.cos(half), 0.0, 0.0, np.sin(half)
        force[:] = 0.0
        kinetic, potential = (energy[:, k].sum(dtype=np.float64) for k in range(2))  # both at once take ten times as long
        return {
            "configuration/step": np.array([sim.steps], np.uint64),
            **self.chunks,
            **self.lasting(names, masses),
            "particles/position": position,
            "particles/velocity": velocities,
            "particles/orientation": orientation,
            "log/time": np.array([sim.time]),
            "log/shift": np.array(scene.size) / 2,
            "log/particles/spin": turns[:, 1].copy(),
            **{name: column()[: sim.count][slots].astype(np.float32) for name, column in self.carried.items()},
            "log/kinetic_energy_J": np.array([kinetic]),
            "log/potential_energy_J": np.array([potential]),
            **self.bonds(sim, force),
        }

    def lasting(self, names: np.ndarray, masses: np.ndarray) -> dict[str, np.ndarray]:
        """The chunks that stay as they are while grains neither come nor go, nor are held or let go."""
        if not (self.seen and np.array_equal(names, self.seen[0]) and np.array_equal(masses, self.seen[1])):
            inertia = np.zeros((len(names), 3), np.float32)
            inertia[:, 2] = masses[:, 2]
            self.seen, self.last = (
                [names, masses],
                {
                    "particles/N": np.array([len(names)], np.uint32),
                    "particles/typeid": names[:, TYPE].astype(np.uint32),
                    "particles/body": names[:, BODY].copy(),
                    "particles/mass": masses[:, 0].copy(),
                    "particles/diameter": masses[:, 1].copy(),
                    "particles/moment_inertia": inertia,
                    "log/particles/id": names[:, ID].copy(),
                },
            )
        return self.last

    def bonds(self, sim: Any, force: np.ndarray) -> dict[str, np.ndarray]:
        """The contacts of grains; all forces are added to those on the particles, `force` (n, 3)."""
        found = pairs_of(sim)
        many, made = len(found.whole), len(self.first) + 1
        group, bridges, numbers = np.empty((many, 2), np.int32), np.empty(many, np.int32), np.empty((3, many), np.float32)
        counts = np.zeros(made, np.int32)
        if many:
            order = np.empty(many, np.int32)
            lay_bonds(found.whole, found.exact, self.first, counts, order, group, bridges, numbers, force, sim.world.serial)
        between, at_walls = int(counts[-2]), np.flatnonzero(found.whole[:, TWO] < 0)
        touched = as_contacts(sim, Found(found.whole[at_walls], found.exact[at_walls], 0))
        return {
            **{f"log/walls/{row['name']}": np.array([*row["force"], row["torque"]]) for row in there(sim, wall_forces(sim, touched))},
            "bonds/N": np.array([between], np.uint32),
            "bonds/typeid": bridges[:between].view(np.uint32),
            "bonds/group": group[:between].view(np.uint32),
            "log/particles/force": force,
            "log/bonds/force_n": numbers[0, :between],
            "log/bonds/force_t": numbers[1, :between],
            "log/bonds/overlap": numbers[2, :between],
        }
