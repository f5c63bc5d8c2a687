"""Walls drawn in pieces, by one wall or many, are walls: grains rest on them, roll over them and bounce off them as off straight lines.

Numbers are those of a straight line: heights from geometry, speeds of free rolling, rebounds off one line in the same simulation.
"""

import math
from typing import Any

import numpy as np
import pytest
from helpers import D, Disc, G, R, simulate

import taichi_sand as sand

SOLVERS = ("rigid", "md")
TOLERANCE = 0.02


FLOOR_OF_PIECES = f"""
title = "A floor of pieces"
size = [1.0, 0.5]
duration = 0.5

[solver]
restitution = 0.1

[[grains]]
positions = [[0.10, 0.106, 0.005]]

[[walls]]
points = {[[round(0.02 * k, 2), 0.1] for k in range(51)]}
"""
SLOT = """
title = "A slot that is too narrow"
size = [0.4, 0.35]
duration = 1.5

[[grains]]
positions = [[0.2, 0.106, 0.005]]

[[walls]]
points = [[0.0, 0.1], [0.19575, 0.1]]

[[walls]]
points = [[0.20425, 0.1], [0.4, 0.1]]
"""
PERIODIC_FLOOR = """
title = "A floor that goes round"
size = [0.2, 0.2]
duration = 2.0
edges = { left = "periodic", right = "periodic", bottom = "wall", top = "wall" }

[[grains]]
positions = [[0.03, 0.056, 0.005], [0.10, 0.056, 0.005], [0.17, 0.056, 0.005]]

[[walls]]
points = [[0.0, 0.05], [0.2, 0.05]]
velocity = [0.1, 0.0]

[effects.friction]
mu = 0.5
"""
DRAWN = {  # text of a scene, where its grains are at last, and their speed: discs on a belt roll at a third of its speed
    "floor of pieces": (FLOOR_OF_PIECES, 0.105, 0.0),
    "slot": (SLOT, 0.1 + math.sqrt(0.005**2 - 0.00425**2), 0.0),
    "periodic floor": (PERIODIC_FLOOR, 0.055, 0.1 / 3),
}


def settings(kind: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "precision": 32, "tolerance": TOLERANCE, **more}


def in_pieces(piece: float, length: float, height: float, bump: float = 0.0) -> list[list[float]]:
    """Points of a level floor of pieces about so long [m], every other one raised by `bump` pieces."""
    count = max(1, round(length / piece))
    return [[length * k / count, height + bump * piece * (k % 2)] for k in range(count + 1)]


def walls_of(points: list[list[float]], frictions: tuple[float, float]) -> list[dict[str, Any]]:
    """A wall for each piece, of two frictions in turn, drawn to the right and to the left."""
    pairs = [points[k : k + 2] for k in range(len(points) - 1)]
    return [{"points": pair[:: 1 if k % 3 else -1], "friction": frictions[k % 2]} for k, pair in enumerate(pairs)]


@pytest.mark.parametrize("kind", SOLVERS)
@pytest.mark.parametrize("name", DRAWN)
def test_scenes_that_users_draw(name: str, kind: str, scene_file: Any) -> None:
    """As shipped: grains end where geometry has them, within the tolerance of 0.02 d a contact, and go with the floor; no flags."""
    text, height, speed = DRAWN[name]
    slant = math.sqrt(1 - 0.85**2) if name == "slot" else 1.0  # of the normals on the rims of the slot
    sim = sand.Simulation(sand.load(scene_file(text), [f"solver.kind={kind}"]))
    x = sim.positions[:, 0]
    sim.advance(sim.scene.duration)
    off = sim.positions[:, 1] - height
    assert (off <= 0.005 * D).all() and (off >= -TOLERANCE * D / slant).all(), off / D
    assert sim.velocities[:, 0] == pytest.approx(np.full(len(x), speed), rel=0.05, abs=1e-3)
    if not speed:
        assert sim.positions[:, 0] == pytest.approx(x, abs=0.01 * D)
    assert sim.flags() == [] and sim.count == len(x)


@pytest.mark.parametrize("kind", SOLVERS)
def test_grains_rest_on_pieces_combs_and_slots(kind: str) -> None:
    """Discs in a row on floors with a point every 0.1, 0.4, 2 and 200 diameters, of one wall or of two hundred; over slots of 0.85 d; on
    the teeth of a comb, half a diameter apart; in a star: all come to rest where geometry has them, within the tolerance.
    """
    length, slot, tooth = 0.4, 0.85 * D, 0.5 * D
    walls: list[dict[str, Any]] = []
    places, heights = [], []
    for level, piece in enumerate((0.1, 0.4, 2.0, 200.0)):
        y = 0.05 + 0.03 * level
        points = in_pieces(piece * D, length, y)
        walls += walls_of(points, (0.3, 0.6)) if piece == 2.0 else [{"points": points}]
        places += [[0.02 * k, y + R] for k in range(1, 20)]
        heights += [y + R] * 19
    y = 0.05 + 0.03 * 4
    edges = [0.0, *np.ravel([[0.1 * k - slot / 2, 0.1 * k + slot / 2] for k in (1, 2, 3)]).tolist(), length]
    walls += [{"points": [[a, y], [b, y]]} for a, b in zip(edges[::2], edges[1::2], strict=True)]
    places += [[0.1 * k, y + R] for k in (1, 2, 3)]
    heights += [y + math.sqrt(R**2 - (slot / 2) ** 2)] * 3
    y += 0.03
    walls += [{"points": [[tooth * k, y], [tooth * k, y - 0.01]]} for k in range(1, 40)]
    places += [[tooth * (k + 0.5), y + R] for k in (5, 15, 25)]
    heights += [y + math.sqrt(R**2 - (tooth / 2) ** 2)] * 3
    y += 0.03
    star = [math.radians(a) for a in (30, 150, 270)]  # a groove of 120 degrees
    walls += [{"points": [[0.3, y], [0.3 + 0.02 * math.cos(a), y + 0.02 * math.sin(a)]]} for a in star]
    places.append([0.3, y + R / math.sin(math.radians(60)) + 0.02 * D])
    heights.append(y + R / math.sin(math.radians(60)))
    discs = [Disc(x, y + 0.02 * D) for x, y in places]
    sim = simulate(discs, (length, y + 0.05), settings(kind, restitution=0.1), gravity=(0, -G), mu=0.5, walls=walls)
    sim.advance(0.5)
    assert sim.flags() == []
    off = sim.positions - np.array([[x, h] for (x, _), h in zip(places, heights, strict=True)])
    assert (off[:, 1] <= 0.002 * D).all() and (off[:, 1] >= -1.5 * TOLERANCE * D).all(), off[:, 1] / D
    assert np.abs(off[:, 0]).max() < 0.01 * D
    assert np.hypot(*sim.velocities.T).max() < 1e-3


@pytest.mark.parametrize("kind", SOLVERS)
def test_joints_are_not_felt(kind: str) -> None:
    """Discs roll at 1, 5 and 20 m/s over 70 joints, within a polyline and of walls of other friction on either side, drawn either way:
    they hop less than 0.02 d, and lose less than 0.1 % of their speed a joint.
    """
    length, piece = 0.9, 1.25 * D
    walls: list[dict[str, Any]] = []
    discs, floors = [], []
    for level, speed in enumerate((1.0, 5.0, 20.0)):
        for lane, separate in enumerate((False, True)):
            y = 0.02 + 0.03 * (2 * level + lane)
            points = in_pieces(piece, length, y)
            walls += (
                walls_of(points, (0.3, 0.7)) if separate else [{"points": [[x, h + 1e-4 * D * (k % 2)] for k, (x, h) in enumerate(points)]}]
            )
            discs.append(Disc(0.03, y + R, speed, 0.0, spin=-speed / R))
            floors.append(y)
    sim = simulate(discs, (length, 0.25), settings(kind, restitution=0.5), gravity=(0, -G), mu=0.5, walls=walls)
    floors, speeds = np.array(floors), np.array([disc.vx for disc in discs])
    lost = np.full(len(discs), np.nan)
    hop = np.zeros(len(discs))
    crossed = np.zeros(len(discs))
    for every, until in ((2.5e-5, 0.042), (5e-4, 0.17), (2e-3, 0.82)):
        while sim.time < until:
            sim.advance_steps(max(1, int(every / sim.step)))
            x, v = sim.positions, sim.velocities
            rolling = (x[:, 0] < 0.87) & (crossed >= 0)
            hop[rolling] = np.maximum(hop[rolling], (x[:, 1] - floors - R)[rolling])
            lost[rolling] = (1 - v[:, 0] / speeds)[rolling]
            crossed[rolling] = (x[:, 0] - 0.03)[rolling] / piece
            crossed[~rolling & (crossed > 0)] *= -1  # it turns back at the edge, and that is another matter
    assert sim.flags() == []
    assert (np.abs(crossed) > 65).all(), crossed
    assert (hop < 0.02 * D).all(), hop / D
    assert (lost / np.abs(crossed) < 1e-3).all(), lost / np.abs(crossed)


@pytest.mark.parametrize("kind", SOLVERS)
def test_rebound_from_a_mesh_is_that_from_a_line(kind: str) -> None:
    """Discs that fly onto meshes of pieces of 0.1 to 5 d, at three slopes and three spins, half of them onto corners, leave as they leave a
    line: within 1 % in normal speed and 3 % in spin.
    """
    count, length = 32, 3 * D * 33
    random = np.random.default_rng(1)
    x = 3 * D * (np.arange(count) + 1)
    x[1::2] += random.uniform(-0.5, 0.5, count // 2) * D
    lanes = [("line", 0.0)] + [(how, p) for how in ("flat", "walls", "bumps") for p in (0.1, 0.25, 0.4, 1.0, 1.5, 5.0)]
    walls: list[dict[str, Any]] = []
    discs = []
    for lane, (how, piece) in enumerate(lanes):
        y = 0.02 + 0.05 * lane
        points = in_pieces(piece * D if piece else length, length, y, 1e-3 if how == "bumps" else 0.0)
        walls += walls_of(points, (0.3, 0.3001)) if how == "walls" else [{"points": points, "friction": 0.3}]
        sideways = 0.4 * (np.arange(count) % 3 - 1)
        heights = np.interp(x + sideways * 0.4 * R, *np.transpose(points))  # where they land: all touch at the same moment of a step
        discs += [
            Disc(a, h + 1.4 * R, v, -1.0, spin=20 * (k // 3 % 3 - 1)) for k, (a, h, v) in enumerate(zip(x, heights, sideways, strict=True))
        ]
    sim = simulate(discs, (length, 0.05 * len(lanes) + 0.05), settings(kind, restitution=0.5), mu=0.3, walls=walls)
    sim.advance(0.012)
    assert sim.flags() == []
    normal, spin = (a.reshape(len(lanes), count) for a in (sim.velocities[:, 1], sim.spins))
    assert (normal[0] > 0.3).all() and np.abs(spin[0]).max() > 20
    assert np.abs(normal / normal[0] - 1).max(axis=1) == pytest.approx(np.zeros(len(lanes)), abs=0.01)
    assert np.abs(spin - spin[0]).max(axis=1) / np.abs(spin[0]).max() == pytest.approx(np.zeros(len(lanes)), abs=0.03)


@pytest.mark.parametrize("kind", SOLVERS)
def test_a_floor_that_goes_round(kind: str) -> None:
    """A belt around a box that is periodic, drawn as long as the box or twice as long: grains on it, over the seam too, roll without slip
    from V / (3 μ g) on, at V / 3, and none leaves it or feels the seam.
    """
    speed, mu, length = 0.1, 0.5, 0.2
    belts = [{"points": [[0.0, 0.05], [0.2, 0.05]]}, {"points": [[-0.1, 0.1], [0.3, 0.1]]}]
    walls = [{**belt, "velocity": [speed, 0.0]} for belt in belts]
    discs = [Disc(x, y + R) for y in (0.05, 0.1) for x in (0.03, 0.10, 0.17, 0.199)]
    edges = {"left": "periodic", "right": "periodic"}
    sim = simulate(discs, (length, 0.2), settings(kind), gravity=(0, -G), mu=mu, walls=walls, edges=edges)
    for _ in range(8):
        sim.advance(0.25)
        y = sim.positions[:, 1] - np.repeat([0.05, 0.1], 4) - R
        assert (np.abs(y) < 1.5 * TOLERANCE * D).all()
    assert sim.flags() == []
    assert sim.velocities[:, 0] == pytest.approx(np.full(8, speed / 3), rel=0.05)
    way = speed / 3 * (sim.time - 0.5 * speed / (3 * mu * G))
    gone = (sim.positions[:, 0] - np.array([disc.x for disc in discs])) % length
    assert gone == pytest.approx(np.full(8, way % length), abs=0.05 * way)


@pytest.mark.parametrize("kind", SOLVERS)
def test_a_cell_of_plane_shear(kind: str) -> None:
    """Two rough walls that move past each other in a periodic box, drawn across its edges, one over it one and a half times: the grains
    between shear, the middle stays where it is, the outer layers go with the walls, and nobody gets out.
    """

    def rough(y: float, height: float, numbers: range) -> list[list[float]]:
        return [[0.005 * k, y + height * (k % 2)] for k in numbers]

    walls = [
        {"points": rough(0.014, 0.006, range(41)), "velocity": [-0.1, 0.0]},
        {"points": rough(0.1, -0.006, range(-10, 51)), "velocity": [0.1, 0.0]},
    ]
    grains = {"radius": [0.0045, 0.0055], "fill": "hexagonal", "pitch": 1.0, "count": 140, "region": [0, 0.0205, 0.2, 0.1]}
    edges = {"left": "periodic", "right": "periodic"}
    sim = simulate([grains], (0.2, 0.2), settings(kind), mu=0.5, walls=walls, edges=edges, seed=2)
    sim.advance(2.0)
    found = []
    for _ in range(10):
        sim.advance(0.1)
        y, v = sim.positions[:, 1], sim.velocities[:, 0]
        assert y.min() > 0.014 and y.max() < 0.1
        found.append([v[(y >= a) & (y < a + 0.02)].mean() for a in (0.02, 0.04, 0.06, 0.08)])
    profile = np.mean(found, axis=0)
    assert sim.count == len(sim.ids) and sim.flags() == []
    assert (np.diff(profile) > 0).all() and profile[0] < -0.03 and profile[-1] > 0.03, profile
    assert abs(profile.mean()) < 0.02
