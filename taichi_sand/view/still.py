"""A scene as it is packed, as a picture that needs no Taichi: what a window shows while kernels are compiled."""

import numpy as np
from PIL import Image, ImageDraw

from taichi_sand.scene.grains import Pack
from taichi_sand.scene.schema import Scene
from taichi_sand.view import palette
from taichi_sand.view.camera import Camera

FINE, FINEST = 2, 8000
"""Pictures of so many discs at most are drawn so much larger, and shrunk, which smooths them."""


def tones(packed: Pack, kinds: int) -> np.ndarray:
    """Colour of every grain, (n, 3) uint8, as the painter chooses it by kind and id."""
    number = np.arange(len(packed), dtype=np.uint32)
    bits = number * np.uint32(2654435761)
    bits = (bits ^ (bits >> np.uint32(15))) * np.uint32(2246822519)
    bits ^= bits >> np.uint32(13)
    table = np.array([palette.rgb(tone) for tone in (palette.SAND if kinds == 1 else palette.KINDS)], float)
    chosen = (bits & np.uint32(3)).astype(int) if kinds == 1 else packed.kind % len(table)
    spread = ((bits >> np.uint32(8)) & np.uint32(0xFFFF)) / 32767.5 - 1
    colours = np.minimum(255, table[chosen] * (1 + palette.LIGHTNESS_SPREAD * spread[:, None]) + 0.5)
    colours[packed.fixed] = palette.rgb(palette.FIXED)
    return colours.astype(np.uint8)


def still(scene: Scene, packed: Pack, picture: tuple[int, int]) -> np.ndarray:
    """A picture of the grains and walls of a scene as they are at its start, or of the part that its [view] shows, (height, width) u32
    0x00RRGGBB.
    """
    parts = [form.discs for form in packed.forms] or [np.array([[0.0, 0.0, 1.0]])]
    fine = FINE if len(packed) * max(len(discs) for discs in parts) <= FINEST else 1
    width, height = (fine * side for side in picture)
    image = Image.new("RGB", (width, height), palette.GROUNDS[scene.view.ground].colour)
    draw, camera = ImageDraw.Draw(image), Camera.shown(scene.view.window, scene.size, (width, height))
    turn = np.stack([np.cos(packed.angle), np.sin(packed.angle)], axis=1)
    colours = [tuple(colour) for colour in tones(packed, max(1, len(scene.grains) + len(scene.sources))).tolist()]
    for kind, discs in enumerate(parts):
        of = np.flatnonzero(packed.kind == kind)
        for x, y, r in np.asarray(discs, float)[:, :3]:
            arm = np.stack([x * turn[of, 0] - y * turn[of, 1], x * turn[of, 1] + y * turn[of, 0]], axis=1)
            centre = camera.pixels(packed.position[of] + packed.radius[of, None] * arm, height)
            radius = np.maximum(0.5, packed.radius[of] * r * camera.scale * palette.SHOWN_RADIUS)[:, None]
            boxes = np.column_stack([centre - radius, centre + radius])
            for box, number in zip(boxes.tolist(), of.tolist(), strict=True):
                draw.ellipse(box, fill=colours[number])
    for wall in scene.walls:
        points = [*wall.points, *(wall.points[:1] if wall.closed else ())]
        draw.line(list(map(tuple, camera.pixels(np.array(points), height).tolist())), fill=palette.FIXED, width=2 * fine)
    found = np.asarray(image.resize(picture, Image.Resampling.BOX) if fine > 1 else image, np.uint32)
    return (found[..., 0] << 16) | (found[..., 1] << 8) | found[..., 2]
