"""Files of strangers: every index is looked at before kernels use it, and nothing that a file announces is believed."""

import base64
import functools
import io
import json
import os
import resource
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand.cli.main import app
from taichi_sand.files import memory
from taichi_sand.files.reading import MOST_BYTES
from taichi_sand.play import actions, recording
from taichi_sand.play import files as played
from taichi_sand.play.session import Session
from taichi_sand.play.verbs import VERBS
from taichi_sand.run import rooms, trust
from taichi_sand.scene.packing import most_grains, pack
from taichi_sand.world import checkpoint
from taichi_sand.world.walls.build import tables_of

BOX = {"size": [0.5, 0.5]}
SCENES: dict[str, dict[str, Any]] = {
    "discs": {"grains": [{"radius": 0.02, "count": 40}], "water": [{"region": [0.0, 0.0, 0.5, 0.2]}], "effects": {"water": {}}},
    "sleepers": {
        "grains": [{"radius": [0.01, 0.02], "count": 30}],
        "edges": {"left": "periodic", "right": "periodic"},
        "walls": [
            {"points": [[0.1, 0.1], [0.2, 0.1]], "spin": 1.0},
            {"points": [[0.3, 0.1], [0.4, 0.1]], "friction": 0.3},
            {"points": [[0.3, 0.2], [0.4, 0.2]], "material": "steel"},
        ],
        "materials": [{"name": "steel", "friction": 0.2}],
        "sources": [{"radius": 0.01, "rate": 30.0, "region": [0.1, 0.3, 0.4, 0.4]}],
        "sinks": [{"region": [0.0, 0.0, 0.1, 0.1]}],
        "effects": {"friction": {}, "sleeping": {}},
    },
    "bonds": {
        "grains": [{"shape": "2x1", "radius": 0.005, "count": 20, "bonded": True}, {"shape": "2x1", "radius": 0.03, "count": 1}],
        "walls": [{"points": [[0.2, 0.0], [0.3, 0.0]], "velocity": [0.0, 0.1], "force": 0.1}],
        "effects": {"bonds": {}},
        "solver": {"kind": "md"},
    },
}
"""Structures that together have every table."""


@functools.cache
def saved_of(name: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """A checkpoint in mid-life, as a header and arrays; one with a hand, as the window saves them."""
    with tempfile.TemporaryDirectory() as folder:
        sim = sand.Simulation(sand.Scene(**BOX, **SCENES[name]), threads=1, hand=name == "discs")
        sim.advance(0.2)
        sim.save(Path(folder) / "state.npz")
        with np.load(Path(folder) / "state.npz") as file:
            arrays = {part: file[part] for part in file.files}
    return json.loads(arrays.pop("header").tobytes()), arrays


@pytest.fixture(scope="module", params=SCENES)
def saved(request: pytest.FixtureRequest) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Each in turn."""
    return saved_of(request.param)


def write(path: Path, header: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """A checkpoint with its hash made right."""
    header = {**header, "sha256": checkpoint.digest(arrays)}
    with path.open("wb") as file:
        np.savez(file, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)


def resumed(path: Path) -> None:
    """Goes on from a checkpoint for a few steps."""
    sim = sand.Simulation.resume(path, threads=1)
    sim.advance_steps(30)
    json.dumps(sim.report())


def refused(path: Path) -> str:
    """The sentence with which a checkpoint is refused."""
    with pytest.raises(sand.SandError) as caught:
        resumed(path)
    assert path.name in str(caught.value) and "\n" not in str(caught.value)
    return str(caught.value)


def test_every_table_of_whole_numbers_is_declared(saved: tuple[dict, dict[str, np.ndarray]], tmp_path: Path) -> None:
    """If this fails, a new table must be entered in trust.INDICES; and what is saved is believed."""
    header, arrays = saved
    missing = {trust.short(name) for name, values in arrays.items() if values.dtype.kind == "i"} - set(trust.INDICES)
    assert not missing
    assert {values.dtype.kind for values in arrays.values()} <= {"i", "f"}
    write(tmp_path / "state.npz", header, arrays)
    resumed(tmp_path / "state.npz")


def test_all_that_is_declared_is_there() -> None:
    """No rule for a table that no structure has."""
    tables = [(trust.short(name), values) for keys in SCENES for name, values in saved_of(keys)[1].items()]
    assert {name for name, values in tables if values.dtype.kind == "i"} == set(trust.INDICES)


@pytest.fixture(scope="module")
def looked_at(saved: tuple[dict, dict[str, np.ndarray]]) -> Iterator[Callable[[str, Any], str]]:
    """Why the checkpoint is refused if one number of one table is another, or "": without the second that it takes to make a simulation."""
    sim = resumed_from(saved)
    tables, random = checkpoint.tables_of(sim._fields()), np.random.default_rng(3)
    world, scene, kinds = sim.world, sim.scene, len(sim.sizes)
    del sim  # the next one has its tables, and need not be compiled

    def look(name: str, value: Any, place: int | None = None) -> str:
        changed = tables[name].copy()
        changed.flat[random.integers(changed.size) if place is None else place] = value
        try:
            trust.check(world, scene, kinds, tables, {**tables, name: changed})
        except sand.SandError as error:
            return str(error)
        return ""

    yield look


def test_every_index_that_is_out_of_range_is_refused(
    saved: tuple[dict, dict[str, np.ndarray]], looked_at: Callable[[str, Any], str]
) -> None:
    """In any row of any table, one too many or far beyond; only scratch may hold anything, and a count be large."""
    for name, values in saved[1].items():
        rule = trust.INDICES.get(trust.short(name))
        if values.dtype.kind != "i" or rule == trust.ANY or not values.size:
            continue
        counts = isinstance(rule, tuple) and rule[1] == trust.LARGEST and "pairs" not in name
        for value in (-(2**31), -2, 2**30 + 7, 2**31 - 1):
            allowed = isinstance(rule, tuple) and isinstance(rule[0], int) and rule[0] <= value < 0
            if (counts and value > 0) or allowed:
                continue
            said = looked_at(name, value)
            assert trust.short(name).partition("_")[0].partition(":")[0] in said and "\n" not in said, (name, value, said)


def test_walls_are_those_of_the_scene(saved: tuple[dict, dict[str, np.ndarray]], looked_at: Callable[[str, Any], str]) -> None:
    """A part of a still wall that is said to move crashed: its entries have no arm."""
    random = np.random.default_rng(4)
    found = {trust.short(name): (name, values) for name, values in saved[1].items()}
    sim = resumed_from(saved)
    tables = tables_of(sim.world, sim.scene)
    assert {"walls.start", "walls.part", "walls.point"} < set(tables)
    assert ("movers.wall" in tables) == sim.world.moves
    for short, expected in tables.items():
        name, values = found[short]
        place = int(random.integers(expected.size))
        for value in (-1, 0, 1, 63) if values.dtype.kind == "i" else (-1e9, 0.0, 1e9):
            if values.flat[place] != value:
                assert short in looked_at(name, value, place), (short, value)


def test_lists_of_moving_walls_are_whole(saved: tuple[dict, dict[str, np.ndarray]], looked_at: Callable[[str, Any], str]) -> None:
    """One entry said to be all crashed: the sites of the others kept their lists, which then ran into those of the next list build."""
    if ".0.movers.count" not in saved[1] or not (count := int(saved[1][".0.movers.count"])):
        return
    assert count > 1
    wrong = [("count", value, 0) for value in (1, count - 1, 0)]
    for entry in range(0, count, 7):
        wrong += [(name, value, entry) for name in ("head", "next") for value in (-1, entry, count - 1)]
        wrong += [("site", value, entry) for value in (entry, count - 1)]
    for name, value, entry in wrong:
        at = int(saved[1][".0.movers.site"][entry]) if name == "head" else entry
        if saved[1][f".0.movers.{name}"].flat[at] != value:
            assert "movers.head and movers.next" in looked_at(f".0.movers.{name}", value, at), (name, value, entry)


def resumed_from(saved: tuple[dict, dict[str, np.ndarray]]) -> sand.Simulation:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / "state.npz", *saved)
        return sand.Simulation.resume(Path(folder) / "state.npz", threads=1)


def test_the_tampered_file_that_crashed(saved: tuple[dict, dict[str, np.ndarray]], tmp_path: Path) -> None:
    """All the way, with its hash made right."""
    header, arrays = saved
    for row in (0, -1):
        second = arrays[".0.pairs.second"].copy()
        second[row] = 2**30
        write(tmp_path / "state.npz", header, {**arrays, ".0.pairs.second": second})
        assert "pairs.second holds 1073741824" in refused(tmp_path / "state.npz")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38])
def test_numbers_that_are_none_are_refused(value: float, looked_at: Callable[[str, Any], str]) -> None:
    for name in (".0.grains.offset", ".0.grains.twist", ".0.pairs.force", ".0.pace:horizon", ".0.box:least_cell", ".1.constants:step"):
        assert "no number of a simulation" in looked_at(name, value)


FLIGHTS = {"offset": 1e9, "shift": -1e9, "twist": 1e12, "start_velocity": 1e12, "radius": 0.0}


@pytest.mark.parametrize("name", FLIGHTS)
def test_places_and_speeds_that_cells_cannot_be_found_from(name: str, saved: tuple[dict, dict[str, np.ndarray]], tmp_path: Path) -> None:
    header, arrays = saved
    changed = arrays[f".0.grains.{name}"].copy()
    changed[(0,) * changed.ndim] = FLIGHTS[name]
    write(tmp_path / "state.npz", header, {**arrays, f".0.grains.{name}": changed})
    assert name in refused(tmp_path / "state.npz")


def test_tables_of_another_size_are_refused(saved: tuple[dict, dict[str, np.ndarray]], tmp_path: Path) -> None:
    header, arrays = saved
    for name, values in (
        (".0.grains.kind", np.zeros(7, np.int32)),
        (".0.grains.kind", np.zeros(len(arrays[".0.grains.kind"]), np.int64)),
        (".0.pairs.gap", np.zeros((3, 3, 3))),
    ):
        write(tmp_path / "state.npz", header, {**arrays, name: values})
        assert f"lacks a fitting `{name}`" in refused(tmp_path / "state.npz")
    write(tmp_path / "state.npz", header, {name: values for name, values in arrays.items() if "twist" not in name})
    refused(tmp_path / "state.npz")


@contextmanager
def a_second_and_little_memory(most: float = 1.0) -> Iterator[None]:
    """No more than a second, and than 300 MB more of memory."""
    limits, start = resource.getrlimit(resource.RLIMIT_AS), time.perf_counter()
    used = resource.getpagesize() * int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (used + 300 * 2**20, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
    assert time.perf_counter() - start < most


def bomb(path: Path, header: dict[str, Any] | None, names: dict[str, int]) -> None:
    """An archive with arrays of so many zeros, of 8 bytes each, in a thousandth of that; without a header such a one is its header."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open("header.npy", "w", force_zip64=True) as file:
            if header is None:
                for _ in range(20):
                    file.write(bytes(2**24))
            else:
                np.lib.format.write_array(file, np.frombuffer(json.dumps(header).encode(), np.uint8))
        for name, count in names.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (count,)})
                for _ in range(count * 8 // 2**24):
                    file.write(bytes(2**24))
                file.write(bytes(count * 8 % 2**24))


def test_an_archive_that_unfolds_to_gigabytes(tmp_path: Path) -> None:
    """It is refused before it is read."""
    header, arrays = saved_of("discs")
    bomb(tmp_path / "state.npz", header, {".0.grains.id": len(arrays[".0.grains.id"]), "anything": 2**26})
    with a_second_and_little_memory():
        assert "announced" in refused(tmp_path / "state.npz")
    bomb(tmp_path / "state.npz", None, {})
    with a_second_and_little_memory():
        assert "its head announces" in refused(tmp_path / "state.npz")


FLOOD = {"radius": 0.01, "rate": 1e6, "region": [0.1, 0.1, 0.4, 0.4]}
LIES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "room": lambda about: about.update(room=10**9),
    "no room": lambda about: about.update(room=-1),
    "room of half": lambda about: about.update(room=0.5),
    "more grains": lambda about: edit(about, lambda scene: scene["grains"][0].update(count=10**6)),
    "a flood": lambda about: edit(about, lambda scene: scene.update(sources=[FLOOD])),
    "full of dust": lambda about: edit(about, lambda scene: scene["grains"].append({"radius": 1e-6, "fill": "hexagonal"})),
    "no scene": lambda about: about["host"].pop("scene"),
    "made": lambda about: about["host"].update(made=3),
    "removed": lambda about: about["host"].update(removed="x"),
    "epoch": lambda about: about["host"].update(epoch=[0, float("nan")]),
    "epoch of one": lambda about: about["host"].update(epoch=[0]),
    "no step": lambda about: about["host"]["numbers"].update(step=0.0),
    "another step": lambda about: about["host"]["numbers"].update(step=1e-9),
    "numbers": lambda about: about["host"].update(numbers={}),
    "a bed": lambda about: about["host"]["bed"].update(depth=-1.0),
    "a bed of texts": lambda about: about["host"]["bed"].update(mass="1.0"),
    "owed": lambda about: about["host"].update(owed=1e9),
    "owed of nothing": lambda about: about["host"].update(owed=None),
    "over what is not live": lambda about: about["host"].update(over={"size": 3.0}),
    "over what may not be": lambda about: about["host"].update(over={"solver.restitution": float("nan")}),
    "over what a scene may have": lambda about: about["host"].update(over={"solver.restitution": 0.5}),
    "over a text": lambda about: about["host"].update(over="solver"),
    "no host": lambda about: about.pop("host"),
    "walls": lambda about: about.update(first_walls=[{"points": [[8, 8], [9, 9]]}]),
    "grown tables": lambda about: about.update(rooms=[10**9, 3, 0, 0, 0]),
    "tables of texts": lambda about: about.update(rooms=["6", 3, 0, 0, 0]),
    "walls of none": lambda about: about.update(first_walls=3),
}


def edit(about: dict[str, Any], change: Callable[[dict[str, Any]], Any]) -> None:
    """Changes the scene of a header."""
    scene = json.loads(about["host"]["scene"])
    change(scene)
    about["host"]["scene"] = json.dumps(scene)


@pytest.mark.parametrize("lie", LIES)
def test_a_header_that_lies(lie: str, saved: tuple[dict, dict[str, np.ndarray]], tmp_path: Path) -> None:
    header, arrays = saved
    about = json.loads(json.dumps(header["about"]))
    LIES[lie](about)
    write(tmp_path / "state.npz", {**header, "about": about}, arrays)
    refused(tmp_path / "state.npz")


def test_the_scene_of_a_checkpoint_reads_no_file(saved: tuple[dict, dict[str, np.ndarray]], tmp_path: Path) -> None:
    """Not even one that is there: no path of ours, no pipe, no device."""
    header, arrays = saved
    secret, pipe = tmp_path / "secret.csv", tmp_path / "pipe"
    secret.write_text("0.1,0.1,0.01\n")
    os.mkfifo(pipe)
    for name in (str(secret), "secret.csv", str(pipe), "/dev/zero"):
        about = json.loads(json.dumps(header["about"]))
        edit(about, lambda scene, name=name: scene["grains"].append({"positions_file": name}))
        write(tmp_path / "state.npz", {**header, "about": about}, arrays)
        with a_second_and_little_memory():
            assert "reads no file" in refused(tmp_path / "state.npz")


def strange(folder: Path) -> dict[str, Path]:
    """Files that are none of ours."""
    os.mkfifo(folder / "pipe")
    (folder / "truncated.npz").write_bytes(b"PK\x03\x04" + bytes(100))
    (folder / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(1000))
    (folder / "zeros").write_bytes(bytes(10**7))
    with (folder / "sparse").open("wb") as file:
        file.truncate(MOST_BYTES * 100)
    (folder / "deep.toml").write_text("a = " + "[" * 10**5)
    (folder / "empty").touch()
    names = ("pipe", "truncated.npz", "picture.png", "zeros", "sparse", "deep.toml", "empty")
    return {name: folder / name for name in names} | {"zero": Path("/dev/zero"), "null": Path("/dev/null"), "folder": folder}


def test_pipes_devices_and_foreign_files(tmp_path: Path) -> None:
    """A sentence within a second, wherever a file is read."""
    (tmp_path / "strange").mkdir()
    reads: dict[str, Callable[[Path], object]] = {
        "scene": sand.load,
        "checkpoint": sand.Simulation.resume,
        "quick save": played.read,
        "recording": recording.read,
        "positions": lambda path: sand.Scene(size=[1, 1], grains=[{"radius": 0.01, "positions_file": path}]),
    }
    for name, path in strange(tmp_path / "strange").items():
        for what, read in reads.items():
            if (what, name) in (("scene", "empty"),):
                continue
            with a_second_and_little_memory(), pytest.raises(sand.SandError) as caught:
                read(path)
            assert "\n" not in str(caught.value) and path.name in str(caught.value), (name, what, str(caught.value))
        if name != "empty":
            done = CliRunner().invoke(app, ["run", "--resume", str(path)])
            assert done.exit_code == 2 and done.stderr.count("\n") == 1


def test_grains_that_differ_too_much_for_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene of a thousand grains that would take terabytes: a boulder among dust."""
    grains = [{"radius": 1e-6, "count": 1000, "region": [0, 0, 1, 1]}, {"positions": [[5e4, 5e4, 4e4]]}]
    with pytest.raises(sand.SandError, match="GB of memory are free"):
        sand.Simulation(sand.Scene(size=[1e5, 1e5], grains=grains), threads=1)
    assert 10**8 < memory.available() <= memory.UNKNOWN


@pytest.mark.parametrize("name", ["hourglass", "soft_sand", "pile"])
def test_most_grains_are_never_too_few(name: str) -> None:
    scene = sand.load(name)
    assert len(pack(scene)) <= most_grains(scene)
    assert rooms.by_hand(scene) >= max(1000, len(pack(scene)) // 2)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The lines of a recording."""
    path = tmp_path_factory.mktemp("recorded") / "it.record"
    session = Session(sand.Scene(**BOX, **SCENES["discs"]), threads=1)
    recorder = recording.Recorder(session, path)
    done = [
        ["set", "gravity.0", 2.0],
        ["choose", "stir"],
        ["stroke", "press", 0.2, 0.2, 0.0, 0.0, False],
        ["stroke", "release", 0.2, 0.2, 1.0, 0.0],
    ]
    for action in (*done, ["look", "color", "speed"], ["look", "grid", True], ["undo"], ["kind", 1], ["mark"], ["opened", True]):
        session.do(action)
        session.advance(5)
        recorder([action], 5)
    recorder.close()
    return path.read_text().splitlines()


def replayed(lines: list[str], path: Path) -> int:
    """Steps of a recording that is done again."""
    path.write_text("".join(f"{line}\n" for line in lines))
    *_, (session, _) = recording.replay(recording.read(path), path, "cpu", 1)
    return session.sim.steps


def test_every_verb_has_its_kinds(recorded: list[str], tmp_path: Path) -> None:
    """And what is recorded is believed."""
    assert set(actions.ARGUMENTS) == set(VERBS)
    assert replayed(recorded, tmp_path / "it.record") > 0


@pytest.mark.parametrize(
    "line",
    [
        '[[["set", "gravity.0", "x"]], 1, 0.0]',
        '[[["set", "gravity.0", NaN]], 1, 0.0]',
        '[[["set", "gravity.0", 1e300]], 1, 0.0]',
        '[[["set", 3, 1.0]], 1, 0.0]',
        '[[["set"]], 1, 0.0]',
        '[[["stroke", "press", 1e300, 0.1]], 1, 0.0]',
        '[[["stroke", "pres", 0.1, 0.1]], 1, 0.0]',
        '[[["stroke", "press"]], 1, 0.0]',
        '[[["kind", 0.5]], 1, 0.0]',
        '[[["choose", "bomb"]], 1, 0.0]',
        '[[["solver", "fast"]], 1, 0.0]',
        '[[["look", "color", 3]], 1, 0.0]',
        '[[["look", "colour", "speed"]], 1, 0.0]',
        '[[["drop"]], 1, 0.0]',
        '[[[["set"]]], 1, 0.0]',
        "[[], -1, 0.0]",
        "[[], 1000000000, 0.0]",
        "[[], 1, 1e300]",
        "[[], 1, -1.0]",
        "[[], true, 0.0]",
        '{"hash": 3}',
        "3",
    ],
)
def test_actions_of_other_kinds_are_refused(line: str, recorded: list[str], tmp_path: Path) -> None:
    with pytest.raises(sand.SandError, match=r"it\.record: line 2 of the recording is damaged"):
        replayed([recorded[0], line, *recorded[1:]], tmp_path / "it.record")


def test_states_within_a_recording_are_looked_at(recorded: list[str], tmp_path: Path) -> None:
    """The one it starts from, and one that is loaded in the middle."""
    head = json.loads(recorded[0])
    with np.load(io.BytesIO(base64.b64decode(head["start"]))) as file:
        arrays = {name: file[name] for name in file.files}
    for name, value in ((".0.pairs.second", 2**30), (".0.grains.kind", 77), (".0.grid.cell", -5), (".0.blocks.pair_end", 2**30)):
        changed = arrays[name].copy()
        changed.flat[0] = value
        file = io.BytesIO()
        np.savez(file, **{**arrays, name: changed})
        start = base64.b64encode(file.getvalue()).decode()
        with pytest.raises(sand.SandError, match=rf"it\.record: .*{trust.short(name)}"):
            replayed([json.dumps({**head, "start": start}), *recorded[1:]], tmp_path / "it.record")
    session = Session(sand.Scene(**BOX, **SCENES["discs"]), threads=1)
    before = session.digest()
    session.do(["load", start])
    assert "blocks.pair" in session.message and session.digest() == before


def test_shapes_that_a_recording_announces_are_held_against_what_is_there(recorded: list[str], tmp_path: Path) -> None:
    head = json.loads(recorded[0])
    with np.load(io.BytesIO(base64.b64decode(head["start"]))) as file:
        arrays = {name: file[name] for name in file.files}
    about = json.loads(arrays["head"].tobytes())
    for name, value in (
        (".0.grains.offset", [[10**12, 2], [[0, 30]]]),
        (".0.grains.offset", [[64, 2], [[0, 10**12]]]),
        (".0.grains.offset", [[64, 2], [[30, 0]]]),
        (".0.grains.offset", [[-64, 2], [[0, 30]]]),
        (".0.grains.offset", [["x"], [[0, 30]]]),
        (".0.grains.offset", 3),
    ):
        text = json.dumps({**about, "shapes": {**about["shapes"], name: value}})
        file = io.BytesIO()
        np.savez(file, **{**arrays, "head": np.frombuffer(text.encode(), np.uint8)})
        line = json.dumps({**head, "start": base64.b64encode(file.getvalue()).decode()})
        with a_second_and_little_memory(), pytest.raises(sand.SandError, match=r"it\.record"):
            (tmp_path / "it.record").write_text(line + "\n")
            recording.read(tmp_path / "it.record")
