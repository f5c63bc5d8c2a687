"""Films as pages that play in a browser: every disc where the film has it, in its colour; nothing of a scene is code."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import browser, opened, until
from PIL import Image

import taichi_sand as sand
from taichi_sand.output.html import html
from taichi_sand.view.picture import image, painter_of
from taichi_sand.view.views import VIEWS

FPS, FRAMES, WIDTH = 20, 50, 360
HOSTILE = "</script><script>document.title='taken'</script><!-- <b>&amp;"
SCENE = {
    "title": HOSTILE,
    "size": [0.3, 0.4],
    "edges": {"left": "periodic", "right": "periodic", "bottom": "open"},
    "solver": {"kind": "rigid"},
    "grains": [
        {"shape": "2x1", "radius": [0.003, 0.004], "count": 60, "region": [0.0, 0.2, 0.3, 0.38], "spin": 9.0, "velocity": [0.6, 0.0]},
        {"radius": [0.004, 0.006], "count": 60, "region": [0.0, 0.05, 0.3, 0.2], "spin": -9.0, "velocity": [0.6, 0.0]},
        {"positions": [[0.15, 0.02]], "radius": 0.01, "fixed": True},
    ],
    "walls": [{"points": [[0.05, 0.1], [0.15, 0.06]], "shake": {"amplitude": [0.01, 0.0], "frequency": 2.0}}],
    "effects": {"friction": {"mu": 0.4}},
    "view": {"width": WIDTH, "caption": False},
}
"""Clumps and discs that fly around a periodic box and fall out of it, past one that is fixed and a wall that shakes."""


class Made:
    """A page, and what was in the simulation when each of its frames was written."""

    def __init__(self, path: Path) -> None:
        self.path, self.frames = path, []
        sim = sand.Simulation(sand.Scene(**SCENE), threads=1)
        with html(path, FPS) as write:
            for _ in range(FRAMES):
                sim.advance(1 / FPS)
                write(sim)
                self.frames.append(self.seen(sim))
        self.size = sim.scene.size
        self.report = sim.report()

    @staticmethod
    def seen(sim: sand.Simulation) -> dict[str, Any]:
        """Discs as the painter lists them: x, y (px, down), radius; the picture by kind and by speed."""
        painter, found = painter_of(sim), {}
        for color in ("kind", "speed"):
            painter.color = color
            found[color] = image(sim)
        count = int(painter._bands[:, 1].max(initial=0))
        return {**found, "discs": painter._discs[:count].copy(), "time": sim.time, "grains": sim.count}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Shared: it takes some seconds."""
    return Made(tmp_path_factory.mktemp("page") / "film.html")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """Shared."""
    with browser() as one:
        yield one


def test_discs_are_where_the_film_has_them(made: Made, chromium: Any) -> None:
    """Within half a pixel of the film; so that they may be half a pixel apart in any film, within a tenth in this small one."""
    with opened(chromium, f"{made.path.as_uri()}#t=0.1") as page:
        for number in (0, 1, 31, 32, 49):
            expected = made.frames[number]
            found = page.evaluate(
                """async at => { const film = sand; film.seek(at);
                while (film.busy) await new Promise(done => setTimeout(done, 10));
                const p = film.picture, n = p.now(), rows = p.listDiscs(n);
                return { time: p.frame.time, grains: p.frame.grains, rows: Array.from(p.place.subarray(0, 4 * rows)) }; }""",
                page.evaluate("k => sand.tail.series.at[k] + 1e-9", number),
            )
            assert found["time"] == pytest.approx(expected["time"]) and found["grains"] == expected["grains"]
            rows = np.array(found["rows"]).reshape(-1, 4)[:, :3] * (WIDTH / made.size[0])
            rows[:, 1] = painter_height(made) - rows[:, 1]
            wanted, shown = (inside(discs, painter_height(made)) for discs in (expected["discs"][:, :3], rows))
            assert len(wanted) > (100 if number < 2 else 0) and distances(wanted, rows).max() < 0.1
            assert distances(shown, expected["discs"][:, :3]).max() < 0.1


def painter_height(made: Made) -> int:
    """Of the film [px]."""
    return made.frames[0]["kind"].shape[0]


def inside(discs: np.ndarray, height: int) -> np.ndarray:
    """Those that reach into the picture."""
    centre, radius = discs[:, :2], discs[:, 2:]
    return discs[((centre > -radius) & (centre < np.array([WIDTH, height]) + radius)).all(axis=1)]


def distances(wanted: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """From every disc wanted (n, 3) to the nearest one that there is, its radius counted [px]."""
    return np.sqrt(((wanted[:, None] - rows[None]) ** 2).sum(axis=2)).min(axis=1)


@pytest.mark.parametrize("flat", [False, True], ids=["WebGL2", "canvas"])
def test_the_picture_is_that_of_the_film(flat: bool, made: Made, chromium: Any, tmp_path: Path) -> None:
    height = painter_height(made)
    with opened(chromium, f"{made.path.as_uri()}{'?flat' if flat else ''}#t=0.1", (WIDTH, height)) as page:
        assert page.evaluate("sand.picture.paint.constructor.name") == ("Flat" if flat else "Gl")
        page.add_style_tag(
            content="body { display: block } #bar, #panel, #caption, #scale, #badges { display: none !important } #stage { height: 100% }"
        )
        for number, view in ((2, "kind"), (6, "speed")):
            page.evaluate("([k, view]) => { sand.view(view); sand.seek(sand.tail.series.at[k] + 1e-9) }", [number, view])
            until(page, "!sand.busy && !sand.picture.stale")
            page.wait_for_timeout(200)
            page.screenshot(path=tmp_path / "shot.png")
            shot = np.asarray(Image.open(tmp_path / "shot.png").convert("RGB")).astype(int)
            assert shot.shape == (height, WIDTH, 3)
            wanted = made.frames[number][view].astype(int)
            assert wanted.std() > 8, number
            assert np.abs(shot - wanted).mean() < (0.1 if flat else 0.05) * wanted.std(), (np.abs(shot - wanted).mean(), wanted.std())


def test_nothing_of_a_scene_is_code(made: Made, chromium: Any) -> None:
    with opened(chromium, made.path.as_uri()) as page:
        until(page, "document.getElementById('title').textContent")
        assert page.title() == HOSTILE and page.inner_text("#title") == HOSTILE
        assert page.evaluate("document.querySelectorAll('#title *').length") == 0


def test_keys_links_and_pointer(made: Made, chromium: Any) -> None:
    with opened(chromium, f"{made.path.as_uri()}#t=1.5&view=speed") as page:
        assert page.evaluate("[sand.at, sand.playing, sand.picture.look.color]") == [1.5, False, "speed"]
        page.keyboard.press("ArrowRight")
        assert page.evaluate("sand.at") == pytest.approx(1.5 + 1 / FPS, abs=1e-3)
        page.keyboard.press("c")
        assert page.evaluate("sand.picture.look.chains") and "view=chains" in page.url
        page.keyboard.press("v")
        assert page.evaluate("sand.picture.look.color") == "kind"
        page.keyboard.press("Space")
        until(page, "sand.at > 1.7")
        page.keyboard.press("Space")
        assert not page.evaluate("sand.playing")
        page.evaluate("sand.seek(0.1)")
        until(page, "!sand.busy && !sand.picture.stale")
        x, y = page.evaluate("""() => { const p = sand.picture, k = p.frame.roster.fixed.indexOf(1), [left, low, scale] = p.map;
            return [(p.x[k] * scale + left) / p.ratio, (p.canvas.height - p.y[k] * scale - low) / p.ratio]; }""")
        page.mouse.move(x, y)
        until(page, "!document.getElementById('tip').hidden")
        assert re.match(r"grain \d+ · disc · fixed\nradius 10 mm", page.inner_text("#tip"))
        page.mouse.wheel(0, -240)
        until(page, "sand.picture.camera")
        zoom = page.evaluate("sand.picture.camera.zoom")
        assert zoom > 1.1 and page.evaluate("([x, y]) => sand.picture.under(sand.picture.point({ clientX: x, clientY: y }))", [x, y]) >= 0
        page.keyboard.press("Home")
        assert page.evaluate("sand.picture.camera") is None


MOIST = {
    "size": [0.2, 0.2],
    "grains": [{"radius": 0.005, "count": 80, "fill": "lattice"}, {"positions": [[0.1, 0.15]], "radius": 0.01, "fixed": True}],
    "effects": {"moisture": {}, "friction": {}},
    "view": {"width": WIDTH, "window": [0.05, 0.0, 0.15, 0.06]},
}


def test_wet_grains_are_darker_and_the_part_that_a_scene_shows_is_shown(chromium: Any, tmp_path: Path) -> None:
    """As dark as the painter has them, within what a level of colour and the steps of wetness in a film round."""
    sim = sand.Simulation(sand.Scene(**MOIST), threads=1)
    sim.wet(0.05, 0.02, 0.04, 0.2)
    image(sim)
    count, painter = sim.count, painter_of(sim)
    grain, packed = sim.world.grains.id.to_numpy()[:count], painter._colours[:count]
    expected = np.stack([(packed[np.argsort(grain)] >> shift) & 255 for shift in (16, 8, 0)], axis=1).astype(int)
    with html(tmp_path / "wet.html", FPS) as write:
        write(sim)
    with opened(chromium, f"{(tmp_path / 'wet.html').as_uri()}#t=0", (800, 600)) as page:
        found = page.evaluate(
            "(() => { const p = sand.picture, n = p.now(); return [Array.from(p.tints(n)), Array.from(p.dryTints(n))]; })()"
        )
        tints, dry = (np.stack([(np.array(one) >> shift) & 255 for shift in (0, 8, 16)], axis=1)[:count].astype(int) for one in found)
        assert np.abs(tints - expected).max() <= 3
        light = tints.sum(axis=1) / dry.sum(axis=1)
        assert light[-1] == 1 and light.min() < 0.65 and light[:-1].max() > light.min() + 0.1  # the last is fixed
        left, low, scale = page.evaluate("sand.picture.map")
        wide, high = page.evaluate("[sand.picture.canvas.width, sand.picture.canvas.height]")
        assert (0.5 * wide - left) / scale == pytest.approx(0.1) and (0.5 * high - low) / scale == pytest.approx(0.03)
        assert wide / scale >= 0.1 * (1 - 1e-6) and high / scale >= 0.06 * (1 - 1e-6)


def test_the_report_and_what_was_measured_are_in_it(made: Made) -> None:
    tail = json.loads(re.search(r'id="tail">(.*?)</script>', made.path.read_text("utf-8"))[1])
    assert tail["report"]["grains"] == made.report["grains"] and tail["report"]["steps"] == made.report["steps"]
    assert tail["series"]["grains"] == [frame["grains"] for frame in made.frames]
    assert made.frames[0]["grains"] > made.frames[-1]["grains"]  # some fell out
    assert sum(span[2] for span in tail["groups"]) == FRAMES


def test_every_view_of_a_page_has_its_colours() -> None:
    from taichi_sand.view.style import style

    assert {name for name, view in VIEWS.items() if view.stops} < set(style()["maps"])
