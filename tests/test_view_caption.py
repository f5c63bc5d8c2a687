"""The caption: what it says, where it stands, and that it can be read."""

import numpy as np
import pytest
from view_world import start_taichi

import taichi_sand as sand
from taichi_sand.view import caption, palette
from taichi_sand.view.paint import Legend
from taichi_sand.view.picture import facts, image, wall_lines

GROUND = palette.packed(palette.GROUND)


@pytest.fixture(autouse=True)
def taichi() -> None:
    start_taichi()


def drawn(width: int = 720, height: int = 300, scale: float = 720.0, ground: int = GROUND, **parts) -> np.ndarray:
    canvas = np.full(width * height, ground, np.uint32)
    words = {"title": "Hourglass", "facts": ["t = 0.75 s", "3000 grains", "rigid, tolerance 0.02 d"], "legend": None} | parts
    caption.Caption(width, height, scale).draw(canvas, **words)
    return canvas.reshape(height, width)


@pytest.mark.parametrize(
    ("longest", "length", "text"),
    [
        (0.13, 0.1, "10 cm"),
        (0.2, 0.2, "20 cm"),
        (7.0, 5.0, "5 m"),
        (0.0049, 0.002, "2 mm"),
        (3000, 2000, "2 km"),
        (1.5e-4, 1e-4, "0.1 mm"),
    ],
)
def test_scale_bar_has_round_units(longest: float, length: float, text: str) -> None:
    assert caption.round_length(longest) == pytest.approx(length)
    assert caption.length_text(caption.round_length(longest)) == text


def test_scale_bar_is_as_long_as_it_says() -> None:
    canvas = drawn(scale=600.0, title="", facts=[])
    bar = canvas == palette.packed(palette.TEXT)
    rows = np.flatnonzero(bar.any(1))
    columns = np.flatnonzero(bar[rows[0]])
    assert len(columns) == 0.1 * 600 and len(rows) == 2
    assert columns[0] > 360 and 720 - columns[-1] < 40


def test_text_stands_at_the_upper_left() -> None:
    changed = drawn() != GROUND
    assert changed[:60, :300].any()
    assert not changed[80:].any()
    assert not changed[:, 400:600].any()


def test_facts_wrap_in_a_narrow_picture() -> None:
    wide, narrow = drawn(width=400, scale=400.0) != GROUND, drawn(width=150, scale=150.0) != GROUND
    assert np.flatnonzero(narrow.any(1))[-1] > np.flatnonzero(wide.any(1))[-1] + 10
    assert not narrow[:, 149].any()


def test_a_tiny_picture_does_no_harm() -> None:
    assert drawn(width=16, height=8).shape == (8, 16)


def test_legend_shows_the_map_and_its_ends() -> None:
    colours = palette.colour_map(palette.VIRIDIS)
    canvas = drawn(legend=Legend("speed", "m/s", 4.04, colours))
    for colour in (colours[0], colours[-1]):
        assert (canvas == colour).any()


def test_text_over_bright_grains_can_be_read() -> None:
    """Under the text the picture is dimmed towards the ground."""
    bright = palette.packed(palette.SAND[0])
    under = drawn(ground=bright)[:60, 20:200]
    assert np.median(under >> 16) < 0x60
    assert drawn(ground=bright)[200, 100] == bright


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (4.0449, "4.04"), (20312.0, "20300"), (0.0123, "0.0123"), (3.03e-6, "3.0e-6"), (1.25e7, "1.2e7")],
)
def test_numbers(value: float, text: str) -> None:
    assert caption.number_text(value) == text


def test_same_words_same_bits() -> None:
    assert np.array_equal(drawn(), drawn())


@pytest.fixture(scope="module")
def sim() -> sand.Simulation:
    edges = {"left": "wall", "right": "open", "bottom": "wall", "top": "open"}
    walls = [{"points": [(0, 0.2), (0.1, 0.1), (0.2, 0.1)], "closed": True}]
    grains = [{"positions": [(0.5, 0.25)], "radius": 0.05}]
    return sand.Simulation(sand.Scene(title="One", size=(1.0, 0.5), edges=edges, walls=walls, grains=grains, view={"width": 400}))


def test_picture_of_a_simulation(sim: sand.Simulation) -> None:
    picture = sim.image()
    assert picture.shape == (200, 400, 3) and picture.dtype == np.uint8 and picture.flags.c_contiguous
    assert facts(sim) == ["t = 0.00 s", "1 grain", "rigid, tolerance 0.02 d"]
    assert np.array_equal(picture, image(sim))
    assert tuple(picture[100, 0]) == palette.rgb(palette.FIXED)
    assert tuple(picture[100, 399]) == palette.rgb(palette.GROUND)


def test_walls_of_a_closed_polyline_close(sim: sand.Simulation) -> None:
    assert wall_lines(sim).tolist() == [[0, 0.2, 0.1, 0.1], [0.1, 0.1, 0.2, 0.1], [0.2, 0.1, 0, 0.2]]
