"""Plane shear, as it is in the middle of a bed: its rate, and the stress that goes with it (da Cruz et al. 2005)."""

import math
from typing import Any

import numpy as np

from taichi_sand.measure.contacts import contacts
from taichi_sand.measure.grain_state import state_of, stresses

LAYER = (25.0, 75.0)
"""Between these percentiles of their heights grains are looked at: what is next to walls is another flow."""
LEAST = 10
"""Fewest grains that a rate is fitted to."""


def shear(sim: Any) -> tuple[float, np.ndarray, float]:
    """Rate of shear dv_x/dy [1/s], mean stress (2, 2) of the layer, pressure positive, velocities off the mean flow included [N/m], and
    mean mass [kg]; NaN without enough grains.
    """
    state = state_of(sim)
    free = state["mass"] > 0
    if free.sum() < LEAST:
        return math.nan, np.full((2, 2), math.nan), math.nan
    x, y = state["position"].T
    low, high = np.percentile(y[free], LAYER)
    layer = free & (y > low) & (y < high)
    rate, base = np.polyfit(y[layer], state["velocity"][layer, 0], 1)
    off = state["velocity"][layer] - np.stack([base + rate * y[layer], np.zeros(layer.sum())], axis=1)
    width = sim.scene.size[0] if sim.scene.periodic[0] else float(np.ptp(x[layer]))
    borne = (stresses(sim, state, contacts(sim)) * state["area"][:, None, None])[layer].sum(axis=0)
    borne += np.einsum("n,ni,nj->ij", state["mass"][layer], off, off)
    return float(rate), borne / (width * (high - low)), float(state["mass"][layer].mean())


def shear_friction(sim: Any) -> float:
    """Shear stress over pressure across the flow, in the middle of a bed that is sheared along x."""
    _, stress, _ = shear(sim)
    return abs(float(0.5 * (stress[0, 1] + stress[1, 0]))) / float(stress[1, 1]) if stress[1, 1] else math.nan


def inertial_number(sim: Any) -> float:
    """I = rate of shear √(m / P) there, m the mean mass, P the pressure across the flow."""
    rate, stress, mass = shear(sim)
    return abs(rate) * math.sqrt(mass / stress[1, 1]) if stress[1, 1] > 0 else math.nan
