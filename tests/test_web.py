"""The session in a browser: what the page does is done to the session, and nobody who misbehaves is noticed."""

import base64
import io
import json
import math
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from browser import browser, opened, until
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import taichi_sand as sand
from taichi_sand.play import recording
from taichi_sand.play.tools import TOOLS
from taichi_sand.play.web import described
from taichi_sand.play.web.messages import MESSAGES, is_message
from taichi_sand.play.web.server import Server
from taichi_sand.scene import loading

client = pytest.importorskip("websockets.sync.client", reason="plays in a browser need the library websockets")

SCENE = """
title = "Box <b>of</b> discs"
about = "For tests."
size = [0.3, 0.4]
grains = [{ radius = [0.006, 0.008], count = 150, fill = "lattice", region = [0.0, 0.0, 0.3, 0.25] }]
effects = { friction = { mu = 0.4 } }
"""
PATIENCE = 60.0


class Served:
    """`taichi-sand play --web` in a process of its own."""

    def __init__(self, folder: Path, *arguments: str, scene: str = SCENE) -> None:
        (folder / "box.toml").write_text(scene, "utf-8")
        command = [
            sys.executable,
            "-m",
            "taichi_sand",
            "play",
            str(folder / "box.toml"),
            "--web",
            "--folder",
            str(folder),
            "--threads",
            "1",
        ]
        environment = {**os.environ, "PYTHONPATH": str(Path(sand.__file__).parents[1])}
        self.process = subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
        assert self.process.stdout
        line = self.process.stdout.readline()
        found = re.fullmatch(r"open (http://127\.0\.0\.1:(\d+)/\?token=(\S+))\n", line)
        assert found, line + self.process.communicate()[1]
        self.url, self.port, self.token = found[1], int(found[2]), found[3]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()

    def connect(self, **options: Any) -> Any:
        """Somebody else's page."""
        given = {"origin": f"http://127.0.0.1:{self.port}", "compression": None, "max_size": None, "open_timeout": PATIENCE, **options}
        return client.connect(f"ws://127.0.0.1:{self.port}/socket?token={self.token}", **given)

    def status(self, path: str, **headers: str) -> int:
        """Of the answer to a request."""
        try:
            with urlopen(Request(f"http://127.0.0.1:{self.port}{path}", headers=headers), timeout=PATIENCE) as answer:
                return answer.status
        except HTTPError as error:
            return error.code

    def memory(self) -> float:
        """What the process holds [MB]."""
        return int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


class Watcher:
    """A page without a browser."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.role, self.state, self.frame = socket, "", {}, {}

    def until(self, condition: Any, seconds: float = PATIENCE) -> None:
        """Takes and answers messages until something holds."""
        end = time.monotonic() + seconds
        while not condition(self):
            assert time.monotonic() < end
            self.take()

    def take(self) -> None:
        """One message."""
        data = self.socket.recv(timeout=PATIENCE)
        self.socket.send('["ack"]')
        if isinstance(data, str):
            told = json.loads(data)
            self.role, self.state = told.get("role", self.role), told.get("state", self.state)
            return
        (length,) = struct.unpack("<I", data[:4])
        head = json.loads(data[4 : 4 + length])
        if head["kind"] == "frame":
            self.frame = head

    def say(self, *words: Any) -> None:
        """A message."""
        self.socket.send(json.dumps(words))


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Shared: it takes some seconds to compile."""
    with Served(tmp_path_factory.mktemp("web")) as one:
        yield one


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """Shared."""
    with browser() as one:
        yield one


def test_who_has_no_token_or_comes_from_another_page_is_refused(served: Served) -> None:
    assert served.status(f"/?token={served.token}") == 200
    assert served.status(f"/other?token={served.token}") == 404
    for path in ("/", "/?token=", f"/?token={served.token}x", "/?token=%00", "/socket", f"/socket?token={served.token[:-1]}"):
        assert served.status(path) == 403, path
    assert served.status(f"/?token={served.token}", Host="evil.example") == 403  # a name that somebody made to lead here
    for origin in ("http://evil.example", f"http://127.0.0.1:{served.port + 1}", None):
        with pytest.raises(Exception, match="403"), served.connect(origin=origin):
            pass


def test_one_drives_and_others_watch(served: Served) -> None:
    with served.connect() as first:
        driver = Watcher(first)
        driver.until(lambda one: one.role == "drive" and one.state and one.frame)
        with served.connect() as second:
            other = Watcher(second)
            other.until(lambda one: one.role == "watch" and one.frame)
            other.say("key", " ")
            other.say("do", ["choose", "pour"])
            time.sleep(0.5)
            driver.until(lambda one: one.frame["time"] > other.frame["time"])
            assert driver.state["tool"] == "grab" and not driver.state["paused"]
            first.close()
            other.until(lambda one: one.role == "drive")
            other.say("do", ["choose", "pour"])
            other.until(lambda one: one.state["tool"] == "pour")
            other.say("do", ["choose", "grab"])
            other.until(lambda one: one.state["tool"] == "grab")


WRONG = [
    *(
        "",
        "[",
        "null",
        "{}",
        '"ack"',
        "[[]]",
        '["fly"]',
        '["press", 1, 2]',
        '["press", "a", 2, true]',
        '["press", 1e999, 0, true]',
        '["press", NaN, 0, true]',
    ),
    *(
        '["key", 7]',
        '["grow", 1.5]',
        '["grow", true]',
        '["do", ["open", "{}"]]',
        '["do", ["load", "xx"]]',
        '["do", ["look", "hud", 3]]',
        '["do"]',
    ),
    *(
        '["do", ["look", "color", "nothing"]]',
        '["do", ["effect", "nothing", true]]',
        '["do", ["look", "cold", "red"]]',
        '["slide", "nothing", 0.5]',
    ),
    *(
        '["take", "__class__"]',
        '["scene", "../../etc/passwd"]',
        '["scene", "/etc/passwd"]',
        '["upload", "x.npz", -1]',
        '["upload", "x.npz", 1000000000000]',
    ),
    *(
        '["gone"]',
        '["file", "x", "y"]',
        '["slide", "gravity.0", 1e308]',
        '["value", "gravity.0", -1e9]',
        "[" * 100_000,
        "9" * 100_000,
        b"\x00\xff" * 1000,
    ),
]


def test_messages_that_are_none_do_nothing(served: Served) -> None:
    with served.connect() as connection:
        one = Watcher(connection)
        one.until(lambda one: one.role == "drive" and one.state)
        for message in WRONG:
            connection.send(message)
        for name, data in (("x.npz", b"PK\x03\x04" + b"no archive" * 50), ("x.toml", b"size = 7"), ("x.toml", b"\xff"), ("x.exe", b"MZ")):
            one.say("upload", name, len(data))
            connection.send(data)
        one.say("do", ["choose", "stir"])
        one.until(lambda one: one.state["tool"] == "stir")
        assert one.state["look"]["color"] == "kind" and one.state["effects"] == ["friction"] and one.state["look"]["hud"] is True
        one.say("do", ["choose", "grab"])
        one.say("key", "r")
        one.until(lambda one: one.state["tool"] == "grab")
    with served.connect() as connection:
        connection.send("x" * 2**20)  # larger than any message: the connection is closed, no more
        with pytest.raises(Exception, match="1009"):
            for _ in range(1000):
                connection.recv(timeout=PATIENCE)
    assert served.process.poll() is None


def test_clients_that_stall_or_vanish_are_not_noticed(served: Served) -> None:
    """Fifty of them: the simulation goes on as fast, memory stays, the server takes little of a core."""

    def pace(one: Watcher, seconds: float) -> tuple[float, float]:
        """Simulated and CPU time of the thread of the server, over the time that passed."""
        one.take()
        start, simulated, spent = time.monotonic(), one.frame["time"], one.state["serving_s"]
        one.until(lambda one: time.monotonic() - start > seconds)
        passed = time.monotonic() - start
        return (one.frame["time"] - simulated) / passed, (one.state["serving_s"] - spent) / passed

    with served.connect() as connection:
        one = Watcher(connection)
        one.until(lambda one: one.role == "drive" and one.frame and one.state)
        alone, _ = pace(one, 2.0)
        before = served.memory()
        lost: list[Any] = []
        for number in range(50):
            raw = socket.create_connection(("127.0.0.1", served.port))
            lost.append(raw)
            if number % 3 == 0:  # half a handshake
                raw.send(b"GET /socket HTTP/1.1\r\nHost: ")
                continue
            host = (
                f"Host: 127.0.0.1:{served.port}\r\nOrigin: http://127.0.0.1:{served.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            )
            key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
            raw.send(f"GET /socket?token={served.token} HTTP/1.1\r\n{host}{key}\r\n".encode())
            if number % 3 == 1:  # reads nothing, answers nothing
                continue
            assert raw.recv(12) == b"HTTP/1.1 101"  # goes without a word
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            raw.close()
        crowded, share = pace(one, 4.0)
        grown = served.memory() - before
        for raw in lost:
            raw.close()
        print(f"{crowded / alone:.2f} times as fast, {grown:.1f} MB more, {100 * share:.1f} % of a core")
        assert crowded > 0.5 * alone, (crowded, alone)
        assert grown < 30, grown
        assert share < 0.1, share
    assert served.process.poll() is None


def test_only_messages_are_messages() -> None:
    assert is_message(["press", 0.1, 0.2, False]) and is_message(["key", " "]) and is_message(["do", ["choose", "pour"]])
    for wrong in (
        ["press", 0.1, 0.2, 1],
        ["press", True, 0.2, False],
        ["key", "x" * 1000],
        ["do", ["open", "{}"]],
        ["do", "choose"],
        [],
        None,
    ):
        assert not is_message(wrong)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.sampled_from([*MESSAGES, "do"]),
    lambda inner: st.lists(inner, max_size=6) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
)


@given(JSON)
def test_what_is_taken_for_a_message_is_a_list_of_known_words_and_finite_numbers(said: Any) -> None:
    """Whatever JSON comes, it is a message or not, and nothing goes wrong."""
    if is_message(said):
        verb, *given = said
        assert verb == "do" or len(given) == len(MESSAGES[verb])
        assert all(math.isfinite(value) for value in given if isinstance(value, float))


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    with pytest.raises(sand.SandError, match=r"pip install 'taichi-sand\[web\]'"):
        Server(b"", "127.0.0.1", 0)


def test_an_address_that_cannot_be_had_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(sand.SandError, match=rf"--port {port}: cannot be served: .*in use"):
            Server(b"", "127.0.0.1", port)


def test_small_pictures_are_of_scenes() -> None:
    """Those that the page lists; `python docs/thumbnails.py` makes them of renders/."""
    listed = {name: picture for name, _, _, picture in described.scenes()}
    assert set(listed) == set(loading.bundled())
    shown = {name: data.partition(",")[2] for name, data in listed.items() if data}
    files = (Path(sand.__file__).parent / "view" / "page" / "scenes").glob("*.webp")
    assert len(shown) >= 30 and {path.stem for path in files} == set(shown)
    for name, data in shown.items():
        with Image.open(io.BytesIO(base64.b64decode(data))) as picture:
            assert picture.size == (168, 112), name


def test_played_in_a_browser_and_done_again(chromium: Any, tmp_path: Path) -> None:
    """Tools, sliders, views, undo and keys by mouse and keyboard; what was recorded gives the same bits when it is done again."""
    with Served(tmp_path, "--record", str(tmp_path / "it.record")) as served:
        with opened(chromium, served.url, ready="window.sand && sand.newest && sand.state") as page:
            assert page.inner_text("#title") == "Box <b>of</b> discs"
            for name in TOOLS:
                assert page.get_by_role("button", name=name).count() >= 1, name
            page.get_by_role("button", name="pour").click()
            until(page, "sand.state.tool === 'pour'")
            box = page.locator("#canvas").bounding_box()
            x, y = box["x"] + box["width"] / 2, box["y"] + 0.15 * box["height"]
            before = page.evaluate("sand.newest.grains")
            page.mouse.move(x, y)
            page.mouse.down()
            until(page, f"sand.newest.grains > {before}")
            page.mouse.move(x + 40, y, steps=4)
            page.mouse.up()
            until(page, "sand.newest.path === undefined")
            page.keyboard.press("z")
            until(page, f"sand.newest.grains === {before} && sand.state.redo > 0")
            page.keyboard.press("v")
            until(page, "sand.picture.look.color === 'speed' && sand.newest.shades.speed.length === sand.newest.x.length")
            slider = page.get_by_role("slider", name="gravity x m/s2")
            slider.focus()
            page.keyboard.press("End")
            until(page, "sand.state.values['gravity.0'][3] === 20")
            page.get_by_role("button", name="chains").click()
            until(page, "sand.picture.look.chains && sand.newest.chains && sand.newest.chains.first.length > 10")
            page.keyboard.press("Space")
            until(page, "sand.state.paused")
            with page.expect_download() as download:
                page.get_by_role("button", name="scene file").click()
            assert sand.load(download.value.path().rename(tmp_path / "there.toml")).gravity == (20.0, -9.81)
            with page.expect_download() as download:
                page.keyboard.press("s")
            assert download.value.suggested_filename == "box.npz" and (tmp_path / "box.npz").is_file()
            page.keyboard.press("r")
            until(page, "sand.state.values['gravity.0'][3] === 0")
            page.set_input_files("input[type=file]", tmp_path / "box.npz")
            until(page, "sand.state.values['gravity.0'][3] === 20")
            page.keyboard.press("Space")
            until(page, "!sand.state.paused")
        served.process.send_signal(signal.SIGTERM)
        assert served.process.wait(30) == 143
    path = tmp_path / "it.record"
    hashes = sum(b'"hash"' in line for line in path.read_bytes().splitlines())
    assert hashes > 2
    *_, (session, _) = recording.replay(recording.read(path), path, "cpu", 2)
    assert session.sim.scene.gravity[0] == 20.0


def test_touch_and_a_small_screen(served: Served, chromium: Any) -> None:
    """One finger is the tool, two pan and zoom; nothing is wider than the screen."""
    with opened(chromium, served.url, (390, 844), ready="window.sand && sand.newest && sand.state", has_touch=True, is_mobile=True) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert page.evaluate(
            "[...document.querySelectorAll('#panel button:not([hidden])')].every(b => b.getBoundingClientRect().right <= 390)"
        )
        until(page, "sand.role === 'drive'")
        page.evaluate("sand.do('choose', 'pour')")
        until(page, "sand.state.tool === 'pour'")
        before = page.evaluate("sand.newest.grains")
        touch = page.context.new_cdp_session(page)

        def fingers(kind: str, *places: tuple[float, float]) -> None:
            touch.send(
                "Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]}
            )

        fingers("touchStart", (195, 120))
        until(page, f"sand.newest.grains > {before}")
        fingers("touchEnd")
        until(page, "sand.newest.path === undefined")
        assert page.evaluate("sand.picture.camera") is None
        fingers("touchStart", (150, 200), (240, 200))
        fingers("touchMove", (120, 200), (270, 200))
        fingers("touchMove", (100, 220), (290, 220))
        fingers("touchEnd")
        assert page.evaluate("sand.picture.camera.zoom") > 1.5
        page.evaluate("sand.say('key', 'r')")


TALL = """
title = "Tower"
size = [0.2, 0.2]
grains = [{ positions = [[0.1, 0.01], [0.1, 0.03], [0.1, 0.05]], radius = 0.01, density = 1000.0 }]
"""


def test_what_a_teacher_wants_beside_the_picture(chromium: Any, tmp_path: Path) -> None:
    """A grain is inspected and followed, a ruler laid, plots chosen, time wound back; what is not shown is not sent."""

    def at(page: Any, x: float, y: float) -> list[float]:
        return page.evaluate(
            """([x, y]) => { const p = sand.picture, [left, low, scale] = p.map;
            return [(x * scale + left) / p.ratio, (p.canvas.height - y * scale - low) / p.ratio]; }""",
            [x, y],
        )

    with Served(tmp_path, scene=TALL) as served, opened(chromium, served.url, ready="window.sand && sand.newest && sand.state") as page:
        until(page, "sand.role === 'drive'")
        assert page.evaluate("[sand.state.watched.grain, sand.state.watched.line, sand.state.rewind]") == [None, None, None]
        page.get_by_role("button", name="rewind").click()
        page.keyboard.press("k")
        until(page, "sand.newest.time > 0.6")
        page.mouse.click(*at(page, 0.1, 0.03))
        until(page, "sand.state.watched.grain?.id === 1 && sand.state.watched.grain.contacts.length === 2")
        weight = 9.81 * 1000 * math.pi * 0.01**2
        forces = page.evaluate("Object.fromEntries(sand.state.watched.grain.contacts.map(one => [one.with, one.force[1]]))")
        assert forces == pytest.approx({"grain 0": 2 * weight, "grain 2": -weight}, rel=0.03)
        assert "moment of inertia" in page.inner_text("#panel") and "grain 0: " in page.inner_text("#panel")
        page.get_by_role("button", name="follow").click()
        until(page, "sand.picture.camera && Math.abs(sand.picture.camera.y - 0.03) < 1e-3 && sand.picture.camera.zoom === 3")
        page.get_by_role("button", name="forget").click()
        until(page, "!sand.state.watched.grain && !sand.follow")
        page.keyboard.press("Home")
        grains = page.evaluate("sand.newest.grains")
        page.keyboard.press("'")
        page.mouse.move(*at(page, 0.02, 0.1))
        page.mouse.down()
        page.mouse.move(*at(page, 0.12, 0.2), steps=4)
        page.mouse.up()
        until(page, "sand.state.watched.line?.ends[2] > 0.119 && !document.getElementById('ruler').hidden")
        rows = dict(page.evaluate("sand.state.watched.line.rows"))
        assert float(rows["angle"].split()[0]) == pytest.approx(45, abs=1)
        assert float(rows["length"].split()[0]) == pytest.approx(0.1414, abs=0.002)
        page.keyboard.press("Escape")
        assert page.evaluate("sand.mode") == "" and page.evaluate("sand.newest.grains") == grains
        assert page.evaluate("sand.state.plots") == ["floor", "kinetic"]
        page.get_by_role("group", name="plots").get_by_role("button", name="depth").click()
        until(page, "sand.state.plots.length === 3 && sand.state.watched.plots.depth?.[1].length > 0 && !sand.state.watched.plots.order")
        until(page, "sand.state.rewind.length > 2")
        page.keyboard.press("Space")
        until(page, "sand.state.paused")
        slider = page.get_by_role("slider", name="rewind to")
        slider.focus()
        page.keyboard.press("Home")
        until(page, "Math.abs(sand.newest.time - sand.state.rewind[0]) < 1e-5")
        page.keyboard.press("z")
        until(page, "sand.newest.time > 1")
