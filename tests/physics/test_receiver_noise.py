"""Noise that receivers have in common: number of independent ones, and doubtful detections."""

import numpy as np
import pytest

from dechirp.processing.receiver_noise import (
    correlated_noise_findings,
    count_independent_receivers,
)


def complex_noise(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.mark.parametrize("common_power", [0.0, 0.25, 1.0, 100.0])
def test_number_of_independent_receivers_follows_from_their_covariance(common_power):
    rng, n_rx = np.random.default_rng(2), 4
    phases = np.exp(1j * rng.uniform(0, 2 * np.pi, (1, n_rx, 1)))  # of a direction
    samples = complex_noise(rng, 64, n_rx, 256)
    samples = samples + np.sqrt(common_power) * phases * complex_noise(rng, 64, 1, 256)
    echo = 300 * np.exp(2j * np.pi * (0.2 * np.arange(64)[:, None, None] + 0.1 * np.arange(256)))
    samples = samples + echo * phases

    n_independent = count_independent_receivers(samples, 1)

    # Eigenvalues 1 + n g, and 1 for the others; cells up to four medians have less of the largest.
    largest = 1 + n_rx * common_power
    expected = (n_rx - 1 + largest) ** 2 / (n_rx - 1 + largest**2)
    assert n_independent == pytest.approx(expected, rel=0.1)


def test_real_samples_and_slots_of_transmitters_are_counted():
    rng = np.random.default_rng(3)
    independent = rng.normal(size=(64, 3, 64))
    common = np.repeat(rng.normal(size=(64, 1, 64)), 3, axis=1)
    slots = np.stack([common, independent], axis=1).reshape(128, 3, 64)

    assert count_independent_receivers(independent, 1) == pytest.approx(3, rel=0.1)
    assert count_independent_receivers(slots, 2) == pytest.approx(1, rel=0.01)


def test_warning_names_detections_below_the_threshold_of_common_noise():
    rng, n_training, probability = np.random.default_rng(4), 16, 1e-3
    n_trials = 100_000
    # Power of common noise, over the mean of training cells: exceeds the stated limit with the
    # designed probability.
    power = rng.exponential(size=n_trials)
    noise = rng.exponential(size=(n_trials, n_training)).mean(axis=1)
    snr = 4 * (power / noise - 1)

    (warning,) = correlated_noise_findings(
        1.0, 4, snr, n_training=n_training, false_alarm_probability=probability
    )

    n_below = int(warning.value.split("common; ")[1].split(" ")[0].replace(",", ""))
    # 100 expected above, with a standard deviation of 10; five of them 1 in 10^6.
    assert n_trials - n_below == pytest.approx(100, abs=50)
    assert not correlated_noise_findings(
        1.0, 4, snr[:0], n_training=n_training, false_alarm_probability=probability
    )
    assert not correlated_noise_findings(
        3.6, 4, snr, n_training=n_training, false_alarm_probability=probability
    )
