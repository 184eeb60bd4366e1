"""The iterative adaptive approach: one snapshot, coherent sources, any array."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.iterative_adaptive import IterativeAdaptive

LINE = np.stack([np.zeros(12), np.arange(12) / 2, np.zeros(12)], axis=1)
RANDOM_POSITIONS = np.random.default_rng(101).uniform(0, 3.5, (16, 3)) * [0.05, 1, 1]
BEAMWIDTH = 0.886 / 6  # in sines, for twelve elements


def draw_noise(shape, rng):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def draw_source_pairs(aperture, n, rng):
    middle = rng.uniform(-0.5, 0.5, (n, 1))
    sines = middle + np.array([-BEAMWIDTH / 2, BEAMWIDTH / 2])
    amplitudes = 10 * np.exp(2j * np.pi * rng.uniform(size=(n, 2)))
    x = np.einsum("nk,nki->ni", amplitudes, aperture.steering_vectors(np.arcsin(sines)))
    return sines, (x + draw_noise(x.shape, rng))[:, None]


def test_resolves_sources_one_beamwidth_apart_unlike_bartlett():
    aperture, n = Aperture(LINE), 400
    sines, x = draw_source_pairs(aperture, n, np.random.default_rng(102))
    resolved_share = {}
    for kind in (IterativeAdaptive, Bartlett):
        estimates = kind(n_sources=2).find_directions(x, aperture, np.ones(n))
        estimated_sines = np.sort(np.sin(estimates.azimuth_rad), axis=1)
        resolved_share[kind] = np.mean(np.all(abs(estimated_sines - sines) < BEAMWIDTH / 2, axis=1))
    assert resolved_share[IterativeAdaptive] > 0.95 and resolved_share[Bartlett] < 0.85


def test_sidelobes_are_lower_than_bartlett_sidelobes():
    aperture = Aperture(LINE)
    x = 10 * aperture.steering_vectors(0.2)[None, None] + draw_noise(
        (1, 1, 12), np.random.default_rng(103)
    )
    beams, adaptive = (
        10 * np.log10(kind().spectrum(x, aperture, np.ones(1))[0, 0])
        for kind in (Bartlett, IterativeAdaptive)
    )
    is_sidelobe = abs(np.sin(aperture.direction_grid.azimuth_rad) - np.sin(0.2)) > 1 / 6
    # The first sidelobe of twelve elements is at -13 dB.
    assert beams.max() - beams[is_sidelobe].max() < 14
    assert adaptive.max() - adaptive[is_sidelobe].max() > 20


def test_standard_errors_of_two_sources_on_sparse_plane_are_correct():
    aperture, n = Aperture(RANDOM_POSITIONS), 40
    rng = np.random.default_rng(104)
    azimuth, elevation = np.array([-0.4, 0.3]), np.array([0.1, -0.2])
    amplitudes = 10 * np.exp(2j * np.pi * rng.uniform(size=(n, 1, 2)))
    x = amplitudes @ aperture.steering_vectors(azimuth, elevation) + draw_noise((n, 1, 16), rng)
    estimates = IterativeAdaptive(n_sources=2).find_directions(x, aperture, np.ones(n))
    order = np.argsort(estimates.azimuth_rad, axis=1)
    for truth, angles, std in (
        (azimuth, estimates.azimuth_rad, estimates.azimuth_std_rad),
        (elevation, estimates.elevation_rad, estimates.elevation_std_rad),
    ):
        error = (np.take_along_axis(angles, order, 1) - truth) / np.take_along_axis(std, order, 1)
        assert np.all(abs(error) < 6)
        # The mean of 80 squared errors has a standard error of 0.16.
        assert np.mean(error**2) == pytest.approx(1, abs=0.75)


def test_accepts_noise_free_snapshots():
    aperture = Aperture(LINE)
    x = np.stack([aperture.steering_vectors(0.2), np.zeros(12)])[:, None]
    estimates = IterativeAdaptive().find_directions(x, aperture, np.zeros(2))
    assert estimates.azimuth_rad[0, 0] == pytest.approx(0.2, abs=1e-6)
    assert estimates.azimuth_std_rad[0, 0] < 1e-6


def test_rejects_zero_iterations():
    with pytest.raises(dc.InvalidSetting, match="n_iterations"):
        IterativeAdaptive(n_iterations=0)
