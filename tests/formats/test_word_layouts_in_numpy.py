"""Decoding of raw words in NumPy for small recordings: bits of the compiled loops."""

import itertools

import numpy as np
import pytest

from dechirp.core.compiled_kernels import (
    compiled_kernels_for_large_work,
    plain_twins_for_small_work,
)
from dechirp.recordings.samples.layouts import FourLanes, Pairs, SampleCode, TwoLanes


@pytest.mark.parametrize(
    ("layout", "n_rx", "n_present"),
    [
        (TwoLanes(), 2, 2),
        (FourLanes(receivers=(0, 2, 3)), 3, 4),
        (Pairs(receivers=(1, 0), n_present=3), 2, 3),
    ],
)
@pytest.mark.parametrize("dtype", [np.complex64, np.float32])
def test_decoded_samples_are_bit_identical(layout, n_rx, n_present, dtype):
    rng = np.random.default_rng(1)
    n_words = n_present * 32 * (2 if dtype == np.complex64 else 1)
    words = rng.integers(-32768, 32768, (5, n_words)).astype(np.int16)
    for iq, bits, offset_binary in itertools.product(("iq", "qi"), (12, 16), (True, False)):
        code = SampleCode(bits=bits, offset_binary=offset_binary, iq=iq)
        decoded = []
        for context in (plain_twins_for_small_work(0), compiled_kernels_for_large_work(np.inf)):
            out = np.empty((5, n_rx, 32), dtype)
            with context:
                layout.decode(words.copy(), out, code)
            decoded.append(out)
        assert np.array_equal(*decoded)
