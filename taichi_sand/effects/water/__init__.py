"""Water: sand and water that feel each other, averaged over cells of some grains (unresolved; Model A of Zhou et al. 2010).

Markers carry the water over a staggered grid (FLIP on a MAC grid), a projection makes it divergence-free, with a free surface below air.
Grains enter as porosity. The water pushes them by its pressure gradient, which is buoyancy too, and by drag; they push back just as much.
A disc stands for a sphere in a slab one grain thick, so that porosities, drag and quicksand are those of spheres. The water acts at most
1/120 s apart, and so often that none of it flows on by more than a cell; the grains' steps lie between. `[[water]]` says where it is at
the start; cells should be three grains wide or more. Grains of several discs are to the water discs of the same area; those
wider than a cell are felt over their own width. Walls, still ones and those that move, hold and drive it as the edges of the box do. With
the effect `moisture` what is under water is soaked, so that liquid bridges let go, takes up what they can hold, and comes out wet; that
water is taken from the markers. A bed under water is lighter to the tolerance. Turbulence, capillarity and lubrication are left out.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.effects.water.boulders import WIDTH
from taichi_sand.effects.water.drag import body_of, deal, feel, felt, under
from taichi_sand.effects.water.grid import Fluid, allocate, plan
from taichi_sand.effects.water.laws import LAWS
from taichi_sand.effects.water.markers import start
from taichi_sand.effects.water.pressure import project
from taichi_sand.effects.water.soaking import held, most_held
from taichi_sand.effects.water.transfer import advance, transfer
from taichi_sand.effects.water.walls import fastest_mover, lay_walls
from taichi_sand.effects.water.wells import flow
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.flags import WATER_FULL, flag
from taichi_sand.world.geometry import add, at_most, mobility, velocity, wrench
from taichi_sand.world.tables import write_rows

LONGEST, CFL = 1 / 120, 1.0
"""The water acts at least so often [s], and before it has flowed on by so many cells."""
SPREAD, FINEST = 3.0, 1.8
"""Grains are dealt to a width of SPREAD d, or of a cell (half of it: terminal speeds 6 % low); with that, cells are no smaller than
FINEST d."""
MOST_CELLS, MOST_MARKERS = 1_000_000, 4_000_000
FOR_EVER = 1e30
MOST_TOGETHER = 1e9
"""Steps of the grains in one of the water: whole numbers end at 2^31."""
AWASH, STEADY = 0.01, 0.1
"""A bed counts as lighter when all but so much of it is under water; by how much is a multiple of STEADY, so that steps stay as they are
while the water moves."""
SPARE = 30.0
"""There is room for what wells up within the duration and so much longer [s]."""
VECTORS = ("pull", "stream", "start", "given", "borne")


@dataclass(frozen=True, eq=False)
class Water(Effect):
    """The effect."""

    parameters = (
        Parameter("density", 1000.0, "density", "kg/m3", low=1.0, high=2e4),
        Parameter("viscosity", 1e-3, "viscosity; water has 0.001, glycerol 1", "Pa s", low=1e-6, high=1e3, decades=True),
        Parameter("cell", 3.0, "width of a cell", "d", low=0.1, high=100.0, live=False),
        Parameter("permeability", 1.0, "of beds, over that by the law of drag", low=1e-3, high=1e3, decades=True),
        Parameter("drag", "di_felice", "law of drag; gidaspow is made for beds", choices=LAWS, live=False),
    )
    neutral: ClassVar = {}

    fluid: Fluid

    @classmethod
    def misfit(cls, scene: Any) -> str:
        """Why it does not fit `scene`, or ""."""
        if scene.solver.kind == "md" and scene.solver.integrator != "symplectic_euler":
            return f'does not fit the integrator {scene.solver.integrator}, only "symplectic_euler"'
        cell = scene.effects["water"].get("cell", cls.parameters[2].default)
        if cell < FINEST and (scene.grains or scene.sources):
            return f"with grains, cell = {cell:g} d must be at least {FINEST:g} d: what is smaller than a grain is not resolved"
        return ""

    @classmethod
    def carried(cls, values: dict[str, Any]) -> dict[str, float]:
        """Columns that follow a grain: what it feels of the water, see `drag.felt`; wet below 0 = it has not been looked at yet."""
        return {f"water_{name}_{axis}": 0.0 for name in VECTORS for axis in "xy"} | {
            "water_drag": 0.0,
            "water_wet": -1.0,
            "water_depth": -1e3,
        }

    @classmethod
    def tables(cls, values: dict[str, Any], scene: Any, grains: Any, world: Any, solver: str) -> tuple[Fluid]:
        """What the effect keeps beside columns."""
        cells = plan(scene.size, values["cell"] * float(world.box[None].diameter), world.periodic)
        if cells.columns * cells.rows > MOST_CELLS:
            text = f"{values['cell']:g} d makes {cells.columns} x {cells.rows} cells of the box; at most {MOST_CELLS} are possible"
            raise scene.error("effects.water.cell", text)
        place, share = start(scene, grains, cells)
        sizes = [form.size for form in grains.forms] or [1.0]
        spread = max(1.0, SPREAD / values["cell"]) if scene.grains or scene.sources else 1.0
        wells = [table for table in scene.water if table.rate is not None]
        inflow = sum(max(0.0, table.rate) for table in wells) * (scene.duration + SPARE) / (share * cells.width * cells.height)
        if inflow > MOST_MARKERS:
            raise scene.error("water", f"their rates make {inflow:.3g} markers within the duration; at most {MOST_MARKERS} are possible")
        soaks = "moisture" in scene.effects
        more = most_held(grains, cells.width * cells.height) / share if soaks else 0.0
        made = allocate(world.real, cells, len(place) + math.ceil(inflow + more), len(sizes), len(wells))
        write_rows(made["place"], place)
        write_rows(made["sizes"], sizes)
        if wells:
            size = [cells.width, cells.height] * 2
            write_rows(made["wells"].region, np.array([table.region for table in wells]) / size + 0.5)
            write_rows(made["wells"].rate, [table.rate for table in wells])
            write_rows(made["wells"].span, [(table.since, FOR_EVER if table.until is None else table.until) for table in wells])
            write_rows(made["wells"].velocity, np.array([table.velocity for table in wells]))
        now = made["now"][None]
        now.wells = len(wells)
        now.markers, now.marker, now.spread, now.law = len(place), share, spread, LAWS.index(values["drag"])
        structure = {"wraps": world.periodic, "opens": world.open_edges, "reach": max(1, math.ceil(1.5 * spread - 0.5))}
        structure["boulders"] = widest(scene, grains) * WIDTH > spread * min(cells.width, cells.height)
        return (Fluid(**made, **structure, rigid=solver == "rigid", soaks=soaks, real=world.real),)

    @classmethod
    def lift(cls, values: dict[str, Any], world: Any) -> float:
        """How much lighter a bed is under water, over its weight, in steps of STEADY; 0 while more than AWASH of it is not."""
        if not world.count[None]:
            return 0.0
        whole, sunk, pushed_out = weighed(world)
        if sunk < (1.0 - AWASH) * whole or whole <= 0.0:
            return 0.0
        lighter = values.get("density", cls.parameters[0].default) * pushed_out / whole
        return STEADY * math.floor(min(1.0, lighter) / STEADY)

    @classmethod
    def build(cls, values: dict[str, Any], columns: tuple, solver: str) -> "Water":
        """The effect for a world; its `tables` are last among the columns."""
        return cls(columns[-1])

    @ti.func
    def body(self, w: ti.template(), c: ti.template(), i):
        """Force of the water on grain i: A (-∇p + β/s (u - v)), v where the step ends, foreseen by gravity, pressure and contacts."""
        g = ti.static(w.carried)
        push = ti.Vector([0.0, 0.0])
        diameter, area = body_of(w, self.fluid, i)
        pull, stream, _wet, _start, _given = felt(w, i)
        wet = under(diameter, g.water_depth[i])
        if wet > 0.0:
            inverse, load = w.grains.mobility[i].x, w.grains.wrench[i].xy
            if ti.static(not self.fluid.rigid):
                load *= c.step
            foreseen = velocity(w, i) + c.step * (w.box[None].gravity - wet * area * inverse * pull) + inverse * load
            drag = g.water_drag[i]
            push = wet * (drag * (stream - foreseen) / (1.0 + c.step * drag * wet * area * inverse) - pull)
            add(g.water_given_x, i, c.step * push.x)
            add(g.water_given_y, i, c.step * push.y)
            push *= area
        rise = (velocity(w, i) - stream).dot(w.box[None].gravity) / (w.box[None].gravity.norm() + 1e-30)
        add(g.water_depth, i, c.step * rise)
        return wrench(push, 0.0)

    def on_pause(self, world: Any, solver: Any) -> int:
        """Ends the water's step, and begins the next one; returns how many steps of the grains that takes."""
        return int(turn(world, solver, self.fluid))

    def report(self, world: Any, solver: Any) -> dict[str, float]:
        """How much water there is, and how well it is followed."""
        now = self.fluid.now[None]
        shape = (now.columns + 2, now.rows + 2)
        lowest = self.fluid.cells.pressure.to_numpy()[: shape[0] * shape[1]].reshape(shape)[1:-1, 1]
        weight = -float(now.gravity[1]) * 0.5 * now.height  # from the middle of a cell to its lower side
        floor = np.where(lowest != 0, lowest * (now.density / now.step) + now.density * weight, 0.0).mean()
        marker = float(now.marker) * float(now.width) * float(now.height)
        found = {"water_m2": now.markers * marker, "water_gone_m2": now.gone * marker}
        if self.fluid.soaks:
            owed = float(self.fluid.cells.owed.to_numpy().sum(dtype=float)) * marker
            found["water_m2"] += owed
            found["water_held_m2"] = held(world, self.fluid, self.fluid.sizes.to_numpy())
        return found | {
            "water_floor_Pa": float(floor),
            "water_speed_max_m_s": float(now.fastest),
            "water_divergence_1_s": float(now.left),
            "water_iterations": int(now.rounds),
            "water_step_s": float(now.step),
        }


def widest(scene: Any, grains: Any) -> float:
    """Diameter of the largest grain, or of what sources may make, as a disc of the same area [m]."""
    made = [scene.form_of(table).size * table.radius[1] for table in scene.sources]
    return 2 * max([float(grains.size.max(initial=0.0)), *made])


@ti.kernel
def turn(w: ti.template(), s: ti.template(), f: ti.template()) -> ti.i32:
    """All of it in one launch, which costs as much as 100 grains. Returns how many steps of the grains the next one of the water takes."""
    steps = 0
    ti.loop_config(serialize=True)
    for _run in range(1):
        advance(f)
        flow(f)
        steps = begin(w, s, f)
        lay_walls(w, f)
    ti.loop_config(serialize=True)
    for _run in range(1):
        transfer(f)
        deal(w, f)
    ti.loop_config(serialize=True)
    for _run in range(1):
        project(f)
        feel(w, f)
    return steps


@ti.func
def begin(w: ti.template(), s: ti.template(), f: ti.template()):
    """How many steps of the grains the next one of the water may take; and with which numbers."""
    c, now = s.constants[None], f.now[None]
    fastest = ti.max(now.fastest, fastest_mover(w))
    longest = at_most(LONGEST, CFL * ti.min(now.width, now.height) / (fastest + 1e-30))
    steps = ti.max(1, ti.floor(at_most(longest / c.step * (1.0 + 1e-6), MOST_TOGETHER), ti.i32))
    f.now[None].density, f.now[None].viscosity, f.now[None].gravity = c.water_density, c.water_viscosity, w.box[None].gravity
    f.now[None].permeability = c.water_permeability
    f.now[None].next = steps * c.step
    if now.full == 1:
        flag(w, WATER_FULL, 0)
        f.now[None].full = 0
    f.now[None].time += now.step
    return steps


@ti.kernel
def weighed(w: ti.template()) -> ti.types.vector(3, ti.f32):
    """Mass of the grains that can move, of those that are under water [kg], and the area of these [m2], as discs."""
    whole, sunk, area = 0.0, 0.0, 0.0
    ti.loop_config(serialize=True)
    for _run in range(1):
        for i in range(w.count[None]):
            light = mobility(w, i).x
            if w.grains.id[i] >= 0 and light > 0.0:
                whole += 1.0 / light
                if w.carried.water_wet[i] > 0.99:
                    sunk += 1.0 / light
                    area += math.pi * w.grains.radius[i] * w.grains.radius[i]
    return ti.Vector([ti.cast(whole, ti.f32), ti.cast(sunk, ti.f32), ti.cast(area, ti.f32)])
