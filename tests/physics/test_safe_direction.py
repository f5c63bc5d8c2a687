"""Safe direction breaks the conservation of momentum: by how much is measured, and reported to the last bit."""

import math

import numpy as np
import pytest
from helpers import D, Disc, K, M, simulate

MD = {"kind": "md", "k_r": K, "restitution": 0.5, "step": math.pi * math.sqrt(M / 2 / K) / 30}


@pytest.mark.parametrize("variant", ["velocity", "force"])
def test_the_momentum_that_is_violated(variant: str) -> None:
    """Of a disc that meets another head-on `velocity` takes all momentum (to 5 %, what the first overlap pushes); `force` takes none, as
    each disc is only pushed off. Of 36 in a gas both take some. What is taken is what is missing, to rounding.
    """
    rng = np.random.default_rng(6)
    pair = [Disc(0.05, 0.3, 0.2), Disc(0.05 + 1.001 * D, 0.3)]
    gas = [Disc(0.2 + 1.02 * D * (k % 6), 0.2 + 1.02 * D * (k // 6), *rng.normal(0, 0.3, 2)) for k in range(36)]
    effects = {"safe_direction": {"variant": variant}}
    for discs in (pair, gas):
        sim = simulate(discs, (0.6, 0.6), MD, effects={"friction": {"mu": 0.3}, **effects})
        start = M * sum(np.array([disc.vx, disc.vy]) for disc in discs)
        sim.advance(0.02)
        report = sim.report()
        taken = np.array(report["momentum_taken_Ns"])
        assert np.array(report["momentum_Ns"]) + taken == pytest.approx(start, abs=1e-9 * M)
        if discs is pair:
            share = 1.0 if variant == "velocity" else 0.0
            assert taken[0] == pytest.approx(share * M * 0.2, abs=0.05 * M * 0.2)
        else:
            assert np.hypot(*taken) > 0.01 * M * 0.3
        del sim
