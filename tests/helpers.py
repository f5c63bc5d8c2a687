"""What the tests build their small worlds with: the laboratory of the study package, and a hash of a state."""

import hashlib
from typing import Any

import numpy as np

from taichi_sand.study.laboratory import (
    ANGLES,
    INERTIA,
    OPEN,
    PERIODIC,
    RHO,
    Contact,
    D,
    Disc,
    Face,
    G,
    Gallery,
    K,
    M,
    R,
    chain_forces,
    fresh_taichi,
    kinetic,
    listed,
    perp,
    simulate,
    tables,
    unit,
)

__all__ = [
    "ANGLES",
    "INERTIA",
    "OPEN",
    "PERIODIC",
    "RHO",
    "Contact",
    "D",
    "Disc",
    "Face",
    "G",
    "Gallery",
    "K",
    "M",
    "R",
    "chain_forces",
    "digest",
    "fresh_taichi",
    "kinetic",
    "listed",
    "perp",
    "simulate",
    "tables",
    "unit",
]


def digest(sim: Any) -> str:
    """Hash of the whole visible state, bit by bit."""
    total = hashlib.sha256()
    for part in (sim.ids, sim.positions, sim.velocities, sim.angles, sim.spins):
        total.update(np.ascontiguousarray(part).tobytes())
    return total.hexdigest()
