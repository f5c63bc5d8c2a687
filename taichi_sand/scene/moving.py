"""Where walls that move are, and how fast: the motion that a [[walls]] table prescribes (`wall` below), by the time its clock shows.

A wall is moved as a whole: its pivot by velocity t + amplitude sin(2 π frequency t), and the wall turns about it by spin t.
"""

from typing import Any

import numpy as np

SURFACE = ("name", "material", "friction", "surface_velocity")
"""Keys of a wall that have nothing to do with where it is."""


def motion(wall: Any) -> dict[str, Any]:
    """The keys that say where it is at a time."""
    return {name: value for name, value in wall.model_dump().items() if name not in SURFACE}


def moves(wall: Any) -> bool:
    """Whether the wall ever moves."""
    return wall.shake is not None or wall.spin != 0 or any(wall.velocity)


def pivot(wall: Any) -> np.ndarray:
    """What the wall turns about at time 0 [m]: the mean of its points unless the scene says so."""
    return np.mean(wall.points, axis=0) if wall.pivot is None else np.array(wall.pivot, float)


def lever(wall: Any) -> float:
    """Distance of the farthest point from the pivot [m]."""
    return float(np.hypot(*(np.array(wall.points) - pivot(wall)).T).max())


def shaking(wall: Any) -> tuple[np.ndarray, float]:
    """Amplitude [m] and angular frequency [rad/s] of its shaking; zeros if it does not."""
    return (np.zeros(2), 0.0) if wall.shake is None else (np.array(wall.shake.amplitude), 2 * np.pi * wall.shake.frequency)


def top_speed(wall: Any) -> float:
    """No point of the wall, or of its surface, moves faster [m/s]."""
    amplitude, omega = shaking(wall)
    return float(np.hypot(*wall.velocity) + abs(wall.surface_velocity) + omega * np.hypot(*amplitude) + abs(wall.spin) * lever(wall))


def breadth(wall: Any) -> float:
    """How broad it is across its `velocity` [m]."""
    vx, vy = np.array(wall.velocity) / np.hypot(*wall.velocity)
    return float(np.ptp(np.array(wall.points) @ [-vy, vx]))


def pivot_at(wall: Any, time: float) -> np.ndarray:
    """Where the pivot is when its clock shows `time` [s]."""
    amplitude, omega = shaking(wall)
    return pivot(wall) + np.array(wall.velocity) * time + amplitude * np.sin(omega * time)


def corners(wall: Any, time: float = 0.0) -> np.ndarray:
    """Its points (n, 2) [m] when its clock shows `time` [s], the first one again at the end if it is closed."""
    points = np.array(wall.points + (wall.points[:1] if wall.closed else ()))
    if not moves(wall):
        return points
    amplitude, omega = shaking(wall)
    cos, sin = np.cos(wall.spin * time), np.sin(wall.spin * time)
    turned = (points - pivot(wall)) @ np.array([[cos, sin], [-sin, cos]])
    return pivot(wall) + turned + np.array(wall.velocity) * time + amplitude * np.sin(omega * time)
