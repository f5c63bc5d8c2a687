"""Where grains start: from the [[grains]] tables of a scene to arrays, a row a grain."""

import numpy as np

from taichi_sand.scene.bodies import taken_apart
from taichi_sand.scene.grains import Pack
from taichi_sand.scene.nearby import close_pairs, images, segments
from taichi_sand.scene.scatter import DENSEST, Taken, scatter
from taichi_sand.scene.schema import MOST_GRAINS, Grains, Scene
from taichi_sand.scene.shapes import inertia, mass
from taichi_sand.scene.sizes import drawn, limits, mean_area

COINCIDENT = 1e-3  # of the least diameter: centres nearer than this are one place
LOOSE = 0.5  # part of the free area that fill = "random" covers


def pack(scene: Scene) -> Pack:
    """Places the grains of a scene; the same scene gives the same arrays.

    Grains that are placed (`count`, `fill`) lie wholly inside their region and keep clear of walls and of the grains of other
    tables; those with exact `positions` are taken as they are.

    Raises:
        SandError: more grains than fit.
    """
    *streams, darts = [np.random.default_rng(seed) for seed in np.random.SeedSequence(scene.seed).spawn(len(scene.grains) + 1)]
    corners = [np.array(wall.points + (wall.points[:1] if wall.closed else ())) for wall in scene.walls]
    taken = Taken(images(segments(corners), scene.size, scene.periodic))
    rows: dict[int, np.ndarray] = {}
    for place, belongs in ((_given, _is_given), (_pattern, _is_pattern)):
        for index, table in enumerate(scene.grains):
            if belongs(table):
                rows[index] = place(scene, index, taken, streams[index])
                taken.add(rows[index][:, :2], rows[index][:, 2])
    rows |= _random(scene, [index for index in range(len(scene.grains)) if index not in rows], taken, streams, darts)
    parts = [_pack_table(scene, table, index, rows[index], streams[index]) for index, table in enumerate(scene.grains)]
    for part in parts:  # all at rest in the flow
        part.velocity[:, 0] += scene.edges.shear_rate * (part.position[:, 1] - 0.5 * scene.size[1])
    parts = parts or [_pack_table(scene, Grains(radius=(1.0, 1.0), count=1), 0, np.empty((0, 7)), darts)]
    _check_number(scene, 0, sum(map(len, parts)))
    columns = [name for name in Pack.__dataclass_fields__ if name != "forms"]
    forms = tuple(scene.form_of(table) for table in (*scene.grains, *scene.sources))
    return Pack(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns}, forms=forms)


def most_grains(scene: Scene) -> float:
    """No more grains than this can the tables of a scene make; nothing is placed to find out."""
    return sum(_most_of(scene, table) * (len(scene.discs(table.shape)) if table.bonded else 1) for table in scene.grains)


def _most_of(scene: Scene, table: Grains) -> float:
    if table.positions is not None:
        return len(table.positions)
    if table.count is not None:
        return table.count
    low, high = _reach(scene, table)
    width, height = np.subtract(_box(scene, table)[2:], _box(scene, table)[:2])
    if table.fill == "random":
        return LOOSE * width * height / mean_area(table.radius, scene.form(table.shape).reach) + 1
    pitch = 2 * high if table.pitch is None else table.pitch * (low + high)
    return (width / pitch + 2) * (height / (pitch * np.sqrt(0.75)) + 2)


def parted(grains: Pack, size: np.ndarray) -> np.ndarray:
    """Positions (n, 2) [m] in a box of `size`; centres that coincide lie a little apart, so that contacts have a direction.

    Each is moved its own way, by some thousandths of its diameter (physics.md C7).
    """
    position = grains.position.copy()
    if not len(grains):
        return position
    least = COINCIDENT * 2 * float(grains.radius.min())
    first, second = close_pairs(grains.position, grains.position, least)
    alike = np.unique(first[first != second])
    way = alike * np.pi * (3 - np.sqrt(5))  # the golden angle: no two ways are alike
    moved = position[alike] + 2 * least * np.stack([np.cos(way), np.sin(way)], axis=1)
    inside = (position[alike] >= 0) & (position[alike] <= size)
    position[alike] = np.where(inside, size - np.abs(size - np.abs(moved)), moved)  # mirrored at the edges
    return position


def _is_given(table: Grains) -> bool:
    return table.positions is not None


def _is_pattern(table: Grains) -> bool:
    return table.fill in ("lattice", "hexagonal")


def _pack_table(scene: Scene, table: Grains, index: int, rows: np.ndarray, rng: np.random.Generator) -> Pack:
    """Rows x, y, radius, vx, vy, angle, spin[, density] (n, 7 or 8) and what the table says of all its grains."""
    count, form = len(rows), scene.form(table.shape)
    density = rows[:, 7] if rows.shape[1] > 7 else np.full(count, table.density)
    heading, turn = rng.uniform(-np.pi, np.pi, (2, count))
    speed = rng.uniform(*table.speed, count)
    grains = Pack(
        position=rows[:, :2].copy(),
        velocity=rows[:, 3:5] + table.velocity + speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1),
        angle=rows[:, 5] + (turn if table.angle == "random" else float(table.angle)),
        spin=rows[:, 6] + table.spin,
        radius=rows[:, 2].copy(),
        mass=mass(form, rows[:, 2], density),
        inertia=inertia(form, rows[:, 2], density),
        kind=np.full(count, index, np.int32),
        fixed=np.full(count, table.fixed),
        body=np.full(count, -1, np.int32),
    )
    return taken_apart(grains, form, scene.form_of(table), density) if table.bonded else grains


def _at_rest(places: np.ndarray, radius: np.ndarray) -> np.ndarray:
    return np.concatenate([places, radius[:, None], np.zeros((len(radius), 4))], axis=1)


def _reach(scene: Scene, table: Grains) -> tuple[float, float]:
    """Lowest and highest radius [m] of the circle that holds a grain."""
    assert table.radius is not None
    low, high = limits(table.radius)
    reach = scene.form(table.shape).reach
    return reach * low, reach * high


def _box(scene: Scene, table: Grains) -> np.ndarray:
    return np.array(table.region or (0.0, 0.0, *scene.size))


def _given(scene: Scene, index: int, taken: Taken, rng: np.random.Generator) -> np.ndarray:
    """Rows (n, 7), or 8 with densities, of a table with `positions`."""
    table = scene.grains[index]
    given = np.array(table.positions)
    rows = np.zeros((len(given), max(7, given.shape[1])))
    rows[:, : given.shape[1]] = given
    if table.radius is not None:
        rows[:, 2] = drawn(table.radius, len(given), rng)
    rows[:, 2] *= scene.form(table.shape).reach
    return rows


def _random(
    scene: Scene, indices: list[int], taken: Taken, streams: list[np.random.Generator], darts: np.random.Generator
) -> dict[int, np.ndarray]:
    """Rows (n, 7) of each table with `count` alone, or with fill = "random"; all are scattered together, so that kinds mix."""
    radii: dict[int, np.ndarray] = {}
    boxes: dict[int, np.ndarray] = {}
    room = 0
    for index in indices:
        table, box = scene.grains[index], _box(scene, scene.grains[index])
        low, _ = _reach(scene, table)
        disc = mean_area(table.radius, scene.form(table.shape).reach)
        sample = np.random.default_rng(0).uniform(box[:2], box[2:], (4096, 2))
        free = np.prod(box[2:] - box[:2]) * taken.free(sample, np.zeros(len(sample))).mean()
        used = sum(_shared(boxes[other][0], box) * np.pi * (radii[other] ** 2).sum() for other in radii)
        room = int(max(0, DENSEST * free - used) / disc) if 2 * low <= min(box[2:] - box[:2]) else 0
        count = table.count or int(max(0, LOOSE * free - used) / disc)
        _check_number(scene, index, count)
        if not min(room, count) or count > 1.05 * room + 4:  # near the limit it is tried
            raise _too_many(scene, index, room)
        radii[index] = drawn(table.radius, count, streams[index], scene.form(table.shape).reach)
        boxes[index] = np.tile(box, (count, 1))
    if not radii:
        return {}
    places = scatter(np.concatenate([*radii.values()]), np.concatenate([*boxes.values()]), taken, darts)
    if places is None:
        raise _too_many(scene, indices[-1], min(room, int(0.9 * len(radii[indices[-1]]))))
    ends = np.cumsum([len(radius) for radius in radii.values()])[:-1]
    return {index: _at_rest(part, radii[index]) for index, part in zip(radii, np.split(places, ends), strict=True)}


def _shared(region: np.ndarray, box: np.ndarray) -> float:
    """The part of a region that lies in a box."""
    sides = np.minimum(region[2:], box[2:]) - np.maximum(region[:2], box[:2])
    return float(np.prod(np.maximum(sides, 0.0)) / np.prod(region[2:] - region[:2]))


def _pattern(scene: Scene, index: int, taken: Taken, rng: np.random.Generator) -> np.ndarray:
    """Rows (n, 7) of a table with fill = "lattice" or "hexagonal": from the bottom of the region upwards."""
    table = scene.grains[index]
    low, high = _reach(scene, table)
    mean = (low + high) / 2
    pitch = 2 * high if table.pitch is None else table.pitch * 2 * mean
    edge = high + table.jitter * mean  # room that a grain needs around its place
    box = _box(scene, table)
    across, up = (box[2:] - box[:2]) / pitch
    _check_number(scene, index, across if table.count else across * up)
    places = _sites(box, edge, pitch, table.fill == "hexagonal")
    places = places[taken.free(places, np.full(len(places), edge * (1 - 1e-9)))]  # they may touch
    if not len(places) or len(places) < (table.count or 0):
        raise _too_many(scene, index, len(places))
    places = places[: table.count]
    places = places + rng.uniform(-1, 1, places.shape) * table.jitter * mean
    return _at_rest(places, drawn(table.radius, len(places), rng, scene.form(table.shape).reach))


def _sites(box: np.ndarray, edge: float, pitch: float, hexagonal: bool) -> np.ndarray:
    """Sites (n, 2) of a lattice whose rows are centred in the box and stay `edge` away from its sides."""
    rise = pitch * np.sqrt(0.75) if hexagonal else pitch
    width, height = box[2:] - box[:2] - 2 * edge
    columns, rows = int(width / pitch + 1 + 1e-6), int(height / rise + 1 + 1e-6)
    if width < -1e-6 * pitch or height < -1e-6 * pitch:
        return np.empty((0, 2))
    rows = min(rows, MOST_GRAINS // columns + 1)
    wide = hexagonal and width >= (columns - 0.5) * pitch * (1 - 1e-6)  # the rows that are shifted hold as many
    left = (box[0] + box[2] - (columns - (0.5 if wide else 1)) * pitch) / 2
    lines = []
    for row in range(rows):
        shifted = hexagonal and row % 2 == 1
        x = left + pitch * (np.arange(columns - (shifted and not wide)) + (0.5 if shifted else 0.0))
        lines.append(np.stack([x, np.full(len(x), box[1] + edge + row * rise)], axis=1))
    return np.concatenate(lines)


def _check_number(scene: Scene, index: int, count: float) -> None:
    if count > MOST_GRAINS:
        raise scene.error(f"grains[{index}]", f"would make more than the {MOST_GRAINS} grains that a scene may have")


def _too_many(scene: Scene, index: int, room: int) -> Exception:
    table = scene.grains[index]
    if table.count is None or room == 0:
        return scene.error(f"grains[{index}]", "not one grain of this size fits the region")
    return scene.error(f"grains[{index}]", f"count {table.count} does not fit the region: room for about {room}")
