"""The grains with which a scene starts, as arrays."""

from dataclasses import dataclass

import numpy as np

from taichi_sand.scene.shapes import Form


@dataclass(frozen=True)
class Pack:
    """The grains of a scene at time 0, in the order of the scene's tables; float64 and SI unless said otherwise."""

    position: np.ndarray  # (n, 2) m
    velocity: np.ndarray  # (n, 2) m/s
    angle: np.ndarray  # (n,) rad
    spin: np.ndarray  # (n,) rad/s
    radius: np.ndarray  # (n,) m, of the circle about the centre of mass that holds the grain
    mass: np.ndarray  # (n,) kg, of fixed grains too
    inertia: np.ndarray  # (n,) kg m2, of fixed grains too
    kind: np.ndarray  # (n,) int32, which [[grains]] table made it; those of [[sources]] follow them
    fixed: np.ndarray  # (n,) bool
    body: np.ndarray  # (n,) int32: grains of one kind and number are bonded to one another; -1 = to none
    forms: tuple[Form, ...] = ()  # of each kind; none = all are discs

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def clumps(self) -> bool:
        """Whether a grain is anything but a disc."""
        return any(form.name != "disc" for form in self.forms)

    @property
    def size(self) -> np.ndarray:
        """Radii of discs of the same area [m], (n,)."""
        return self.radius * self._of_kind("size", 1.0)

    @property
    def lightness(self) -> np.ndarray:
        """(n,): mass of a grain over the least mass that a push at its rim has to move."""
        return self._of_kind("lightness", 1.0)

    def _of_kind(self, name: str, otherwise: float) -> np.ndarray:
        if not self.forms:
            return np.full(len(self), otherwise)
        return np.array([getattr(form, name) for form in self.forms])[self.kind]
