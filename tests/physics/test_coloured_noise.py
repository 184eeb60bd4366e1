"""Coloured noise: density over beat frequency, independence and filtering."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.radar.budget import noise_power_w

SLOPED_NOISE = dc.impairments.ColouredNoise(beat_hz=(1e6, 4e6), level=(1.0, 100.0))


def spectrum_over_thermal(radar, sampling, noise):
    """Estimate the noise density over thermal noise by frequency, from all chirps and receivers."""
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    cube = dc.simulate(dc.Scene(), radar, impairments=[noise], n_frames=4, seed=5)
    transform = np.fft.fft if sampling == "complex" else np.fft.rfft
    window = np.hanning(257)[:-1]
    lines = transform(cube.values * window / np.sqrt((window**2).sum()))
    beat_hz = np.arange(lines.shape[-1]) * 10e6 / 256
    return beat_hz, np.mean(abs(lines) ** 2, axis=(0, 1, 2)) / noise_power_w(radar), cube


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_noise_density_is_log_linear_between_frequencies_and_constant_outside(radar, sampling):
    beat_hz, density, _ = spectrum_over_thermal(radar, sampling, SLOPED_NOISE)

    expected_db = np.interp(beat_hz, (1e6, 4e6), (0, 20))
    is_inside = (beat_hz > 0.2e6) & (beat_hz < (9.8e6 if sampling == "complex" else 4.8e6))
    error_db = 10 * np.log10(density) - expected_db
    # The standard deviation of 1024 periodograms is 0.14 dB; the window smooths the corners
    # slightly.
    assert np.all(abs(error_db[is_inside]) < 0.6)
    assert abs(np.mean(error_db[is_inside])) < 0.05


def test_single_level_yields_white_noise_of_that_level(radar):
    noise = dc.impairments.ColouredNoise(beat_hz=(0,), level=(4.0,))

    _, density, cube = spectrum_over_thermal(radar, "complex", noise)

    np.testing.assert_allclose(density.mean(), 4.0, rtol=0.01)
    samples = cube.values.reshape(-1, 256)
    neighbours = np.mean(samples[:, 1:] * samples[:, :-1].conj()) / np.mean(abs(samples) ** 2)
    assert abs(neighbours) < 5 / np.sqrt(samples.size)


def test_noise_is_independent_between_chirps_and_receivers(radar):
    _, _, cube = spectrum_over_thermal(radar, "complex", SLOPED_NOISE)

    first, next_chirp, next_rx = cube.values[0, 0, 0], cube.values[0, 1, 0], cube.values[0, 0, 1]
    for second in (next_chirp, next_rx):
        correlation = abs(np.vdot(first, second)) / np.sqrt(
            np.vdot(first, first) * np.vdot(second, second)
        )
        assert abs(correlation) < 0.4  # standard deviation of 100 independent samples: 0.1


@pytest.mark.parametrize(
    ("settings", "setting"),
    [
        ({"beat_hz": (2.0, 1.0), "level": (1.0, 1.0)}, "beat"),
        ({"beat_hz": (1.0, 1.0), "level": (1.0, 1.0)}, "beat"),
        ({"beat_hz": (), "level": ()}, "beat"),
        ({"beat_hz": (-1.0,), "level": (1.0,)}, "beat"),
        ({"beat_hz": (0.0, 1.0), "level": (1.0,)}, "level"),
        ({"beat_hz": (0.0,), "level": (0.0,)}, "level"),
        ({"beat_hz": (0.0,), "level": (np.nan,)}, "level"),
        ({"beat_hz": 3.0, "level": (1.0,)}, "beat"),
    ],
)
def test_rejects_invalid_density(settings, setting):
    with pytest.raises(dc.InvalidSetting, match=setting):
        dc.impairments.ColouredNoise(**settings)


def test_filtered_noise_is_settled_at_first_sample(radar):
    low_pass = dc.impairments.IfFilter(high_pass_hz=None, low_pass_hz=2e6)

    cube = dc.simulate(dc.Scene(), radar, impairments=[SLOPED_NOISE, low_pass], n_frames=4, seed=5)

    # The first samples have the power of the others: means of 2048, at most 15 % apart.
    power = np.mean(abs(cube.values) ** 2, axis=(0, 1, 2))
    np.testing.assert_allclose(power[:8] / power.mean(), 1, atol=0.15)
