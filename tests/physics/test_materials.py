"""[[materials]]: friction and restitution by what two that meet are made of, both solvers."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import G, digest, fresh_taichi

import taichi_sand as sand
from taichi_sand.errors import SandError

KINDS = ("md", "rigid")
R = 0.005
OWN_MU, OWN_E = 0.5, 0.9
MATERIALS = [
    {"name": "steel", "friction": 0.3, "restitution": 0.6},
    {"name": "sand", "friction": 0.6, "restitution": 0.2},
    {"name": "glass", "restitution": 0.8},
]
PAIRS = [{"between": ["steel", "sand"], "friction": 0.4, "restitution": 0.35}]
MU = {"steel": 0.3, "sand": 0.6, "glass": OWN_MU, "": OWN_MU}
E = {"steel": 0.6, "sand": 0.2, "glass": 0.8, "": OWN_E}
SCENE: dict[str, Any] = {"materials": MATERIALS, "material_pairs": PAIRS, "effects": {"friction": {"mu": OWN_MU}}}
NAMES = ("steel", "sand", "glass", "")


def between(values: dict[str, float], pair: float, one: str, other: str) -> float:
    """What the scene asks for: the geometric mean, unless it names the pair."""
    return pair if {one, other} == {"steel", "sand"} else math.sqrt(values[one] * values[other])


@pytest.mark.parametrize("kind", KINDS)
def test_restitution_by_pair(kind: str) -> None:
    """All ten pairs of three materials and the scene's own, head-on; and glass that meets a steel wall and the sand of the edges."""
    pairs = [(one, other) for k, one in enumerate(NAMES) for other in NAMES[k:]]
    grains, wanted = [], []
    for lane, (one, other) in enumerate(pairs):
        y = 0.012 + 0.018 * lane
        grains += [
            {"positions": [[x, y]], "velocity": [v, 0.0], "material": name} for name, x, v in ((one, 0.1, 1.0), (other, 0.1105, -1.0))
        ]
        wanted.append(between(E, 0.35, one, other))
    grains += [{"positions": [[x, 0.1]], "velocity": [1.0, 0.0], "material": "glass"} for x in (0.29, 0.39)]
    made = sand.Scene(
        **SCENE,
        size=[0.4, 0.2],
        gravity=[0.0, 0.0],
        edges={"material": "sand"},
        solver={"kind": kind, "restitution": OWN_E, "stiffness": 1e6, "step": 4e-6}
        if kind == "md"
        else {"kind": kind, "restitution": OWN_E},
        grains=[{"radius": R, **table} for table in grains],
        walls=[{"points": [[0.3, 0.0], [0.3, 0.2]], "material": "steel"}],
    )
    sim = sand.Simulation(made, threads=1)
    sim.advance(0.02)
    speeds = sim.velocities[:, 0]
    found = 0.5 * (speeds[1:20:2] - speeds[0:20:2])
    assert found == pytest.approx(wanted, abs=0.004)
    assert -speeds[20:] == pytest.approx([between(E, 0.0, "glass", "steel"), between(E, 0.0, "glass", "sand")], abs=0.004)


LANES = [("steel", "sand"), ("steel", "steel"), ("sand", "sand"), ("steel", ""), ("", "glass")]


def slopes(kind: str, off: float) -> tuple[sand.Scene, np.ndarray]:
    """Bars on walls as steep as their pair's angle of friction and `off` [rad] more, and these angles."""
    angles = np.array([math.atan(between(MU, 0.4, *pair)) for pair in LANES]) + off
    grains, walls = [], []
    for lane, ((bar, base), angle) in enumerate(zip(LANES, angles, strict=True)):
        along, up = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        start = np.array([0.02 + 0.2 * lane, 0.02])
        place = start + 0.12 * along + R * up
        grains.append({"shape": "2x1", "radius": R, "positions": [place.tolist()], "angle": float(angle), "material": bar})
        walls.append({"points": [start.tolist(), (start + 0.16 * along).tolist()], "material": base})
    solver = {"kind": kind, "tolerance": 0.005}
    return sand.Scene(**SCENE, size=[1.02, 0.3], solver=solver, grains=grains, walls=walls), angles


@pytest.mark.parametrize("kind", KINDS)
def test_a_bar_slides_at_its_pairs_angle(kind: str) -> None:
    """0.2 degrees below the angle of friction of bar and slope it stays, 0.2 above it slides by g (sin - mu cos) t²/2."""
    for off in (-math.radians(0.2), math.radians(0.2)):
        made, angles = slopes(kind, off)
        sim = sand.Simulation(made, threads=1)
        sim.advance(0.2)  # it sinks in
        before, speed = sim.positions, np.hypot(*sim.velocities.T)
        sim.advance(0.5)
        gone = np.hypot(*(sim.positions - before).T)
        if off < 0:
            assert gone.max() < 1e-4
        else:
            pull = G * (np.sin(angles) - np.tan(angles - off) * np.cos(angles))
            assert gone == pytest.approx(speed * 0.5 + pull * 0.5**2 / 2, rel=0.15)


def test_what_the_scene_has_of_its_own_stays_live_and_checkpoints_hold_all(tmp_path: Path) -> None:
    """A bar of the scene's own on glass starts to slide as `effects.friction.mu` is lowered, steel on sand does not; the same bits after a
    checkpoint, on two threads.
    """
    made, _ = slopes("rigid", -math.radians(0.2))
    sim = sand.Simulation(made, threads=1)
    sim.set("effects.friction.mu", 0.2)
    sim.advance(0.2)
    speeds = np.hypot(*sim.velocities.T)
    assert speeds[:3].max() < 1e-3 < 0.1 < speeds[4]
    sim.save(tmp_path / "bars.npz")
    sim.advance(0.1)
    shown = digest(sim)
    sim.close()
    fresh_taichi()
    sim = sand.Simulation.resume(tmp_path / "bars.npz", threads=2)
    sim.advance(0.1)
    assert digest(sim) == shown
    sim.close()


def test_without_materials_nothing_is_stored() -> None:
    sim = sand.Simulation(sand.Scene(size=[0.1, 0.1], walls=[{"points": [[0.0, 0.0], [0.1, 0.1]]}]), threads=1)
    assert sim.world.materials is None and sim.world.walls.material is None and not sim.world.mixed


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown": ({"grains": [{"radius": R, "count": 1, "material": "stel"}]}, 'grains[0].material = "stel" must be the name of one of the'),
    "unknown edge": ({"edges": {"material": "wood"}}, 'edges.material = "wood"'),
    "unknown pair": ({"material_pairs": [{"between": ["steel", "wood"], "friction": 0.1}]}, 'material_pairs[0].between = "wood"'),
    "a pair twice": ({"material_pairs": [*PAIRS, {"between": ["sand", "steel"], "friction": 0.1}]}, "names two that another pair names"),
    "a pair of nothing": ({"material_pairs": [{"between": ["sand", "steel"]}]}, "material_pairs[0] needs `friction` or `restitution`"),
    "a name twice": ({"materials": [*MATERIALS, {"name": "sand"}]}, 'materials[3].name = "sand" is the name of two'),
    "no name": ({"materials": [{"friction": 0.1}]}, "materials[0].name is missing"),
    "no friction": ({"effects": {}}, "materials[0].friction = 0.3 needs a table [effects.friction]"),
    "friction twice": ({"walls": [{"points": [[0, 0], [1, 1]], "material": "sand", "friction": 0.1}]}, "exclude each other"),
    "a dashpot": ({"solver": {"kind": "md", "k_d": 1.0, "k_r": 1e4}}, "materials[0].restitution = 0.6 cannot be had beside solver.k_d"),
    "too much": ({"materials": [{"name": "sand", "restitution": 2.0}]}, "must be at most 1"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_materials(case: str) -> None:
    keys, said = WRONG[case]
    with pytest.raises(SandError) as error:
        sand.Scene(**SCENE | {"size": [1.0, 1.0]} | keys)
    assert said in str(error.value) and "\n" not in str(error.value)
