"""The origin of a scene: places in other coordinates than those that begin in the lower left corner of the box."""

from typing import Any

PLACES = ("region", "points", "pivot", "positions", "to", "window")
"""Keys of a scene, in whatever table, that hold places: x, y, or several such, or with more numbers behind.
Of a dotted key it is the last word that tells."""


def moved(data: Any, origin: tuple[float, float]) -> Any:
    """What a scene holds, dumped, with the lower left corner of its box, `origin`, at 0, 0."""
    if isinstance(data, dict):
        return {
            key: _shifted(value, origin) if key.rpartition(".")[2] in PLACES else moved(value, origin)
            for key, value in data.items()
            if key != "origin"
        }
    return [moved(part, origin) for part in data] if isinstance(data, list | tuple) else data


def _shifted(place: Any, origin: tuple[float, float]) -> Any:
    """x, y[, …]; x0, y0, x1, y1; or rows of them."""
    if not isinstance(place, list | tuple) or not place:
        return place
    if isinstance(place[0], list | tuple):
        return [[row[0] - origin[0], row[1] - origin[1], *row[2:]] for row in place]
    return [value - origin[k % 2] for k, value in enumerate(place)]
