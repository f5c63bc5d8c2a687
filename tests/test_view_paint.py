"""The painter, pixel by pixel, on worlds made by hand."""

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from view_world import shift, start_taichi, world_of

from taichi_sand.errors import SandError
from taichi_sand.view import palette
from taichi_sand.view.camera import Camera
from taichi_sand.view.paint import Painter, picture_height
from taichi_sand.view.palette import SHOWN_RADIUS
from taichi_sand.view.views import HOLD, Range, quantile, views_of

GROUND = np.array(palette.rgb(palette.GROUND))


@pytest.fixture(autouse=True)
def taichi() -> None:
    start_taichi()


def painted(world: Any, width: int = 200, size: tuple[float, float] = (1.0, 1.0), **options: Any) -> np.ndarray:
    painter = Painter(world, size, width, **options)
    return painter.rgb(painter.paint()).astype(int)


def light_area(image: np.ndarray, colour: np.ndarray) -> float:
    """Pixels that `colour` covers on the ground, parts of pixels counted as such."""
    share = (image - GROUND) @ (colour - GROUND) / float((colour - GROUND) @ (colour - GROUND))
    return float(share.sum())


@pytest.mark.parametrize(("radius_px", "rows"), [(0.6, 10), (2.7, 8), (5.3, 5), (20.0, 3), (60.0, 1)])
def test_disc_covers_its_area(radius_px: float, rows: int) -> None:
    """Whatever part of a pixel its centre lies on."""
    column, row = np.meshgrid(np.arange(rows), np.arange(rows))
    offsets = np.random.default_rng(3).uniform(-0.01, 0.01, (rows * rows, 2))
    places = (np.stack([column.ravel(), row.ravel()], 1) + 0.5) / rows + offsets
    image = painted(world_of(places, radius_px / 200 / SHOWN_RADIUS, fixed=range(rows * rows)))
    area = light_area(image, np.array(palette.rgb(palette.FIXED))) / rows**2
    assert area == pytest.approx(math.pi * radius_px**2, rel=0.01)


def test_disc_lies_where_the_grain_is_y_up() -> None:
    image = painted(world_of([(0.25, 0.75)], 0.1, fixed=[0]))
    assert image.shape == (200, 200, 3)
    assert tuple(image[50, 50]) == palette.rgb(palette.FIXED)
    assert tuple(image[50 + 18, 50]) == palette.rgb(palette.FIXED)
    for row, column in ((150, 50), (50, 150), (50 + 22, 50), (50, 50 - 22)):
        assert tuple(image[row, column]) == palette.rgb(palette.GROUND)


def test_mirror_symmetry() -> None:
    """No direction is favoured: a disc in the middle looks the same from all sides."""
    image = painted(world_of([(0.5, 0.5)], 0.3, fixed=[0]))
    assert np.array_equal(image, image[::-1])
    assert np.array_equal(image, image[:, ::-1])
    assert np.array_equal(image, image.transpose(1, 0, 2))


def test_bands_leave_no_seams() -> None:
    """A disc over the whole picture is one flat colour, whatever band a column belongs to."""
    image = painted(world_of([(0.5, 0.5)], 1.0, fixed=[0]), width=333)
    assert (image == np.array(palette.rgb(palette.FIXED))).all()


def test_discs_beyond_the_picture_are_clipped() -> None:
    world = world_of([(0.0, 0.5), (0.5, 0.5), (0.5, 0.5), (0.5, 1.0)], 0.1, fixed=[0, 1, 2, 3])
    shift(world, 1, (0.55, 0.0))
    shift(world, 2, (4.5, -3.5))
    image = painted(world)
    fixed = palette.rgb(palette.FIXED)
    assert tuple(image[100, 0]) == tuple(image[100, 199]) == tuple(image[0, 100]) == fixed
    assert tuple(image[199, 0]) == palette.rgb(palette.GROUND)


def test_a_grain_that_is_nowhere_is_not_painted() -> None:
    world = world_of([(0.5, 0.5)] * 4, 0.1)
    for slot, place in enumerate(((math.nan, 0.5), (math.inf, 0.5), (1e30, -1e30), (0.5, -math.inf))):
        shift(world, slot, place)
    assert (painted(world) == GROUND).all()


def test_kinds_have_their_tones_and_grains_their_lightness() -> None:
    places = [(0.05 + 0.1 * (k % 10), 0.05 + 0.1 * (k // 10)) for k in range(100)]
    image = painted(world_of(places, 0.04, kind=[k // 50 for k in range(100)]), kinds=2)
    for kind in range(2):
        seen = np.array([image[round(200 - 200 * y), round(200 * x)] for x, y in places[50 * kind : 50 * kind + 50]])
        lightness = seen / np.array(palette.rgb(palette.KINDS[kind]))
        assert 0.92 < lightness.min() < 0.96 and 1.04 < lightness.max() < 1.08
        assert np.allclose(lightness, lightness[:, :1], atol=0.02)


def test_one_kind_has_all_tones() -> None:
    places = [(0.05 + 0.1 * (k % 10), 0.05 + 0.1 * (k // 10)) for k in range(100)]
    image = painted(world_of(places, 0.04))
    blue = [image[round(200 - 200 * y), round(200 * x), 2] for x, y in places]
    tones = [palette.rgb(tone)[2] for tone in palette.SAND]
    nearest = {int(np.argmin([abs(value - tone) for tone in tones])) for value in blue}
    assert nearest == {0, 1, 2, 3}


def test_spoke_turns_with_the_grain() -> None:
    """It points along the angle, counter-clockwise with y up; the rest of the disc is plain."""
    angles = (0.0, 1.0, math.pi / 2, 3.0, -2.0)
    image = painted(world_of([(0.5, 0.1 + 0.2 * k) for k in range(5)], 0.1, angle=angles), width=1000)
    for k, angle in enumerate(angles):
        ahead = np.array([math.cos(angle), -math.sin(angle)])

        def at(x: float, y: float, k: int = k, ahead: np.ndarray = ahead) -> np.ndarray:
            """Colour at a place within disc k, turned along with it, in radii."""
            column, row = np.array([499.5, 899.5 - 200 * k]) + 98.5 * (x * ahead + y * np.array([-ahead[1], ahead[0]]))
            return image[round(row), round(column)]

        plain = at(-0.5, 0.0)
        assert all(np.array_equal(at(*place), plain) for place in ((0.0, 0.5), (0.0, -0.5), (0.95, 0.0), (0.5, 0.17), (0.5, -0.17)))
        assert all(np.allclose(at(*place) / plain, 0.62, atol=0.01) for place in ((0.5, 0.0), (0.8, 0.0), (0.5, 0.1), (0.5, -0.1)))


def test_no_spoke_where_nothing_turns_or_a_number_is_shown() -> None:
    for world, options in ((world_of([(0.5, 0.5)], 0.4), {}), (world_of([(0.5, 0.5)], 0.4, angle=[0.0]), {"color": "speed"})):
        image = painted(world, **options)
        assert np.array_equal(image[100, 140], image[100, 60])


def test_walls_and_edges() -> None:
    walls = np.array([[0.2, 0.25, 0.8, 0.75]])
    image = painted(world_of([], []), width=720, walls=walls, edges=(True, False, True, False))
    fixed = palette.rgb(palette.FIXED)
    assert np.allclose(image[359:361, 359:361], fixed, atol=40)
    assert tuple(image[300, 0]) == tuple(image[719, 300]) == fixed
    assert tuple(image[300, 719]) == tuple(image[0, 300]) == palette.rgb(palette.GROUND)
    assert (image[60:130, 60:600] == GROUND).all()
    length = light_area(image[10:-10, 10:-10], np.array(fixed)) / 2.0
    assert length == pytest.approx(math.hypot(0.6, 0.5) * 720, rel=0.01)


def test_periodic_grain_is_seen_on_both_sides() -> None:
    image = painted(world_of([(0.01, 0.99)], 0.09, fixed=[0], periodic=(True, True)))
    assert light_area(image, np.array(palette.rgb(palette.FIXED))) == pytest.approx(math.pi * (18 * SHOWN_RADIUS) ** 2, rel=0.01)
    for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        assert tuple(image[corner]) == palette.rgb(palette.FIXED)


def test_force_chain_lies_between_the_centres() -> None:
    """Strong contacts are light and wide, weak ones dark and thin, untouched grains dim."""
    places = [(0.2, 0.5), (0.4, 0.5), (0.6, 0.5), (0.8, 0.5)]
    world = world_of(places, 0.1, pairs=[(0, 1, 100.0), (1, 2, 5.0), (2, 3, 0.0)], wall_pairs=[(3, (1.0, 0.0), 0.1, 100.0)])
    image = painted(world, force_chains=True)
    top = palette.rgb(palette.CHAIN[-1])
    assert np.allclose(image[100, 60], top, atol=2)
    assert np.allclose(image[100, 190], top, atol=2)
    weak = image[100, 100] + image[99, 100] - GROUND
    assert weak[0] > weak[2] + 20
    middle = image[100, 140]
    assert np.ptp(middle) < 20 and middle.max() < 80
    assert light_area(image[90:110, 50:70], np.array(top)) > 3 * light_area(image[90:110, 90:110], np.array(top))


def test_strong_force_is_on_top_whatever_the_order() -> None:
    places = [(0.3, 0.5), (0.7, 0.5), (0.5, 0.3), (0.5, 0.7)]
    for pairs in ([(0, 1, 100.0), (2, 3, 10.0)], [(0, 1, 10.0), (2, 3, 100.0)]):
        image = painted(world_of(places, 0.2, pairs=pairs), force_chains=True)
        assert np.allclose(image[100, 100], palette.rgb(palette.CHAIN[-1]), atol=2)


def test_force_over_a_periodic_edge_is_drawn_at_both() -> None:
    world = world_of([(0.05, 0.5), (0.95, 0.5)], 0.06, pairs=[(0, 1, 1.0)], periodic=(True, False))
    image = painted(world, force_chains=True)
    for column in (2, 197):
        assert np.allclose(image[100, column], palette.rgb(palette.CHAIN[-1]), atol=2)
    assert (image[100, 100] == GROUND).all()


def test_speed_runs_from_0_to_the_percentile() -> None:
    n = 200
    places = [(0.05 + 0.1 * (k % 10), 0.025 + 0.05 * (k // 10)) for k in range(n)]
    speeds = np.linspace(0.0, 2.0, n)
    speeds[-1] = 1e6
    world = world_of(places, 0.02, velocity=np.stack([0 * speeds, -speeds], 1))
    painter = Painter(world, (1.0, 1.0), 400, color="speed")
    image = painter.rgb(painter.paint())
    assert painter.legend is not None and painter.legend.unit == "m/s"
    assert painter.legend.top == pytest.approx(quantile(speeds, 0.99), rel=1e-5)
    stops = palette.INFERNO.split()
    assert np.allclose(image[390, 20], palette.rgb(stops[0]), atol=6)
    assert np.allclose(image[10, 380], palette.rgb(stops[-1]), atol=2)
    share = speeds[100] / painter.legend.top
    assert np.allclose(image[round(400 - 400 * places[100][1]), 20], palette.rgb(stops[round(16 * share)]), atol=20)


def test_fixed_grains_do_not_stretch_the_range() -> None:
    world = world_of([(0.2, 0.5), (0.6, 0.5)], 0.1, pairs=[(0, 1, 3.0)], wall_pairs=[(1, (1.0, 0.0), 0.0, 1000.0)], fixed=[1])
    painter = Painter(world, (1.0, 1.0), color="force")
    painter.paint()
    assert painter.legend is not None and painter.legend.top == pytest.approx(3.0)


def test_energy_has_the_colours_of_the_scene() -> None:
    world = world_of([(0.25, 0.5), (0.75, 0.5)], 0.1, velocity=[(0, 0), (2, 0)])
    image = painted(world, color="energy", cold="#102030", hot="#F0E0D0")
    assert tuple(image[100, 50]) == (0x10, 0x20, 0x30)
    assert tuple(image[100, 150]) == (0xF0, 0xE0, 0xD0)


def test_every_view_paints_an_empty_world_and_one_at_rest() -> None:
    empty, rest = world_of([], []), world_of([(0.5, 0.5)], 0.1)
    for color in views_of(empty):
        assert (painted(empty, color=color) == GROUND).all()
        assert not (painted(rest, color=color)[100, 100] == GROUND).all()


def test_unknown_view_is_refused_with_the_names() -> None:
    with pytest.raises(SandError, match=r"'sped'; did you mean `speed`.*kind, speed"):
        Painter(world_of([], []), (1.0, 1.0), color="sped")


def test_range_rises_at_once_and_falls_slowly() -> None:
    top = Range(least=0.01)
    assert top.follow(5.0, 0.0) == 5.0
    assert top.follow(7.0, 0.1) == 7.0
    assert top.follow(1.0, 0.1 + HOLD) == pytest.approx(7.0 / math.e)
    assert top.follow(0.0, 1000.0) == pytest.approx(0.07)
    assert top.follow(2.0, 0.0) == 2.0


def test_canvas_of_a_window_is_painted_in_place() -> None:
    painter = Painter(world_of([(0.5, 0.5)], 0.1, fixed=[0]), (1.0, 1.0), 100)
    screen = np.zeros(100 * 100, np.uint32)
    assert painter.paint(canvas=screen) is screen
    assert screen[50 * 100 + 50] == palette.packed(palette.FIXED)


@pytest.mark.parametrize("corner", [(0.0, 0.0), (0.3, 0.45)])
def test_a_window_is_a_part_of_the_picture_of_all(corner: tuple[float, float]) -> None:
    """Grains, contacts, walls and edges, as in a picture that is as many times as wide."""
    places = np.random.default_rng(5).uniform(0, 1, (60, 2))
    world = world_of(places, 0.05, kind=np.arange(60) % 3, pairs=[(k, k + 1, 1.0 + k) for k in range(59)])
    drawn: dict[str, Any] = {"walls": np.array([[0.2, 0.1, 0.7, 0.9]]), "edges": (True, True, True, True), "kinds": 3}
    for chains in (False, True):
        whole, part = (
            Painter(world, (1.0, 1.0), 400, force_chains=chains, **drawn),
            Painter(world, (1.0, 1.0), 400, force_chains=chains, **drawn),
        )
        part.look_at(Camera(*corner, 800.0))
        part.chain_widths = tuple(2 * width for width in whole.chain_widths)
        fine = Painter(world, (1.0, 1.0), 800, force_chains=chains, **drawn)
        left, top = round(800 * corner[0]), 800 - round(800 * corner[1]) - 400
        crop = fine.rgb(fine.paint()).astype(int)[top : top + 400, left : left + 400]
        shown = part.rgb(part.paint()).astype(int)
        off = np.abs(crop - shown).max(axis=2)
        assert (off > 60).mean() < 0.02 and (crop != GROUND).any()  # lines of walls are half as wide
        assert (np.abs(whole.rgb(whole.paint()).astype(int) - shown).max(axis=2) > 60).mean() > 0.2
    window = painted(world, 400, window=(*corner, corner[0] + 0.5, corner[1] + 0.5), kinds=3)
    again = Painter(world, (1.0, 1.0), 400, kinds=3)
    again.look_at(Camera(*corner, 800.0))
    assert (window == again.rgb(again.paint())).all()


def test_the_camera_zooms_at_a_point_moves_and_shows_nothing_but_the_box() -> None:
    home = Camera.of((0.0, 0.0, 2.0, 1.0), 400)
    place = home.place(300, 50, 200)
    near = home.zoomed(3.0, place)
    assert near.scale == 600 and near.place(300, 50, 200) == pytest.approx(place)
    assert near.pixels(np.array([place]), 200)[0] == pytest.approx((300, 50))
    assert near.within((2.0, 1.0), (400, 200), home.scale) == near
    assert near.zoomed(0.1, place).within((2.0, 1.0), (400, 200), home.scale) == home
    far = near.moved(10.0, -10.0).within((2.0, 1.0), (400, 200), home.scale)
    assert (far.x, far.y) == pytest.approx((2.0 - 400 / 600, 0.0))


def test_kinds_of_grains_differ_for_everybody() -> None:
    """Also for those who lack a sort of cones (simulated by Viénot and others 1999), and on both grounds."""
    colours = (np.array([palette.rgb(colour) for colour in palette.KINDS], float) / 255) ** 2.2
    lms = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]])
    blind = {"none": np.eye(3), "red": np.array([[0, 2.02344, -2.52581], [0, 1, 0], [0, 0, 1]])}
    blind["green"] = np.array([[1, 0, 0], [0.494207, 0, 1.24827], [0, 0, 1]])
    for seen in blind.values():
        shown = np.clip(colours @ (np.linalg.inv(lms) @ seen @ lms).T, 0, 1) ** (1 / 2.2) * 255
        apart = np.hypot(*(shown[:, None, :2] - shown[None, :, :2]).transpose(2, 0, 1)) + np.abs(shown[:, None, 2] - shown[None, :, 2])
        assert apart[np.triu_indices(6, 1)].min() > 35, apart
    for ground in palette.GROUNDS.values():
        assert min(np.abs(np.subtract(palette.rgb(colour), palette.rgb(ground.colour))).max() for colour in palette.KINDS) > 60


def test_a_light_ground() -> None:
    image = painted(world_of([(0.5, 0.5)], 0.1, fixed=[0]), ground="light")
    assert tuple(image[5, 5]) == (255, 255, 255) and tuple(image[100, 100]) == palette.rgb(palette.FIXED)


@pytest.mark.parametrize(("size", "width", "height"), [((0.4, 0.8), 720, 1440), ((3.0, 1.0), 100, 34), ((1.0, 1e-6), 100, 2)])
def test_height_follows_from_the_size_and_is_even(size: tuple[float, float], width: int, height: int) -> None:
    assert picture_height(size, width) == height


def test_a_picture_that_no_one_could_look_at_is_refused() -> None:
    with pytest.raises(SandError, match=r"view\.width: 720 makes the picture 7200000 pixels high"):
        picture_height((1e-3, 10.0), 720)


PICTURES = """
import hashlib, sys
import taichi_sand as sand
from taichi_sand.view.picture import image, painter_of
scene = sand.load("settle", ["view.width=360"])
sim = sand.Simulation(scene, threads=int(sys.argv[1]))
sim.advance(0.4)
painter = painter_of(sim)
for color in ("kind", "speed", "energy", "force", "pressure", "rotation", "order"):
    painter.color = color
    print("picture", color, hashlib.sha256(image(sim).tobytes()).hexdigest())
painter.force_chains = True
print("picture chains", hashlib.sha256(image(sim).tobytes()).hexdigest())
"""


def test_pictures_do_not_depend_on_the_number_of_threads() -> None:
    run = [subprocess.run([sys.executable, "-c", PICTURES, threads], check=True, capture_output=True, text=True) for threads in "12"]
    hashes = [[line for line in one.stdout.splitlines() if line.startswith("picture")] for one in run]
    assert len(hashes[0]) == 8
    assert hashes[0] == hashes[1]
