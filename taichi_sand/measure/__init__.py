"""Observables and structure of a simulation."""

from taichi_sand.measure.report import report

__all__ = ["report"]
