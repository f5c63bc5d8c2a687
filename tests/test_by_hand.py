"""What is done by hand, without a window: strokes, scenes that come and go, what is recorded of it."""

import json
import math
import queue
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest

from taichi_sand import SandError, Scene
from taichi_sand.output.film import WRITERS
from taichi_sand.play import files, recording
from taichi_sand.play.actions import is_action
from taichi_sand.play.commands import Commands
from taichi_sand.play.history import MOST_BYTES, History
from taichi_sand.play.knobs import Knob
from taichi_sand.play.session import Session
from taichi_sand.play.snapshot import Snapshot
from taichi_sand.play.tools import TOOLS, Tool
from taichi_sand.play.web.face import Browser
from taichi_sand.play.web.messages import is_message
from taichi_sand.play.web.server import MOST_WAITING, Server
from taichi_sand.scene.packing import pack
from taichi_sand.view.paint import Painter
from taichi_sand.view.picture import wall_lines
from taichi_sand.view.still import still

GRAINS = [{"radius": 0.01, "count": 20, "fill": "lattice"}]
SCENE = {"size": [0.2, 0.3], "grains": GRAINS, "effects": {"friction": {}}, "title": "Narrow"}
OTHER = {**SCENE, "size": [0.4, 0.3], "title": "Wide"}


@pytest.fixture(scope="module")
def session() -> Iterator[Session]:
    """Shared: it takes seconds to compile."""
    yield Session(Scene(**SCENE), threads=1)


class Face:
    """Stands for a window."""

    name, folder, frame_time = "narrow", Path(), 1 / 60

    def __init__(self) -> None:
        self.opened = 0

    def wait(self, text: str) -> None:
        """Never long."""

    def open(self) -> None:
        """Another scene."""
        self.opened += 1


@pytest.mark.parametrize("phase", ["press", "drag", "release"])
@pytest.mark.parametrize("error", [SandError("no"), ZeroDivisionError("no")])
def test_a_stroke_ends_whatever_its_tool_raises(session: Session, monkeypatch: pytest.MonkeyPatch, phase: str, error: Exception) -> None:
    def work(stroke: Any) -> None:
        if stroke.phase == phase:
            raise error

    monkeypatch.setitem(TOOLS, "stir", Tool("stir", "5", "", work))
    session.do(["choose", "stir"])
    kept = len(session.history.past)
    for now in ("press", "drag", "release"):
        try:
            session.do(["stroke", now, 0.1, 0.1, 0.0, 0.0])
        except ZeroDivisionError:
            assert not isinstance(error, SandError)
        if now == phase:
            break
    assert session.stroke is None and session.sim.hand.now[None].work == 0
    assert len(session.history.past) == kept + (phase != "press")
    if isinstance(error, SandError):
        assert session.message == "no"
    session.do(["choose", "grab"])
    session.do(["stroke", "press", 0.1, 0.02, 0.0, 0.0])
    session.do(["stroke", "release", 0.1, 0.02, 0.0, 0.0])
    assert not session.message


def test_a_wall_that_is_too_short_ends_its_stroke_too(session: Session) -> None:
    session.do(["choose", "wall"])
    session.do(["stroke", "press", 0.1, 0.2, 0.0, 0.0])
    session.do(["stroke", "release", 0.1, 0.2, 0.0, 0.0])
    assert session.stroke is None and "longer" in session.message


@pytest.mark.parametrize("tool", ["wet", "dry", "water", "drain", "wave"])
def test_what_a_tool_lacks_is_offered(session: Session, tool: str) -> None:
    session.do(["choose", tool])
    session.do(["stroke", "press", 0.1, 0.02, 0.0, 0.0])
    assert session.message.startswith("switch on ") and session.stroke is None
    name, action = session.offer
    assert name in session.message and action == ["effect", TOOLS[tool].needs[0], True]
    session.do(["choose", "grab"])
    assert session.offer is None


@pytest.mark.parametrize("points", [[(0.02, 0.28), (0.02, 0.2), (0.1, 0.2), (0.1, 0.28)], [(0.02, 0.28), (0.18, 0.21), (0.02, 0.14)]])
def test_a_stroke_keeps_its_corners_however_slow_the_frames_are(session: Session, points: list) -> None:
    """All of it between two frames; as drawn in many."""
    drawn = []
    for slow in (True, False):
        commands = Commands(Face(), session)
        before = session.digest()
        commands.do("choose", "wall")
        commands.press(points[0], False)
        for place in points[1:]:
            commands.passes(place)
            if not slow:
                commands.drag(place)
        commands.release(points[-1])
        drawn.append(np.array(session.sim.scene.walls[-1].points))
        commands.do("undo")
        assert session.digest() == before
    assert drawn[0] == pytest.approx(np.array(points)) and drawn[1] == pytest.approx(drawn[0])


def test_a_brush_works_all_along_its_way(session: Session) -> None:
    """What lies under the way of a fast stroke is destroyed, not only what lies where it was at a frame."""
    commands = Commands(Face(), session)
    places, count = session.sim.positions, session.sim.count
    low = places[:, 1].min()
    commands.do("choose", "destroy")
    commands.do("set", "tool.size", 0.011)
    commands.press((0.01, low), False)
    commands.passes((0.1, low))
    commands.drag((0.19, low))
    commands.release((0.19, low))
    hit = (np.abs(places[:, 1] - low) < 0.005).sum()
    assert hit > 5 and count - session.sim.count >= hit
    commands.do("undo")
    assert session.sim.count == count


def test_a_scene_that_was_opened_is_undone_and_done_again(session: Session) -> None:
    """To the same bits; the face is told, and goes by the names of the scenes."""
    face = Face()
    commands = Commands(face, session)
    session.chapter.name = "narrow"
    session.advance(10)
    before, start = session.digest(), session.chapter.start
    commands.start(Scene(**OTHER), "wide")
    assert face.name == "wide" and face.opened == 1 and session.home.size == (0.4, 0.3)
    session.advance(20)
    after = session.digest()
    commands.undo()
    assert face.name == "narrow" and face.opened == 2
    assert session.digest() == before and session.home.size == (0.2, 0.3) and session.chapter.start is start
    commands.redo()
    assert face.name == "wide" and session.digest() == after and session.sim.scene.size == (0.4, 0.3)
    commands.start(Scene(**{**SCENE, "grains": [{"radius": 0.01, "count": 10000}]}), "full")
    assert session.message and face.name == "wide" and session.digest() == after
    commands.undo()
    assert session.digest() == before


def test_a_checkpoint_of_another_scene_is_gone_on_with_as_that(session: Session, tmp_path: Path) -> None:
    face, before = Face(), session.digest()
    commands = Commands(face, session)
    commands.start(Scene(**OTHER), "wide")
    session.advance(30)
    files.save(session, tmp_path / "wide.npz")
    wide = session.digest()
    commands.undo()
    assert session.digest() == before
    commands.do("load", files.read(tmp_path / "wide.npz"))
    assert not session.message and session.digest() == wide and session.home.size == (0.4, 0.3)
    session.advance(5)
    commands.do("reset")
    assert session.digest() == wide
    commands.undo()
    commands.undo()
    assert session.digest() == before and session.home.size == (0.2, 0.3)


def test_closing_the_ranges_gives_back_the_values_there_were(session: Session) -> None:
    session.do(["set", "effects.friction.mu", 0.37])
    session.do(["opened", True])
    session.do(["set", "effects.friction.mu", -0.2])
    session.do(["set", "effects.friction.mu", -0.4])
    session.do(["set", "solver.restitution", 1.2])
    assert len(session.unphysical()) == 2 and all("energy" in text for text in session.unphysical())
    restitution = session.home.solver.restitution
    session.do(["opened", False])
    assert session.value("effects.friction.mu") == 0.37 and session.value("solver.restitution") == restitution
    session.do(["default", "effects.friction.mu"])
    assert session.value("effects.friction.mu") == 0.5 and not session.unphysical()


@pytest.mark.parametrize("size", [(120, 180), (60, 180), (121, 61)])
def test_pictures_of_other_scenes_are_shown_whole_in_those_of_the_first(size: tuple[int, int]) -> None:
    pictures = recording.Pictures(None)
    pictures.size = size
    for box in ((0.2, 0.3), (0.3, 0.2), (1.0, 0.1), (0.1, 1.0)):
        scene = Scene(**{**SCENE, "size": box, "grains": []})
        fake: Any = SimpleNamespace(sim=SimpleNamespace(scene=scene), home=scene, chapter=None)
        wide, high = pictures._screen(fake).picture
        assert wide <= size[0] and high <= size[1]
        assert wide > 0.8 * size[0] - 10 or high > 0.8 * size[1] - 10


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_an_encoder_takes_pictures_of_one_size(tmp_path: Path, ending: str) -> None:
    with pytest.raises(SandError, match="16 x 32 pixels, and not 32 x 16"), WRITERS[ending](tmp_path / f"it{ending}", 10) as write:
        write(np.zeros((32, 16, 3), np.uint8))
        write(np.zeros((16, 32, 3), np.uint8))


def test_an_effect_that_paces_itself_is_switched_on_and_off(session: Session) -> None:
    """As water is offered to who pours some: it flows from then on, and time goes on without it."""
    before = session.digest()
    session.do(["choose", "water"])
    session.do(["stroke", "press", 0.1, 0.2, 0.0, 0.0])
    session.do(session.offer[1])
    assert not session.message and "water" in session.sim.effects
    session.advance(30)
    session.do(["stroke", "press", 0.1, 0.2, 0.0, 0.0])
    session.do(["stroke", "release", 0.1, 0.2, 0.0, 0.0])
    session.advance(30)
    assert not session.message and session.sim.due["water"] > session.sim.steps - 1
    session.do(["effect", "water", False])
    session.advance(30)
    assert not session.message and not session.sim.due
    for _ in range(3):
        session.do(["undo"])
    assert session.digest() == before


@pytest.mark.parametrize("part", [None, [0.02, 0.1, 0.12, 0.25]], ids=["all", "a part"])
def test_the_first_picture_is_that_of_the_scene(session: Session, part: list[float] | None) -> None:
    """What a window shows while kernels are compiled, drawn without any, is what it shows then."""
    scene = Scene(**{**SCENE, "walls": [{"points": [[0.05, 0.25], [0.15, 0.28]]}], "view": {"window": part}})
    session.do(["open", scene.to_json()])
    painter = Painter(session.sim.world, scene.size, 300, walls=wall_lines(session.sim), window=part)
    painted, drawn = painter.rgb(painter.paint()).astype(int), still(scene, pack(scene), (300, 450))
    drawn = np.stack([(drawn >> shift) & 255 for shift in (16, 8, 0)], axis=-1).astype(int)
    assert painted.shape == drawn.shape
    assert (np.abs(painted - drawn).max(axis=2) > 60).mean() < 0.05  # rims and spokes
    assert np.abs(painted.mean(axis=(0, 1)) - drawn.mean(axis=(0, 1))).max() < 6
    session.do(["undo"])


def test_what_can_be_undone_takes_no_more_memory_than_it_may() -> None:
    """Moments of 100000 grains, 40 MB each; the last is always kept."""

    def moment(megabytes: int) -> Snapshot:
        rows: Any = SimpleNamespace(rows=SimpleNamespace(nbytes=megabytes * 2**20))
        return Snapshot(None, {"x": rows}, None, ())  # type: ignore[arg-type]

    history = History()
    for _ in range(30):
        history.keep(moment(40))
        assert history.bytes() <= MOST_BYTES
    assert len(history.past) == 6
    history.keep(moment(400))
    assert len(history.past) == 1


def test_a_recording_in_which_scenes_change_becomes_a_film(session: Session, tmp_path: Path) -> None:
    """Scenes, a checkpoint, undoing: pictures of one size, that of the first, and the same bits. The last test of its session."""
    path, out = tmp_path / "it.record", tmp_path / "it.mp4"
    files.save(session, tmp_path / "it.npz")
    recorder = recording.Recorder(session, path)
    loaded = ["load", files.read(tmp_path / "it.npz")]
    for change in (["mark"], ["open", Scene(**OTHER).to_json()], ["undo"], ["redo"], loaded, ["undo"], ["undo"]):
        session.do(change)
        assert not session.message
        session.advance(10)
        recorder(session.take_log(), 10)
        recorder.started -= 0.25
    recorder.close()
    session.drop()  # so that what is done again finds its tables and kernels
    recording.film(path, str(out), fps=4, width=120, arch="cpu", threads=1)
    assert next(imageio_ffmpeg.read_frames(str(out)))["size"] == (120, 180)
    assert imageio_ffmpeg.count_frames_and_secs(str(out))[0] >= 7  # in the time that it took


class Wire(Server):
    """A server without a socket: what it takes waits for the loop."""

    def __init__(self) -> None:
        self.inputs, self.place, self.clients = queue.Queue(MOST_WAITING), None, [self]

    def publish(self, slot: str, data: str | bytes) -> None:
        """To nobody."""

    def say(self, *message: Any) -> None:
        """A message of the driver."""
        self._take(self, json.dumps(message))  # type: ignore[arg-type]


def test_strokes_of_a_page_keep_their_order(session: Session, tmp_path: Path) -> None:
    """Two walls drawn within one frame of the server keep their corners; however many moves come, there is room for what ends them."""
    wire = Wire()
    browser = Browser(session, "narrow", wire, tmp_path)
    session.sim.set_walls([])
    first = [[0.02, 0.22], [0.1, 0.28], [0.1, 0.22], [0.18, 0.28]]
    second = [[0.02, 0.12], [0.18, 0.12]]
    wire.say("key", "0")
    for points in (first, second):
        wire.say("press", *points[0], False)
        for place in points[1:-1]:
            wire.say("move", *place)
        wire.say("release", *points[-1])
    browser._inputs()
    assert [np.array(wall.points).tolist() for wall in session.sim.scene.walls] == [first, second]
    wire.say("press", *first[0], False)
    for k in range(2 * MOST_WAITING):
        wire.say("move", 0.02 + 1e-5 * k, 0.22)
    wire.say("cancel")
    assert wire.inputs.qsize() < MOST_WAITING
    browser._inputs()
    assert session.stroke is None


def test_typed_numbers_are_of_any_size_that_kernels_have(session: Session) -> None:
    """What is set can be recorded and read again; what is no number is told, not recorded."""
    commands = Commands(Face(), session)
    knob = Knob("tool.size", "brush", "tools", "m", "", 0.0, 1.0, most=math.inf)
    session.log = []
    for value in (math.inf, math.nan, 1e300):
        with pytest.raises(SandError, match="no value for brush"):
            commands.type_in(knob, value)
    assert session.log == []
    for value in (2e9, -1e29, 1e-300):
        assert is_action(["set", "solver.k_r", value]) and is_message(["value", "solver.k_r", value])
    for wrong in (math.inf, math.nan, 1e300, 10**400, True):
        assert not is_action(["set", "solver.k_r", wrong]) and not is_message(["value", "solver.k_r", wrong])
    session.log = None
