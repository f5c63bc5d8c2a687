"""World -> picture: the painter, behind every picture, film and window."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sand.view import fringes, kernels, palette, placing, wet
from taichi_sand.view.camera import Camera, picture_height
from taichi_sand.view.fringes import Fringes
from taichi_sand.view.scales import Scales
from taichi_sand.view.views import KIND, PHOTOELASTIC, VIEWS, check_view, quantile
from taichi_sand.world.edit import link_lines
from taichi_sand.world.tables import World

REFERENCE_WIDTH = 720
"""Walls and force chains have their nominal widths [px] in a picture this wide, and grow with it."""
WALL_WIDTH = 2.0
CHAIN_WIDTHS = (0.4, 4.6)
CHAIN_WIDEST_GRAIN = (0.25, 0.9)
"""The widest chains are at least and at most this part of a mean grain's diameter."""
SPOKED = (KIND, "rotation")
"""Views in which a spoke shows how a grain is turned; in the others it would be in the way."""
WET_VIEWS = ("moisture", "saturation")
"""Views whose colours say how wet a grain is; in the others it is darker."""
BOND_WIDTH = 0.12
"""Of a bar that shows a bond, in mean diameters."""
BEHIND, OVER = 0.92, 0.18
"""How much of the ground, and of the grains, water hides."""
LINES_PER_GRAIN = 6
"""Room for force lines: contacts that push, per grain slot."""


@dataclass(frozen=True)
class Legend:
    """What the colours of a picture mean."""

    name: str
    unit: str
    top: float  # the range is 0 .. top
    colours: np.ndarray  # the map, u32


def kind_colour(kind: int, kinds: int) -> int:
    """Colour of a kind of grain where there are so many, u32."""
    return palette.packed(palette.SAND[1] if kinds == 1 else palette.KINDS[kind % len(palette.KINDS)])


def sand_tones(kinds: int) -> np.ndarray:
    """Colours of each kind of grain, four tones each. A single kind gets all tones of sand, so that its grains can be told apart."""
    if kinds == 1:
        return np.array([palette.packed(tone) for tone in palette.SAND], np.uint32)
    return np.repeat(np.array([kind_colour(kind, kinds) for kind in range(kinds)], np.uint32), kernels.TONES)


def edge_lines(left: float, top: float, right: float, bottom: float, edges: Sequence[bool], thickness: float) -> np.ndarray:
    """The edges of a box (left, right, bottom, top) that are walls, as lines just inside it [px]; shape (n, 4)."""
    inset = 0.5 * thickness
    within = (left + inset, right - inset, bottom - inset, top + inset)
    lines = [(within[0], top, within[0], bottom), (within[1], top, within[1], bottom)]
    lines += [(left, within[2], right, within[2]), (left, within[3], right, within[3])]
    return np.array([line for line, wall in zip(lines, edges, strict=True) if wall], float).reshape(-1, 4)


class Painter:
    """Paints a world. These may be changed between pictures: `color`, `force_chains`, `sleepers` (whether they are shown fainter), `bonds`
    (whether they are shown), `dimmed` (whether grains only are the ground for what is drawn over them) and `walls`.

    water: what paints it (view.water.Pool), or None.
    walls: straight parts, shape (n, 4): x, y of one end, x, y of the other [m].
    edges: which edges of the box are walls: left, right, bottom, top.
    kinds: how many kinds of grains the scene has.
    ground: what it is painted on, of palette.GROUNDS.
    window: the part of the box that is shown, x0, y0, x1, y1 [m]; None = all of it. `look_at` shows another.
    """

    def __init__(
        self,
        world: World,
        size_m: Sequence[float],
        width: int = REFERENCE_WIDTH,
        *,
        color: str = KIND,
        force_chains: bool = False,
        cold: str = palette.COLD,
        hot: str = palette.HOT,
        walls: np.ndarray | None = None,
        edges: Sequence[bool] = (False, False, False, False),
        kinds: int = 1,
        window: Sequence[float] | None = None,
        ground: str = "dark",
    ) -> None:
        check_view(color, world)
        self.world, self.color, self.force_chains = world, color, force_chains
        self.sleepers, self.bonds, self.dimmed = True, True, False
        self.size = tuple(size_m)
        window = window or (0.0, 0.0, *size_m)
        self.width, self.height = width, picture_height((window[2] - window[0], window[3] - window[1]), width)
        self.enlargement = width / REFERENCE_WIDTH
        self.water: Any = None
        self.walls = np.zeros((0, 4)) if walls is None else walls
        self.walled, self.ground = edges, palette.packed(palette.GROUNDS[ground].colour)
        self.look_at(Camera.of(window, width))
        self.legend: Legend | None = None
        self._maps = {name: palette.colour_map(view.stops) for name, view in VIEWS.items() if view.stops}
        self.set_energy_colours(cold, hot)
        self._chain_map = palette.colour_map(palette.CHAIN)
        self._tones = sand_tones(kinds)
        self._dim = np.full(kernels.TONES, palette.packed(palette.CHAIN_GRAIN), np.uint32)
        self._scales = Scales(world)
        self._allocate()

    def look_at(self, camera: Camera) -> None:
        """Shows another part of the box."""
        self.camera = camera
        self.chain_widths = self._chain_widths()
        left, low, wide, high = self.box
        bottom = self.height + low
        self.edges = edge_lines(-left, bottom - high, wide - left, bottom, self.walled, max(1.0, WALL_WIDTH * self.enlargement))

    @property
    def scale(self) -> float:
        """Pixels of a metre."""
        return self.camera.scale

    @property
    def box(self) -> tuple[float, float, float, float]:
        """How far the lower left corner of the box lies beyond that of the picture, to the left and below, and how wide and high it is
        [px]; a picture of all of it has whole pixels.
        """
        camera, (wide, high) = self.camera, self.size
        if (camera.x, camera.y) == (0, 0) and abs(wide * self.scale - self.width) < 1e-6 and abs(high * self.scale - self.height) <= 1:
            return 0.0, 0.0, float(self.width), float(self.height)
        return camera.x * self.scale, camera.y * self.scale, wide * self.scale, high * self.scale

    def set_energy_colours(self, cold: str, hot: str) -> None:
        """The ends of the scale of the view `energy`."""
        self._maps["energy"] = palette.blend_map(cold, hot)

    def _allocate(self) -> None:
        """Lists that the kernels fill. Where edges are periodic a grain may be seen up to four times."""
        capacity = self.world.capacity
        discs = self.world.discs
        copies = (4 if any(self.world.periodic) else 1) * discs
        self._colours = np.zeros(capacity, np.uint32)
        self._discs, self._owner = np.zeros((copies * capacity, 4), np.float32), np.zeros(copies * capacity, np.int32)
        self._parts = np.zeros(copies * capacity, np.int32)
        self._bands = np.zeros((kernels.band_count(), 2), np.int32)
        self._fringes: Fringes | None = None
        self._lines = np.zeros((LINES_PER_GRAIN * discs * capacity, 4), np.float32)
        self._forces = np.zeros(LINES_PER_GRAIN * discs * capacity, np.float32)
        self._canvas = np.zeros(self.width * self.height, np.uint32)

    def _chain_widths(self) -> tuple[float, float]:
        """Thinnest and widest chain [px]."""
        grain = float(self.world.box[None].diameter) * self.scale
        thin, wide = (self.enlargement * width for width in CHAIN_WIDTHS)
        return thin, min(max(wide, CHAIN_WIDEST_GRAIN[0] * grain), CHAIN_WIDEST_GRAIN[1] * grain)

    def paint(self, time: float = 0.0, canvas: np.ndarray | None = None) -> np.ndarray:
        """Paints the world as it is at `time` [s] and returns the canvas: u32, 0x00RRGGBB, row by row from the top, flat.

        `canvas`, if given, is painted instead of the painter's own: with `ti.GUI(fast_gui=True).img` nothing is copied.
        """
        canvas = self._canvas if canvas is None else canvas
        canvas.fill(self.ground)
        self.legend = None
        if self.water:
            self.water.look()
            self._colour_water(time)
            self.water.paint(canvas, self.width, self.height, BEHIND, self.box)
        self._colour(time)
        if not (self.force_chains or self.dimmed):
            if hasattr(self.world.carried, "wetness") and self.color not in WET_VIEWS:
                wet.darken(self.world, self._colours)
            if self.sleepers and self.world.sleeps:
                kernels.fade_sleepers(self.world, self._colours)
        world, size = self.world, (self.width, self.height)
        placing.place_discs(world, self.scale, *self.box[:2], *size, self._discs, self._owner, self._bands, self._parts)
        bars = self.bonds and not self.force_chains and world.linked  # they show how a body is turned
        spokes = self.color in SPOKED and not self.force_chains and not bars
        if self.color == PHOTOELASTIC and not (self.force_chains or self.dimmed):
            self._paint_fringes(canvas, time)
        else:
            kernels.paint_discs(canvas, *size, self._discs, self._owner, self._bands, self._colours, spokes)
        if self.water:
            self.water.paint(canvas, self.width, self.height, OVER, self.box)
        if self.force_chains:
            self._paint_chains(canvas, time)
        elif bars:
            self._paint_bonds(canvas)
        self._paint_walls(canvas)
        return canvas

    def _colour(self, time: float) -> None:
        """Fills the colour of every grain."""
        fixed = palette.packed(palette.FIXED)
        dimmed = self.force_chains or self.dimmed
        if dimmed or self.color in (KIND, PHOTOELASTIC):
            kernels.colour_by_kind(self.world, self._dim if dimmed else self._tones, fixed, self._colours)
            return
        table = self._maps[self.color]
        values, top = self._scales.measure(self.color, time)
        kernels.colour_by_value(self.world, values, max(top, 1e-30), table, fixed, self._colours)
        self.legend = Legend(self.color, VIEWS[self.color].unit, top, table)

    def _colour_water(self, time: float) -> None:
        """Has the water show its pressure or speed, if that is asked for."""
        self._scales.water = self.water
        if self.color in VIEWS and VIEWS[self.color].measure is None:
            self.water.colour(self._scales.of_water(self.color, time), self._maps[self.color])

    def _paint_fringes(self, canvas: np.ndarray, time: float) -> None:
        """Grains as photoelastic discs; a fringe goes with the forces there are."""
        if self._fringes is None:
            self._fringes = Fringes(self.world)
        top = self._scales.chains.follow(quantile(self._fringes.place(self.scale), fringes.PERCENTILE), time)
        fringe = 8 * top / (np.pi * float(self.world.box[None].diameter)) / fringes.ORDERS
        listed = (self._discs, self._owner, self._bands, self._parts)
        self._fringes.paint(canvas, (self.width, self.height), listed, self.scale, fringe)
        self.legend = Legend("a fringe", "N/m", fringe, self._fringes.colours)

    def _paint_chains(self, canvas: np.ndarray, time: float) -> None:
        """Contacts as lines whose width and colour follow the normal force, the strong ones on top."""
        found = placing.place_forces(self.world, self.scale, *self.box[:2], self.height, self._lines, self._forces)
        strength, top = self._scales.levels(self._forces[:found], time)
        level = np.rint(strength * (palette.ENTRIES - 1)).astype(np.uint8)
        upwards = np.argsort(level, kind="stable")
        thickness = self.chain_widths[0] + (self.chain_widths[1] - self.chain_widths[0]) * strength[upwards]
        kernels.paint_lines(
            canvas, self.width, self.height, self._lines[upwards], thickness.astype(np.float32), self._chain_map[level[upwards]]
        )
        self.legend = Legend("contact force", "N", top, self._chain_map)

    def _paint_bonds(self, canvas: np.ndarray) -> None:
        """Bonds that hold, as bars between centres."""
        ends = self.camera.pixels(link_lines(self.world)[1], self.height)
        thickness = max(1.0, BOND_WIDTH * float(self.world.box[None].diameter) * self.scale)
        colours = np.full(len(ends), palette.packed(palette.BOND), np.uint32)
        if len(ends):
            widths = np.full(len(ends), thickness, np.float32)
            kernels.paint_lines(canvas, self.width, self.height, ends.astype(np.float32), widths, colours)

    def _paint_walls(self, canvas: np.ndarray) -> None:
        """Walls and walled edges."""
        ends = self.camera.pixels(self.walls, self.height)
        lines = np.concatenate([ends, self.edges]).astype(np.float32)
        thickness = np.full(len(lines), max(1.0, WALL_WIDTH * self.enlargement), np.float32)
        colours = np.full(len(lines), palette.packed(palette.FIXED), np.uint32)
        if len(lines):
            kernels.paint_lines(canvas, self.width, self.height, lines, thickness, colours)

    def rgb(self, canvas: np.ndarray) -> np.ndarray:
        """A canvas as an image: uint8, shape (height, width, 3)."""
        image = np.empty(3 * self.width * self.height, np.uint8)
        kernels.unpack(canvas, image)
        return image.reshape(self.height, self.width, 3)
