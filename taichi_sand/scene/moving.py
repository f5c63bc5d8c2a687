"""Where walls that move are, and how fast: the motion that a [[walls]] table prescribes (`wall` below), by the time its clock shows.

A wall is moved as a whole: its pivot by velocity t + A (sin(2 π f t + φ) - sin φ), along x and y each with an amplitude A and a phase φ of
its own, and the wall turns about it by spin t + angle sin(2 π f' t). At time 0 it is where its points say.
"""

import math
from typing import Any

import numpy as np

SURFACE = ("name", "material", "friction", "surface_velocity")
"""Keys of a wall that have nothing to do with where it is."""


def motion(wall: Any) -> dict[str, Any]:
    """The keys that say where it is at a time."""
    return {name: value for name, value in wall.model_dump().items() if name not in SURFACE}


def turns(wall: Any) -> bool:
    """Whether the wall ever turns."""
    return wall.spin != 0 or wall.rock is not None


def moves(wall: Any) -> bool:
    """Whether the wall ever moves."""
    return wall.shake is not None or turns(wall) or any(wall.velocity)


def moving_walls(scene: Any) -> list[Any]:
    """The [[walls]] that move."""
    return [wall for wall in scene.walls if moves(wall)]


def drive(wall: Any) -> float:
    """What the wall is driven with: its force [N], or its pressure [N/m]; 0 if it moves as its keys say."""
    return wall.pressure or wall.force or 0.0


def pivot(wall: Any) -> np.ndarray:
    """What the wall turns about at time 0 [m]: the mean of its points unless the scene says so."""
    return np.mean(wall.points, axis=0) if wall.pivot is None else np.array(wall.pivot, float)


def lever(wall: Any) -> float:
    """Distance of the farthest point from the pivot [m]."""
    return float(np.hypot(*(np.array(wall.points) - pivot(wall)).T).max())


def shaking(wall: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Of its shaking S sin(ω t) + C (cos(ω t) - 1): S and C [m], and ω [rad/s]; zeros if it does not."""
    if wall.shake is None:
        return np.zeros(2), np.zeros(2), 0.0
    amplitude, phase = np.array(wall.shake.amplitude), np.array(wall.shake.phase)
    return amplitude * np.cos(phase), amplitude * np.sin(phase), math.tau * wall.shake.frequency


def rocking(wall: Any) -> tuple[float, float]:
    """Largest angle [rad] and angular frequency [rad/s] of its rocking; zeros if it does not."""
    return (0.0, 0.0) if wall.rock is None else (wall.rock.angle, math.tau * wall.rock.frequency)


def top_speed(wall: Any) -> float:
    """No point of the wall, or of its surface, moves faster [m/s]."""
    amplitude, omega = (0.0, 0.0) if wall.shake is None else (math.hypot(*wall.shake.amplitude), math.tau * wall.shake.frequency)
    angle, beat = rocking(wall)
    turning = abs(wall.spin) + abs(angle) * beat
    return float(math.hypot(*wall.velocity) + abs(wall.surface_velocity) + omega * amplitude + turning * lever(wall))


def shortest_period(wall: Any) -> float:
    """With which it is shaken or rocked [s]; infinite if it is not."""
    return min((1 / motion.frequency for motion in (wall.shake, wall.rock) if motion is not None), default=math.inf)


def breadth(wall: Any) -> float:
    """How broad it is across its `velocity` [m]."""
    vx, vy = np.array(wall.velocity) / np.hypot(*wall.velocity)
    return float(np.ptp(np.array(wall.points) @ [-vy, vx]))


def pivot_at(wall: Any, time: float) -> np.ndarray:
    """Where the pivot is when its clock shows `time` [s]."""
    sine, cosine, omega = shaking(wall)
    return pivot(wall) + np.array(wall.velocity) * time + sine * np.sin(omega * time) + cosine * (np.cos(omega * time) - 1.0)


def turn_at(wall: Any, time: float) -> float:
    """By how much it has turned then [rad]."""
    angle, beat = rocking(wall)
    return float(wall.spin * time + angle * np.sin(beat * time))


def corners(wall: Any, time: float = 0.0) -> np.ndarray:
    """Its points (n, 2) [m] when its clock shows `time` [s], the first one again at the end if it is closed."""
    points = np.array(wall.points + (wall.points[:1] if wall.closed else ()))
    if not moves(wall):
        return points
    cos, sin = np.cos(turn_at(wall, time)), np.sin(turn_at(wall, time))
    return pivot_at(wall, time) + (points - pivot(wall)) @ np.array([[cos, sin], [-sin, cos]])
