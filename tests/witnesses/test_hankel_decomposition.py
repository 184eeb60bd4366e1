"""Separation of tones and bursts by a Hankel matrix of low rank."""

import numpy as np
import pytest
import scipy.linalg

from dechirp.witnesses.hankel_decomposition import (
    multiply_hankel,
    separate_tones_from_bursts,
    sum_antidiagonals,
)

N_SAMPLES = 400


def make_complex(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def test_products_equal_those_of_the_matrix():
    rng = np.random.default_rng(1)
    values, left, right = (make_complex(rng, *shape) for shape in ((11,), (5, 2), (7, 2)))
    matrix = scipy.linalg.hankel(values[:5], values[4:])
    assert multiply_hankel(values, right) == pytest.approx(matrix @ right)
    product = np.fliplr(left @ right.conj().T)
    expected = [np.trace(product, 6 - total) for total in range(11)]
    assert sum_antidiagonals(left, right) == pytest.approx(np.array(expected))


def test_tones_of_a_disturbed_signal_are_found():
    rng = np.random.default_rng(2)
    times = np.arange(N_SAMPLES)
    tones = np.exp(2j * np.pi * 0.11 * times) + 0.5 * np.exp(2j * np.pi * 0.23 * times)
    noise = 0.01 * make_complex(rng, N_SAMPLES)
    bursts = np.zeros(N_SAMPLES, complex)
    bursts[130:190] = 5 * np.exp(1j * np.pi * 0.02 * np.arange(60) ** 2)

    separated = separate_tones_from_bursts(tones + noise + bursts, rank=4)

    error = np.linalg.norm(separated - tones) / np.linalg.norm(tones)
    assert error < 0.013  # the noise of the samples; bursts are 1.7
