"""Cosine and sine of turns against forty digits of `mpmath`."""

import mpmath
import numpy as np

from dechirp.core.phasors import phasors


def test_phasors_are_those_of_forty_digits_to_1e_15():
    near = np.linspace(-0.5, 0.5, 2001)
    far = np.random.default_rng(1).uniform(-1e6, 1e6, 2000)
    turns = np.concatenate([near, far]).reshape(-1, 1)
    with mpmath.workdps(40):
        exact = [mpmath.expjpi(2 * mpmath.mpf(float(t))) for t in turns.ravel()]
        found = (mpmath.mpc(complex(z)) for z in phasors(turns).ravel())
        worst = max(abs(z - w) for z, w in zip(found, exact, strict=True))
    assert worst < 1e-15
