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
`water_m2`: with the effect `water`: area of the water that there is, over the box; what left through open edges is gone.
`water_floor_Pa`: mean pressure of the water on the lower edge of the box.
`water_speed_max_m_s`: of its fastest marker, along x or y.
`water_divergence_1_s`: largest divergence that the projection has left.
`water_iterations`: of the projection, in the last step of the water.
`water_step_s`: how far apart the water acts.
`wall_force_N`: sum over all wall contacts of the size of their force.
`wall_forces_N`: by wall, of those that are touched: force of the grains on it, x and y, and its torque about the pivot [N m], of an edge
about its middle. With rigid, impacts of the last step are in it.
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

from taichi_sand.measure import observe
from taichi_sand.measure.contacts import contacts as contact_rows
from taichi_sand.measure.contacts import real_of
from taichi_sand.measure.grain_state import wall_forces
from taichi_sand.solvers.tolerance import softness
from taichi_sand.world.extras.hooks import offers
from taichi_sand.world.extras.links import ends_of
from taichi_sand.world.sources import waiting

CELLS_ACROSS = 8
"""A bed of n grains gets cells of about sqrt(n) / CELLS_ACROSS diameters, between SMALLEST and LARGEST."""
SMALLEST, LARGEST = 2.0, 6.0
BEARING = 1e-3


def _blocks(world: Any) -> int:
    """Rows that per-block sums need."""
    return world.blocks.pair_start.shape[0]


def _frame(sim: Any, dtype: Any) -> np.ndarray:
    """Lattice spacing, upward unit vector and gravity, for the kernels."""
    gravity = sim.world.box[None].gravity.to_numpy().astype(np.float64)
    size = float(np.hypot(*gravity))
    up = -gravity / size if size > 0 else np.array([0.0, 1.0])
    return np.concatenate([sim.world.box[None].spacing.to_numpy(), up, gravity]).astype(dtype)


def motion(sim: Any) -> dict[str, Any]:
    """Energies [J], momenta [N s, N m s], largest speed [m/s] and height of the bed [m]."""
    real, dtype = real_of(sim)
    sums = np.zeros((_blocks(sim.world), observe.GRAIN_COLUMNS), dtype)
    sums[:, observe.LOWEST] = np.inf
    observe.sum_grains(sim.world, _frame(sim, dtype), sums, real)
    total = sums.sum(axis=0, dtype=np.float64)
    moving = total[observe.MOVING] > 0
    height = 2 * (total[observe.HEIGHT] / total[observe.MASS] - sums[:, observe.LOWEST].min()) if moving else 0.0
    return {
        "mass_kg": float(total[observe.MASS]) if moving else 0.0,
        "kinetic_energy_J": float(total[observe.KINETIC]),
        "potential_energy_J": float(total[observe.POTENTIAL]),
        "momentum_Ns": [float(total[observe.PX]), float(total[observe.PY])],
        "angular_momentum_Nms": float(total[observe.SPIN]),
        "bed_height_m": float(height),
        "speed_max_m_s": float(np.sqrt(sums[:, observe.SPEED2].max())),
    }


def look_at_pairs(sim: Any) -> tuple[np.ndarray, np.ndarray]:
    """The sums over pairs, by the columns of `observe`, and the overlaps of those that touch [m]."""
    real, dtype = real_of(sim)
    w = sim.world
    sums = np.zeros((_blocks(w), observe.PAIR_COLUMNS), dtype)
    overlaps = np.zeros(w.half * (1 + w.sleeps), dtype)
    observe.sum_pairs(w, _frame(sim, dtype), sums, overlaps, real)
    return sums.sum(axis=0, dtype=np.float64), overlaps[overlaps > 0].astype(np.float64)


def contacts(sim: Any) -> dict[str, Any]:
    """Pairs, overlaps as a fraction of d, coordination, and the force on floors and walls [N]."""
    total, touching = look_at_pairs(sim)
    touching /= sim.bed.diameter
    mean_push = total[observe.PUSH] / total[observe.PUSHING] if total[observe.PUSHING] else 0.0
    return {
        "pairs": int(total[observe.LISTED]),
        "contacts": int(total[observe.TOUCHING]),
        "overlap_mean": float(touching.mean()) if len(touching) else 0.0,
        "overlap_p99": float(np.percentile(touching, 99)) if len(touching) else 0.0,
        "overlap_max": float(touching.max()) if len(touching) else 0.0,
        "coordination": coordination(sim, mean_push),
        "floor_force_N": float(total[observe.FLOOR]),
        "wall_force_N": float(total[observe.WALL]),
    }


def walls(sim: Any) -> dict[str, list[float]]:
    """Force x, y [N] and torque [N m] on every wall that is touched, by its name."""
    found = wall_forces(sim, contact_rows(sim))
    return {str(row["name"]): [*row["force"].tolist(), float(row["torque"])] for row in found[found["contacts"] > 0]}


def coordination(sim: Any, mean_push: float) -> float:
    """Bearing contacts a grain, without rattlers; `mean_push` [N] is the mean normal force of the pushing contacts."""
    if mean_push <= 0:
        return 0.0
    w = sim.world
    bearing = np.zeros(w.capacity, np.int32)
    ends = np.zeros((_blocks(w), 2), np.int32)
    observe.count_bearing(w, BEARING * mean_push, bearing)
    observe.count_ends(w, BEARING * mean_push, bearing, ends)
    met, grains = ends.sum(axis=0)
    return float(met / grains) if grains else 0.0


def packing_fraction(sim: Any) -> float:
    """Area of grains a unit area inside the bed: see the head of this file."""
    real, dtype = real_of(sim)
    w = sim.world
    d = sim.bed.diameter
    cell = float(np.clip(np.sqrt(max(w.count[None], 1)) / CELLS_ACROSS, SMALLEST, LARGEST)) * d
    shape = tuple(max(1, int(np.ceil(side / cell))) for side in w.box[None].size.to_numpy())
    filled = np.zeros(shape, np.int32)
    observe.deal_area(w, _frame(sim, dtype), cell, filled, real)
    fraction = np.pad(filled / observe.FULL, 1)
    full = fraction > 0.5
    around = [full[1 + dx : 1 + dx + shape[0], 1 + dy : 1 + dy + shape[1]] for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    inside = np.logical_and.reduce(around)
    return float(fraction[1:-1, 1:-1][inside].mean()) if inside.any() else 0.0


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
    weights = np.zeros(w.capacity, np.float32)
    observe.weigh_grains(w, weights)
    mass = weights[: sim.count].astype(np.float64)
    columns = {name: column.to_numpy()[: sim.count].astype(np.float64) for name, column in w.carried._asdict().items()}
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
        **contacts(sim),
        "wall_forces_N": walls(sim),
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
