"""Walls that move: their clocks, where they are, how fast, and the lattice sites they are felt from.

Every moving wall has a clock, and is where the scene says it is at the time that its clock shows (scene.moving). The clock keeps
simulated time, unless grains are wedged between it and what it closes on, another wall or a fixed grain: a wall without `force` or
`pressure` then slows down, waits and yields; one with it runs as that and what it meets make it (world.walls.servo). Since the last
list build a wall has turned and shifted a little; its parts are listed anew, by lattice site, in every one.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.scene import moving
from taichi_sand.scene.loaded import spans
from taichi_sand.taichi_support import field_pool
from taichi_sand.world.flags import WALL_WAITS, flag
from taichi_sand.world.tables import round_up, site_rows, write_rows

JAMMED, TOLERANCES = 0.06, {"md": 3.0, "rigid": 1.5}
"""Overlap with a wall at which it slows down, if something bears against it: in mean diameters, or, if that is more, in tolerances. It
waits at a quarter as much again, and yields from half as much again on: if it did not wait in between, it would follow the grains about
for good. Rigid grains squeezed by a wall overlap one another several times as deep as the wall."""
BLUR = {"md": 20.0, "rigid": 1.0}
"""Steps over which overlaps are averaged: soft grains that hit a wall overlap for as long as a collision lasts, which is no jam."""
LASTS = 4.0
"""What bears against a wall is kept in mind for so many times as long: in a wedge the ends are pressed by turns."""


CLOCKS = ("age", "since", "rate", "onward", "strain", "brace")
"""Columns that change as a wall goes on, and follow from nothing else."""
SCALARS = ("lever", "force", "mass", "speed", "since", "rate", "onward", "phase", "tilt", "press", "brace", "strain")


class Movers(NamedTuple):
    """Shape (more than moving walls,) unless said otherwise; `wide` numbers have 64 bits on a CPU."""

    walls: Any  # 0-D i32: how many move
    parts: Any  # 0-D i32: how many parts these have
    velocity: Any  # as the scene has it, as what follows up to `lever`: 2-vector [m/s], wide
    spin: Any  # [rad/s], wide
    pivot: Any  # 2-vector [m], wide
    amplitude: Any  # of the sine of its shaking, 2-vector [m], wide
    swing: Any  # of the cosine
    omega: Any  # [rad/s], wide
    rock: Any  # largest angle of its rocking [rad], wide
    beat: Any  # [rad/s], wide
    lever: Any  # of the farthest point [m]
    force: Any  # that it is driven with, for every metre of `span` [N/m], or in all [N]; 0 = it has none, and moves as the scene has it
    span: Any  # own ends across its course, and of what is beside it, at time 0 (scene.loaded): 4-vector [m]; 0, 1, 0, 1 of one with force
    beside: Any  # which moving walls the latter are, -1 = what stands still: 2-vector, i32
    mass: Any  # of a wall with force [kg]
    way: Any  # its course, a unit 2-vector
    speed: Any  # along it at rate 1 [m/s]
    age: Any  # what the clock showed at the last list build [s], wide
    since: Any  # what it has gone on since [s]
    rate: Any  # how fast it goes in this step
    onward: Any  # how fast a wall with force goes into the next one
    hinge: Any  # where the pivot was at the last list build [m], 2-vector
    phase: Any  # of the shaking then [rad]
    tilt: Any  # of the rocking then [rad]
    start: Any  # motion then: velocity of the pivot x, y and spin, 0; 4-vector
    pose: Any  # cosine and sine of the turn, and the shift of the pivot, since; 4-vector
    course: Any  # motion that the scene asks for now
    twist: Any  # motion now
    press: Any  # deepest overlap that it drives at in this step, as the solver counts it [m]
    brace: Any  # up to how deep an overlap anything else bears against it, or lately did [m]
    strain: Any  # what it is held up by: average of the two [m]
    jam: Any  # 0-D: average at which a wall without a force slows down [m]
    blur: Any  # 0-D: steps that are averaged over
    wall: Any  # of every part of all walls: which moving wall it belongs to, -1 = none; shape (more than parts,), i32
    part: Any  # of every part that moves, as the next three: its number; shape (more than moving parts,), i32
    home: Any  # its point from the pivot, and its `along`, at time 0; 4-vector, wide
    bounds: Any  # as of joints.Part, at time 0
    slopes: Any  # as of joints.Part
    side: Any  # as of joints.Part
    head: Any  # last entry of each lattice site, -1 = none; shape (sites,), i32
    next: Any  # the entry before, from row `first` of the walls on; shape (entries,), i32
    site: Any  # its site
    arm: Any  # from the centre of the site to the pivot [m], 2-vector
    count: Any  # 0-D i32: entries in use
    first: Any  # 0-D i32: a row of the neighbour list of a wall with force, -1 = none; see Pairs.driven
    driven: bool  # whether any wall has a force


def allocate_movers(real: Any, wide: Any, walls: int, every: int, parts: int, sites: tuple[int, int], entries: int, driven: bool) -> Movers:
    """Empty tables for so many moving walls, parts of all walls, parts that move, lattice sites and entries."""
    walls, parts = round_up(walls), round_up(parts)
    pairs = {"velocity": wide, "pivot": wide, "amplitude": wide, "swing": wide, "hinge": real, "way": real, "beside": ti.i32}
    columns: dict[str, Any] = {name: field_pool.vectors(2, kind, walls) for name, kind in pairs.items()}
    columns |= {name: field_pool.vectors(4, real, walls) for name in ("start", "pose", "course", "twist")}
    columns |= {"span": field_pool.vectors(4, wide, walls)}
    columns |= {name: field_pool.scalars(wide, walls) for name in ("spin", "omega", "rock", "beat", "age")}
    columns |= {name: field_pool.scalars(real, walls) for name in SCALARS}
    columns |= {
        **{name: field_pool.scalars(ti.i32, ()) for name in ("walls", "parts", "count", "first")},
        "jam": field_pool.scalars(real, ()),
        "blur": field_pool.scalars(real, ()),
        "wall": field_pool.scalars(ti.i32, every),
    }
    columns |= {
        "part": field_pool.scalars(ti.i32, parts),
        "side": field_pool.scalars(ti.i32, parts),
        "home": field_pool.vectors(4, wide, parts),
    }
    columns |= {"bounds": field_pool.vectors(2, wide, parts), "head": field_pool.scalars(ti.i32, site_rows(sites))}
    columns |= {"slopes": field_pool.vectors(2, real, parts), "arm": field_pool.vectors(2, real, entries)}
    columns |= {name: field_pool.scalars(ti.i32, entries) for name in ("next", "site")}
    return Movers(**columns, driven=driven)


def constants(scene: Any) -> dict[str, np.ndarray]:
    """What of their tables follows from the [[walls]] of `scene` that move, and stays; a row a wall."""
    walls = moving.moving_walls(scene)
    shakes, rocks, (span, beside) = [moving.shaking(wall) for wall in walls], [moving.rocking(wall) for wall in walls], spans(scene)
    speeds = np.array([np.hypot(*wall.velocity) for wall in walls])
    velocities = np.array([wall.velocity for wall in walls])
    columns = {
        "velocity": velocities,
        "spin": [wall.spin for wall in walls],
        "pivot": [moving.pivot(wall) for wall in walls],
        "amplitude": [sine for sine, _, _ in shakes],
        "swing": [cosine for _, cosine, _ in shakes],
        "omega": [omega for _, _, omega in shakes],
        "rock": [angle for angle, _ in rocks],
        "beat": [beat for _, beat in rocks],
        "lever": [moving.lever(wall) for wall in walls],
        "force": [moving.drive(wall) for wall in walls],
        "span": span,
        "beside": beside,
        "mass": [wall.mass or 0.0 for wall in walls],
        "way": velocities / np.maximum(speeds, 1e-30)[:, None],
        "speed": speeds,
    }
    return {name: np.array(values) for name, values in columns.items()}


def set_out(movers: Movers, scene: Any) -> None:
    """All clocks at 0, for the [[walls]] of `scene` that move; one with a mass starts from rest."""
    walls = moving.moving_walls(scene)
    rates = np.array([0.0 if wall.mass else 1.0 for wall in walls])
    columns = {**constants(scene), "rate": rates, "onward": rates}
    columns |= {name: np.full(getattr(movers, name).shape[0], -1) for name in ("head", "next")}
    for name, values in columns.items():
        write_rows(getattr(movers, name), values)
    movers.walls[None] = len(walls)
    movers.first[None] = -1


def clocks_of(movers: Movers | None) -> dict[str, np.ndarray]:
    """What goes on with each moving wall, a row each; nothing without any."""
    return {name: getattr(movers, name).to_numpy()[: movers.walls[None]] for name in CLOCKS} if movers else {}


def go_on(movers: Movers, before: Any, after: Any, clocks: dict[str, np.ndarray]) -> None:
    """The moving [[walls]] of scene `after` take the place of those of `before` with these clocks: what moves as it did goes on, others
    set out.
    """
    set_out(movers, after)
    left = dict(enumerate(map(moving.motion, moving.moving_walls(before))))
    columns = {name: getattr(movers, name).to_numpy() for name in CLOCKS}
    for name in CLOCKS:
        if name not in ("rate", "onward"):
            columns[name][:] = 0
    for row, wall in enumerate(moving.moving_walls(after)):
        same = next((number for number, other in left.items() if other == moving.motion(wall)), None)
        if same is not None:
            del left[same]
            for name, values in columns.items():
                values[row] = clocks[name][same]
    for name, values in columns.items():
        getattr(movers, name).from_numpy(values)


def hours(movers: Movers) -> np.ndarray:
    """What the clock of each moving wall shows [s]."""
    return (movers.age.to_numpy().astype(float) + movers.since.to_numpy())[: movers.walls[None]]


@ti.func
def shift_of(movers: ti.template(), m, phase, time):
    """Shift of the pivot of wall m within `time` after the shaking had this phase [m]."""
    turn = 0.5 * movers.omega[m] * time
    shift = movers.velocity[m] * time + 2.0 * ti.cos(phase + turn) * ti.sin(turn) * movers.amplitude[m]
    return shift - 2.0 * ti.sin(phase + turn) * ti.sin(turn) * movers.swing[m]


@ti.func
def turned_within(movers: ti.template(), m, tilt, time):
    """By how much wall m turns within `time` after the rocking had this phase [rad]."""
    turn = 0.5 * movers.beat[m] * time
    return movers.spin[m] * time + 2.0 * ti.cos(tilt + turn) * ti.sin(turn) * movers.rock[m]


@ti.func
def turn_at(movers: ti.template(), m, age):
    """By how much wall m has turned when its clock shows `age` [rad], wide."""
    return movers.spin[m] * age + movers.rock[m] * ti.sin(movers.beat[m] * age)


@ti.func
def motion_at(movers: ti.template(), m, phase, tilt):
    """Velocity of the pivot [m/s] and spin [rad/s] of wall m when shaking and rocking have these phases, its clock going at rate 1."""
    v = movers.velocity[m] + movers.omega[m] * ti.cos(phase) * movers.amplitude[m]
    v -= movers.omega[m] * ti.sin(phase) * movers.swing[m]
    return ti.Vector([v.x, v.y, movers.spin[m] + movers.beat[m] * ti.cos(tilt) * movers.rock[m], 0.0])


@ti.func
def place_walls(w: ti.template(), ahead, lead):
    """Puts the moving walls where they are `ahead` of this step, 0 … 1, with the motion that they have at `lead` of it."""
    movers = ti.static(w.movers)
    if w.pace[None].spent == 0:
        for m in range(movers.walls[None]):
            step = movers.rate[m] * w.pace[None].step
            time = movers.since[m] + ahead * step
            turn = ti.cast(turned_within(movers, m, movers.tilt[m], time), w.real)
            shift = ti.cast(shift_of(movers, m, movers.phase[m], time), w.real)
            movers.pose[m] = ti.Vector([ti.cos(turn), ti.sin(turn), shift.x, shift.y])
            hour = movers.since[m] + lead * step
            phase, tilt = movers.phase[m] + movers.omega[m] * hour, movers.tilt[m] + movers.beat[m] * hour
            movers.course[m] = ti.cast(motion_at(movers, m, phase, tilt), w.real)
            movers.twist[m] = ti.cast(movers.rate[m], w.real) * movers.course[m]
            movers.press[m] = 0.0


@ti.func
def close_walls(w: ti.template()):
    """Ends a step: the clocks have gone on, and go on as what is in the way allows; notes how far walls are off their foreseen paths."""
    movers = ti.static(w.movers)
    pace = w.pace[None]
    for m in range(movers.walls[None]):
        movers.since[m] += movers.rate[m] * pace.step
        if movers.force[m] > 0.0:
            movers.rate[m] = movers.onward[m]
        else:
            movers.strain[m] += (ti.min(movers.press[m], movers.brace[m]) - movers.strain[m]) / movers.blur[None]
            movers.brace[m] *= 1.0 - 1.0 / (LASTS * movers.blur[None])
            jam = movers.strain[m] / movers.jam[None]
            movers.rate[m] = ti.max(0.0, ti.min(1.0, 5.0 - 4.0 * jam)) - ti.max(0.0, ti.min(1.0, 4.0 * jam - 6.0))
            if movers.rate[m] < 1.0:
                flag(w, WALL_WAITS, m)
        time = ti.cast(pace.since + 1, w.real) * pace.step
        turn = ti.cast(turned_within(movers, m, movers.tilt[m], movers.since[m]), w.real)
        shift = ti.cast(shift_of(movers, m, movers.phase[m], movers.since[m]), w.real)
        off = (shift - movers.start[m].xy * time).norm()
        off += movers.lever[m] * (ti.abs(turn - movers.start[m].z * time) + 0.5 * turn * turn)
        if 4.0 * off * off > pace.skin * pace.skin:
            w.pace[None].strayed = 1
        movers.pose[m] = ti.Vector([ti.cos(turn), ti.sin(turn), shift.x, shift.y])


@ti.func
def held_up(w: ti.template()):
    """Whether grains are jammed in the way of a wall without a force."""
    waits = False
    if ti.static(w.moves):
        for m in range(w.movers.walls[None]):
            waits = waits or (w.movers.force[m] == 0.0 and w.movers.rate[m] < 1.0)
    return waits


@ti.func
def start_walls(w: ti.template()):
    """In a list build: where the moving walls are is where they start from now. Returns their fastest point [m/s] and spin [rad/s]."""
    movers = ti.static(w.movers)
    fastest = ti.Vector([0.0, 0.0])
    for m in range(movers.walls[None]):
        age = movers.age[m] + movers.since[m]
        phase, tilt = within_turn(movers.omega[m] * age), within_turn(movers.beat[m] * age)
        movers.age[m], movers.since[m] = age, 0.0
        movers.phase[m], movers.tilt[m] = ti.cast(phase, w.real), ti.cast(tilt, w.real)
        movers.hinge[m] = ti.cast(pivot_at(movers, m, age, phase), w.real)
        movers.pose[m] = ti.Vector([1.0, 0.0, 0.0, 0.0])
        movers.start[m] = ti.cast(movers.rate[m] * motion_at(movers, m, phase, tilt), w.real)
        motion = movers.start[m]
        speed = motion.xy.norm() + ti.abs(motion.z) * movers.lever[m]
        fastest = ti.max(fastest, ti.Vector([speed, ti.abs(motion.z)]))
    return fastest


@ti.func
def pivot_at(movers: ti.template(), m, age, phase):
    """Where the pivot of wall m is when its clock shows `age` [m], wide."""
    swung = (1.0 - ti.cos(phase)) * movers.swing[m]
    return movers.pivot[m] + movers.velocity[m] * age + ti.sin(phase) * movers.amplitude[m] - swung


@ti.func
def within_turn(angle):
    """The same angle, 0 … 2 π."""
    turns = angle / (2 * ti.math.pi)
    return 2 * ti.math.pi * (turns - ti.floor(turns))
