"""Every key of a scene file: unit, range, default, one line of help.

A `Scene` is checked when it is made, from a file or in Python; afterwards it does not change. What is wrong with it is told
by a `SandError` in one sentence.
"""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, PrivateAttr, ValidationError, model_validator

from taichi_sand.errors import SandError
from taichi_sand.scene import checks
from taichi_sand.scene.events import Event, check_events
from taichi_sand.scene.expected import Check
from taichi_sand.scene.flows import Sink, Source, Water
from taichi_sand.scene.kinds import Angle, Box, Color, Edge, Number, Range, Switch, Table, Vector, Whole, key, sealed
from taichi_sand.scene.materials import Material, MaterialPair, check_materials
from taichi_sand.scene.origin import moved
from taichi_sand.scene.record import Record
from taichi_sand.scene.rows import read_rows
from taichi_sand.scene.shapes import BUILT_IN, Form, form
from taichi_sand.scene.sizes import Radius, Sizes
from taichi_sand.scene.walls import Rock, Shake, Wall
from taichi_sand.scene.wording import in_words

MOST_GRAINS = 4_000_000
MOST_DISCS = 64


class EdgeSpeeds(Table):
    """Velocities of the surfaces of edges that are walls, each along it: upwards, or to the right."""

    left: Number = key(0.0, "upwards", "m/s")
    right: Number = key(0.0, "upwards", "m/s")
    bottom: Number = key(0.0, "to the right", "m/s")
    top: Number = key(0.0, "to the right", "m/s")


class Edges(Table):
    """What the four sides of the box do: wall, open (a grain that leaves is removed and counted), periodic."""

    left: Edge = key("wall", "wall, open or periodic (together with right)")
    right: Edge = key("wall", "wall, open or periodic (together with left)")
    bottom: Edge = key("wall", "wall, open or periodic (together with top)")
    top: Edge = key("wall", "wall, open or periodic (together with bottom)")
    material: str = key("", "name of one of [[materials]] that those which are walls are made of")
    surface_velocity: EdgeSpeeds = key(EdgeSpeeds(), "{ bottom = 0.2, … }: of surfaces along edges that are walls, conveyor belts", "m/s")
    shear_rate: Number = key(
        0.0, "in a box that is periodic both ways: images above run to the right by this times its height (Lees and Edwards 1972)", "1/s"
    )


class Solver(Table):
    """How contacts are resolved, and how exactly. `tolerance` sets the rest; the keys below `precision` are for experts."""

    kind: Literal["md", "rigid"] = key("rigid", "md: soft discs, forces; rigid: hard discs, impulses")
    tolerance: Number = key(0.02, "overlap allowed at rest, as a fraction of the mean grain diameter", "d", ge=0.0005, le=0.3)
    restitution: Number = key(
        0.1, "normal speed after an impact / before it; rigid: slower than max(0.3 √(g d), 4 g h) they rest", ge=0, le=1
    )
    precision: Literal[32, 64] = key(32, "bits of a number in the solver, 32 or 64")
    step: Number | None = key(None, "time step", "s", gt=0, le=0.1)
    substeps: Whole | None = key(None, "rigid: steps in 1/60 s, instead of `step`", ge=1, le=100_000)
    hertz: Number | None = key(None, "rigid: frequency of the soft contact", "Hz", gt=0)
    stiffness: Number | None = key(None, "md: force / overlap at the tolerated overlap", "N/m", gt=0)
    integrator: Literal["symplectic_euler", "velocity_verlet", "rk4"] = key("symplectic_euler", "md: how velocity and place advance")
    law: Literal["linear", "hertz", "custom"] = key("linear", "md: normal force; custom takes `alpha`, `beta` and `k_d`")
    k_r: Number | None = key(None, "md: coefficient of the elastic force k_r ζ^beta, instead of `stiffness`", "N/m^beta", gt=0)
    k_d: Number | None = key(None, "md: coefficient of the damping force k_d ζ^alpha ζ', instead of `restitution`", "N s/m^(1+alpha)", ge=0)
    alpha: Number | None = key(None, "md, custom law: exponent of the overlap in the damping force", ge=0, le=4)
    beta: Number | None = key(None, "md, custom law: exponent of the overlap in the elastic force", gt=0, le=4)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        checks.solver(self)
        return self


class Shape(Table):
    """A shape of grains: discs, rigidly joined. Where they overlap, the mass counts once."""

    name: str = key(..., "what `shape` of [[grains]] calls it", min_length=1)
    discs: tuple[tuple[Number, Number, Number], ...] = key(
        ..., "x, y and radius of each disc, in units of the `radius` of the grains", "r", min_length=1, max_length=MOST_DISCS
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        checks.shape(self)
        return self


class Grains(Table):
    """Grains of one kind: their shape, and where they start."""

    shape: str = key("disc", "disc, 2x1, 3x1, triangle, square, or the name of one of [[shapes]]")
    radius: Radius | None = key(
        None, "radius of a disc, of which a shape has several: a number, [low, high] to draw from uniformly, or a distribution", "m"
    )
    density: Number = key(2650.0, "mass / area", "kg/m2", ge=1e-6)
    material: str = key("", "name of one of [[materials]] that they are made of")
    count: Whole | None = key(None, "how many; without `fill`, in random places that do not overlap", ge=1, le=MOST_GRAINS)
    fill: Literal["lattice", "hexagonal", "random"] | None = key(None, "pattern that fills the region, up to `count` if given")
    pitch: Number | None = key(None, "lattice, hexagonal: spacing; the largest diameter if not given", "d", gt=0, le=100)
    jitter: Number = key(0.0, "lattice, hexagonal: moved by up to this much either way, in mean radii", "r", ge=0, le=100)
    region: Box | None = key(None, "[x0, y0, x1, y1] that the grains start in; the whole box if not given", "m")
    positions: tuple[tuple[Number, ...], ...] | None = key(
        None, "a row a grain, instead of `region`: x, y[, radius[, vx, vy[, angle[, spin[, density]]]]]", "m, m/s, rad, rad/s, kg/m2"
    )
    positions_file: str | None = key(
        None, "file beside the scene file with such columns: CSV, yade's text, LAMMPS data, or a trajectory (GSD)"
    )
    frame: Whole | None = key(None, "of a trajectory that is the `positions_file`, from 0 on; the last if not given", ge=0)
    velocity: Vector = key((0.0, 0.0), "[vx, vy], added to that of the row if there is one", "m/s")
    speed: Range = key((0.0, 0.0), "added in a random direction, to every grain its own: a number, or [low, high]", "m/s")
    spin: Number = key(0.0, "counter-clockwise, added to that of the row if there is one", "rad/s")
    angle: Angle = key(0.0, 'a number, or "random"; added to that of the row if there is one', "rad")
    fixed: Switch = key(False, "held in place")
    bonded: Switch = key(
        False, "[effects.bonds] holds it together: the discs of each shape, then grains of their own, or all discs of the table"
    )

    @model_validator(mode="before")
    @classmethod
    def _read_file(cls, data: Any) -> Any:
        name = data.get("positions_file") if isinstance(data, dict) else None
        if not isinstance(name, str | os.PathLike) or data.get("positions") is not None:
            return data
        frame = data.get("frame")
        if frame is not None and (not isinstance(frame, int) or frame < 0):
            return data  # is told so
        if sealed.get():
            raise SandError("positions_file: a checkpoint or a recording holds its grains itself, and reads no file", "positions_file")
        try:
            rows = read_rows(Path(name), frame, data.get("radius"))
        except SandError as error:
            raise SandError(f"positions_file: {error}", "positions_file") from None
        taken = {"radius": None} if rows.radius_taken else {}
        return {**data, "positions": rows.rows, "positions_file": None, "frame": None, **taken}

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        checks.grains(self)
        return self


class View(Table):
    """How pictures and films of the scene look."""

    width: Whole = key(720, "width of the picture; its height follows from the size of the box", "pixels", ge=16, le=8192)
    color: Color = key("kind", "what the colour shows")
    force_chains: Switch = key(False, "draws the contact forces as lines between dimmed grains")
    cold: str = key("#2B5DA8", 'color = "energy": the lowest', pattern=r"^#[0-9a-fA-F]{6}$")
    hot: str = key("#F2542D", 'color = "energy": the highest', pattern=r"^#[0-9a-fA-F]{6}$")
    ground: Literal["dark", "light"] = key("dark", "what pictures are painted on; light is for slides and print")
    window: Box | None = key(None, "[x0, y0, x1, y1]: the part of the box that pictures and films show; all of it if not given", "m")
    caption: Switch = key(True, "title, time, number of grains, solver and a scale bar")
    fps: Whole = key(30, "frames in a second of film", "1/s", ge=1, le=240)

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.window is not None:
            checks.region(self.window, "window")
        return self


class Scene(Table):
    """A scene, as one file describes it.

    Raises:
        SandError: a key is unknown, missing, of the wrong type, out of range or at odds with another.
    """

    title: str = key("", "name of the scene, shown above its pictures")
    about: str = key("", "one line that says what there is to see")
    size: Vector = key(..., "[width, height] of the box, which spans x 0…width, y 0…height", "m")
    origin: Vector = key((0.0, 0.0), "lower left corner of the box in the coordinates of this scene; the simulation has it at 0, 0", "m")
    gravity: Vector = key((0.0, -9.81), "[gx, gy]", "m/s2")
    seed: Whole = key(0, "all randomness of the scene comes from it", ge=0, lt=2**63)
    duration: Number = key(5.0, "how long `run` and `render` simulate unless told otherwise", "s", ge=0)
    scale: Number = key(
        1.0, "the same scene with this many times the grains: counts ×scale, lengths but for grain sizes ×√scale", gt=0, le=1e4
    )
    edges: Edges = key(Edges(), "what the four sides of the box do")
    solver: Solver = key(Solver(), "how contacts are resolved, and how exactly")
    shapes: tuple[Shape, ...] = key((), "shapes of grains, besides those that there are")
    grains: tuple[Grains, ...] = key((), "one table for every kind of grain")
    walls: tuple[Wall, ...] = key((), "line obstacles")
    sources: tuple[Source, ...] = key((), "make grains while the simulation runs")
    sinks: tuple[Sink, ...] = key((), "take grains out")
    water: tuple[Water, ...] = key((), "where water is at the start")
    materials: tuple[Material, ...] = key((), "what grains, walls and edges are made of")
    material_pairs: tuple[MaterialPair, ...] = key((), "how two materials meet, where it is not the mean of both")
    effects: dict[str, dict[str, Any]] = key({}, "a table present = the effect is on")
    view: View = key(View(), "how pictures look")
    record: Record = key(Record(), "what `run` writes beside its report")
    events: tuple[Event, ...] = key((), "stages of an experiment: what is changed while it is simulated, and when")
    checks: tuple[Check, ...] = key((), "what it must show, for `taichi-sand check`")
    _source: str = PrivateAttr("")

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
            if any(self.origin):  # moved once; the scene made is an ordinary one
                super().__init__(**moved(self.model_dump(exclude_unset=True), self.origin) | {"origin": (0.0, 0.0)})
            if self.scale != 1:  # grow once; the scene made is an ordinary one with scale = 1
                super().__init__(**self._grown())
        except ValidationError as error:
            raise in_words(error, _tables()) from None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        checks.scene(self)
        check_materials(self)
        if not sealed.get():  # a simulation that is gone on with has lost the walls that were removed
            check_events(self)
        return self

    def _grown(self) -> dict[str, Any]:
        length = math.sqrt(self.scale)
        data = self.model_dump(exclude_unset=True)
        data |= {"scale": 1.0, "size": [length * side for side in self.size]}
        for grains in data.get("grains", ()):
            if grains.get("count"):
                grains["count"] = max(1, round(grains["count"] * self.scale))
            if grains.get("region"):
                grains["region"] = [length * side for side in grains["region"]]
        for table in (*data.get("sources", ()), *data.get("sinks", ()), *data.get("water", ())):
            table["region"] = [length * side for side in table["region"]]
            if table.get("rate"):
                table["rate"] = min(1e6, table["rate"] * self.scale)
        for wall in data.get("walls", ()):
            wall["points"] = [[length * x, length * y] for x, y in wall["points"]]
            if wall.get("pivot"):
                wall["pivot"] = [length * x for x in wall["pivot"]]
        if data.get("view", {}).get("window"):
            data["view"]["window"] = [length * side for side in data["view"]["window"]]
        for event in data.get("events", ()):
            places = {name: [length * x for x in value] for name, value in event.get("set", {}).items() if name.endswith(".pivot")}
            event["set"] = {**event.get("set", {}), **places}
        return data

    @property
    def source(self) -> str:
        """Name of the file that the scene was read from, or "" if it was made in Python."""
        return self._source

    def form(self, name: str) -> Form:
        """Returns the shape that grains call `name`."""
        return form(name, self.discs(name))

    def discs(self, name: str) -> tuple[tuple[float, float, float], ...]:
        """Returns the discs, x, y and radius, of the shape that grains call `name`."""
        return next((item.discs for item in self.shapes if item.name == name), None) or BUILT_IN[name]

    def form_of(self, table: Grains | Source) -> Form:
        """Returns the shape of the grains that a table makes: of a bonded one, discs."""
        return self.form("disc" if isinstance(table, Grains) and table.bonded else table.shape)

    def error(self, name: str, text: str) -> SandError:
        """Returns the error "file: key: text" about key `name` of this scene (`solver.step`), to be raised."""
        return SandError(f"{self._source}: {name}: {text}" if self._source else f"{name}: {text}", name)

    @property
    def periodic(self) -> tuple[bool, bool]:
        """Which axes of the box are: x, y."""
        return self.edges.left == "periodic", self.edges.bottom == "periodic"

    def with_walls(self, walls: Sequence[Any]) -> Self:
        """Returns this scene with these walls, a table each; SandError if they are wrong."""
        tables = [dict(wall) if isinstance(wall, Wall) else wall for wall in walls]
        kept = {name: getattr(self, name) for name in ("size", "edges", "effects", "materials")}
        checked = type(self)(**kept, walls=tables)
        return self.model_copy(update={"walls": checked.walls})

    def to_json(self) -> str:
        """Returns the scene as JSON, positions read from files included."""
        return self.model_dump_json(exclude_unset=True)

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Returns the scene that `to_json` wrote; SandError if the text is something else. No other file is read."""
        token = sealed.set(True)
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            raise in_words(error, _tables()) from None
        finally:
            sealed.reset(token)


def _tables() -> dict[str, type[BaseModel]]:
    kinds = {"solver": Solver, "shapes": Shape, "grains": Grains, "radius": Sizes, "walls": Wall, "shake": Shake, "rock": Rock}
    kinds |= {"sources": Source, "sinks": Sink, "water": Water, "materials": Material, "material_pairs": MaterialPair}
    kinds |= {"edges": Edges, "surface_velocity": EdgeSpeeds}
    return {"": Scene, "view": View, "record": Record, **kinds, "events": Event, "checks": Check}
