"""Scenes as files and as objects: keys, defaults, overrides, scale, JSON."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from taichi_sand import Scene
from taichi_sand.errors import SandError
from taichi_sand.scene import loading
from taichi_sand.scene.parameters import Parameter, check_table
from taichi_sand.scene.schema import Edges, Grains, Solver, View, Wall

ROOT = Path(__file__).parents[1]
CONTRACT = """
title = "Hourglass"
about = "Discs drain through a narrow neck."
size = [0.40, 0.80]
gravity = [0.0, -9.81]
seed = 7
duration = 8.0
edges = { left = "wall", right = "wall", bottom = "wall", top = "open" }
[solver]
kind = "rigid"
tolerance = 0.02
restitution = 0.1
[[grains]]
shape = "disc"
radius = [0.002, 0.003]
density = 2650.0
count = 4000
region = [0.02, 0.45, 0.38, 0.78]
[[walls]]
points = [[0.0, 0.45], [0.19, 0.40], [0.19, 0.38], [0.0, 0.33]]
[effects.friction]
mu = 0.5
[view]
width = 720
color = "kind"
force_chains = false
"""
"""Section 5 of the design, but for keys that come later."""
SMALL = 'size = [1, 1]\n[solver]\nkind = "rigid"\nhertz = 40\n[[grains]]\nradius = 0.01\ncount = 5\n'


def test_the_contract_loads(scene_file: Callable[[str], Path]) -> None:
    scene = loading.load(scene_file(CONTRACT))
    assert scene.size == (0.4, 0.8)
    assert scene.edges.top == "open"
    assert scene.solver.precision == 32
    assert scene.grains[0].radius == (0.002, 0.003)
    assert scene.effects == {"friction": {"mu": 0.5}}
    assert scene.source == "scene.toml"


@pytest.mark.parametrize("name", loading.bundled())
def test_bundled_scenes_load_and_say_what_they_are(name: str) -> None:
    scene = loading.load(name)
    assert scene.title and scene.about
    assert "\n" not in scene.about


def test_all_scenes_of_the_first_issue_are_there() -> None:
    wanted = {"hourglass", "circles", "billiards", "pile", "newton_cradle", "stack", "settle", "force_chains", "crystals"}
    assert wanted <= set(loading.bundled())


@pytest.mark.parametrize("table", [Scene, Edges, Solver, Grains, Wall, View])
def test_every_key_explains_itself_here_and_in_the_reference(table: type) -> None:
    reference = (ROOT / "docs" / "reference" / "scene.md").read_text("utf-8")
    for name, field in table.model_fields.items():
        assert field.description and "\n" not in field.description, name
        assert "unit" in field.json_schema_extra, name
        assert re.search(rf"`{name}\b", reference), f"{table.__name__}.{name} is not in the reference"


def test_an_integer_is_a_number_and_a_switch_is_not() -> None:
    assert Scene(size=[1, 2], duration=3).duration == 3.0
    with pytest.raises(SandError, match=r"duration = true must be a number"):
        Scene(size=[1, 2], duration=True)


def test_scenes_survive_json() -> None:
    grains = [
        {"positions": [[0.1, 0.2, 0.01, 1, 2, 0.1, 7], [1 / 3, 0.2, 0.02, 0, 0, 0, 0]]},
        {"radius": [0.1, 0.2], "count": 3, "angle": "random", "speed": 2},
    ]
    scene = Scene(size=[1, 1], grains=grains, walls=[{"points": [[0, 0], [1, 0.5]]}], effects={"friction": {"mu": 0.3}}, scale=1)
    again = Scene.from_json(scene.to_json())
    assert again.model_dump() == scene.model_dump()
    assert again.to_json() == scene.to_json()


def test_scenes_from_foreign_json_are_refused() -> None:
    for text in ("", "{", "[]", "3", '{"size": 3}', '{"sise": [1, 1]}'):
        with pytest.raises(SandError):
            Scene.from_json(text)


def test_scenes_do_not_change() -> None:
    scene = Scene(size=[1, 1])
    with pytest.raises(Exception, match="frozen"):
        scene.solver.tolerance = 0.1


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("duration=3", "duration", 3.0),
        ("duration=.5", "duration", 0.5),
        ("duration=1e-3", "duration", 1e-3),
        ("title=A b c", "title", "A b c"),
        ('title="A = b"', "title", "A = b"),
        ("title=x\ny=1", "title", "x\ny=1"),
        ("solver.tolerance=0.1", "solver.tolerance", 0.1),
        ("grains.0.count=7", "grains.0.count", 7),
        ("grains[0].count=8", "grains.0.count", 8),
        ("gravity=[0, -1]", "gravity", (0.0, -1.0)),
        ("gravity[1]=-2", "gravity", (0.0, -2.0)),
        ("effects.friction.mu=0.3", "effects.friction.mu", 0.3),
        ("view.color=speed", "view.color", "speed"),
        ("view.caption=false", "view.caption", False),
        ("edges.top=open", "edges.top", "open"),
        (" size = [2, 2] ", "size", (2.0, 2.0)),
    ],
)
def test_overrides(scene_file: Callable[[str], Path], override: str, path: str, value: object) -> None:
    found = loading.load(scene_file("gravity = [0, -9]\n" + SMALL), [override])
    for part in path.split("."):
        found = found[int(part)] if part.isdigit() else found[part] if isinstance(found, dict) else getattr(found, part)
    assert found == value


def test_the_last_override_wins(scene_file: Callable[[str], Path]) -> None:
    assert loading.load(scene_file(SMALL), ["seed=1", "seed=2"]).seed == 2


def test_changing_the_solver_drops_what_belongs_to_the_other(scene_file: Callable[[str], Path]) -> None:
    path = scene_file(SMALL)
    assert loading.load(path).solver.hertz == 40
    assert loading.load(path, ["solver.kind=md", "solver.stiffness=1e5"]).solver.stiffness == 1e5
    with pytest.raises(SandError, match=r"--set: solver.hertz belongs to the rigid solver; this scene uses md"):
        loading.load(path, ["solver.kind=md", "solver.hertz=30"])


def test_scale_grows_a_scene() -> None:
    grains = [{"radius": 0.01, "count": 10, "region": [0, 0, 0.5, 1]}, {"radius": 0.02, "fill": "lattice"}]
    small = {"size": [1, 2], "grains": grains, "walls": [{"points": [[0, 0], [1, 1]]}]}
    scene = Scene(**small, scale=4)
    assert scene.size == (2.0, 4.0)
    assert [table.count for table in scene.grains] == [40, None]
    assert scene.grains[0].region == (0.0, 0.0, 1.0, 2.0)
    assert scene.grains[0].radius == (0.01, 0.01)
    assert scene.walls[0].points == ((0.0, 0.0), (2.0, 2.0))
    assert scene.scale == 1, "applied once"
    assert Scene.from_json(scene.to_json()).size == scene.size
    with pytest.raises(SandError, match="scale"):
        Scene(size=[1, 1], scale=4, grains=[{"radius": 0.1, "positions": [[0.5, 0.5]]}])


def test_a_file_of_positions_lies_beside_the_scene(scene_file: Callable[[str], Path], tmp_path: Path) -> None:
    (tmp_path / "grains.csv").write_text("x, y, radius, vx, vy\n0.1,0.2,0.01,1,-1\n\n0.3,0.4,0.02,0,0\n")
    scene = loading.load(scene_file('size = [1, 1]\n[[grains]]\npositions_file = "grains.csv"\n'))
    assert scene.grains[0].positions == ((0.1, 0.2, 0.01, 1, -1), (0.3, 0.4, 0.02, 0, 0))
    (tmp_path / "grains.csv").unlink()
    assert Scene.from_json(scene.to_json()).grains == scene.grains


def test_errors_name_file_key_and_what_is_allowed(scene_file: Callable[[str], Path]) -> None:
    with pytest.raises(SandError) as caught:
        loading.load(scene_file(SMALL + 'fil = "lattice"\n'))
    assert caught.value.key == "grains[0].fil"
    assert str(caught.value).startswith("scene.toml: grains[0].fil is not a known key; did you mean `fill`? ([[grains]] has shape,")


def test_parameters_of_effects() -> None:
    parameters = (
        Parameter("mu", 0.5, "friction coefficient", low=0, high=10),
        Parameter("turns", 3, "how often", low=1),
        Parameter("on", True, "switch"),
        Parameter("model", "spring", "which", choices=("spring", "viscous")),
        Parameter("stiffness", None, "found if not given", unit="N/m", low=0),
    )
    assert check_table("x.toml: effects.e", {"mu": 1}, parameters) == {
        "mu": 1, "turns": 3, "on": True, "model": "spring", "stiffness": None,
    }  # fmt: skip
    for table, words in [
        ({"my": 1}, "effects.e.my is not a known key; did you mean `mu`? (allowed: mu, turns, on, model, stiffness)"),
        ({"mu": -1}, "effects.e.mu = -1: must lie in 0 … 10"),
        ({"mu": "a"}, 'effects.e.mu = "a": must be a number'),
        ({"mu": True}, "effects.e.mu = true: must be a number"),
        ({"mu": float("nan")}, "must be a finite number"),
        ({"mu": 10**400}, "must be a finite number"),
        ({"turns": 1.5}, "must be a whole number"),
        ({"turns": 0}, "must be at least 1"),
        ({"on": 1}, "must be true or false"),
        ({"model": "sprin"}, "must be one of spring, viscous; did you mean `spring`?"),
        ({"stiffness": -1.0}, "must be at least 0 N/m"),
    ]:
        with pytest.raises(SandError) as caught:
            check_table("x.toml: effects.e", table, parameters)
        assert words in str(caught.value)
        assert str(caught.value).startswith("x.toml: effects.e.")


def test_help_and_list_do_without_taichi() -> None:
    script = "import sys; from taichi_sand.cli.main import app; app(['scenes'], standalone_mode=False); assert 'taichi' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert "hourglass" in done.stdout


def test_the_public_face() -> None:
    import taichi_sand as sand

    assert {"load", "Scene", "Simulation", "SandError", "PhysicsError"} <= set(sand.__all__)
    assert re.fullmatch(r"\d+\.\d+\.\d+", sand.__version__)
    assert json.loads(sand.Scene(size=[1, 1]).to_json())["size"] == [1.0, 1.0]
    with pytest.raises(AttributeError):
        _ = sand.Sandcastle
