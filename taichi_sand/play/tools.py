"""The tools of the mouse: what a stroke with each of them does to the grains."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand import effects
from taichi_sand.errors import SandError
from taichi_sand.play import wall_tools
from taichi_sand.play.stroke import Stroke
from taichi_sand.run.simulation import Simulation
from taichi_sand.scene.scatter import Taken
from taichi_sand.scene.schema import MOST_GRAINS
from taichi_sand.world import edit
from taichi_sand.world.build import EARTH
from taichi_sand.world.extras import hand
from taichi_sand.world.walls.build import wall_segments

"""Forces of the hand go with the gravity of the scene, or with this one [m/s2] where the scene has less."""
GRAB_HZ, GRAB_DAMPING = 5.0, 0.7
"""Frequency and damping ratio of a grain on the spring of the hand."""
STIR_RATE, STILL_RATE = 400.0, 1.0
"""How fast a stirred grain takes over the velocity of the hand, and how fast an attracted one is slowed down [1/s]."""
PULL = 4.0
"""Acceleration towards the hand of `attract`, over gravity."""
DARTS, POURED = 120, 4
"""Places tried a frame by `create` and `pour`."""
POUR_SPEED = 0.5
WETTED = 0.02
"""Water that `wet` adds and `dry` takes a frame, as a share of the pores."""


def create(stroke: Stroke) -> None:
    """Fills the brush with grains, wherever there is room for one."""
    _add(stroke, DARTS, stroke.session.brush.size, (0.0, 0.0))


def pour(stroke: Stroke) -> None:
    """A jet of grains, straight down or along gravity."""
    gravity = np.array(stroke.sim.scene.gravity, float)
    size = np.hypot(*gravity)
    way = gravity / size if size > 0 else np.array([0.0, -1.0])
    _add(stroke, POURED, min(stroke.session.brush.size, 4 * stroke.sim.bed.diameter), POUR_SPEED * way)


def _add(stroke: Stroke, darts: int, reach: float, velocity: Any) -> None:
    """New grains in a circle around the hand where nothing is in their way."""
    session, sim = stroke.session, stroke.sim
    room = MOST_GRAINS - sim.count
    if room <= 0:
        raise SandError(f"there cannot be more than {MOST_GRAINS} grains; destroy some first")
    brush, rng = session.brush, session.rng
    sizes = np.sort([brush.low, brush.high]) * 0.5 * sim.bed.diameter
    radius = rng.uniform(*sizes, darts)
    distance, angle = reach * np.sqrt(rng.uniform(0, 1, darts)), rng.uniform(-math.pi, math.pi, darts)
    position = stroke.place + np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)
    turned, spin = rng.uniform(-math.pi, math.pi, darts), rng.uniform(-1, 1, darts) * brush.spin
    fits = np.flatnonzero(_clear(sim, position, radius, stroke.place, reach))[:room]
    if len(fits):
        reach = sim.scene.form_of(sim.scene.grains[brush.kind]).reach if sim.scene.grains else 1.0
        given = {"velocities": velocity, "angles": turned[fits], "spins": spin[fits], "kind": brush.kind}
        sim.add(position[fits], radius=radius[fits] / reach, **given)


def _clear(sim: Simulation, position: np.ndarray, radius: np.ndarray, centre: np.ndarray, reach: float) -> np.ndarray:
    """Which discs touch neither walls, edges, grains, nor an earlier one of these that is clear."""
    size = np.array(sim.scene.size)
    clear = ((position > radius[:, None]) & (position < size - radius[:, None])).all(axis=1)
    places, _ = edit.places(sim.world)
    near = np.hypot(*(places[:, :2] - centre).T) < reach + places[:, 2] + radius.max()
    clear &= Taken(wall_segments(sim.world, sim.scene), places[near, :2], places[near, 2]).free(position, radius)
    apart = np.hypot(*(position[:, None] - position[None]).transpose(2, 0, 1)) - radius[:, None] - radius[None]
    for k in np.flatnonzero(clear):
        clear[k] = not (clear[:k] & (apart[k, :k] < 0)).any()
    return clear


def destroy(stroke: Stroke) -> None:
    """Takes out what is under the brush."""
    slots, _, whole = stroke.under()
    stroke.sim.remove(whole[slots, 0])


def grab(stroke: Stroke) -> None:
    """Holds the grain under the hand by a spring; let go while moving, it flies."""
    if stroke.phase == "press":
        places, whole = edit.places(stroke.sim.world)
        if not len(places):
            raise SandError("there is no grain to grab")
        gap = np.hypot(*(places[:, :2] - stroke.place).T) - places[:, 2]
        slot = int(np.argmin(gap + 1e9 * whole[:, 2]))
        if whole[slot, 2] or gap[slot] > stroke.session.brush.size:
            raise SandError("there is no grain under the hand that is free to move")
        mass, _ = stroke.session.brush.masses(stroke.sim, places[slot : slot + 1, 2], whole[slot : slot + 1, 1])
        weight = float(mass[0]) * max(EARTH, math.hypot(*stroke.sim.scene.gravity))
        omega = 2 * math.pi * GRAB_HZ
        spring = {"rate": omega**2, "drag": 2 * GRAB_DAMPING * omega, "limit": stroke.session.brush.grip * weight}
        stroke.hand(work=hand.GRAB, grain=int(whole[slot, 0]), **spring)
    else:
        now = stroke.sim.hand.now
        now[None].place, now[None].velocity = (stroke.x, stroke.y), (stroke.vx, stroke.vy)


def stir(stroke: Stroke) -> None:
    """Drags along what is under the brush."""
    brush = stroke.session.brush
    stroke.hand(work=hand.STIR, reach=brush.size, drag=STIR_RATE * brush.strength)


def attract(stroke: Stroke) -> None:
    """Pulls grains towards the hand from four brushes away."""
    _pull(stroke, 1.0)


def repel(stroke: Stroke) -> None:
    """Pushes grains off the hand."""
    _pull(stroke, -1.0)


def _pull(stroke: Stroke, sign: float) -> None:
    brush = stroke.session.brush
    size = PULL * brush.strength * max(EARTH, math.hypot(*stroke.sim.scene.gravity))
    stroke.hand(work=hand.ATTRACT, reach=4 * brush.size, rate=sign * size, drag=STILL_RATE)


def freeze(stroke: Stroke) -> None:
    """Holds what is under the brush in its place."""
    _hold(stroke, True)


def thaw(stroke: Stroke) -> None:
    """Lets go of what is held under the brush, fixed grains of the scene too."""
    _hold(stroke, False)


def _hold(stroke: Stroke, on: bool) -> None:
    slots, places, whole = stroke.under()
    slots = slots[(whole[slots, 2] == 0) == on]
    if len(slots):
        mass, inertia = stroke.session.brush.masses(stroke.sim, places[slots, 2], whole[slots, 1])
        free = np.zeros((len(slots), 2)) if on else np.stack([1 / mass, 1 / inertia], axis=1)
        edit.hold(stroke.sim.world, slots, free)
        stroke.sim.renew()


def wet(stroke: Stroke) -> None:
    """Pours water on the grains under the brush."""
    _water(stroke, WETTED)


def dry(stroke: Stroke) -> None:
    """Takes it out of them."""
    _water(stroke, -WETTED)


def _water(stroke: Stroke, amount: float) -> None:
    brush = stroke.session.brush
    stroke.sim.wet(stroke.x, stroke.y, brush.size, amount * brush.strength)


def pour_water(stroke: Stroke) -> None:
    """Fills the brush with water."""
    stroke.sim.pour_water(stroke.x, stroke.y, stroke.session.brush.size)


def drain_water(stroke: Stroke) -> None:
    """Takes out the water under the brush."""
    stroke.sim.drain_water(stroke.x, stroke.y, stroke.session.brush.size)


def sweep_water(stroke: Stroke) -> None:
    """Has the water under the brush move as the hand does."""
    brush = stroke.session.brush
    if stroke.phase != "press":
        velocity = (brush.strength * stroke.vx, brush.strength * stroke.vy)
        stroke.sim.push_water(stroke.x, stroke.y, brush.size, velocity)


@dataclass(frozen=True)
class Tool:
    """What the mouse does."""

    name: str
    key: str
    help: str
    work: Callable[[Stroke], None]
    inverse: str = ""  # what the right button does instead
    uses: tuple[str, ...] = ("size",)  # the numbers of the brush that it goes by
    finish: Callable[[Stroke], None] | None = None  # at the end of a stroke
    follows: bool = False  # works all along the way of the hand, not only where it is at a frame
    needs: tuple[str, str] = ("", "")  # the effect without which it can do nothing, and what it does then


def check_need(session: Any, tool: Tool) -> None:
    """SandError, and what would help is offered, where an effect is off without which a tool can do nothing."""
    name, purpose = tool.needs
    if not name or name in session.sim.effects:
        return
    solvers = effects.find(name).solvers
    if session.sim.scene.solver.kind not in solvers:
        session.offer = (f"switch to {solvers[0]}", ["solver", solvers[0]])
        raise SandError(f"switch to the solver {solvers[0]} and then on {name} to {purpose}")
    session.offer = (f"switch on {name}", ["effect", name, True])
    raise SandError(f"switch on {name} to {purpose}")


MADE, STRONG = ("size", "low", "high", "spin"), ("size", "strength")
WET, DRY = ("moisture", "wet grains"), ("moisture", "dry grains")
POUR, DRAIN, WAVE = ("water", "pour water"), ("water", "drain it"), ("water", "make waves")
TOOLS = {
    tool.name: tool
    for tool in (
        Tool("grab", "1", "hold the grain under the cursor by a spring, drag it, throw it", grab, uses=("size", "grip")),
        Tool("create", "2", "fill the brush with grains, never inside others (right button: destroy)", create, "destroy", MADE),
        Tool("destroy", "3", "take out the grains under the brush (right button: create)", destroy, "create", follows=True),
        Tool("pour", "4", "pour grains while the button is held (right button: destroy)", pour, "destroy", MADE),
        Tool("stir", "5", "drag along what is under the brush", stir, uses=STRONG),
        Tool("attract", "6", "pull grains towards the cursor (right button: repel)", attract, "repel", STRONG),
        Tool("repel", "7", "push grains away from the cursor (right button: attract)", repel, "attract", STRONG),
        Tool("freeze", "8", "hold the grains under the brush in place (right button: thaw)", freeze, "thaw", follows=True),
        Tool("thaw", "9", "let held grains go (right button: freeze)", thaw, "freeze", follows=True),
        Tool("wall", "0", "draw a wall (right button: erase)", wall_tools.draw, "erase", (), wall_tools.build, True),
        Tool("erase", "e", "rub out walls under the brush (right button: draw one)", wall_tools.erase, "wall", follows=True),
        Tool("wet", "w", "pour water on the grains under the brush (right button: dry)", wet, "dry", STRONG, follows=True, needs=WET),
        Tool("dry", "d", "take water out of the grains under the brush (right button: wet)", dry, "wet", STRONG, follows=True, needs=DRY),
        Tool("water", "o", "pour water that flows (right button: drain)", pour_water, "drain", follows=True, needs=POUR),
        Tool(
            "drain",
            "q",
            "take out the water that flows under the brush (right button: water)",
            drain_water,
            "water",
            follows=True,
            needs=DRAIN,
        ),
        Tool("wave", "j", "sweep the water under the brush along (right button: drain)", sweep_water, "drain", STRONG, needs=WAVE),
    )
}
