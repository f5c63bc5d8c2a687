"""Where things are in the window: nothing lies on anything else, whatever scene and view, and all can be read."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from taichi_sand.play import numbers
from taichi_sand.play.chapter import Chapter
from taichi_sand.play.knobs import knobs_of
from taichi_sand.play.tools import TOOLS
from taichi_sand.play.window import hud
from taichi_sand.play.window.arrange import arrange
from taichi_sand.play.window.panel import Panel
from taichi_sand.play.window.shape import Shape
from taichi_sand.play.window.sheet import LEAST_TEXT, Type
from taichi_sand.scene import loading
from taichi_sand.scene.schema import Scene
from taichi_sand.view import palette
from taichi_sand.view.caption import Caption
from taichi_sand.view.paint import Legend
from taichi_sand.view.text import LINE_SIZE, Placed
from taichi_sand.view.views import VIEWS, views_of

LAPTOP = (1366, 768)
CARRIED = {"moisture": "wetness", "heat": "temperature", "water": "water_wet"}
FLAGS = ["grain 17 was faster than 12.3 m/s and was slowed down at t = 1.23 s", "0.3 % of the contacts overlap by more than the tolerance"]
Rectangle = tuple[float, float, float, float]


def session_of(scene: Scene, color: str, tool: str = "create") -> Any:
    """What of a session is shown, without a simulation."""
    carried = SimpleNamespace(**{column: 0 for effect, column in CARRIED.items() if effect in scene.effects})
    world = SimpleNamespace(carried=carried, sleeps="sleeping" in scene.effects, linked="bonds" in scene.effects)
    sim = SimpleNamespace(scene=scene, world=world, over={"effects.friction.mu": -0.3}, count=12345)
    knobs = knobs_of(scene, scene)
    values = {knob.key: knob.home if knob.home is not None else knob.low for knob in knobs}
    found = SimpleNamespace(sim=sim, home=scene, speed=1.0, opened=True, tool=tool, brush=SimpleNamespace(kind=0))
    found.knobs, found.value = lambda: knobs, values.__getitem__
    found.unphysical = lambda: ["friction.mu = -0.3 (friction that pushes what slides gives energy)"]
    found.look = {**Chapter(scene).look, "color": color}
    return found


MEASURED = {
    **{"grains": 12345, "contacts": 34567, "asleep": 100, "lost": 3, "frames": 58.0, "real_time": 0.42, "overlap_mean": 0.0123},
    **{"overlap_p99": 0.0456, "overlap_max": 0.1234, "energy": 123.4, "power": -1.23e-3, "kinetic_energy_J": 1.23e-5, "flags": FLAGS},
    **{
        "stages": dict.fromkeys(("simulate", "paint", "hud", "panel", "measure", "show"), 0.0123),
        "given": [0.1234, 0.5678],
        "slowed": True,
    },
    "cost": 1.23,
}


def rectangles(tiles: Sequence[Placed], left: float = 0, top: float = 0) -> list[Rectangle]:
    """Left, top, right, bottom of each."""
    return [(left + x, top + y, left + x + tile.shape[1], top + y + tile.shape[0]) for x, y, tile in tiles]


def around(found: Sequence[Rectangle]) -> Rectangle:
    """What holds them all."""
    lefts, tops, rights, bottoms = zip(*found, strict=True)
    return min(lefts), min(tops), max(rights), max(bottoms)


def overlap(one: Rectangle, other: Rectangle) -> bool:
    """Whether they have a pixel in common."""
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


@pytest.mark.parametrize("text", [LEAST_TEXT, 18])
@pytest.mark.parametrize("name", list(loading.bundled()))
def test_nothing_lies_on_anything_else_on_a_laptop(name: str, text: int) -> None:
    """Caption, legend, scale bar, numbers, badges, message, what is offered, panel: of all views, with all there may be at a time."""
    scene, type = loading.load(name), Type.of(text)
    shape = Shape.of(scene.size, None, text, LAPTOP)
    assert shape.size[0] <= LAPTOP[0] and shape.size[1] <= LAPTOP[1] - 60
    for color in views_of(session_of(scene, "kind").sim.world):
        session = session_of(scene, color)
        caption = Caption(*shape.picture, shape.picture[0] / scene.size[0], text / LINE_SIZE)
        legend = Legend(color, VIEWS[color].unit if color in VIEWS else "N/m", 1.23e-5, palette.colour_map(palette.CHAIN))
        facts = ["t = 12.34 s", "opened at 1.23 s", "12345 grains", "rigid, tolerance 0.0005 d"]
        texts, scale = caption.parts(scene.title, facts, legend, [("#FFFFFF", 20.0, "0.5 m/s"), ("#FFFFFF", 12.0, "2 N")])
        badges = hud.badges(session, MEASURED, paused=False, filming=True, recording=True)
        told = "switch on moisture to wet grains: a sentence that is as long as sentences of the window may be, and then some"
        notices = hud.Notices(badges, told, "switch on moisture", shape.wide, shape.high, type)
        lines = hud.Numbers(numbers.lines(session, MEASURED), shape.wide, type)
        ends = max(bottom for *_, bottom in rectangles([*texts, *scale]))
        begin, room = arrange(shape.high, (shape.top, shape.top + shape.picture[1]), shape.top + ends, lines.height, notices.top)
        groups = {
            "caption": around(rectangles(texts, shape.left, shape.top)),
            "numbers": around(rectangles(lines.tiles(0, begin, room)) or [(0, 0, 0, 0)]),
            "notices": around(rectangles(notices.sheet.tiles)),
            "panel": (shape.wide, 0, shape.size[0], shape.high),
        }
        if scale:
            groups["scale"] = around(rectangles(scale, shape.left, shape.top))
        for one, first in groups.items():
            assert first[0] >= 0 and first[1] >= 0 and first[2] <= shape.size[0] and first[3] <= shape.high, (name, color, one, first)
            for other, second in groups.items():
                assert one == other or not overlap(first, second), (name, color, one, other, first, second)
        for tiles in (rectangles(texts), rectangles(notices.sheet.tiles[1::2])):
            for number, one in enumerate(tiles):
                assert not any(overlap(one, other) for other in tiles[:number]), (name, color)
        assert room >= lines.step or text > LEAST_TEXT, (name, color)


@pytest.mark.parametrize("text", [LEAST_TEXT, 18])
@pytest.mark.parametrize("tool", list(TOOLS))
def test_controls_of_the_panel_lie_beside_one_another(tool: str, text: int) -> None:
    """In the order of use, within the panel, all of them by scrolling; their texts within them."""
    for name in ("hourglass", *(name for name in loading.bundled() if len(loading.load(name).effects) > 3)):
        scene, type = loading.load(name), Type.of(text)
        shape = Shape.of(scene.size, None, text, LAPTOP)
        panel = Panel(shape.panel, shape.high, type)
        session = session_of(scene, "energy", tool)
        panel.compose(shape.size[0], session, MEASURED)
        seen = set()
        for _ in range(40):
            column = panel.compose(shape.size[0], session, MEASURED)
            zones = [zone for zone in panel.zones if zone.name != "scroll bar"]
            for number, zone in enumerate(zones):
                one = (zone.left, zone.top, zone.left + zone.width, zone.top + zone.height)
                assert one[0] >= shape.wide and one[2] <= shape.size[0], (name, zone)
                for other in zones[:number]:
                    assert not overlap(one, (other.left, other.top, other.left + other.width, other.top + other.height)), (zone, other)
                if zone.top >= 0 and one[3] <= shape.high:
                    seen.add(zone.name)
            for x, _, tile in column.sheet.tiles:
                assert x >= shape.wide and x + tile.shape[1] <= shape.size[0], (name, tile.shape)
            before = panel.scrolled
            panel.scroll(200)
            if panel.scrolled == before:
                break
        assert seen == {zone.name for zone in zones}
        order = [next(number for number, zone in enumerate(zones) if zone.name == first) for first in ("grab", "kind", "gravity x", "md")]
        assert order == sorted(order)


def test_three_sizes_of_text() -> None:
    assert Type.of() == (13, 15, 18) and min(Type.of(20)) == 20
