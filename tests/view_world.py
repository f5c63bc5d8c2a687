"""A world for the tests of the painter: grains and forces just where a test wants them, no engine."""

from collections.abc import Sequence

import numpy as np
import taichi as ti

from taichi_sand.world.tables import Grains, Pairs, World, box_type, pace_type, round_up


def column(values: np.ndarray, rows: int, kind: object, vector: bool = False) -> object:
    """A field of `rows` rows that starts with `values`."""
    field = ti.Vector.field(2, kind, shape=rows, layout=ti.Layout.SOA) if vector else ti.field(kind, shape=rows)
    whole = np.zeros((rows, 2) if vector else rows, np.int32 if kind == ti.i32 else np.float32)
    whole[: len(values)] = values
    field.from_numpy(whole)
    return field


def world_of(
    places: Sequence,
    radius: float | Sequence[float],
    size: tuple[float, float] = (1.0, 1.0),
    *,
    velocity: Sequence | None = None,
    angle: Sequence | None = None,
    spin: Sequence | None = None,
    fixed: Sequence[int] = (),
    kind: Sequence | None = None,
    pairs: Sequence = (),
    wall_pairs: Sequence = (),
    periodic: tuple[bool, bool] = (False, False),
) -> World:
    """Grains of mass 2 kg and inertia 4 kg m2. pairs: (first, second, normal force); wall_pairs: (grain, normal, gap, normal force)."""
    places = np.asarray(places, float).reshape(-1, 2)
    n = len(places)
    rows = round_up(n)
    radius = np.broadcast_to(np.asarray(radius, float), n)
    inverse = np.where(np.isin(np.arange(n), fixed), 0.0, 0.5)
    spacing = 0.1
    site = np.floor(places / spacing)
    zeros = np.zeros(n)
    columns = {
        "site": column(site, rows, ti.i32, True),
        "offset": column(places - (site + 0.5) * spacing, rows, ti.f32, True),
        "shift": column(np.zeros((n, 2)), rows, ti.f32, True),
        "velocity": column(np.zeros((n, 2)) if velocity is None else np.asarray(velocity), rows, ti.f32, True),
        "angle": column(zeros if angle is None else np.asarray(angle), rows, ti.f32),
        "turn": column(zeros, rows, ti.f32),
        "spin": column(zeros if spin is None else np.asarray(spin), rows, ti.f32),
        "radius": column(radius, rows, ti.f32),
        "inverse_mass": column(inverse, rows, ti.f32),
        "inverse_inertia": column(0.5 * inverse, rows, ti.f32),
        "id": column(np.arange(n), rows, ti.i32),
        "kind": column(zeros if kind is None else np.asarray(kind), rows, ti.i32),
    }
    grains = Grains(**dict.fromkeys(Grains._fields) | columns)
    table = pair_tables(places, radius, pairs, wall_pairs, np.array(size) if any(periodic) else None, rows)
    pace = pace_type(ti.f32).field(shape=())
    box = box_type(ti.f32).field(shape=())
    box[None].size, box[None].spacing, box[None].diameter = size, (spacing, spacing), 2 * radius.mean()
    count = ti.field(ti.i32, ())
    count[None] = n
    return World(
        **dict.fromkeys(World.__dataclass_fields__)
        | {"grains": grains, "pairs": table, "pace": pace, "count": count, "box": box, "periodic": periodic, "capacity": rows}
        | {"turns": angle is not None or spin is not None, "layout": "one", "real": ti.f32}
    )


def pair_tables(
    places: np.ndarray, radius: np.ndarray, pairs: Sequence, wall_pairs: Sequence, period: np.ndarray | None, capacity: int
) -> Pairs:
    """The pairs of discs, then those of a disc and a wall, each sorted by its first grain."""
    pairs, wall_pairs = sorted(pairs), sorted(wall_pairs, key=lambda row: row[0])
    first = [row[0] for row in (*pairs, *wall_pairs)]
    normal, gap, distance = [], [], []
    for i, j, _ in pairs:
        way = places[j] - places[i]
        if period is not None:
            way = way - period * np.round(way / period)
        normal.append(way / np.hypot(*way))
        distance.append(radius[i] + radius[j])
        gap.append(np.hypot(*way) - distance[-1])
    for i, direction, space, _ in wall_pairs:
        normal.append(np.asarray(direction, float))
        distance.append(radius[i])
        gap.append(space)
    rows = max(1, len(first))
    slots = np.arange(capacity)
    own, walls = (np.array([row[0] for row in table], int) for table in (pairs, wall_pairs))
    spans = {
        "row_start": np.searchsorted(own, slots),
        "row_end": np.searchsorted(own, slots, "right"),
        "wall_row_start": len(pairs) + np.searchsorted(walls, slots),
        "wall_row_end": len(pairs) + np.searchsorted(walls, slots, "right"),
    }
    columns = {name: column(values, 2 * capacity, ti.i32) for name, values in spans.items()}
    columns |= {
        "first": column(np.array(first), rows, ti.i32),
        "second": column(np.array([row[1] for row in pairs] + [0] * len(wall_pairs)), rows, ti.i32),
        "contact_distance": column(np.array(distance), rows, ti.f32),
        "gap": column(np.array(gap), rows, ti.f32),
        "normal": column(np.array(normal).reshape(-1, 2), rows, ti.f32, True),
        "force": column(np.array([(row[-1], 0.0) for row in (*pairs, *wall_pairs)]).reshape(-1, 2), rows, ti.f32, True),
    }
    return Pairs(**dict.fromkeys(Pairs._fields) | columns)
