"""What a frame of a trajectory holds, in the chunks of the GSD schema hoomd (gsd.readthedocs.io): a particle a disc.

Particles come in the order of the ids of their grains, the discs of a clump one after the other. `log/particles/id` is the id of the
grain; `particles/body` is that too for the discs of a clump, and -1 for grains that are one disc. The schema's central particles, which
have a mass and no size, are left out: every particle is a disc that can be seen. The mass of a clump is shared among its discs by area,
velocities are those of the discs, moments of inertia are of each disc about its own centre: so momentum and kinetic energy of the
particles are those of the clump wherever its discs do not overlap.

Contacts of grains (measure/contacts.py) are bonds between the two discs that touch; bonds of the type `bridge` have a liquid bridge, which
may also pull without touching. `log/particles/force` is the sum of the contact forces on a disc, those of walls included.

The box is the scene's, with its centre as the origin: a place in the scene is the position plus `log/shift`. Over a periodic edge
positions are folded into the box. Angles are the quaternion (cos a/2, 0, 0, sin a/2). Fixed grains have the mass that their density
gives. Units are SI with areal density, so masses are kg and forces N.
"""

import json
from typing import Any

import numpy as np

from taichi_sand.measure.contacts import CONTACT, WORDS, contacts
from taichi_sand.scene.shapes import mass
from taichi_sand.taichi_support.host_access import reader

COLUMNS = ("site", "offset", "shift", "twist", "angle", "turn", "radius", "mobility", "id", "kind")
"""Of the table of grains that a frame is made from."""
COLUMN = {name: CONTACT.fields[name][1] // 8 for name in ("force_n", "force_t", "overlap")}  # type: ignore[index]
COLUMN |= {f"normal_{axis}": CONTACT.fields["normal"][1] // 8 + k for k, axis in enumerate("xy")}  # type: ignore[index]
"""Where the numbers of a contact stand, all of 8 bytes; the first are id1, id2, disc1, disc2, bridge."""


def words(lines: list[str]) -> np.ndarray:
    """Words as the schema has them: a row of bytes each, zeros behind."""
    longest = max((len(line.encode()) for line in lines), default=0) + 1
    rows = np.array([line.encode() for line in lines], dtype=np.dtype((bytes, longest)))
    return rows.view(np.int8).reshape(len(lines), longest)


class Kinds:
    """The kinds of grains of a scene, a table of grains or sources each: what all their grains have in common."""

    def __init__(self, scene: Any) -> None:
        tables = (*scene.grains, *scene.sources)
        forms = [scene.form_of(table) for table in tables]
        self.many = np.array([len(form.discs) for form in forms] or [1])  # discs
        self.start = np.cumsum(self.many) - self.many
        self.discs = np.concatenate([form.discs for form in forms] or [[[0.0, 0.0, 1.0]]])  # x, y, radius over that of the grain
        self.clumps = bool((self.many > 1).any())
        self.dense = np.array([mass(form, np.ones(1), table.density)[0] for form, table in zip(forms, tables)] or [1.0])  # mass / radius²
        names = [f"grains[{k}]" for k in range(len(scene.grains))] + [f"sources[{k}]" for k in range(len(scene.sources))]
        shapes = [json.dumps({"type": "Sphere", "diameter": 2 * mean_radius(table)}) for table in tables]
        self.chunks = {"configuration/dimensions": np.array([2], np.uint8), "bonds/types": words(["contact", "bridge"])}
        self.chunks |= {"particles/types": words(names or ["A"]), "particles/type_shapes": words(shapes or ["{}"])}


def mean_radius(table: Any) -> float:
    """Of the discs of a table of grains or sources [m]; 0 if it has none."""
    return float(np.mean(table.radius or [row[2] for row in table.positions if len(row) > 2] or [0.0]))


class Frames:
    """Makes the frames of a simulation."""

    def __init__(self, sim: Any) -> None:
        self.kinds = Kinds(sim.scene)
        self.world: Any = None
        self.ids, self.order = np.empty(0, np.int32), np.empty(0, int)
        self.seen: list[np.ndarray] = [np.empty(0)] * 4
        self.last: dict[str, np.ndarray] = {}

    def table(self, sim: Any) -> dict[str, np.ndarray]:
        """The grains present, by id: SI, f64."""
        if sim.world is not self.world:  # tables that have grown are others
            self.world = sim.world
            self.columns = {name: reader(getattr(sim.world.grains, name)) for name in COLUMNS}
            carried = sim.world.carried._asdict() if sim.world.carried else {}
            self.columns |= {f"log/particles/{name}": reader(column) for name, column in carried.items()}
            self.asleep = reader(sim.world.sleep.mobility) if sim.world.sleeps else None
            self.spacing = np.array(sim.world.box[None].spacing.to_list())
        count = sim.count
        ids = self.columns["id"]()[:count]
        if not np.array_equal(ids, self.ids):  # list builds move grains
            self.ids, self.order = ids.copy(), np.argsort(ids)
        order = self.order
        table = {
            name: column()[:count].copy().take(order, axis=0) for name, column in self.columns.items()
        }  # three times as quick as [order]
        if self.asleep:  # sleepers have theirs kept for them
            awake = sim.world.sleep.state[None].awake
            table["mobility"] = np.where((order >= awake)[:, None], self.asleep()[:count][order], table["mobility"])
        moved = table["offset"].astype(float) + table["shift"]
        table["position"] = (table["site"] + 0.5) * self.spacing + moved
        table["angle"] = table["angle"].astype(float) + table["turn"]
        return table

    def mass(self, table: dict[str, np.ndarray]) -> np.ndarray:
        """Masses of grains [kg]; of fixed ones by their density."""
        inverse = table["mobility"][:, 0].astype(float)
        fixed = np.flatnonzero(inverse == 0)
        inverse[fixed] = 1.0
        mass = 1 / inverse
        mass[fixed] = self.kinds.dense[table["kind"][fixed]] * table["radius"][fixed].astype(float) ** 2
        return mass

    def of(self, sim: Any) -> dict[str, np.ndarray]:
        """The chunks of this moment, by name. Those that are the same arrays as in another frame have not changed."""
        table, scene = self.table(sim), sim.scene
        whole = self.mass(table)
        discs = discs_of(table, whole, self.kinds)
        owner, size, count = discs["owner"], np.array(scene.size), len(discs["radius"])
        half = (table["angle"][owner] / 2).astype(np.float32)
        position, velocity, turn = (np.zeros((count, width), np.float32) for width in (3, 3, 4))
        position[:, :2], velocity[:, :2] = centred(discs["place"], size, scene.periodic), discs["velocity"]
        turn[:, 0], turn[:, 3] = np.cos(half), np.sin(half)
        return {
            "configuration/step": np.array([sim.steps], np.uint64),
            "configuration/box": np.array([*scene.size, 0, 0, 0, 0], np.float32),
            **self.kinds.chunks,
            **self.lasting(table, discs),
            "particles/position": position,
            "particles/velocity": velocity,
            "particles/orientation": turn,
            "log/time": np.array([sim.time]),
            "log/shift": size / 2,
            "log/particles/spin": table["twist"][owner, 2].astype(np.float32),
            **{name: values[owner].astype(np.float32) for name, values in table.items() if name.startswith("log/")},
            **energies(table, whole, scene.gravity),
            **bonds(contacts(sim), table["id"], discs["first"], count),
        }

    def lasting(self, table: dict[str, np.ndarray], discs: dict[str, Any]) -> dict[str, np.ndarray]:
        """The chunks that stay as they are while grains neither come nor go, nor are held or let go."""
        now = [table[name] for name in ("id", "kind", "radius", "mobility")]
        if not all(map(np.array_equal, now, self.seen)):
            owner, mass = discs["owner"], discs["mass"]
            ids, kind = table["id"][owner].astype(np.int32), table["kind"][owner]
            inertia = np.zeros((len(mass), 3), np.float32)
            inertia[:, 2] = 0.5 * mass * discs["radius"] ** 2
            self.seen, self.last = (
                now,
                {
                    "particles/N": np.array([len(mass)], np.uint32),
                    "particles/typeid": kind.astype(np.uint32),
                    "particles/body": np.where(self.kinds.many[kind] > 1, ids, np.int32(-1)),
                    "particles/mass": mass.astype(np.float32),
                    "particles/diameter": (2 * discs["radius"]).astype(np.float32),
                    "particles/moment_inertia": inertia,
                    "log/particles/id": ids,
                },
            )
        return self.last


def discs_of(table: dict[str, np.ndarray], whole: np.ndarray, kinds: Kinds) -> dict[str, Any]:
    """The discs of grains with the masses `whole`, a row each: owner (row of the table), place, velocity, radius, mass; and first, the row
    of the first disc of each grain.
    """
    velocity, radius = table["twist"][:, :2], table["radius"].astype(float)
    if not kinds.clumps:
        rows = np.arange(len(radius))
        return {"owner": slice(None), "first": rows, "place": table["position"], "velocity": velocity, "radius": radius, "mass": whole}
    kind = table["kind"]
    many = kinds.many[kind]
    owner, first = np.repeat(np.arange(len(kind)), many), np.cumsum(many) - many
    number = np.arange(len(owner)) - first[owner]
    own = kinds.discs[kinds.start[kind[owner]] + number] * radius[owner, None]
    angle, spin, area = table["angle"][owner], table["twist"][owner, 2], own[:, 2] ** 2
    c, s = np.cos(angle), np.sin(angle)
    arm = np.stack([c * own[:, 0] - s * own[:, 1], s * own[:, 0] + c * own[:, 1]], axis=1)
    return {
        "owner": owner,
        "first": first,
        "place": table["position"][owner] + arm,
        "velocity": velocity[owner] + spin[:, None] * np.stack([-arm[:, 1], arm[:, 0]], axis=1),
        "radius": own[:, 2],
        "mass": whole[owner] * area / np.bincount(owner, area, len(kind))[owner],
    }


def bonds(found: np.ndarray, ids: np.ndarray, first: np.ndarray, count: int) -> dict[str, np.ndarray]:
    """The contacts `found` of grains as bonds, and their forces on each of `count` particles; `ids` of the grains are in order, `first` is
    the first particle of each.
    """
    wide = np.ascontiguousarray(found.view(np.float64).reshape(len(found), WORDS).T)  # a row a number: three times as quick as by fields
    whole, between = wide.view(np.int64), wide.view(np.int64)[1] >= 0
    nx, ny, push, slide, overlap = (wide[COLUMN[name]] for name in ("normal_x", "normal_y", "force_n", "force_t", "overlap"))
    rows = np.zeros(int(ids[-1]) + 1 if len(ids) else 0, int)
    rows[ids[ids >= 0]] = first[ids >= 0]
    one, other = rows[whole[0]] + whole[2], rows[whole[1][between]] + whole[3][between]
    force = np.zeros((count, 3), np.float32)
    for axis, along in enumerate((push * nx - slide * ny, push * ny + slide * nx)):
        force[:, axis] = np.bincount(other, along[between], count) - np.bincount(one, along, count)
    group = np.empty((len(other), 2), np.uint32)
    group[:, 0], group[:, 1] = one[between], other
    return {
        "bonds/N": np.array([len(other)], np.uint32),
        "bonds/typeid": (whole[4][between] > 0).astype(np.uint32),
        "bonds/group": group,
        "log/particles/force": force,
        "log/bonds/force_n": push[between].astype(np.float32),
        "log/bonds/force_t": slide[between].astype(np.float32),
        "log/bonds/overlap": overlap[between].astype(np.float32),
    }


def centred(place: np.ndarray, size: np.ndarray, periodic: tuple[bool, bool]) -> np.ndarray:
    """Places (n, 2) [m] from the centre of the box, float32; over a periodic edge they are folded into it."""
    shifted = place - size / 2
    for axis, wraps in enumerate(periodic):
        if wraps:
            folded = np.float32(place[:, axis] % size[axis] - size[axis] / 2)
            shifted[:, axis] = np.where(folded >= np.float32(size[axis] / 2), -size[axis] / 2, folded)  # rounded up
    return shifted.astype(np.float32)


def energies(table: dict[str, np.ndarray], whole: np.ndarray, gravity: tuple[float, float]) -> dict[str, np.ndarray]:
    """Of the grains that can move, as the report has them [J]."""
    turning = table["mobility"][:, 2].astype(float)
    inertia = np.divide(1.0, turning, out=np.zeros(len(whole)), where=turning > 0)
    free = whole * (table["mobility"][:, 0] > 0)
    twist = table["twist"].astype(float)
    kinetic = 0.5 * (free @ twist[:, 0] ** 2 + free @ twist[:, 1] ** 2 + inertia @ twist[:, 2] ** 2)
    potential = -(free @ (table["position"] @ np.array(gravity)))
    return {"log/kinetic_energy_J": np.array([kinetic]), "log/potential_energy_J": np.array([potential])}
