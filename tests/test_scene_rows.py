"""Grains from files: each format that is read gives the grains that stand in it, or one sentence that says where it is wrong."""

from pathlib import Path

import gsd.hoomd
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import taichi_sand as sand
from taichi_sand.scene import loading
from taichi_sand.scene.packing import pack
from taichi_sand.scene.rows import read_rows

PLACES = [(0.1, 0.2), (0.35, 0.4), (0.6, 0.25)]
RADII = [0.01, 0.02, 0.015]
LAMMPS = """LAMMPS data file of a test

3 atoms
2 atom types

-1 1 xlo xhi
-1 1 ylo yhi
-0.5 0.5 zlo zhi

Atoms # sphere

3 1 0.03 900.0 0.6 0.25 0 0 0 0
1 1 0.02 1000.0 0.1 0.2 0
2 2 0.04 1100.0 0.35 0.4 0

Velocities

1 0.5 -0.5 0 0 0 3
2 0 0 0 0 0 0
3 1 2 0 0 0 -1
"""
TEXTS = {
    "comma": "x,y,radius\n0.1,0.2,0.01\n0.35,0.4,0.02\n0.6,0.25,0.015\n",
    "any order": "radius;Y;X\n0.01;0.2;0.1\n0.02;0.4;0.35\n0.015;0.25;0.6\n",
    "diameters and units": "D [m]\tPosition.Y [m]\tPosition.X [m]\n0.02\t0.2\t0.1\n0.04\t0.4\t0.35\n0.03\t0.25\t0.6\n",
    "decimal commas": "x;y;r\n0,1;0,2;0,01\n0,35;0,4;0,02\n0,6;0,25;0,015\n",
    "numpy": "# x y radius\n1.0e-1 2.0e-1 1.0e-2\n3.5e-1 4.0e-1 2.0e-2\n6.0e-1 2.5e-1 1.5e-2\n",
    "pandas": ",x,y,radius\n0,0.1,0.2,0.01\n1,0.35,0.4,0.02\n2,0.6,0.25,0.015\n",
    "ParaView": '"radius","Points:0","Points:1","Points:2"\n0.01,0.1,0.2,0\n0.02,0.35,0.4,0\n0.015,0.6,0.25,0\n',
    "bare": "0.1 0.2 0.01\n\n0.35 0.4 0.02  # the second\n0.6 0.25 0.015\n",
    "yade": "#format x_y_z_r\n0.1\t0.2\t0\t0.01\n0.35\t0.4\t0\t0.02\n0.6\t0.25\t0\t0.015\n",
    "yade bare": "0.1 0.2 0 0.01\n0.35 0.4 0 0.02\n0.6 0.25 0 0.015\n",
    "LAMMPS": LAMMPS,
    "DOS": "\ufeffx,y,radius\r\n0.1,0.2,0.01\r\n0.35,0.4,0.02\r\n0.6,0.25,0.015\r\n",
}


@pytest.mark.parametrize("name", TEXTS)
def test_what_is_told_apart(name: str, tmp_path: Path) -> None:
    path = tmp_path / "grains.txt"
    path.write_text(TEXTS[name], "utf-8", newline="")
    rows = np.array(read_rows(path).rows)
    assert rows[:, :2].tolist() == pytest.approx(np.array(PLACES)) and rows[:, 2] == pytest.approx(RADII)


def test_lammps_has_velocities_and_densities(tmp_path: Path) -> None:
    (tmp_path / "data.lmp").write_text(LAMMPS)
    grains = pack(sand.Scene(size=(1, 1), grains=[{"positions_file": tmp_path / "data.lmp"}]))
    assert grains.velocity.tolist() == [[0.5, -0.5], [0, 0], [1, 2]] and grains.spin.tolist() == [3, 0, -1]
    assert grains.mass == pytest.approx(np.array([1000, 1100, 900]) * np.pi * np.array(RADII) ** 2)


NAMES = {"x": ["x", "X", "pos_x", "Position.X (m)"], "y": ["y", "posY", "Points:1"], "radius": ["r", "Radius"], "vx": ["vx", "velocity_x"]}
NAMES |= {"vy": ["v_y", "Velocity.Y"], "angle": ["theta", "Angle [rad]"], "spin": ["omega", "wz"], "density": ["rho", "density"]}
NAMES |= {"": ["id", "type", ""]}


@given(st.data())
def test_any_table_of_any_columns(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """In any order, with any separator, comments and aliases: each number comes out where it belongs."""
    kinds = data.draw(st.permutations(["x", "y", "radius", *data.draw(st.sampled_from([[], ["vx", "vy"], ["vy", "vx", "spin"]]))]))
    kinds = data.draw(st.permutations([*kinds, *data.draw(st.sets(st.sampled_from(["density", "angle", ""])))]))
    cut = data.draw(st.sampled_from([",", ";", "\t", " , "]))
    number = st.floats(0.001, 1000, allow_nan=False)
    table = data.draw(st.lists(st.tuples(*[number] * len(kinds)), min_size=1, max_size=5))
    lines = [cut.join(data.draw(st.sampled_from(NAMES[kind])) for kind in kinds), *(cut.join(map(repr, row)) for row in table)]
    for place in data.draw(st.lists(st.integers(0, len(lines)), max_size=3)):
        lines.insert(place, data.draw(st.sampled_from(["# a comment, with; all\tof them", "", "  "])))
    path = tmp_path_factory.mktemp("any") / "grains.csv"
    path.write_text("\n".join(lines) + "\n")
    rows = np.array(read_rows(path).rows)
    order = ("x", "y", "radius", "vx", "vy", "angle", "spin", "density")
    for k in range(rows.shape[1]):
        expected = [row[kinds.index(order[k])] if order[k] in kinds else 0.0 for row in table]
        assert rows[:, k].tolist() == expected


def frames(path: Path, **more: object) -> None:
    """A trajectory as HOOMD writes it: two frames, no shift."""
    with gsd.hoomd.open(path, "w") as trajectory:
        for k in range(2):
            frame = gsd.hoomd.Frame()
            frame.configuration.box = [1, 1, 0, 0, 0, 0]
            frame.particles.N = 3
            frame.particles.position = [(x - 0.5 + 0.1 * k, y - 0.5, 0) for x, y in PLACES]
            frame.particles.diameter = [2 * radius for radius in RADII]
            frame.particles.velocity = [(k, 2 * k, 0)] * 3
            frame.particles.orientation = [(np.cos(0.2), 0, 0, np.sin(0.2))] * 3
            for name, values in more.items():
                setattr(frame.particles, name, values)
            trajectory.append(frame)


def test_a_frame_of_a_trajectory(tmp_path: Path) -> None:
    path = tmp_path / "run.gsd"
    frames(path)
    for number, moved in ((0, 0.0), (1, 0.1), (None, 0.1)):
        table = {"positions_file": path} | ({} if number is None else {"frame": number})
        grains = pack(sand.Scene(size=(1, 1), grains=[table]))
        assert grains.position == pytest.approx(np.array(PLACES) + np.array([moved, 0]), abs=1e-7) and grains.radius == pytest.approx(RADII)
        assert grains.velocity.tolist() == [[10 * moved, 20 * moved]] * 3 and grains.angle == pytest.approx(0.4, rel=1e-6)
        assert grains.mass == pytest.approx(2650 * np.pi * np.array(RADII) ** 2)


def test_the_radius_of_a_key_goes_with_velocities(tmp_path: Path) -> None:
    path = tmp_path / "grains.csv"
    path.write_text("x,y,vx,vy\n0.5,0.5,1,2\n")
    scene = sand.Scene(size=(1, 1), grains=[{"positions_file": path, "radius": 0.01}])
    assert pack(scene).radius.tolist() == [0.01] and pack(scene).velocity.tolist() == [[1, 2]]
    assert sand.Scene.from_json(scene.to_json()) == scene
    with pytest.raises(sand.SandError, match=r"has no column radius, so the key `radius` must be one number, not \[0.01, 0.02\]"):
        sand.Scene(size=(1, 1), grains=[{"positions_file": path, "radius": [0.01, 0.02]}])


def test_origin(tmp_path: Path) -> None:
    """All places of a scene may begin elsewhere; the simulation has the corner of the box at 0, 0."""
    (tmp_path / "grains.csv").write_text("x,y,radius\n-0.5,-0.25,0.01\n0.4,0.2,0.02\n")
    text = """
size = [1, 0.5]
origin = [-0.5, -0.25]
grains = [{ positions_file = "grains.csv" }, { radius = 0.01, count = 1, region = [0, 0, 0.1, 0.1] }]
walls = [{ points = [[-0.5, 0], [0.5, 0.25]], spin = 1.0, pivot = [0, 0] }]
sinks = [{ region = [-0.1, -0.25, 0.1, 0.1] }]
"""
    (tmp_path / "scene.toml").write_text(text)
    scene = loading.load(tmp_path / "scene.toml")
    assert pack(scene).position[:2] == pytest.approx(np.array([(0, 0), (0.9, 0.45)])) and pack(scene).radius[:2].tolist() == [0.01, 0.02]
    assert scene.walls[0].points == ((0, 0.25), (1, 0.5)) and scene.walls[0].pivot == (0.5, 0.25)
    assert scene.sinks[0].region == pytest.approx((0.4, 0, 0.6, 0.35)) and scene.grains[1].region == pytest.approx((0.5, 0.25, 0.6, 0.35))
    assert scene.origin == (0, 0) and sand.Scene.from_json(scene.to_json()).to_json() == scene.to_json()
    with pytest.raises(sand.SandError, match=r"grains\[0\]\.positions\[0\] = .*outside the box, x -0.5 … 0.5, y -0.25 … 0.25 m"):
        sand.Scene(size=(1, 0.5), origin=(-0.5, -0.25), grains=[{"positions": [(0.6, 0)], "radius": 0.01}])


BAD = {
    "x,y\n0.1,0.2\n0.3\n": r"line 3: has 1 columns instead of 2 \(x, y\)",
    "# made by hand\nx,y,radius\n0.1,0.2,0.01\n0.1,oops,0.01\n": 'line 4: y = "oops" must be a finite number',
    "x,y,raduis\n0.1,0.2,0.01\n": r'line 1: the columns are .*"raduis" is none of them; did you mean `radius`',
    "x,radius\n0.1,0.01\n": "line 1: the columns are .*: y is missing",
    "x,y,vx\n0.1,0.2,0.3\n": "line 1: .*vx or vy is missing",
    "x,y,r,d\n0.1,0.2,0.01,0.02\n": "line 1: .*the radius is there twice",
    "x,y,X\n0.1,0.2,0.1\n": "line 1: .*x is there twice",
    "x,y,d\n0.1,0.2,-0.01\n": "line 2: diameter = .*must be a number greater than 0",
    "x,y,rho,r\n0.1,0.2,0,0.1\n": "line 2: density = .*must be a number greater than 0",
    "0.1 0.2 0 0.01\n0.1 0.3 1 0.01\n": "z runs from 0 to 1: grains here lie in one layer",
    "1 2 3 4 5 6 7 8 9\n": "line 1: has 9 columns instead of 2, 3, 5, 6, 7 or 8",
    "x,y\n": "holds no grains",
    "\n\n# nothing\n": "holds no grains",
    LAMMPS.replace("3 atoms", "4 atoms"): "says that it has 4 atoms, but lists 3",
    LAMMPS.replace("# sphere", "# atomic"): "line 10: atom_style atomic has no diameters; only sphere can be read",
    LAMMPS.replace("0.35 0.4 0", "0.35 0.4"): "line 14: has 6 columns instead of 7 or 10 .*not of atom_style sphere",
    LAMMPS.replace("1100.0", "heavy"): 'line 14: density = "heavy" must be a number greater than 0',
    LAMMPS.replace("2 2 0.04", "1 2 0.04"): "line 14: id = 1 is there twice",
    LAMMPS.replace("3 1 2 0", "7 1 2 0"): "line 20: id = 7 is of no atom above",
}


@pytest.mark.parametrize("text", BAD, ids=BAD.values())
def test_one_sentence_says_where_it_is_wrong(text: str, tmp_path: Path) -> None:
    path = tmp_path / "grains.csv"
    path.write_text(text)
    with pytest.raises(sand.SandError, match=rf"positions_file: .*grains\.csv: {BAD[text]}"):
        sand.Scene(size=(1, 1), grains=[{"positions_file": path}])


def test_bad_trajectories(tmp_path: Path) -> None:
    path = tmp_path / "run.gsd"
    cases = {
        "holds clumps": {"body": [0, 0, -1]},
        "frame 1, particle 1: radius = 0 must be a number greater than 0": {"diameter": [0.01, 0, 0.01]},
        "frame 1, particle 2: x = nan must be a finite number": {"position": [(0, 0, 0), (0, 0, 0), (np.nan, 0, 0)]},
        "z runs from 0 to 1": {"position": [(0, 0, 0), (0, 0, 0), (0, 0, 1)]},
    }
    for sentence, more in cases.items():
        frames(path, **more)
        with pytest.raises(sand.SandError, match=sentence):
            sand.Scene(size=(1, 1), grains=[{"positions_file": path}])
    frames(path)
    with pytest.raises(sand.SandError, match=r"frame = 2 is not there; it has frames 0 … 1"):
        sand.Scene(size=(1, 1), grains=[{"positions_file": path, "frame": 2}])
    with pytest.raises(sand.SandError, match=r"frame"):
        sand.Scene(size=(1, 1), grains=[{"positions_file": path, "frame": -1}])
    (tmp_path / "grains.csv").write_text("0.1,0.2\n")
    with pytest.raises(sand.SandError, match="has no frames: `frame` belongs to a trajectory"):
        sand.Scene(size=(1, 1), grains=[{"positions_file": tmp_path / "grains.csv", "radius": 0.01, "frame": 1}])


def test_any_bytes_are_grains_or_a_sentence(tmp_path: Path) -> None:
    """Of each format with some of its bytes changed."""
    path, rng = tmp_path / "grains", np.random.default_rng(5)
    frames(tmp_path / "run.gsd")
    for whole in (*(text.encode() for text in TEXTS.values()), (tmp_path / "run.gsd").read_bytes()):
        for _ in range(100):
            damaged = np.frombuffer(whole, np.uint8).copy()
            damaged[rng.integers(0, len(whole), 2)] = rng.integers(0, 256, 2)
            path.write_bytes(damaged.tobytes()[: rng.integers(1, len(whole) + 1)])
            try:
                sand.Scene(size=(1, 1), grains=[{"positions_file": path, "radius": 0.01}])
            except sand.SandError as error:
                assert "\n" not in str(error)
