"""What the keys of a scene file must hold to together; each check raises `Wrong`, which the schema turns into a SandError."""

from itertools import pairwise
from typing import Any

import numpy as np

from taichi_sand.errors import Wrong, show, suggest
from taichi_sand.scene.delimited import HEAD
from taichi_sand.scene.moving import drive, moves, turns
from taichi_sand.scene.rows import LENGTHS
from taichi_sand.scene.shapes import BUILT_IN, joined, overlapping
from taichi_sand.scene.sizes import limits

OWNED = {
    "rigid": ("substeps", "hertz"),
    "md": ("stiffness", "integrator", "law", "k_r", "k_d", "alpha", "beta"),
}
"""Keys of [solver] that belong to one kind only."""
LIGHTEST = 1e-6  # areal density [kg/m2]
SMALLEST, LARGEST = 1e-6, 1e6  # radius of a disc, side of the box [m]: what 32 bits can hold the inertia and the places of


def foreign(kind: str) -> tuple[str, ...]:
    """Returns the keys of [solver] that have no meaning for this kind."""
    return tuple(name for other, names in OWNED.items() if other != kind for name in names)


def solver(table: Any) -> None:
    """Keys of the other kind, keys that exclude each other, and what a custom law needs."""
    given = {name for name in table.model_fields_set if getattr(table, name) != type(table).model_fields[name].default}
    for name in foreign(table.kind):
        if name in given:
            other = "rigid" if table.kind == "md" else "md"
            raise Wrong(name, f" belongs to the {other} solver; this scene uses {table.kind}")
    _only_one(given, "step", "substeps")
    _only_one(given, "stiffness", "k_r")
    if table.law != "custom":
        for name in ("alpha", "beta"):
            if name in given:
                raise Wrong(name, f' belongs to law = "custom"; this scene uses "{table.law}"')
        return
    alpha, beta = table.alpha, table.beta
    if alpha is None or beta is None:
        raise Wrong("law", ' = "custom" needs `alpha` and `beta`')
    if table.k_d is None and abs(alpha - (beta - 1) / 2) > 1e-9:
        raise Wrong(
            "law",
            f' = "custom" needs `k_d` with alpha = {alpha:g}, beta = {beta:g}: its restitution depends on the speed '
            f"(only with alpha = (beta - 1)/2 = {(beta - 1) / 2:g} does it follow from `restitution`)",
        )


def grains(table: Any) -> None:
    """Either places or a region to fill; a radius from one side; keys that belong to a pattern."""
    if table.radius is not None:
        _ordered("radius", limits(table.radius), SMALLEST)
    _ordered("speed", table.speed, 0.0)
    given = {name for name in table.model_fields_set if getattr(table, name) is not None}
    if table.positions is None:
        if table.count is None and table.fill is None:
            raise Wrong("", " needs `count`, `fill`, `positions` or `positions_file`")
        if table.radius is None:
            raise Wrong("radius", " is missing: radius of a disc (m)")
    else:
        for name in ("count", "fill", "region", "pitch", "jitter"):
            _only_one(given, "positions", name)
        _rows(table)
    for name in ("pitch", "jitter"):
        if name in given and table.fill not in ("lattice", "hexagonal"):
            raise Wrong(name, ' belongs to fill = "lattice" or "hexagonal"')
    if table.region is not None:
        region(table.region)


def region(box: tuple[float, float, float, float], name: str = "region") -> None:
    """Its corners in order."""
    if not (box[0] < box[2] and box[1] < box[3]):
        raise Wrong(name, f" = {show(box)} must be [x0, y0, x1, y1] with x0 < x1 and y0 < y1")


def water(table: Any) -> None:
    """A region in order, and keys that belong to a rate."""
    region(table.region)
    for name in ("velocity", "since", "until"):
        if name in table.model_fields_set and table.rate is None:
            raise Wrong(name, " needs a `rate`: without one the water is there at the start")
    if table.until is not None and table.until <= table.since:
        raise Wrong("until", f" = {table.until:g} must be later than since = {table.since:g}")


def source(table: Any) -> None:
    """A radius from low to high, and a region in order."""
    _ordered("radius", limits(table.radius), SMALLEST)
    region(table.region)


def _rows(table: Any) -> None:
    assert table.positions is not None
    if not table.positions:
        raise Wrong("positions", " = [] holds no grains")
    length = len(table.positions[0])
    for index, row in enumerate(table.positions):
        if len(row) != length or length not in LENGTHS:
            wanted = length if length in LENGTHS else "2, 3, 5, 6, 7 or 8"
            text = f" has {len(row)} numbers instead of {wanted} ({HEAD})"
            raise Wrong(f"positions[{index}]", text)
        if length > 2 and row[2] < SMALLEST:
            raise Wrong(f"positions[{index}]", f" = {show(row)}: the radius must be at least {SMALLEST:g} m")
        if length > 7 and row[7] < LIGHTEST:
            raise Wrong(f"positions[{index}]", f" = {show(row)}: the density must be at least {LIGHTEST:g} kg/m2")
    if length > 7 and "density" in table.model_fields_set:
        raise Wrong("density", " is given twice: as a key and in the rows of `positions`")
    if length > 2 and table.radius is not None:
        raise Wrong("radius", " is given twice: as a key and in the rows of `positions`")
    if length == 2 and table.radius is None:
        raise Wrong("radius", " is missing: radius of a disc (m), as a key or as third number of the rows of `positions`")


def shape(table: Any) -> None:
    """A name of its own, discs of some size, and one piece."""
    if table.name in BUILT_IN:
        raise Wrong("name", f' = "{table.name}" is a shape that there is already')
    for index, (_, _, radius) in enumerate(table.discs):
        if not 1e-3 <= radius <= 1e3:
            raise Wrong(f"discs[{index}]", f" = {show(table.discs[index])}: the radius must lie in 0.001 … 1000")
    if not joined(table.discs):
        raise Wrong("discs", " must hang together: each disc must touch or overlap another one")


def wall(table: Any) -> None:
    """No segment without length: it would have no direction; and keys of a motion that fit together."""
    points = table.points + (table.points[:1] if table.closed else ())
    for index, (start, end) in enumerate(pairwise(points)):
        if start == end:
            after = (index + 1) % len(table.points)
            raise Wrong(f"points[{after}]", f" = {show(end)} is the same as the point before it")
    _moving_wall(table)


def _moving_wall(table: Any) -> None:
    """What belongs to a motion that there is."""
    if table.surface_velocity and turns(table):
        raise Wrong("surface_velocity", f" does not go with a `{'spin' if table.spin else 'rock'}`")
    if table.pivot is not None and not turns(table):
        raise Wrong("pivot", " needs a `spin` or a `rock`")
    if table.force is not None and table.pressure:
        raise Wrong("force", " and `pressure` exclude each other")
    push = "pressure" if table.pressure else "force"
    driven = drive(table) > 0
    if table.mass is not None and not driven:
        raise Wrong("mass", " needs a `force` or a `pressure`: a wall without one moves as its keys say, whatever it weighs")
    if driven and not any(table.velocity):
        raise Wrong(push, " needs a `velocity`: the one that it pushes along, and that the wall has when nothing resists")
    if driven and (turns(table) or table.shake is not None):
        raise Wrong(push, " goes with a `velocity` alone, not with `spin`, `rock` or `shake`")


SHOWS = {"temperature": "heat", "moisture": "moisture", **dict.fromkeys(("saturation", "water pressure", "water speed"), "water")}
"""Values of view.color that there are only with an effect."""


def scene(table: Any) -> None:
    """What must lie inside the box, and edges that come in pairs."""
    if min(table.size) <= 0 or max(table.size) > LARGEST:
        raise Wrong("size", f" = {show(table.size)} must be greater than 0 and at most {LARGEST:g} m both ways")
    edges = table.edges
    for one, other in (("left", "right"), ("bottom", "top")):
        if (getattr(edges, one) == "periodic") != (getattr(edges, other) == "periodic"):
            text = f' = "{getattr(edges, one)}" but edges.{other} = "{getattr(edges, other)}": periodic edges come in opposite pairs'
            raise Wrong(f"edges.{one}", text)
    if edges.shear_rate:
        _sheared(table)
    for side, speed in edges.surface_velocity:
        where = f"edges.surface_velocity.{side}"
        if speed and getattr(edges, side) != "wall":
            raise Wrong(where, f' = {speed:g} but edges.{side} = "{getattr(edges, side)}": only a wall has a surface')
        _belt(table, where, speed)
    names = [*BUILT_IN, *(item.name for item in table.shapes)]
    for index, item in enumerate(table.shapes):
        if names.index(item.name) < len(BUILT_IN) + index:
            raise Wrong(f"shapes[{index}].name", f' = "{item.name}" is the name of two shapes')
    for index, item in enumerate(table.grains):
        name = f"grains[{index}]"
        if item.shape not in names:
            raise Wrong(f"{name}.shape", f" = {show(item.shape)} must be one of {', '.join(names)}{suggest(item.shape, names)}")
        if item.bonded and overlapping(table.discs(item.shape)):
            text = f' = true cannot be had for shape = "{item.shape}": its discs overlap, and would be pushed apart'
            raise Wrong(f"{name}.bonded", text)
        if item.positions is not None:
            if table.scale != 1:
                raise Wrong("scale", f" = {table.scale:g} cannot be had: {name}.positions are exact places")
            _inside(table, f"{name}.positions", np.asarray(item.positions)[:, :2])
        if item.region is not None and _outside(table, np.reshape(item.region, (2, 2))).any():
            raise Wrong(f"{name}.region", f" = {show(item.region)} must lie inside the box, {_box(table)}")
    _flow(table, names)
    for index, item in enumerate(table.walls):
        if not moves(item) and _beyond(table, np.asarray(item.points)):
            raise Wrong(f"walls[{index}].points", f" = {show([list(p) for p in item.points])} lies wholly outside the box, {_box(table)}")
        if item.friction is not None and "friction" not in table.effects:
            raise Wrong(f"walls[{index}].friction", f" = {item.friction:g} needs a table [effects.friction]")
        _belt(table, f"walls[{index}].surface_velocity", item.surface_velocity)
    shown = SHOWS.get(table.view.color)
    if shown and shown not in table.effects:
        raise Wrong("view.color", f' = "{table.view.color}" needs a table [effects.{shown}]')


SHEARED = ("friction", "rolling", "cohesion")
"""Effects that there may be where images slide: what they do between two grains follows from the pair alone."""


def _sheared(table: Any) -> None:
    """What a box has whose images slide."""
    if not all(table.periodic):
        raise Wrong("edges.shear_rate", f" = {table.edges.shear_rate:g} needs four edges that are periodic")
    for kind in ("walls", "sources"):
        if getattr(table, kind):
            raise Wrong("edges.shear_rate", f" = {table.edges.shear_rate:g} does not go with [[{kind}]]")
    for name in table.effects:
        if name not in SHEARED:
            text = f" = {table.edges.shear_rate:g} does not go with [effects.{name}]; with {', '.join(SHEARED)} it does"
            raise Wrong("edges.shear_rate", text)


def _belt(table: Any, where: str, speed: float) -> None:
    """A surface that moves has friction."""
    if speed and "friction" not in table.effects:
        raise Wrong(where, f" = {speed:g} needs a table [effects.friction]: without friction a belt moves nothing")


def _flow(table: Any, names: list[str]) -> None:
    """Sources and sinks lie in the box; a source knows its shape, and has room for its largest grain."""
    for kind in ("sources", "sinks", "water"):
        for index, item in enumerate(getattr(table, kind)):
            if _outside(table, np.reshape(item.region, (2, 2))).any():
                raise Wrong(f"{kind}[{index}].region", f" = {show(item.region)} must lie inside the box, {_box(table)}")
    if table.water and "water" not in table.effects:
        raise Wrong("water[0]", " needs a table [effects.water]")
    for index, item in enumerate(table.sources):
        name = f"sources[{index}]"
        if item.shape not in names:
            raise Wrong(f"{name}.shape", f" = {show(item.shape)} must be one of {', '.join(names)}{suggest(item.shape, names)}")
        widest = 2 * table.form(item.shape).reach * limits(item.radius)[1]
        if min(item.region[2] - item.region[0], item.region[3] - item.region[1]) < widest * (1 - 1e-9):  # as decimals are rounded
            raise Wrong(f"{name}.region", f" = {show(item.region)} is narrower than its largest grain, {widest:g} m")


def _box(table: Any) -> str:
    (x, y), (width, height) = table.origin, table.size
    return f"x {x:g} … {x + width:g}, y {y:g} … {y + height:g} m"


def _outside(table: Any, points: np.ndarray) -> np.ndarray:
    """Which points (n, 2) lie outside the box, by more than what rounding does."""
    slack = 1e-9 * max(table.size)
    points = points - np.asarray(table.origin)
    return np.any((points < -slack) | (points > np.asarray(table.size) + slack), axis=1)


def _beyond(table: Any, points: np.ndarray) -> bool:
    """Whether all points (n, 2) lie on one side of the box, in a direction that is not periodic."""
    slack, points = 1e-9 * max(table.size), points - np.asarray(table.origin)
    for axis, side in enumerate((table.edges.left, table.edges.bottom)):
        if side != "periodic" and ((points[:, axis] < -slack).all() or (points[:, axis] > table.size[axis] + slack).all()):
            return True
    return False


def _inside(table: Any, name: str, points: np.ndarray) -> None:
    for index in np.flatnonzero(_outside(table, points))[:1]:
        raise Wrong(f"{name}[{index}]", f" = {show(points[index].tolist())} lies outside the box, {_box(table)}")


def _only_one(given: set[str], one: str, other: str) -> None:
    if one in given and other in given:
        raise Wrong(one, f" and `{other}` exclude each other")


def _ordered(name: str, limits: tuple[float, float], least: float) -> None:
    low, high = limits
    value = f" = {show(low if low == high else limits)} must be"
    if low < least:
        raise Wrong(name, f"{value} {f'at least {least:g} m' if low > 0 or not least else 'greater than 0 m'}")
    if low > high:
        raise Wrong(name, f"{value} [low, high] with low not above high")
