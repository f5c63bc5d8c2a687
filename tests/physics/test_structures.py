"""What has been built stands: a tall pyramid of squares, and an arch, for a minute each (physics.md C2, C13)."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import D, R, fresh_taichi

import taichi_sand as sand
from taichi_sand.scene.shapes import union_moments

SOLVERS = {"md": {"kind": "md", "tolerance": 0.02, "restitution": 0.1}, "rigid": {"kind": "rigid", "tolerance": 0.02}}
STIFF = {"md": {"tolerance": 0.001}, "rigid": {"step": 5e-4}}
"""An arch bears far more than the weight that lies on a grain, which is what the tolerance reckons with."""
MINUTE = 60.0


def build(grains: list[dict[str, Any]], size: tuple[float, float], kind: str, mu: float, **keys: Any) -> sand.Simulation:
    fresh_taichi()
    solver = SOLVERS[kind] | keys.pop("solver", {})
    return sand.Simulation(sand.Scene(size=size, grains=grains, solver=solver, effects={"friction": {"mu": mu}}, **keys), threads=1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rigid", "md"])
def test_pyramid_of_squares(kind: str) -> None:
    """C2: base 20, a minute: the top sinks by less than 0.5 % of the height, nothing turns, nothing creeps in the second half.

    The tolerance is what it takes: squares of four discs roll on one another like gears where they overlap by more than some 0.01 d
    (study.stress.hard_structures.squares).
    """
    half, base = 2 * R, 20
    rows = [[0.5 + (2 * k - (base - 1 - level)) * half, (2 * level + 1) * half, R] for level in range(base) for k in range(base - level)]
    sim = build([{"shape": "square", "positions": rows}], (1.0, 0.5), kind, 0.5, solver={"tolerance": 0.005})
    start = sim.positions
    sim.advance(MINUTE / 2)
    middle = sim.positions
    sim.advance(MINUTE / 2)
    end = sim.positions
    assert start[-1, 1] - end[-1, 1] < 0.005 * 2 * half * base
    assert np.abs(sim.angles).max() < 0.01 and sim.flags() == []
    assert np.hypot(*(end - middle).T).max() < 0.01 * D


def arch() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Shapes and grains of half a ring of 17 wedges, radius 1 by 0.3 thick, with a stack of four squares on the keystone; in units of
    0.1 m. A wedge touches the next one by a disc at either end of the joint, and the floor in the same way.
    """
    wedge, middle = math.pi / 17, np.array([2.0, 0.0])
    quarter, discs = math.sin(wedge / 4), []
    for ring in (0.85, 1.15):
        discs += [[ring * math.sin(way * wedge / 4), ring * math.cos(wedge / 4), ring * quarter] for way in (-1, 1)]
    discs += [[0.0, ring, 0.93 * ring * math.sin(wedge / 2)] for ring in (0.93, 1.07)]
    area, first, _ = union_moments(np.array(discs))
    rows = []
    for k in range(17):
        turn = (k + 0.5) * wedge - math.pi / 2
        x, y = first / area
        place = middle + np.array([math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y])
        rows.append([*(0.1 * place), 0.1, 0.0, 0.0, turn])
    size = 1.15 * quarter
    crown = 1.15 * math.cos(wedge / 4) + size
    blocks = [[0.1 * middle[0], 0.1 * (crown + (4 * k + 2) * size), 0.1 * size] for k in range(4)]
    return [{"name": "wedge", "discs": discs}], [{"shape": "wedge", "positions": rows}, {"shape": "square", "positions": blocks}]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rigid", "md"])
def test_arch(kind: str) -> None:
    """C13: an arch of 17 wedges that carries four blocks, mu = 0.6, stands for a minute, contacts overlap by less than 2 %."""
    shapes, grains = arch()
    sim = build(grains, (0.4, 0.25), kind, 0.6, shapes=shapes, solver=STIFF[kind])
    start = sim.positions
    sim.advance(MINUTE)
    report = sim.report()
    assert np.hypot(*(sim.positions - start).T).max() < 0.02 * 0.3 * 0.1  # of the thickness
    assert report["overlap_max"] < 0.02 and report["flags"] == []
    assert report["speed_max_m_s"] < 1e-3
