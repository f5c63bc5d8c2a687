"""What there is to know of one grain: how it is, how it moves, and who touches it with which force."""

from typing import Any

import numpy as np

from taichi_sand.measure.contacts import contacts
from taichi_sand.measure.grain_state import forces, masses
from taichi_sand.measure.wall_numbers import names
from taichi_sand.world.reading import read_columns

COLUMNS = ("id", "position", "velocity", "angle", "spin", "radius", "kind", "mobility")


def about(sim: Any, number: int) -> dict[str, Any] | None:
    """The grain with this id in SI units, for JSON; None if there is none (any more).

    `contacts` has one entry a contact: `with` (a grain, or a wall by its name), `point` [m], `force` on this grain [N], its parts `push`
    along the normal and `slide` along the surface [N], and `overlap` [d]. `force` is their sum.
    """
    table = read_columns(sim.world, COLUMNS)
    row = int(np.searchsorted(table["id"], number))
    if row >= len(table["id"]) or table["id"][row] != number:
        return None
    one = {name: values[row] for name, values in table.items()}
    mass, inertia = masses(table["mobility"][row : row + 1])[0]
    tables = (*sim.scene.grains, *sim.scene.sources)
    kind = tables[int(one["kind"])] if int(one["kind"]) < len(tables) else None
    touching = _touching(sim, number)
    return {
        "id": number,
        "kind": " ".join(filter(None, (kind.material, kind.shape))) if kind else "disc",
        "radius": float(one["radius"]),
        "fixed": bool(mass == 0),
        "mass": float(mass),
        "inertia": float(inertia),
        "position": one["position"].tolist(),
        "velocity": one["velocity"].tolist(),
        "angle": float(one["angle"]),
        "spin": float(one["spin"]),
        "contacts": touching,
        "force": [float(sum(contact["force"][axis] for contact in touching)) for axis in (0, 1)],
    }


def _touching(sim: Any, number: int) -> list[dict[str, Any]]:
    rows = contacts(sim)
    rows = rows[(rows["id1"] == number) | (rows["id2"] == number)]
    first, walls, found = rows["id1"] == number, names(sim.scene), []
    on_it = np.where(first, -1.0, 1.0)[:, None] * forces(rows)
    for row, one, force in zip(rows, first, on_it, strict=True):
        other = int(row["id2"] if one else row["id1"])
        found.append(
            {
                "with": f"grain {other}" if other >= 0 else walls[-1 - other],
                "point": row["point"].tolist(),
                "force": force.tolist(),
                "push": float(row["force_n"]),
                "slide": float(row["force_t"]),
                "overlap": float(row["overlap"] / sim.bed.diameter),
            }
        )
    return found
