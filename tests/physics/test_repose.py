"""Angles of repose of poured heaps and of tilted layers, both solvers, five seeds each (physics.md B4)."""

import math

import pytest

from taichi_sand.study.validate import repose


@pytest.mark.slow
@pytest.mark.parametrize("kind", repose.SOLVERS)
def test_clumps_make_heaps_steeper(kind: str) -> None:
    """Discs < squares and discs < triangles, on a rough base, by more than two standard errors of the difference.

    Whether squares heap up steeper than triangles cannot be told from five heaps: 1.0 ± 0.8 degrees (rigid), 0.0 ± 1.5 (md).
    """
    discs, triangles, squares = (repose.Angle.of([repose.heap(shape, kind, seed) for seed in range(5)]) for shape in repose.SHAPES)
    assert triangles.mean - discs.mean > 2 * math.hypot(triangles.error, discs.error)
    assert squares.mean - discs.mean > 2 * math.hypot(squares.error, discs.error)


@pytest.mark.slow
@pytest.mark.parametrize("kind", repose.SOLVERS)
def test_tilted_layer(kind: str) -> None:
    """B4, Deboeuf et al. 2005: discs at mu = 0.5 avalanche at 21 degrees and come to rest at 15, both within 2."""
    avalanche, rest = zip(*[repose.layer(kind, seed) for seed in range(5)], strict=True)
    assert repose.Angle.of(list(avalanche)).mean == pytest.approx(21, abs=2)
    assert repose.Angle.of(list(rest)).mean == pytest.approx(15, abs=2)
