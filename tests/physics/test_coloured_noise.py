"""Noise of a given density over beat frequency."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.radar.budget import noise_power_w

SLOPED = dc.impairments.ColouredNoise(beat_hz=(1e6, 4e6), level=(1.0, 100.0))


def spectrum_over_thermal(radar, sampling, noise):
    """Periodogram of every chirp and receiver, mean over thermal noise, by frequency."""
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    cube = dc.simulate(dc.Scene(), radar, impairments=[noise], n_frames=4, seed=5)
    transform = np.fft.fft if sampling == "complex" else np.fft.rfft
    taper = np.hanning(257)[:-1]
    lines = transform(cube.values * taper / np.sqrt((taper**2).sum()))
    beat_hz = np.arange(lines.shape[-1]) * 10e6 / 256
    return beat_hz, np.mean(abs(lines) ** 2, axis=(0, 1, 2)) / noise_power_w(radar), cube


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_its_density_is_straight_in_decibels_between_frequencies_and_even_beyond(radar, sampling):
    beat_hz, density, _ = spectrum_over_thermal(radar, sampling, SLOPED)

    expected_db = np.interp(beat_hz, (1e6, 4e6), (0, 20))
    inside = (beat_hz > 0.2e6) & (beat_hz < (9.8e6 if sampling == "complex" else 4.8e6))
    off_db = 10 * np.log10(density) - expected_db
    # 1024 periodograms: 0.14 dB, one standard deviation; the window turns the corners a little.
    assert np.all(abs(off_db[inside]) < 0.6)
    assert abs(np.mean(off_db[inside])) < 0.05


def test_of_one_level_it_is_thermal_noise_of_that_level(radar):
    noise = dc.impairments.ColouredNoise(beat_hz=(0,), level=(4.0,))

    _, density, cube = spectrum_over_thermal(radar, "complex", noise)

    np.testing.assert_allclose(density.mean(), 4.0, rtol=0.01)
    samples = cube.values.reshape(-1, 256)
    neighbours = np.mean(samples[:, 1:] * samples[:, :-1].conj()) / np.mean(abs(samples) ** 2)
    assert abs(neighbours) < 5 / np.sqrt(samples.size)


def test_chirps_and_receivers_have_noise_of_their_own(radar):
    _, _, cube = spectrum_over_thermal(radar, "complex", SLOPED)

    one, other, next_rx = cube.values[0, 0, 0], cube.values[0, 1, 0], cube.values[0, 0, 1]
    for another in (other, next_rx):
        alike = abs(np.vdot(one, another)) / np.sqrt(np.vdot(one, one) * np.vdot(another, another))
        assert abs(alike) < 0.4  # 100 samples by themselves: 0.1, one standard deviation


@pytest.mark.parametrize(
    ("settings", "named"),
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
def test_what_is_no_density_is_refused(settings, named):
    with pytest.raises(dc.InvalidSetting, match=named):
        dc.impairments.ColouredNoise(**settings)


def test_a_filter_behind_it_finds_noise_before_the_first_sample(radar):
    low = dc.impairments.IfFilter(high_pass_hz=None, low_pass_hz=2e6)

    cube = dc.simulate(dc.Scene(), radar, impairments=[SLOPED, low], n_frames=4, seed=5)

    # Settled: the first samples have the power of the others, 2048 of them, 15 % at most apart.
    power = np.mean(abs(cube.values) ** 2, axis=(0, 1, 2))
    np.testing.assert_allclose(power[:8] / power.mean(), 1, atol=0.15)
