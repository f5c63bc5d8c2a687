"""Laws of drag on grains in a bed: force over volume and slip."""

import math

import taichi as ti

from taichi_sand.world.geometry import at_least

LOG_10 = math.log(10)
LEAST_PORES = 0.2
"""Reached only for a moment, in impacts."""


@ti.func
def di_felice(slip, pores, diameter, density, viscosity):
    """Drag on a grain over its volume and slip [kg/(m3 s)], after Di Felice (1994): that of a sphere alone (Dallavalle 1948), times a
    power of the porosity.
    """
    reynolds = at_least(1e-6, pores * density * slip * diameter / viscosity)
    sphere = (0.63 + 4.8 / ti.sqrt(reynolds)) ** 2
    bend = 1.5 - ti.log(reynolds) / LOG_10
    power = 3.7 - 0.65 * ti.exp(-0.5 * bend * bend)
    return 0.75 * sphere * reynolds * viscosity / (pores * diameter * diameter) * ti.exp((2.0 - power) * ti.log(pores))


@ti.func
def gidaspow(slip, pores, diameter, density, viscosity):
    """As di_felice, after Gidaspow (1994): Ergun (1952) in a bed, Wen & Yu (1966) above a porosity of 0.8."""
    found = 150.0 * (1.0 - pores) * viscosity / (pores * diameter * diameter) + 1.75 * density * slip / diameter
    if pores >= 0.8:
        reynolds = at_least(1e-6, pores * density * slip * diameter / viscosity)
        sphere = 0.44
        if reynolds < 1000.0:
            sphere = at_least(0.44, 24.0 * (1.0 + 0.15 * reynolds**0.687) / reynolds)
        found = 0.75 * sphere * reynolds * viscosity / (diameter * diameter) * pores**-2.65
    return found


LAWS = ("di_felice", "gidaspow")


@ti.func
def drag_of(f: ti.template(), slip, pores, diameter):
    """Drag by the law that the scene asks for, over `permeability` [kg/(m3 s)]."""
    now = f.now[None]
    found = 0.0
    if now.law == 0:
        found = di_felice(slip, pores, diameter, now.density, now.viscosity)
    else:
        found = gidaspow(slip, pores, diameter, now.density, now.viscosity)
    return found / now.permeability
