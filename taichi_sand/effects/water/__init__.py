"""Water: sand and water that feel each other, averaged over cells of some grains (unresolved; Model A of Zhou et al. 2010).

Markers carry the water over a staggered grid (FLIP on a MAC grid), a projection makes it divergence-free, with a free surface below air.
Grains enter as porosity. The water pushes them by its pressure gradient, which is buoyancy too, and by drag; they push back just as much.
A disc stands for a sphere in a slab one grain thick, so that porosities, drag and quicksand are those of spheres. The water acts at most
1/120 s apart, and so often that none of it flows on by more than a cell; the grains' steps lie between. `[[water]]` says where it is at
the start; cells should be three grains wide or more. Grains of several discs are to the water discs of the same area, and all of them
should be smaller than a cell. With the effect `moisture` what is under water is soaked, so that liquid bridges let go, and comes out wet;
that water is not taken from the markers. Turbulence, capillarity and lubrication are left out.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_sand.effects.base import Effect
from taichi_sand.effects.water.drag import LAWS, body_of, deal, feel, felt, under
from taichi_sand.effects.water.grid import Fluid, allocate, plan
from taichi_sand.effects.water.markers import start
from taichi_sand.effects.water.pressure import project
from taichi_sand.effects.water.transfer import advance, transfer
from taichi_sand.effects.water.wells import flow
from taichi_sand.scene.parameters import Parameter
from taichi_sand.world.flags import WATER_FULL, flag
from taichi_sand.world.geometry import add, at_most, velocity, wrench
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
SPARE = 30.0
"""There is room for what wells up within the duration and so much longer [s]."""
VECTORS = ("pull", "stream", "start", "given", "borne")


@dataclass(frozen=True, eq=False)
class Water(Effect):
    """The effect."""

    parameters = (
        Parameter("density", 1000.0, "density", "kg/m3", low=1.0, high=2e4),
        Parameter("viscosity", 1e-3, "viscosity; water has 0.001, glycerol 1", "Pa s", low=1e-6, high=1e3),
        Parameter("cell", 3.0, "width of a cell", "d", low=0.1, high=100.0, live=False),
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
        made = allocate(world.real, cells, len(place) + math.ceil(inflow), len(sizes), len(wells))
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
        return (Fluid(**made, **structure, rigid=solver == "rigid", real=world.real),)

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
        advance(self.fluid)
        let_flow(self.fluid)
        steps = begin(world, solver, self.fluid)
        transfer(self.fluid)
        deal(world, self.fluid)
        project(self.fluid)
        feel(world, self.fluid)
        return int(steps)

    def report(self, world: Any, solver: Any) -> dict[str, float]:
        """How much water there is, and how well it is followed."""
        now = self.fluid.now[None]
        shape = (now.columns + 2, now.rows + 2)
        lowest = self.fluid.cells.pressure.to_numpy()[: shape[0] * shape[1]].reshape(shape)[1:-1, 1]
        weight = -float(now.gravity[1]) * 0.5 * now.height  # from the middle of a cell to its lower side
        floor = np.where(lowest != 0, lowest * (now.density / now.step) + now.density * weight, 0.0).mean()
        return {
            "water_m2": float(now.markers * now.marker * now.width * now.height),
            "water_floor_Pa": float(floor),
            "water_speed_max_m_s": float(now.fastest),
            "water_divergence_1_s": float(now.left),
            "water_iterations": int(now.rounds),
            "water_step_s": float(now.step),
        }


@ti.kernel
def let_flow(f: ti.template()):
    """Water that wells up and drains off in the step that has passed."""
    ti.loop_config(serialize=True)
    for _run in range(1):
        flow(f)


@ti.kernel
def begin(w: ti.template(), s: ti.template(), f: ti.template()) -> ti.i32:
    """How many steps of the grains the next one of the water may take; and with which numbers."""
    c, now = s.constants[None], f.now[None]
    longest = LONGEST
    longest = at_most(longest, CFL * ti.min(now.width, now.height) / (now.fastest + 1e-30))
    steps = ti.max(1, ti.floor(at_most(longest / c.step * (1.0 + 1e-6), MOST_TOGETHER), ti.i32))
    f.now[None].density, f.now[None].viscosity, f.now[None].gravity = c.water_density, c.water_viscosity, w.box[None].gravity
    f.now[None].next = steps * c.step
    if now.full == 1:
        flag(w, WATER_FULL, 0)
        f.now[None].full = 0
    f.now[None].time += now.step
    return steps
