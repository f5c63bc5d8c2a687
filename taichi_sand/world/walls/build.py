"""From the [[walls]] of a scene to the tables of the world, at the start and while it runs."""

import math
from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.scene import moving
from taichi_sand.scene.grains import Pack
from taichi_sand.scene.materials import number_of
from taichi_sand.scene.moving import moving_walls
from taichi_sand.scene.nearby import images, segments
from taichi_sand.world.search.neighbour_list import MOST_REACH
from taichi_sand.world.sleep.fall_asleep import wake
from taichi_sand.world.tables import World, write_rows
from taichi_sand.world.walls.joints import Part, join
from taichi_sand.world.walls.motion import BLUR, JAMMED, TOLERANCES, Movers, allocate_movers, clocks_of, constants, go_on, hours, set_out
from taichi_sand.world.walls.polylines import Frame, Own, clipped
from taichi_sand.world.walls.segments import COLUMNS, build_walls, cast_parts, edge_parts, fits, part_room, renumber, write_walls

SIDES = ("left", "right", "bottom", "top")


def wall_parts(scene: Any, unit: float) -> list[Part]:
    """Edges and walls of `scene` in parts, where the smallest grain has diameter `unit` [m]. Those that stand still are joined with one
    another, and cut off at the box; each that moves is joined with itself.
    """
    size, wraps = np.array(scene.size), np.array(scene.periodic)
    walled = tuple(getattr(scene.edges, side) == "wall" for side in SIDES)
    still = Frame(size, wraps, walled, unit, float(size[wraps].min() / 4) if wraps.any() else np.inf)
    lines = [
        (piece, own_of(scene, wall)) for wall in scene.walls if not moving.moves(wall) for piece in clipped(moving.corners(wall), still)
    ]
    speeds = [getattr(scene.edges.surface_velocity, side) for side in SIDES]
    parts = edge_parts(scene.size, walled, number_of(scene, scene.edges.material), speeds) + join(lines, still)
    for mover, wall in enumerate(moving_walls(scene)):
        free = still._replace(walled=(False,) * 4, wraps=wraps & (not moving.turns(wall)))
        parts += join([(moving.corners(wall), own_of(scene, wall))], free, mover)
    return parts


def own_of(scene: Any, wall: Any) -> Own:
    """Coefficient of friction of its own, < 0: it has none; velocity of its surface along it [m/s]; and number of its material."""
    return -1.0 if wall.friction is None else wall.friction, wall.surface_velocity, number_of(scene, wall.material)


def standing_walls(world: World, scene: Any) -> list[np.ndarray]:
    """Corners (n, 2) [m] of every one of the [[walls]] of `scene`, where it is now."""
    times = iter(hours(world.movers)) if world.moves else iter(())
    return [moving.corners(wall, next(times) if moving.moves(wall) else 0.0) for wall in scene.walls]


def wall_segments(world: World, scene: Any) -> np.ndarray:
    """The straight parts of the [[walls]] where they are now (m, 2, 2) [m], with those that are seen beyond periodic edges."""
    return images(segments(standing_walls(world, scene)), scene.size, scene.periodic)


def fastest_wall(scene: Any) -> float:
    """Speed of the fastest point of a wall, or of its surface, or that of an edge [m/s]."""
    return max([abs(speed) for _, speed in scene.edges.surface_velocity] + [moving.top_speed(wall) for wall in scene.walls])


def shortest_shake(scene: Any) -> float:
    """Shortest period with which a wall is shaken or rocked [s]; infinite if none is."""
    return min((moving.shortest_period(wall) for wall in scene.walls), default=math.inf)


def wall_loads(scene: Any, pack: Pack) -> dict[str, float]:
    """What walls with `force` or `pressure` load the grains of `pack` with, as members of a bed: spread over the columns of grains that a
    wall spans.
    """
    driven, count = [wall for wall in scene.walls if moving.drive(wall)], max(1, len(pack))
    diameter = 2 * float(pack.size.mean()) if len(pack) else math.inf
    columns = [min(count, max(1.0, moving.breadth(wall) / diameter)) for wall in driven]
    loads = [wall.pressure * diameter if wall.pressure else wall.force / spread for wall, spread in zip(driven, columns, strict=True)]
    thrust = max((load for load in loads if math.isfinite(load)), default=0.0)
    energy = max((0.5 * (wall.mass or 0.0) * math.hypot(*wall.velocity) ** 2 for wall in driven), default=0.0)
    return {"thrust": thrust, "ram": energy / count}


def check_speeds(scene: Any, cap: float) -> None:
    """SandError if a wall moves faster than can be followed, `cap` [m/s]."""
    speeds = {f"edges.surface_velocity.{side}": abs(speed) for side, speed in scene.edges.surface_velocity}
    speeds |= {f"walls.{wall.name}" if wall.name else f"walls[{k}]": moving.top_speed(wall) for k, wall in enumerate(scene.walls)}
    for name, speed in speeds.items():
        if speed > cap:
            text = f"moves at up to {speed:.3g} m/s; with this step no more than {cap:.3g} m/s can be followed, a smaller one allows more"
            raise scene.error(name, text)


def set_patience(world: World, scene: Any) -> None:
    """How deep grains may be pressed into a moving wall of `scene` before it slows down."""
    if world.moves:
        kind = scene.solver.kind
        deep = max(JAMMED, TOLERANCES[kind] * scene.solver.tolerance)
        world.movers.blur[None] = BLUR[kind]
        world.movers.jam[None] = deep * world.box[None].diameter


def lay_walls(
    scene: Any,
    parts: list[Part],
    entries: list[np.ndarray],
    sites: tuple[int, int],
    room: int,
    moving_room: int,
    gpu: bool,
    real: Any,
) -> dict[str, Any]:
    """Tables of still and moving walls, with room for `room` entries of still ones and for `moving_room` of others."""
    walls = build_walls(parts, entries, real, room, moving_room, bool(scene.materials))
    movers = build_movers(scene, parts, walls, sites, gpu, real)
    return {"walls": walls, "movers": movers, "moves": movers is not None}


def build_movers(scene: Any, parts: list[Part], walls: Any, sites: tuple[int, int], gpu: bool, real: Any) -> Movers | None:
    """The tables of the walls of `scene` that move; None if none does."""
    found = moving_walls(scene)
    if not found:
        return None
    count, entries = sum(part.mover >= 0 for part in parts), walls.part.shape[0] - walls.room
    driven = any(moving.drive(wall) for wall in found)
    movers = allocate_movers(real, real if gpu else ti.f64, len(found), part_room(walls.room, parts), count, sites, entries, driven)
    set_out(movers, scene)
    write_parts(movers, parts)
    return movers


def part_columns(parts: list[Part], pivots: np.ndarray) -> dict[str, np.ndarray]:
    """Which parts move, and how they lie at time 0 from the pivots (walls, 2) [m] of their walls; a row a part that moves."""
    those = [(number, part) for number, part in enumerate(parts) if part.mover >= 0]
    return {
        "part": np.array([number for number, _ in those]),
        "home": np.array([[*(part.point - pivots[part.mover]), *part.along] for _, part in those]),
        "bounds": np.array([part.bounds for _, part in those]),
        "slopes": np.array([part.slopes for _, part in those]),
        "side": np.array([part.side for _, part in those]),
    }


def owners(movers: Movers, parts: list[Part]) -> np.ndarray:
    """Which moving wall every part belongs to, -1 where none, for all that there is room for."""
    return np.array([part.mover for part in parts] + [-1] * (movers.wall.shape[0] - len(parts)))


def write_parts(movers: Movers, parts: list[Part]) -> None:
    """Puts the parts that move into the table."""
    columns = part_columns(parts, movers.pivot.to_numpy())
    for name, values in columns.items():
        write_rows(getattr(movers, name), values)
    write_rows(movers.wall, owners(movers, parts))
    movers.parts[None] = len(columns["part"])


def entries_of(world: World, parts: list[Part]) -> list[np.ndarray]:
    """Where the parts that stand still are felt from; see `cast_parts`."""
    box = world.box[None]
    reach = box.largest / 2 + MOST_REACH * box.diameter + box.bridge
    return cast_parts(parts, tuple(box.spacing), tuple(box.sites), reach, world.periodic)


def tables_of(world: World, scene: Any) -> dict[str, np.ndarray]:
    """What the walls of `scene` make of the tables of `world`, which has room for them: their first rows, by name."""
    parts = wall_parts(scene, world.box[None].least)
    found = dict(zip(COLUMNS, entries_of(world, parts), strict=True))
    tables = {f"walls.{name}": values for name, values in found.items()}
    if world.walls.rough:
        tables["walls.friction"] = np.array([part.friction for part in parts])
    if world.walls.belts:
        tables["walls.surface"] = np.array([part.surface for part in parts])
    if world.mixed:
        tables["walls.material"] = np.array([part.material for part in parts])
    if world.moves:
        fixed = constants(scene)
        moved = {**fixed, **part_columns(parts, fixed["pivot"]), "wall": owners(world.movers, parts)}
        moved |= {"walls": np.array(len(fixed["spin"])), "parts": np.array(len(moved["part"]))}
        tables |= {f"movers.{name}": values for name, values in moved.items()}
    return tables


def structure_fits(world: World, scene: Any) -> bool:
    """Whether `world` has been made for walls of the kinds that `scene` has, and for as many that move."""
    found, kinds = moving_walls(scene), [own_of(scene, wall) for wall in scene.walls]
    rough, belts = any(friction >= 0 for friction, _, _ in kinds), any(speed for _, speed, _ in kinds)
    if (rough and not world.walls.rough) or (belts and not world.walls.belts) or (found and not world.moves):
        return False
    if not world.moves:
        return True
    parts = sum(part.mover >= 0 for part in wall_parts(scene, world.box[None].least))
    room = len(found) < world.movers.twist.shape[0] and parts <= world.movers.part.shape[0]
    return room and (world.movers.driven or not any(moving.drive(wall) for wall in found))


def places_now(parts: list[Part], walls: list[Any], times: Any) -> np.ndarray:
    """Where parts are when the clocks of the moving `walls` show `times` [s]: point, direction and bounds, (parts, 6) [m]."""
    found = np.array([[*part.point, *part.along, *part.bounds] for part in parts]).reshape(-1, 6)
    for m, (wall, time) in enumerate(zip(walls, times, strict=True)):
        rows = np.array([part.mover == m for part in parts])
        cos, sin = np.cos(moving.turn_at(wall, time)), np.sin(moving.turn_at(wall, time))
        turn = np.array([[cos, sin], [-sin, cos]])
        found[rows, :2] = (found[rows, :2] - moving.pivot(wall)) @ turn + moving.pivot_at(wall, float(time))
        found[rows, 2:4] = found[rows, 2:4] @ turn
        ends = rows & np.array([part.side == -1 for part in parts])
        found[ends, 4:] = found[ends, 4:] @ turn
    return found


def change_walls(world: World, before: Any, after: Any, clocks: dict[str, np.ndarray] | None = None) -> None:
    """Puts the walls of scene `after` in the place of those of `before`, for the next list build; SandError if there is no room for them.

    What grains carry on parts that stay is remembered, and walls that move as they did go on from their `clocks`, those there are unless
    they are given.
    """
    unit = world.box[None].least
    old, new = (wall_parts(scene, unit) for scene in (before, after))
    entries = entries_of(world, new)
    if not fits(world.walls, new, entries):
        raise after.error("walls", "there is no room for so many walls in this simulation")
    wake(world)
    clocks = clocks_of(world.movers) if clocks is None else clocks
    here = places_now(old, moving_walls(before), clocks["age"] + clocks["since"] if clocks else ()) / unit
    if world.moves:
        go_on(world.movers, before, after, clocks)
        write_parts(world.movers, new)
        set_patience(world, after)
    there = places_now(new, moving_walls(after), hours(world.movers) if world.moves else ()) / unit
    numbers = np.append(renumber(old, new, here, there), -1)
    rows = world.pairs.second.to_numpy()
    start = world.pace[None].half * world.half + world.wall_base
    part = rows[start : start + world.wall_half]
    part[:] = numbers[np.where((part >= 0) & (part < len(old)), part, len(old))]
    world.pairs.second.from_numpy(rows)
    write_walls(world.walls, new, entries)
    world.pace[None].spent = 1
