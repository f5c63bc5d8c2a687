"""Grain shapes: mass and moment of inertia from radius and areal density."""

import numpy as np


def disc_mass(radius: np.ndarray, density: float) -> np.ndarray:
    """Returns the mass of discs [kg], any shape, from their radius [m] and areal density [kg/m2]."""
    return density * np.pi * radius**2


def disc_inertia(radius: np.ndarray, density: float) -> np.ndarray:
    """Returns the moment of inertia of discs about their centre [kg m2], m R2 / 2."""
    return disc_mass(radius, density) * radius**2 / 2
