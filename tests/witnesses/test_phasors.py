"""Phasors (cosine and sine of cycles) against forty digits of `mpmath`."""

import mpmath
import numpy as np

from dechirp.core.phasors import phasors


def test_phasors_match_forty_digits_within_1e_15():
    small_turns = np.linspace(-0.5, 0.5, 2001)
    large_turns = np.random.default_rng(1).uniform(-1e6, 1e6, 2000)
    turns = np.concatenate([small_turns, large_turns]).reshape(-1, 1)
    with mpmath.workdps(40):
        exact = [mpmath.expjpi(2 * mpmath.mpf(float(t))) for t in turns.ravel()]
        phasor_values = (mpmath.mpc(complex(z)) for z in phasors(turns).ravel())
        max_error = max(abs(z - w) for z, w in zip(phasor_values, exact, strict=True))
    assert max_error < 1e-15
