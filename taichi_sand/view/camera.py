"""Which part of the box a picture shows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from taichi_sand.errors import SandError

MOST_HEIGHT = 16384
"""More [px] no encoder takes."""
MOST_ZOOM = 200.0
"""A picture shows at least this share of the box, 1/MOST_ZOOM, either way."""


def picture_height(size_m: Sequence[float], width: int) -> int:
    """Height [px] of a picture `width` wide of a box of this size [m]; even, as films want it."""
    height = max(2, 2 * round(0.5 * width * size_m[1] / size_m[0]))
    if height > MOST_HEIGHT:
        raise SandError(f"view.width: {width} makes the picture {height} pixels high; at most {MOST_HEIGHT} are possible", "view.width")
    return height


@dataclass(frozen=True)
class Camera:
    """Where a picture lies: its lower left corner is at (x, y) [m], and a metre of the world is `scale` pixels."""

    x: float
    y: float
    scale: float

    @classmethod
    def of(cls, window: Sequence[float], width: int) -> Self:
        """One that shows x0, y0, x1, y1 [m] in a picture so many pixels wide."""
        return cls(float(window[0]), float(window[1]), width / (window[2] - window[0]))

    @classmethod
    def shown(cls, window: Sequence[float] | None, size: Sequence[float], picture: tuple[int, int]) -> Self:
        """One whose picture [px] of a box, `size` [m], shows all of it, or of it `window`, x0, y0, x1, y1 [m], in the middle."""
        home = cls.of((0.0, 0.0, *size), picture[0])
        if window is None:
            return home
        scale = min(picture[0] / (window[2] - window[0]), picture[1] / (window[3] - window[1]))
        x, y = (0.5 * (window[k] + window[k + 2] - picture[k] / scale) for k in (0, 1))
        return cls(x, y, scale).within(size, picture, home.scale)

    def pixels(self, points: np.ndarray, height: int) -> np.ndarray:
        """Points (…, 2) [m], or pairs of them (…, 4), in pixels of a picture so high, y down."""
        moved = np.asarray(points, float) - np.resize((self.x, self.y), np.shape(points)[-1])
        found = moved * self.scale
        found[..., 1::2] = height - found[..., 1::2]
        return found

    def place(self, x: float, y: float, height: int) -> tuple[float, float]:
        """The point [m] under a pixel, y down."""
        return self.x + x / self.scale, self.y + (height - y) / self.scale

    def zoomed(self, factor: float, place: tuple[float, float]) -> "Camera":
        """Nearer by `factor`, with `place` [m] where it was in the picture."""
        x, y = (at + (low - at) / factor for at, low in zip(place, (self.x, self.y), strict=True))
        return Camera(x, y, self.scale * factor)

    def moved(self, x: float, y: float) -> "Camera":
        """Moved by so many metres."""
        return Camera(self.x + x, self.y + y, self.scale)

    def within(self, size: Sequence[float], picture: tuple[int, int], least: float) -> Self:
        """The nearest that shows nothing but the box, `size` [m], in a picture of so many pixels: no farther away than at `least` px/m."""
        scale = min(MOST_ZOOM * least, max(least, self.scale))
        x, y = (
            min(max(0.0, side - pixels / scale), max(0.0, at)) for at, side, pixels in zip((self.x, self.y), size, picture, strict=True)
        )
        return type(self)(x, y, scale)
