"""Wrong scenes and wrong commands: exit status 2, one sentence that names the key, no traceback, nothing written."""

import math
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taichi_sand.cli.main import app

GOOD = """
title = "Good"
size = [1.0, 1.0]
duration = 0.01
[solver]
kind = "rigid"
[[grains]]
radius = 0.02
count = 5
[[walls]]
points = [[0.0, 0.1], [1.0, 0.1]]
[effects.friction]
mu = 0.5
[view]
width = 64
"""
FILES = {"good.csv": "x,y,radius\n0.5,0.5,0.02\n", "letters.csv": "x,y,radius\n0.5,a,0.02\n", "short.csv": "x,y,radius\n0.5,0.5\n",
         "names.csv": "x,y,mass\n0.5,0.5,1\n", "empty.csv": "", "negative.csv": "0.5,0.5,-1\n", "outside.csv": "x,y,radius\n0.5,1.5,0.02\n",
         "nan.csv": "0.5,nan,0.02\n"}  # fmt: skip


def wall(points: str) -> str:
    return GOOD.replace("points = [[0.0, 0.1], [1.0, 0.1]]", f"points = {points}")


def grains(keys: str) -> str:
    return GOOD.replace("radius = 0.02\ncount = 5", keys)


def solver(keys: str) -> str:
    return GOOD.replace('kind = "rigid"', keys)


def effect(keys: str) -> str:
    return GOOD.replace("[effects.friction]\nmu = 0.5", keys)


SCENES = {  # name: (text of the scene file, what the sentence must hold)
    "unknown key": ("colour = 3\n" + GOOD, r"colour is not a known key"),
    "unknown key, nearest": ("durations = 3\n" + GOOD, r"durations .*did you mean `duration`"),
    "unknown table": (GOOD + "[wind]\nspeed = 3\n", r"wind is not a known key"),
    "unknown solver key": (solver("tolerence = 0.02"), r"solver\.tolerence .*did you mean `tolerance`"),
    "unknown grain key": (grains("radius = 0.02\ncuont = 5"), r"grains\[0\]\.cuont .*did you mean `count`"),
    "unknown wall key": (GOOD.replace("[[walls]]", "[[walls]]\nfricton = 0.1"), r"walls\[0\]\.fricton .*did you mean `friction`"),
    "unknown view key": (GOOD + "colour = 'speed'\n", r"view\.colour .*did you mean `color`"),
    "later key": (GOOD + "[[fountains]]\nrate = 3\n", r"fountains is not a known key"),
    "no size": (GOOD.replace("size = [1.0, 1.0]", ""), r"size is missing"),
    "size of one number": (GOOD.replace("size = [1.0, 1.0]", "size = 1.0"), r"size = 1 must be: \[width, height\]"),
    "size of three": (GOOD.replace("size = [1.0, 1.0]", "size = [1, 1, 1]"), r"size = \[1, 1, 1\]"),
    "negative size": (GOOD.replace("size = [1.0, 1.0]", "size = [1, -1]"), r"size = \[1, -1\] must be greater than 0"),
    "endless size": (GOOD.replace("size = [1.0, 1.0]", "size = [1, inf]"), r"size\[1\] = inf must be a finite number"),
    "huge number": (GOOD.replace("size = [1.0, 1.0]", f"size = [1, 1{'0' * 400}]"), r"size\[1\] = a huge number must lie within"),
    "gravity not a number": ('gravity = [0, "down"]\n' + GOOD, r'gravity\[1\] = "down" must be a number'),
    "gravity nan": ("gravity = [0, nan]\n" + GOOD, r"gravity\[1\] = nan must be a finite number"),
    "seed with a fraction": ("seed = 1.5\n" + GOOD, r"seed = 1.5 must be a whole number"),
    "negative seed": ("seed = -1\n" + GOOD, r"seed = -1 must be at least 0"),
    "negative duration": (GOOD.replace("duration = 0.01", "duration = -1"), r"duration = -1 must be at least 0 s"),
    "duration true": (GOOD.replace("duration = 0.01", "duration = true"), r"duration = true must be a number"),
    "duration a date": (GOOD.replace("duration = 0.01", "duration = 2026-11-22"), r"duration = 2026-11-22 must be a number"),
    "title a number": (GOOD.replace('"Good"', "3"), r"title = 3 must be a text in quotes"),
    "edge unknown": ('edges = { left = "wal" }\n' + GOOD, r'edges\.left = "wal" must be one of wall, open, periodic; did you mean `wall`'),
    "edge unpaired": ('edges = { left = "periodic" }\n' + GOOD, r"edges\.left = .*edges\.right = .*opposite pairs"),
    "solver kind": (solver('kind = "dem"'), r'solver\.kind = "dem" must be one of md, rigid'),
    "tolerance too small": (solver("tolerance = 1e-9"), r"solver\.tolerance = 1e-09 must be at least 0.0005 d"),
    "tolerance too large": (solver("tolerance = 0.9"), r"solver\.tolerance = 0.9 must be at most 0.3 d"),
    "restitution": (solver("restitution = 1.2"), r"solver\.restitution = 1.2 must be at most 1"),
    "precision": (solver("precision = 16"), r"solver\.precision = 16 must be one of 32, 64"),
    "step zero": (solver("step = 0"), r"solver\.step = 0 must be greater than 0 s"),
    "step and substeps": (solver("step = 0.001\nsubsteps = 4"), r"solver\.step and `substeps` exclude each other"),
    "hertz in md": (solver('kind = "md"\nhertz = 30'), r"solver\.hertz belongs to the rigid solver; this scene uses md"),
    "stiffness in rigid": (solver("stiffness = 1e5"), r"solver\.stiffness belongs to the md solver; this scene uses rigid"),
    "stiffness and k_r": (solver('kind = "md"\nstiffness = 1e5\nk_r = 1e5'), r"solver\.stiffness and `k_r` exclude"),
    "integrator": (solver('kind = "md"\nintegrator = "explicit_euler"'), r"solver\.integrator = .*symplectic_euler, velocity_verlet, rk4"),
    "alpha without law": (solver('kind = "md"\nalpha = 1'), r'solver\.alpha belongs to law = "custom"'),
    "law without exponents": (solver('kind = "md"\nlaw = "custom"'), r"solver\.law = .*needs `alpha` and `beta`"),
    "law without damping": (solver('kind = "md"\nlaw = "custom"\nalpha = 1\nbeta = 2'), r"solver\.law = .*needs `k_d`"),
    "negative radius": (grains("radius = -0.02\ncount = 5"), r"grains\[0\]\.radius = -0.02 must be greater than 0"),
    "zero radius": (grains("radius = 0\ncount = 5"), r"grains\[0\]\.radius = 0 must be greater than 0"),
    "radius nan": (grains("radius = nan\ncount = 5"), r"grains\[0\]\.radius.* = nan must be a finite number"),
    "radius reversed": (grains("radius = [0.03, 0.02]\ncount = 5"), r"grains\[0\]\.radius = \[0.03, 0.02\] must be \[low, high\]"),
    "radius text": (grains('radius = "big"\ncount = 5'), r'grains\[0\]\.radius = "big" must be a number, or \[low, high\]'),
    "no radius": (grains("count = 5"), r"grains\[0\]\.radius is missing"),
    "shape": (grains('shape = "cube"\nradius = 0.02\ncount = 5'), r'grains\[0\]\.shape = "cube" must be one of disc'),
    "density": (grains("density = 0\nradius = 0.02\ncount = 5"), r"grains\[0\]\.density = 0 must be at least"),
    "count zero": (grains("radius = 0.02\ncount = 0"), r"grains\[0\]\.count = 0 must be at least 1"),
    "count half": (grains("radius = 0.02\ncount = 2.5"), r"grains\[0\]\.count = 2.5 must be a whole number"),
    "count absurd": (grains("radius = 0.02\ncount = 1000000000"), r"grains\[0\]\.count = 1000000000 must be at most"),
    "neither count nor fill": (grains("radius = 0.02"), r"grains\[0\] needs `count`, `fill`, `positions`"),
    "fill": (grains('radius = 0.02\nfill = "hex"'), r'grains\[0\]\.fill = "hex" must be one of lattice, hexagonal, random'),
    "pitch without pattern": (grains("radius = 0.02\ncount = 5\npitch = 1.2"), r"grains\[0\]\.pitch belongs to fill"),
    "region outside": (grains("radius = 0.02\ncount = 5\nregion = [0, 0, 1, 1.2]"), r"grains\[0\]\.region = .*inside the box"),
    "region reversed": (grains("radius = 0.02\ncount = 5\nregion = [0, 0.5, 1, 0.2]"), r"grains\[0\]\.region = .*x0 < x1"),
    "region of three": (grains("radius = 0.02\ncount = 5\nregion = [0, 0, 1]"), r"grains\[0\]\.region = \[0, 0, 1\]"),
    "more than fit": (grains("radius = 0.02\ncount = 4000"), r"grains\[0\]: count 4000 does not fit the region: room for about \d+"),
    "none fits": (grains('radius = 0.7\nfill = "lattice"'), r"grains\[0\]: not one grain of this size fits"),
    "position outside": (grains("radius = 0.02\npositions = [[0.5, 1.5]]"), r"grains\[0\]\.positions\[0\] = .*outside the box"),
    "position of one": (grains("radius = 0.02\npositions = [[0.5]]"), r"grains\[0\]\.positions\[0\] has 1 numbers"),
    "positions and count": (grains("radius = 0.02\npositions = [[0.5, 0.5]]\ncount = 3"), r"positions and `count` exclude each other"),
    "no positions": (grains("radius = 0.02\npositions = []"), r"grains\[0\]\.positions = \[\] holds no grains"),
    "velocity": (grains("radius = 0.02\ncount = 5\nvelocity = 3"), r"grains\[0\]\.velocity = 3 must be"),
    "angle": (grains('radius = 0.02\ncount = 5\nangle = "any"'), r'grains\[0\]\.angle = "any" must be a number in radians, or "random"'),
    "fixed": (grains('radius = 0.02\ncount = 5\nfixed = "yes"'), r'grains\[0\]\.fixed = "yes" must be true or false'),
    "grains not a list": (GOOD.replace("[[grains]]", "[grains]"), r"grains = .*\[\[grains\]\]"),
    "csv missing": (grains('positions_file = "no.csv"'), r"positions_file: .*no\.csv: there is no such file"),
    "csv letters": (grains('positions_file = "letters.csv"'), r'letters\.csv: line 2: y = "a" must be a finite number'),
    "csv short": (grains('positions_file = "short.csv"'), r"short\.csv: line 2: has 2 columns instead of 3"),
    "csv names": (grains('positions_file = "names.csv"'), r"names\.csv: line 1: the columns are .*must be x, y"),
    "csv empty": (grains('positions_file = "empty.csv"'), r"empty\.csv: holds no grains"),
    "csv negative": (grains('positions_file = "negative.csv"'), r"negative\.csv: line 1: radius = .*greater than 0"),
    "csv outside": (grains('positions_file = "outside.csv"'), r"grains\[0\]\.positions\[0\] = .*outside the box"),
    "csv nan": (grains('positions_file = "nan.csv"'), r"nan\.csv: line 1: y = .*finite"),
    "csv and radius": (grains('positions_file = "good.csv"\nradius = 0.1'), r"grains\[0\]\.radius is given twice"),
    "wall of one point": (wall("[[0.0, 0.1]]"), r"walls\[0\]\.points = .*at least two"),
    "wall without length": (wall("[[0.0, 0.1], [0.0, 0.1]]"), r"walls\[0\]\.points\[1\] = .*same as the point before"),
    "wall outside": (wall("[[2.0, 0.1], [3.0, 0.1]]"), r"walls\[0\]\.points = .*wholly outside the box"),
    "shape name": (GOOD + '[[shapes]]\nname = "disc"\ndiscs = [[0, 0, 1]]\n', r'shapes\[0\]\.name = "disc" is a shape that there is'),
    "shape apart": (GOOD + '[[shapes]]\nname = "two"\ndiscs = [[0, 0, 1], [3, 0, 1]]\n', r"shapes\[0\]\.discs must hang together"),
    "heat and rk4": (
        effect("[effects.heat]").replace('kind = "rigid"', 'kind = "md"\nintegrator = "rk4"'),
        r"effects\.heat: does not fit the integrator rk4, only .symplectic_euler.",
    ),
    "view without effect": (GOOD + 'color = "temperature"\n', r'view\.color = "temperature" needs a table \[effects\.heat\]'),
    "wall friction": (GOOD.replace("[[walls]]", "[[walls]]\nfriction = -0.1"), r"walls\[0\]\.friction = -0.1 must be at least 0"),
    "wall friction alone": (
        effect("").replace("[[walls]]", "[[walls]]\nfriction = 0.1"),
        r"walls\[0\]\.friction = 0.1 needs a table \[effects\.friction\]",
    ),
    "effect unknown": (effect("[effects.frction]\nmu = 0.5"), r"effects\.frction.*did you mean `friction`"),
    "effect key": (effect("[effects.friction]\nmy = 0.5"), r"effects\.friction\.my .*did you mean `mu`"),
    "effect value": (effect('[effects.friction]\nmu = "rough"'), r'effects\.friction\.mu = "rough".* must be a number'),
    "effect nan": (effect("[effects.friction]\nmu = nan"), r"effects\.friction\.mu = nan.* must be a finite number"),
    "effect not a table": (effect("[effects]\nfriction = 0.5"), r"effects\.friction = 0.5 must be a table"),
    "view color": (GOOD + 'color = "red"\n', r'view\.color = "red" must be one of kind, speed'),
    "view colour code": (GOOD + 'cold = "blue"\n', r'view\.cold = "blue" must be a colour like'),
    "view width": (GOOD.replace("width = 64", "width = 3"), r"view\.width = 3 must be at least 16"),
    "scale zero": ("scale = 0\n" + GOOD, r"scale = 0 must be greater than 0"),
    "scale of positions": ("scale = 2\n" + grains("radius = 0.02\npositions = [[0.5, 0.5]]"), r"scale = 2 cannot be had"),
    "toml": ("size = [1, 1\n", r"not a scene file, its TOML is wrong: Unclosed array"),
    "toml twice": ("seed = 1\nseed = 2\n" + GOOD, r"its TOML is wrong"),
    "toml nested": ("a = " + "[" * 5000, r"its TOML is wrong: too deeply nested|its TOML is wrong"),
    "not utf-8": ("title = 'caf\xe9'\n", r"not a UTF-8 text file"),
    "binary": ("\x00\xff\xfe", r"not a UTF-8 text file"),
    "python word": ("self = 1\n" + GOOD, r"self is not a known key"),
}  # fmt: skip

COMMANDS = {  # name: (arguments after `taichi-sand`, GOOD stands for the good scene file; what the sentence must hold)
    "no scene": (["run"], r"run needs a SCENE"),
    "no such file": (["run", "nowhere/scene.toml"], r"nowhere/scene\.toml: there is no such file"),
    "no such name": (["run", "hourglas"], r"no scene `hourglas`; did you mean `hourglass`"),
    "a folder": (["run", "."], r"is a folder, not a scene file"),
    "empty name": (["run", ""], r"scene"),
    "set without value": (["run", "GOOD", "--set", "duration"], r"must read KEY=VALUE"),
    "set without key": (["run", "GOOD", "--set", "=3"], r"must read KEY=VALUE"),
    "set odd key": (["run", "GOOD", "--set", "a..b=3"], r"must read KEY=VALUE"),
    "set unknown": (["run", "GOOD", "--set", "solver.tol=3"], r"--set: solver\.tol is not a known key; did you mean `tolerance`"),
    "set out of range": (["run", "GOOD", "--set", "grains.0.radius=-1"], r"--set: grains\[0\]\.radius = -1 must be greater"),
    "set beyond the list": (["run", "GOOD", "--set", "grains.3.count=1"], r"--set grains\[3\]\.count: grains has 1 entries"),
    "set into a number": (["run", "GOOD", "--set", "duration.x=1"], r"--set duration\.x: duration is a value"),
    "set a list by name": (["run", "GOOD", "--set", "grains.count=1"], r"--set grains\.count: grains is a list"),
    "set a table by number": (["run", "GOOD", "--set", "solver.0=1"], r"--set solver\[0\]: solver is a table"),
    "set misfit": (["run", "GOOD", "--set", "solver.kind=md", "--set", "solver.hertz=3"], r"solver\.hertz belongs to the rigid"),
    "precision": (["run", "GOOD", "--precision", "16"], r"solver\.precision = 16 must be one of 32, 64"),
    "negative seconds": (["run", "GOOD", "--seconds", "-1"], r"--seconds -1 must be"),
    "endless seconds": (["run", "GOOD", "--seconds", "inf"], r"--seconds inf must be"),
    "seconds nan": (["run", "GOOD", "--seconds", "nan"], r"--seconds nan must be"),
    "save under a file": (["run", "GOOD", "--save", "GOOD/x.npz"], r"is a file, not a folder"),
    "resume what is not there": (["run", "--resume", "no.npz"], r"no\.npz"),
    "resume something else": (["run", "--resume", "GOOD"], r"scene\.toml"),
    "resume with --set": (["run", "--resume", "GOOD", "--set", "seed=3"], r"brings its own scene"),
    "film suffix": (["render", "GOOD", "-o", "film.avi"], r"film\.avi.*\.mp4"),
    "film without suffix": (["render", "GOOD", "-o", "film"], r"film.*\.mp4"),
    "film under a file": (["render", "GOOD", "-o", "GOOD/film.mp4"], r"is a file, not a folder"),
    "film width": (["render", "GOOD", "-o", "film.png", "--width", "3"], r"view\.width = 3 must be at least 16"),
    "film color": (["render", "GOOD", "-o", "film.png", "--color", "red"], r"view\.color = \"red\" must be one of"),
    "film fps": (["render", "GOOD", "-o", "film.mp4", "--fps", "0"], r"view\.fps = 0 must be at least 1"),
    "film of nothing": (["render", "nowhere", "-o", "film.mp4"], r"no scene `nowhere`"),
}
USAGE = {  # refused by the parser: name: (arguments, what the message must hold)
    "unknown option": (["run", "GOOD", "--tolerance", "3"], r"--tolerance"),
    "unknown command": (["simulate", "GOOD"], r"simulate"),
    "arch": (["run", "GOOD", "--arch", "tpu"], r"tpu"),
    "threads": (["run", "GOOD", "--threads", "0"], r"threads"),
    "seconds a word": (["run", "GOOD", "--seconds", "long"], r"--seconds"),
    "no output": (["render", "GOOD"], r"out|-o"),
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder: a good scene and some CSV files."""
    (tmp_path / "scene.toml").write_text(GOOD)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(folder: Path, arguments: list[str]) -> str:
    """Runs a command that must fail with 2, without a traceback and without writing anything; returns what it says."""
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    result = CliRunner().invoke(app, [argument.replace("GOOD", "scene.toml") for argument in arguments])
    assert result.exit_code == 2, (result.output, result.exception)
    assert isinstance(result.exception, SystemExit)
    assert "Traceback" not in result.output
    assert result.stdout == ""
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    return result.stderr


def sentence(text: str) -> str:
    """Checks that a message is one readable line and returns it."""
    assert re.fullmatch(r"taichi-sand: error: [^\n]{10,600}\n", text), text
    assert "Error(" not in text and "pydantic" not in text
    return text


def test_the_table_is_long_enough() -> None:
    assert len(SCENES) + len(COMMANDS) >= 50


@pytest.mark.parametrize("name", SCENES)
def test_wrong_scene(folder: Path, name: str) -> None:
    text, words = SCENES[name]
    (folder / "scene.toml").write_bytes(text.encode("latin-1" if name in ("not utf-8", "binary") else "utf-8"))
    said = sentence(refused(folder, ["run", "scene.toml", "--json"]))
    assert re.search(words, said), said
    assert "scene.toml" in said, "names the file"


@pytest.mark.parametrize("name", COMMANDS)
def test_wrong_command(folder: Path, name: str) -> None:
    arguments, words = COMMANDS[name]
    said = sentence(refused(folder, arguments))
    assert re.search(words, said), said


@pytest.mark.parametrize("name", USAGE)
def test_wrong_usage(folder: Path, name: str) -> None:
    arguments, words = USAGE[name]
    assert re.search(words, refused(folder, arguments))


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 1e300])
def test_wrong_numbers_in_python(value: float) -> None:
    import taichi_sand as sand

    with pytest.raises(sand.SandError, match=r"solver\.tolerance"):
        sand.Scene(size=[1, 1], solver={"tolerance": value})
