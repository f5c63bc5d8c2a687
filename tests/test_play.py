"""The window, driven as by a user: real keys, real mouse, and what its report and the files it writes say."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import monkey
import numpy as np
import pytest
from PIL import Image
from playing import Playing

import taichi_sand as sand
from taichi_sand.play.keys import KEYS, table
from taichi_sand.scene import loading

SCENE = """
title = "Box"
size = [0.3, 0.3]
seed = 5
[[grains]]
radius = 0.006
fill = "lattice"
region = [0.0, 0.0, 0.3, 0.09]
[[grains]]
positions = [[0.15, 0.2, 0.006]]
fixed = true
[effects.friction]
[view]
width = 400
"""
LATTICE, FIXED = 175, (0.5, 0.2 / 0.3)
D = 0.012
COLUMNS = ("id", "kind", "site", "offset", "shift", "twist", "radius", "mobility")


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Playing]:
    """A box of discs at rest, and one held in the air."""
    folder = tmp_path_factory.mktemp("box")
    (folder / "box.toml").write_text(SCENE)
    with Playing(folder, str(folder / "box.toml"), "--width", "400", "--record", str(folder / "box.record")) as window:
        yield window


def saved(window: Playing) -> dict[str, np.ndarray]:
    """Grains of a quick save, by id: the file alone is read."""
    path = window.folder / f"{window.now['scene']}.npz"
    path.unlink(missing_ok=True)
    window.key("s")
    window.until(lambda now: now["said"].startswith("saved") and path.exists())
    with np.load(path) as file:
        count = int(file[".0.count"])
        table = {name: file[f".0.grains.{name}"][:count] for name in COLUMNS}
        spacing = file[".0.box:spacing"]
    order = np.argsort(table["id"])
    table = {name: values[order] for name, values in table.items()}
    table["position"] = (table["site"] + 0.5) * spacing + table["offset"] + table["shift"]
    return table


def paused(window: Playing, on: bool = True) -> dict:
    """Makes sure that time stands still, or goes on."""
    if window.fresh()["paused"] != on:
        window.key("space")
    return window.until(lambda now: now["paused"] == on)


def test_it_runs_in_real_time_and_stops_and_steps(box: Playing) -> None:
    first = box.until(lambda now: now["time"] > 0.5)
    assert first["scene"] == "box" and first["grains"] == LATTICE + 1 and not first["flags"]
    assert first["window"][0] == 400 + 264
    now = box.until(lambda now: now["real_time"] > 0.9 and now["frames"] > 20)
    now = paused(box)
    assert box.fresh()["time"] == now["time"]
    box.key("period")
    step = box.until(lambda later: later["time"] > now["time"])["time"] - now["time"]
    assert 0 < step <= 1 / 240
    box.key("comma")
    frame = box.until(lambda later: later["time"] > now["time"] + 2 * step)["time"] - now["time"] - step
    assert frame == pytest.approx(1 / 60, abs=step)


def test_time_can_run_slower_and_faster(box: Playing) -> None:
    paused(box, False)
    box.key("minus", "minus")
    now = box.until(lambda now: now["values"]["time"] == 0.25 and abs(now["real_time"] - 0.25) < 0.05)
    box.key("equal", "equal")
    box.until(lambda now: now["values"]["time"] == 1.0 and now["real_time"] > 0.8)
    assert not now["flags"]


def test_an_input_shows_within_two_frames(box: Playing) -> None:
    """From the key to the cells of the cell list on the display, less what it takes to press a key and to look."""
    paused(box, False)

    def air() -> np.ndarray:
        return box.shot()[230:270, 260:380]

    def time_of(key: str) -> float:
        before, start = air(), time.perf_counter()
        box.tool("key", key)
        while (air() == before).all() and key == "g" and time.perf_counter() < start + 5:
            pass
        return time.perf_counter() - start

    shown, idle = (min(time_of(key) for _ in range(6)) for key in ("g", "F5"))
    assert not box.fresh()["look"]["grid"]
    assert shown - idle < 2 / box.now["frames"]


@pytest.mark.parametrize("key", [key for key in KEYS if key.group == "views"], ids=lambda key: key.key)
def test_every_view_key_changes_what_is_shown(box: Playing, key: object) -> None:
    paused(box)
    before = box.fresh()
    after = box.switched(key.key)
    changed = [name for name, value in after["look"].items() if value != before["look"][name]] + ["help"] * after["help"]
    assert changed == [{"v": "color", "h": "help"}.get(key.key, key.arguments[0] if key.arguments else "")]
    if key.key != "v":
        back = box.switched(key.key)
        assert (back["look"], back["help"]) == (before["look"], before["help"])


def test_every_view_shows_something_else(box: Playing) -> None:
    """What the display shows of a stirred bed, in all colours, with all that can be drawn over it; and back again."""
    paused(box, False)
    box.key("i", "5")
    box.click("kind")
    box.stroke((0.3, 0.2), (0.5, 0.25), (0.7, 0.2))
    paused(box)
    box.to(0.9, 0.95)
    box.until(lambda now: now["look"]["color"] == "kind" and not now["look"]["hud"])
    shots = [box.settled(strip=True)]
    while box.switched("v")["look"]["color"] != "kind":
        shots.append(box.shot(strip=True))
    assert len(shots) == 10  # all but those of effects that are off
    for key in ("c", "x", "a", "g", "i", "h"):
        box.switched(key)
        shots.append(box.shot(strip=True))
        box.switched(key)
    assert (box.shot(strip=True) == shots[0]).all()
    for number, shot in enumerate(shots):
        assert not any((shot == other).all() for other in shots[:number]), number
    box.key("i", "z")


def test_the_colours_of_energy_can_be_chosen(box: Playing) -> None:
    box.click("energy")
    box.until(lambda now: now["look"]["color"] == "energy" and "cold #1B7A6E" in now["controls"])
    box.click("cold #1B7A6E")
    box.until(lambda now: now["look"]["cold"] == "#1B7A6E")
    away = np.abs(box.settled().astype(int) - (0x1B, 0x7A, 0x6E)).max(axis=2)
    assert (away < 16).sum() > 1000  # of a bed that is nearly at rest; no other colour of the window is as near
    box.click("kind")


@pytest.mark.parametrize(
    ("tool", "key", "points", "more"),
    [
        ("create", "2", [(0.2, 0.8), (0.3, 0.85)], True),
        ("destroy", "3", [(0.5, 0.1), (0.6, 0.1)], False),
        ("pour", "4", [(0.8, 0.8), (0.82, 0.8)], True),
    ],
)
def test_tools_that_make_and_take_grains_and_their_undoing(box: Playing, tool: str, key: str, points: list, more: bool) -> None:
    before = paused(box)
    before = box.fresh()
    box.key(key)
    box.until(lambda now: now["tool"] == tool)
    box.stroke(*points)
    box.until(lambda now: now["undo"] == before["undo"] + 1 and now["grains"] != before["grains"])
    after = box.fresh()  # the stroke has ended
    assert (after["grains"] > before["grains"]) == more
    grains = saved(box)
    apart = np.hypot(*(grains["position"][:, None] - grains["position"][None]).transpose(2, 0, 1)) - grains["radius"][:, None]
    gap = apart - grains["radius"][None] + 9 * np.eye(len(apart))
    assert gap.min() > -0.02 * D  # a new grain is never inside another
    assert len(grains["id"]) == after["grains"] and len(set(grains["id"])) == after["grains"]
    box.key("z")
    back = box.until(lambda now: now["undo"] == before["undo"])
    assert back["hash"] == before["hash"]
    box.key("y")
    again = box.until(lambda now: now["undo"] == before["undo"] + 1)
    assert again["grains"] == after["grains"]
    box.key("z")
    box.until(lambda now: now["undo"] == before["undo"])


@pytest.mark.parametrize(("tool", "key"), [("grab", "1"), ("stir", "5"), ("attract", "6"), ("repel", "7")])
def test_tools_that_push_and_pull_and_their_undoing(box: Playing, tool: str, key: str) -> None:
    paused(box)
    box.key(key)
    box.until(lambda now: now["tool"] == tool)
    before = box.fresh()
    start = saved(box)
    box.to(0.5, 0.28)
    box.press()
    box.key("space")
    for k in range(1, 8):
        across, up = {"grab": (0.01, 0.045), "stir": (0.06, 0.0)}.get(tool, (0.0, 0.0))
        box.to(0.5 + across * k, 0.28 + up * k)
    box.key("space")
    after = box.until(lambda now: now["paused"] and now["time"] > before["time"])
    moved = saved(box)
    box.release()
    assert np.hypot(*(moved["position"] - start["position"]).T).max() > 0.04 * D  # a bed at rest moves by less than 0.01
    if tool == "grab":
        held = np.argmax(np.hypot(*(moved["position"] - start["position"]).T))
        assert moved["position"][held, 1] - start["position"][held, 1] > 3 * D  # it follows the mouse upwards
        assert after["given"][1] > 0
    elif tool != "stir":
        way = np.array([0.15, 0.084]) - start["position"]
        near = np.hypot(*way.T) < 4 * D
        along = ((moved["position"] - start["position"])[near] * way[near]).sum()
        assert (along > 0) == (tool == "attract")
    box.key("z")
    back = box.until(lambda now: now["undo"] == before["undo"])
    assert back["hash"] == before["hash"]


def test_freeze_and_thaw(box: Playing) -> None:
    paused(box)
    before = box.fresh()
    assert (saved(box)["mobility"][:, 0] == 0).sum() == 1
    box.key("8")
    box.stroke((0.5, 0.1))
    box.until(lambda now: now["undo"] == before["undo"] + 1)
    held = saved(box)["mobility"][:, 0] == 0
    assert held.sum() > 3
    box.key("9")
    box.stroke(FIXED)
    box.until(lambda now: now["undo"] == before["undo"] + 2)
    grains = saved(box)
    assert (grains["mobility"][:, 0] == 0).sum() == held.sum() - 1
    assert grains["mobility"][-1, 0] == pytest.approx(1 / (2650 * np.pi * 0.006**2), rel=1e-5)
    box.key("z", "z")
    assert box.until(lambda now: now["undo"] == before["undo"])["hash"] == before["hash"]


def test_walls_are_drawn_and_rubbed_out(box: Playing) -> None:
    """A wall holds grains up, is cut in two by the brush, and takes out what stands in its way; all can be undone."""
    before = paused(box)
    box.key("0")
    box.until(lambda now: now["tool"] == "wall")
    corners = [(0.2, 0.9), (0.2, 0.75), (0.45, 0.75), (0.45, 0.9)]
    box.stroke(*corners)
    drawn = box.until(lambda now: len(now["walls"]) == 1)
    assert np.array(drawn["walls"][0]) == pytest.approx(0.3 * np.array(corners), abs=1.5 * 0.3 / 400)  # to the pixel
    box.key("2")
    box.stroke((0.3, 0.83))
    made = box.until(lambda now: now["grains"] > drawn["grains"])["grains"] - drawn["grains"]
    paused(box, False)
    box.until(lambda now: now["time"] > drawn["time"] + 0.4)
    paused(box)
    grains = saved(box)
    assert (grains["position"][-made:, 1] > 0.225).all()
    box.key("e")
    box.stroke((0.325, 0.75))
    box.until(lambda now: len(now["walls"]) == 2)
    box.key("0")
    held = box.fresh()
    box.stroke((0.1, 0.1), (0.5, 0.1))
    cut = box.until(lambda now: len(now["walls"]) == 3 and now["grains"] < held["grains"])
    assert f"{held['grains'] - cut['grains']} grains stood in the way" in cut["said"]
    box.stroke((0.3, 0.1), button=3)
    box.until(lambda now: len(now["walls"]) == 4)
    box.key("z", "z", "z", "z")
    assert len(box.until(lambda now: now["undo"] == before["undo"] + 1)["walls"]) == 1
    box.key("z")
    assert box.until(lambda now: now["undo"] == before["undo"])["hash"] == before["hash"]


def test_the_next_kind_of_grain_is_poured(box: Playing) -> None:
    paused(box)
    before = box.fresh()
    box.key("t", "4")
    box.until(lambda now: now["kind"] == 1)
    box.stroke((0.2, 0.8))
    box.until(lambda now: now["grains"] > before["grains"])
    assert set(saved(box)["kind"][before["grains"] :]) == {1}
    box.key("t", "z")
    assert box.until(lambda now: now["undo"] == before["undo"] and now["kind"] == 0)["hash"] == before["hash"]


def test_the_right_button_does_the_opposite_and_the_wheel_sizes_the_brush(box: Playing) -> None:
    paused(box)
    box.key("2")
    before = box.fresh()
    box.to(0.5, 0.1)
    for _ in range(3):
        box.tool("keydown", "shift", "click", 4, "keyup", "shift")
    grown = box.until(lambda now: now["values"]["tool.size"] > before["values"]["tool.size"])
    assert grown["values"]["tool.size"] > before["values"]["tool.size"]
    box.stroke((0.5, 0.1), button=3)
    box.until(lambda now: now["grains"] < before["grains"])
    box.key("z")
    box.until(lambda now: now["grains"] == before["grains"])
    for _ in range(3):
        box.tool("keydown", "shift", "click", 5, "keyup", "shift")


def test_the_camera(box: Playing) -> None:
    """The wheel zooms at the cursor, which stays over the same point; the middle button moves the picture; `home` shows all of it."""
    paused(box)
    before = box.fresh()["camera"]
    _, _, width, height = box.now["picture"]
    box.to(0.75, 0.25)
    box.tool("click", 4, "click", 4)
    near = box.until(lambda now: now["camera"][2] > 1.5 * before[2])["camera"]
    for k, (at, side) in enumerate(((0.75, width), (0.25, height))):
        assert near[k] + at * side / near[2] == pytest.approx(before[k] + at * side / before[2], abs=1.5 / before[2])
    shot = box.settled()
    box.press(2)
    box.to(0.65, 0.35)
    box.release(2)
    moved = box.until(lambda now: now["camera"][0] > near[0])["camera"]
    assert (np.array(moved[:2]) - near[:2]) * near[2] == pytest.approx([0.1 * width, -0.1 * height], abs=2)
    assert (box.settled() != shot).any()
    box.key("Home")
    assert box.until(lambda now: now["camera"][2] == before[2])["camera"] == before


def test_refusals_are_told_in_the_words_of_the_window_and_end_the_stroke(box: Playing) -> None:
    """Nothing can be wetted without moisture: it is offered, and one click switches it on. Wet grains are darker."""
    paused(box)
    before = box.fresh()
    box.key("w")
    box.stroke((0.5, 0.1))
    now = box.until(lambda now: "switch on moisture to wet grains" in now["said"])
    assert now["offer"] == "switch on moisture" and now["undo"] == before["undo"]
    box.click("offer")
    box.until(lambda now: "moisture" in now["effects"], 90)
    box.to(0.9, 0.95)
    dry = box.settled()
    box.stroke((0.4, 0.1), (0.6, 0.1), (0.4, 0.12))
    box.until(lambda now: now["undo"] == before["undo"] + 2)
    box.to(0.9, 0.95)
    assert box.settled()[-60:].mean() < 0.97 * dry[-60:].mean()
    box.key("z", "z")
    assert box.until(lambda now: now["undo"] == before["undo"])["hash"] == before["hash"]


def test_a_value_can_be_typed_and_goes_back_by_a_double_click(box: Playing) -> None:
    paused(box)
    before = box.fresh()
    box.click("gravity x value")
    box.key("3", "5", "Return")
    box.until(lambda now: now["values"]["gravity.0"] == 35.0)  # beyond the end of the slider
    box.key("g", "g")  # keys are keys again
    left, top, width, height = box.seen("gravity x")
    box.tool("mousemove", "--window", box.window, left + 3 * width // 4, top + height // 2, "click", "--repeat", 2, "--delay", 40, 1)
    box.until(lambda now: now["values"]["gravity.0"] == 0.0)
    box.until(lambda now: now["undo"] == before["undo"] + 3)  # what was typed, the first click, the second
    box.key("z", "z", "z")
    box.until(lambda now: now["undo"] == before["undo"] and now["values"] == before["values"])


def test_a_slider_changes_its_number_without_compiling(box: Playing) -> None:
    paused(box, False)
    box.click("tolerance")  # once, so that what a first change compiles is compiled
    box.click("friction mu", 0.3)
    before = box.fresh()
    box.click("tolerance", 0.5, drag_to=0.75)
    after = box.until(lambda now: now["values"]["solver.tolerance"] > 2 * before["values"]["solver.tolerance"])
    box.click("friction mu", 0.3, drag_to=0.8)
    after = box.until(lambda now: now["values"]["effects.friction.mu"] > before["values"]["effects.friction.mu"] + 0.3)
    box.click("gravity y", 0.3, drag_to=0.1)
    after = box.until(lambda now: now["values"]["gravity.1"] < -14)
    assert after["compiled"] == before["compiled"] and not after["flags"]
    box.key("z", "z", "z")
    back = box.until(lambda now: now["undo"] == before["undo"])
    assert back["values"] == before["values"]


def test_unphysical_values_have_a_badge_and_stay_finite(box: Playing) -> None:
    paused(box, False)
    box.key("u")
    box.click("friction mu", 0.5, drag_to=0.1)
    now = box.until(lambda now: now["values"]["effects.friction.mu"] < -0.1)
    assert now["unphysical"] and "friction.mu" in now["unphysical"][0]
    box.click("restitution", 0.5, drag_to=0.97)
    now = box.until(lambda now: now["values"]["solver.restitution"] > 1.1)
    later = box.until(lambda later: later["time"] > now["time"] + 1.0)
    assert np.isfinite(later["kinetic_energy_J"]) and later["grains"] + later["lost"] == now["grains"]
    box.key("u")
    assert not box.until(lambda now: not now["unphysical"])["unphysical"]
    box.key("r")
    box.until(lambda now: now["time"] < 1.0)


def test_the_other_solver_takes_over_the_grains(box: Playing) -> None:
    paused(box)
    before = box.fresh()
    start = saved(box)
    box.key("m")
    box.until(lambda now: now["solver"] == "md", 90)
    assert saved(box)["position"] == pytest.approx(start["position"], abs=1e-7)
    paused(box, False)
    later = box.until(lambda now: now["time"] > before["time"] + 0.3)
    assert later["grains"] == before["grains"] and not later["flags"]
    paused(box)
    box.key("m")
    box.until(lambda now: now["solver"] == "rigid")
    box.key("z", "z")
    assert box.until(lambda now: now["undo"] == before["undo"])["hash"] == before["hash"]


def test_effects_come_and_go_and_sleepers_are_shown(box: Playing) -> None:
    """With sleeping on the bed falls asleep and is painted fainter; off, it goes on as before."""
    paused(box, False)
    before = box.fresh()
    box.click("sleeping")
    box.until(lambda now: "sleeping" in now["effects"], 90)
    box.until(lambda now: now["asleep"] > 0.9 * LATTICE)
    paused(box)
    box.to(0.9, 0.95)
    faint = box.settled()
    box.key("n")
    box.until(lambda now: not now["look"]["asleep"])
    assert box.settled().mean() > 1.05 * faint.mean()
    box.key("n")
    box.click("sleeping")
    after = box.until(lambda now: "sleeping" not in now["effects"])
    assert after["grains"] == before["grains"] and not after["flags"]


def test_save_load_picture_and_film(box: Playing) -> None:
    paused(box)
    before = box.fresh()
    saved(box)
    paused(box, False)
    box.until(lambda now: now["time"] > before["time"] + 0.1)
    paused(box)
    box.key("l")
    assert box.until(lambda now: now["time"] == before["time"])["hash"] == before["hash"]
    box.key("p")
    path = box.folder / "box_001.png"
    box.until(lambda _: path.exists())
    assert Image.open(path).size == tuple(before["window"])
    paused(box, False)
    box.key("f")
    start = box.until(lambda now: now["said"] == "filming")["time"]
    box.until(lambda now: now["time"] > start + 0.5)
    box.key("f")
    box.until(lambda now: now["said"].startswith("saved box_001.mp4"))
    assert (box.folder / "box_001.mp4").stat().st_size > 3000


def test_a_monkey_breaks_nothing(box: Playing) -> None:
    """A minute of random keys, strokes and sliders, ten a second: finite all along, then the window closes as ever."""
    paused(box)
    (box.folder / "so_far.record").write_text((box.folder / "box.record").read_text())
    paused(box, False)
    told = monkey.play(box, 60.0, [key.key for key in KEYS], scenes=2)
    assert told["events"] > 300
    assert np.isfinite([told["kinetic_energy_J"], told["speed_max_m_s"], told["overlap_max"]]).all()
    box.key("r")
    box.until(lambda now: now["time"] < told["time"] or now["undo"] > told["undo"])
    assert box.close() == 0
    assert box.process.stderr.read() == ""


def test_the_recording_of_all_this_is_done_again_bit_for_bit_on_two_threads(box: Playing) -> None:
    """All before the monkey, tools, solvers, effects, undoing and loading: `render` fails if a hash of the state differs."""
    record = box.folder / "so_far.record"
    assert record.read_text().count('"hash"') > 20
    done = subprocess.run(
        [sys.executable, "-m", "taichi_sand", "render", str(record), "-o", str(box.folder / "again.mp4"), "--fps", "2", "--threads", "2"],
        capture_output=True, text=True, check=False, env=box.environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (box.folder / "again.mp4").stat().st_size > 3000


@pytest.fixture(scope="module")
def table_of_balls(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Playing]:
    """Billiards with all ten at rest."""
    folder = tmp_path_factory.mktemp("billiards")
    with Playing(folder, "billiards", "--set", "grains.0.velocity=[0,0]", "--width", "500") as window:
        yield window


def test_dragging_one_disc_of_billiards_moves_them_all(table_of_balls: Playing) -> None:
    """Momentum grows by what the hand gave, within 1 %; let go, the disc starts the cascade."""
    window = table_of_balls
    paused(window)
    start = saved(window)["position"]
    assert window.now["speed_max_m_s"] == 0
    window.key("1")
    x, y = start[0] / (1.0, 0.6)
    window.to(x, y)
    window.press()
    window.key("space")
    for k in range(1, 5):
        window.to(x + 0.03 * k, y + 0.01 * k)
    now = window.until(lambda now: np.hypot(*now["given"]) > 0.1)
    given = np.array(now["given"])
    assert np.hypot(*(given - now["momentum_Ns"])) < 0.01 * np.hypot(*given)
    for k in range(5, 9):
        window.to(x + 0.03 * k, y + 0.01 * k)
    window.release()
    window.key("equal", "equal")
    moved = np.zeros(len(start))
    for seconds in (20, 21):  # at one look a disc may be passing through where it started
        paused(window, False)
        window.until(lambda later, seconds=seconds: later["time"] > now["time"] + seconds)
        paused(window)
        moved = np.maximum(moved, np.hypot(*(saved(window)["position"] - start).T))
    assert (moved > 0.01).all()


def test_the_next_scene_and_the_one_before_and_leaving(table_of_balls: Playing) -> None:
    window, names = table_of_balls, list(loading.bundled())
    here = names.index("billiards")
    window.key("bracketright")
    window.until(lambda now: now["scene"] == names[here + 1], 90)
    window.find()
    window.key("bracketleft")
    now = window.until(lambda now: now["scene"] == "billiards", 90)
    assert now["grains"] == 10 and now["speed_max_m_s"] > 1  # as the file has it
    window.find()
    window.key("z")  # goes back to the scene before
    now = window.until(lambda now: now["scene"] == names[here + 1], 90)
    window.find()
    window.key("y")
    window.until(lambda now: now["scene"] == "billiards", 90)
    window.find()
    window.switched("h")
    window.tool("key", "Escape")
    window.until(lambda now: not now["help"])
    window.tool("key", "Escape")
    window.until(lambda now: "quit?" in now["said"])
    window.tool("key", "v")
    window.until(lambda now: "quit?" not in now["said"])
    window.tool("key", "Escape")
    window.until(lambda now: "quit?" in now["said"])
    window.tool("key", "Escape")
    assert window.process.wait(20) == 0


def test_the_reference_has_the_keys() -> None:
    assert table() in (Path(__file__).parents[1] / "docs" / "reference" / "window.md").read_text("utf-8")
    assert len({key.key for key in KEYS}) == len(KEYS)


def test_no_display(tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    environment["PYTHONPATH"] = str(Path(sand.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-m", "taichi_sand", "play", "billiards", "--folder", str(tmp_path / "new")],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    assert done.returncode == 2
    assert "render" in done.stderr and "play --web" in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "new").exists()
