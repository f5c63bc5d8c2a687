"""The report: what a simulation is worth and what it cost, as one JSON-able dictionary (design.md section 6).

How the less obvious numbers are defined:

`pairs` are those of the neighbour list; `contacts` are the pairs whose surfaces overlap at the present positions, walls included; the
overlaps are theirs, as a fraction of the mean grain diameter d. Energies are in J, the potential one is -m g.x from the origin of
the box (springs and bonds hold energy that is not in it). Momentum and angular momentum are of the grains that can move, the latter
about the origin of the box and with their spins. Fixed grains have no mass and count in nothing but the contacts.

`packing_fraction`: the box is cut into square cells of 2 to 6 d; the cells that are more than half full and whose eight neighbours are
too make up the inside of the bed (so the surface, the walls and their ordering stay out); it is the area of grains a unit area there.
0 where no bed is that large.
`coordination`: mean number of bearing contacts of a grain, walls included, over the grains that are no rattlers. A contact bears when its
normal force exceeds 1e-3 of the mean one; a rattler has fewer than two such contacts (physics.md B3).
`depth`: of the pile, in grains, that stiffness and step are made for; measured anew as the pile grows.
`flow_softness`: of a dense flow, duration of a contact (md: of a collision of two mean grains; rigid: a step) times the speed that 99 %
of the contacts keep below, grains by their centres, over d; the middle one of the last three looks, 8 sqrt(d/g) apart; 0 if there was no
flow. Above 0.03 (md) and 0.08 (rigid) `warnings` says so: a slope is then some 10 % too fast (md: 3.5 to 4 times the softness) or too slow.
`step_set_by`: "tolerance", "scene" (`step` or `substeps`), or "effects", where one, such as bonds, allows no longer step.
`bed_height_m`: twice the mass-weighted mean height above the lowest point of a grain: the height of a level bed of even density.
Up is against gravity (+y without gravity).
`floor_force_N`: downward force on the walls that rise less than 80 degrees, friction and what bridges pull included; a bed at rest
between smooth sides gives its weight.
`heat_J`: with the effect `heat`: energy that contacts have turned into heat, of the grains present [J].
`wetness_mean`: with the effect `moisture`: mean wetness, weighted by mass.
`momentum_taken_Ns`: with the effect `safe_direction`: momentum that the rule has taken from the grains, [x, y] [N s].
`water_m2`: with the effect `water`: area of the water that flows or stands, in the open and in pores, over the box.
`water_gone_m2`: of that which has left through open edges.
`water_held_m2`: with `moisture` too: of that which grains hold by themselves; they take it from the water, and give it back.
`water_floor_Pa`: mean pressure of the water on the lower edge of the box.
`water_speed_max_m_s`: of its fastest marker, along x or y.
`water_divergence_1_s`: largest divergence that the projection has left.
`water_iterations`: of the projection, in the last step of the water.
`water_step_s`: how far apart the water acts.
`wall_force_N`: sum over all wall contacts of the size of their force.
`wall_forces_N`: by wall, and by edge that is a wall: force of the grains on it, x and y, and its torque about the pivot [N m], of an edge
about its middle. With rigid, impacts of the last step are in it.
`wall_pressures_N_m`: of walls with `pressure`: what the grains resist their course with, by the length that they can load [N/m].
`mass_kg`: of the grains that can move.
`events`: with events: when each that has come came, by name [s].
`grains_made`: with sources or sinks: grains there have been in all, those of the start included.
`grains_waiting`: with sources: grains that were due when these last looked, and have found no room yet; flagged when more than a tenth.
`grains_asleep`: with the effect `sleeping`: grains that are not computed at present.
`wall_time_s`, and what is made of it: since the simulation was made or resumed, without compiling.
`stages_s`: wall time by stage [s]: march (lists and steps), effects, look (depth of the pile), measure, record (trajectories).
`warnings`: what holds, but only roughly, a sentence each: flows that are too soft or too fast; empty when there is nothing to say.
`flags`: what had to be bounded or went wrong, a sentence each; empty when all is well.
`solver`, `effects`, `arch`, `threads` and `precision`: what it ran with; `threads` is null for all there are.
Forces are those of the last step. Sums are in f64 on the CPU and CUDA.
"""

from typing import Any

import numpy as np

from taichi_sand.measure.contacts import as_contacts
from taichi_sand.measure.discs import Kinds, discs_of
from taichi_sand.measure.grain_state import masses, there, wall_forces, wall_pressures
from taichi_sand.measure.loads import Loads
from taichi_sand.measure.packing import packing_fraction
from taichi_sand.measure.pairs import Found, pairs_of
from taichi_sand.solvers.tolerance import softness
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.extras.links import ends_of
from taichi_sand.world.reading import in_order, ranks, read_columns, rows_of
from taichi_sand.world.sources import waiting


def upwards(sim: Any) -> np.ndarray:
    """The unit vector against gravity; +y without gravity."""
    gravity = np.array(sim.scene.gravity, float)
    size = float(np.hypot(*gravity))
    return -gravity / size if size > 0 else np.array([0.0, 1.0])


def motion(sim: Any) -> dict[str, Any]:
    """Energies [J], momenta [N s, N m s], largest speed [m/s] and height of the bed [m]."""
    table = read_columns(sim.world, ("position", "velocity", "spin", "angle", "radius", "kind", "mobility"))
    mass, inertia = masses(table["mobility"]).T
    x, v, spin, up = table["position"], table["velocity"], table["spin"], upwards(sim)
    total = float(mass.sum())
    height = 0.0
    if total > 0:
        discs = discs_of(Kinds(sim.scene), *(table[name] for name in ("kind", "position", "angle", "radius")))
        height = 2 * (float(mass @ (x @ up)) / total - float((discs.place @ up - discs.radius).min()))
    square, turning = (v**2).sum(axis=1), inertia * spin
    return {
        "mass_kg": total,
        "kinetic_energy_J": float(0.5 * (mass @ square + turning @ spin)),
        "potential_energy_J": float(-(mass @ (x @ np.array(sim.scene.gravity)))),
        "momentum_Ns": (mass @ v).tolist(),
        "angular_momentum_Nms": float(mass @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + turning.sum()),
        "bed_height_m": height,
        "speed_max_m_s": float(np.sqrt(square[mass > 0].max(initial=0.0))),
    }


def contacts(sim: Any, found: Found | None = None) -> dict[str, Any]:
    """Pairs, overlaps as a fraction of d, coordination, and the force on floors and walls [N]; `found`: the pairs, if they are read."""
    found = pairs_of(sim) if found is None else found
    loads = Loads(found)
    touching = loads.overlaps / sim.bed.diameter
    return {
        "pairs": found.listed,
        "contacts": len(touching),
        "overlap_mean": float(touching.mean()) if len(touching) else 0.0,
        "overlap_p99": float(np.percentile(touching, 99)) if len(touching) else 0.0,
        "overlap_max": float(touching.max()) if len(touching) else 0.0,
        "coordination": loads.coordination(sim.made),
        "floor_force_N": loads.on_floors(upwards(sim)),
        "wall_force_N": loads.on_walls(),
    }


def walls(sim: Any, found: Found) -> dict[str, Any]:
    """By wall, by their names: force x, y [N] and torque [N m]; of those with `pressure` what bears it [N/m]. `found` is not to be used any
    more.
    """
    rows = wall_forces(sim, as_contacts(sim, found))
    told = {str(row["name"]): [*row["force"].tolist(), float(row["torque"])] for row in there(sim, rows)}
    held = wall_pressures(sim, rows)
    return {"wall_forces_N": told, **({"wall_pressures_N_m": held} if held else {})}


def pairs(sim: Any) -> dict[str, Any]:
    """What is told of contacts and walls."""
    found = pairs_of(sim)
    return {**contacts(sim, found), **walls(sim, found)}


def cost(sim: Any) -> dict[str, Any]:
    """What it took since the simulation was made or resumed, compiling apart: times [s], simulated time by wall time, and ns a grain and
    step.
    """
    clock = sim.clock
    return {
        "wall_time_s": float(clock.wall),
        "compile_time_s": float(clock.compile),
        "real_time_factor": float(clock.simulated / clock.wall) if clock.wall > 0 else 0.0,
        "ns_per_grain_step": 1e9 * clock.wall / clock.grain_steps if clock.grain_steps else 0.0,
        "stages_s": {name: float(seconds) for name, seconds in clock.stages.items()},
    }


def carried(sim: Any) -> dict[str, Any]:
    """What grains carry for effects, summed: heat [J], water as their mean wetness, momentum taken [N s]."""
    w = sim.world
    if not w.carried:
        return {}
    count = sim.count
    mass = masses(read_columns(w, ("mobility",))["mobility"])[:, 0]
    rank = ranks(w)
    columns = {name: in_order(rows_of(column, count), rank).astype(np.float64) for name, column in w.carried._asdict().items()}
    found: dict[str, Any] = {}
    if "temperature" in columns:
        heat = mass * columns["temperature"] * sim.solver.constants[None].heat_capacity + columns["warmth"]
        found["heat_J"] = float(heat.sum())
    if "wetness" in columns:
        found["wetness_mean"] = float((mass * columns["wetness"]).sum() / max(mass.sum(), 1e-30))
    if "taken_x" in columns:
        found["momentum_taken_Ns"] = [float(columns["taken_x"].sum()), float(columns["taken_y"].sum())]
    return found


def own_numbers(sim: Any) -> dict[str, Any]:
    """What effects say of themselves."""
    found: dict[str, Any] = {}
    for effect in sim.solver.effects:
        if offers(effect, "report"):
            found |= effect.report(sim.world, sim.solver)
    return found


def step_set_by(sim: Any) -> str:
    """What the step follows from: the keys of the scene, its tolerance, or the effects that allow no longer one."""
    if sim.scene.solver.step or sim.scene.solver.substeps:
        return "scene"
    return "effects" if sim.step == sim.bed.longest_step else "tolerance"


def report(sim: Any) -> dict[str, Any]:
    """Every observable of `sim`, a Simulation, as it stands now; the keys are those of design.md section 6."""
    return {
        "time_s": float(sim.time),
        "steps": int(sim.steps),
        "grains": sim.count,
        "grains_lost": int(sim.lost),
        **({"grains_made": int(sim.made), "grains_removed": int(sim.taken)} if sim.world.flows else {}),
        **({"grains_waiting": sum(waiting(sim.scene, sim.world, sim.stages.flows, sim.poured))} if sim.scene.sources else {}),
        **({"grains_asleep": int(sim.world.sleep.state[None].asleep)} if sim.world.sleeps else {}),
        **({"bonds": len(ends_of(sim.world, 1)), "bonds_broken": len(ends_of(sim.world, 0))} if sim.world.linked else {}),
        "tolerance": float(sim.scene.solver.tolerance),
        "depth": float(sim.bed.depth),
        **({"events": sim.events} if sim.scene.events else {}),
        **pairs(sim),
        "flow_softness": softness(sim.numbers, sim.bed),
        **motion(sim),
        **carried(sim),
        **own_numbers(sim),
        "packing_fraction": packing_fraction(sim),
        "step_s": float(sim.step),
        "step_set_by": step_set_by(sim),
        **cost(sim),
        "solver": sim.scene.solver.kind,
        "effects": list(sim.effects),
        "arch": sim.arch,
        "threads": sim.threads,
        "precision": int(sim.scene.solver.precision),
        "warnings": sim.warnings(),
        "flags": sim.flags(),
    }
