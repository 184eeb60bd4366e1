"""Bartlett and FFT direction finding: spectra, estimation errors and windows."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture, FieldOfView
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.fft import Fft
from dechirp.theory.direction_bounds import direction_std_rad
from nightly import nightly

LINE = np.stack([np.zeros(12), np.arange(12) / 2, np.zeros(12)], axis=1)
PLANE = np.array([(0, y / 2, z / 2) for y in range(5) for z in range(4)])
SPARSE_PLANE = PLANE[[0, 1, 2, 4, 5, 7, 9, 10, 11, 13, 15, 19]]
RANDOM_POSITIONS = np.random.default_rng(81).uniform(-2, 2, (16, 3)) * [0.1, 1, 1]
ARRAYS = {
    "horizontal line": LINE,
    "vertical line": LINE[:, [0, 2, 1]],
    "plane": PLANE,
    "sparse plane": SPARSE_PLANE,
    "random": RANDOM_POSITIONS,
}
FIELD = FieldOfView(elevation_rad=1.0)


def draw_noise(shape, rng):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


@nightly
@pytest.mark.parametrize("kind", [Fft, Bartlett])
@pytest.mark.parametrize("array", ARRAYS)
def test_single_source_reaches_crlb_with_correct_standard_errors(kind, array):
    aperture, n = Aperture(ARRAYS[array], FIELD), 2000
    rng = np.random.default_rng(82)
    angles = [
        rng.uniform(-limit, limit, n) * is_resolved
        for limit, is_resolved in zip(
            (1.2, 0.6), aperture.resolves_azimuth_and_elevation, strict=True
        )
    ]
    phase = np.exp(2j * np.pi * rng.uniform(size=(n, 1)))
    x = 10 * phase * aperture.steering_vectors(*angles) + draw_noise((n, aperture.n_elements), rng)
    estimates = kind().find_directions(x[:, None].astype(np.complex64), aperture, np.ones(n))
    bound = np.array(
        [
            direction_std_rad(
                positions=aperture.positions,
                azimuth_rad=[azimuth],
                elevation_rad=[elevation],
                amplitudes=[10.0],
                noise_power=1.0,
                unknown=aperture.resolves_azimuth_and_elevation,
            )[0]
            for azimuth, elevation in zip(*angles, strict=True)
        ]
    )
    for axis, is_resolved in enumerate(aperture.resolves_azimuth_and_elevation):
        error = estimates[axis][:, 0] - angles[axis]
        if not is_resolved:
            assert np.isnan(error).all() and np.isnan(estimates[axis + 2]).all()
            continue
        assert np.sqrt(np.mean((error / bound[:, axis]) ** 2)) < 1.2
        # The mean of 2,000 squared normal errors has a standard error of 0.032.
        assert 0.85 < np.mean((error / estimates[axis + 2][:, 0]) ** 2) < 1.15
    # |s + w / sqrt(N)|^2: the standard error of the mean, 2 A sigma / sqrt(2 N n), is below 0.1.
    assert np.mean(estimates.power) == pytest.approx(100, abs=0.5)


@pytest.mark.parametrize("array", ["horizontal line", "vertical line"])
@pytest.mark.parametrize("n_snapshots", [1, 3])
def test_fft_spectrum_of_linear_array_equals_bartlett_spectrum(array, n_snapshots):
    aperture = Aperture(ARRAYS[array], FIELD)
    x = draw_noise((5, n_snapshots, aperture.n_elements), np.random.default_rng(83)).astype(
        np.complex64
    )
    fft, product = (kind().spectrum(x, aperture, np.ones(5)) for kind in (Fft, Bartlett))
    assert fft == pytest.approx(product, abs=1e-5 * float(product.max()))


@pytest.mark.parametrize("array", ["plane", "sparse plane"])
def test_fft_spectrum_of_planar_array_is_accurate_to_eighth_of_beam(array):
    aperture = Aperture(ARRAYS[array], FIELD)
    x = aperture.steering_vectors(0.5, -0.3)[None, None]
    fft, product = (kind().spectrum(x, aperture, np.ones(1))[0] for kind in (Fft, Bartlett))
    # The beam power falls by at most pi / 2 of its peak within a beamwidth.
    assert abs(fft - product).max() < np.pi / 16
    assert np.unravel_index(fft.argmax(), fft.shape)[0] == product.argmax() // product.shape[1]


def test_fft_supports_other_spacings_and_coincident_elements():
    for spacing in (0.35, 0.5234, 0.8):
        line = LINE * 2 * spacing
        aperture = Aperture(np.concatenate([line, line[3:6]]))
        x = draw_noise((3, 1, 15), np.random.default_rng(84)).astype(np.complex64)
        fft, product = (kind().spectrum(x, aperture, np.ones(3)) for kind in (Fft, Bartlett))
        assert fft == pytest.approx(product, abs=1e-4 * float(product.max()))


def test_window_lowers_sidelobes_and_keeps_estimate_at_crlb():
    aperture, n = Aperture(LINE), 2000
    rng = np.random.default_rng(85)
    azimuths = np.array([-0.3, 0.5])
    # The sources differ by 30 dB: the weak one is below the first sidelobes, at -13 dB.
    x = aperture.steering_vectors(azimuths).T @ np.array([100.0, 3.2])
    estimates = Fft(n_sources=2, window="chebyshev-60").find_directions(
        x + draw_noise((n, 1, 12), rng), aperture, np.ones(n)
    )
    bound = direction_std_rad(
        positions=LINE, azimuth_rad=azimuths, amplitudes=[100.0, 3.2], noise_power=1.0
    )[:, 0]
    error = estimates.azimuth_rad - azimuths
    assert np.all(np.sqrt(np.mean((error / bound) ** 2, axis=0)) < 1.2)
    squared = np.mean((error / estimates.azimuth_std_rad) ** 2, axis=0)
    assert np.all(abs(squared - 1) < 0.15)
    plain = Fft(n_sources=2).find_directions(x[None, None], aperture, np.ones(1))
    assert abs(plain.azimuth_rad[0, 1] - 0.5) > 0.1


@pytest.mark.parametrize("window", ["hann", "chebyshev-60", "taylor-30", "kaiser-6"])
def test_window_keeps_beam_power_and_is_symmetric(window):
    aperture = Aperture(SPARSE_PLANE)
    x = 3 * aperture.steering_vectors(0.4, -0.2)[None, None]
    spectrum = Fft(window=window)
    prepared = spectrum.precompute_for_spectrum(x, aperture, np.ones(1))
    top = spectrum.spectrum_at(prepared, aperture.steering_vectors(0.4, -0.2)[None])
    assert float(top[0, 0]) == pytest.approx(9, rel=1e-5)
    line = Aperture(LINE)
    weights = abs(spectrum.precompute_for_spectrum(np.ones((1, 1, 12)), line, np.ones(1)))[0, 0]
    assert weights == pytest.approx(weights[::-1]) and weights.min() > 0


def test_two_sources_three_beamwidths_apart_are_unbiased():
    aperture, n = Aperture(LINE), 2000
    rng = np.random.default_rng(86)
    azimuths = np.arcsin([-0.25, 0.25])
    amplitudes = 10 * np.exp(2j * np.pi * rng.uniform(size=(n, 1, 2)))
    x = amplitudes @ aperture.steering_vectors(azimuths) + draw_noise((n, 1, 12), rng)
    estimates = Bartlett(n_sources=2).find_directions(x, aperture, np.ones(n))
    azimuth = np.sort(estimates.azimuth_rad, axis=1)
    error = (azimuth - azimuths) / np.take_along_axis(
        estimates.azimuth_std_rad, np.argsort(estimates.azimuth_rad, axis=1), axis=1
    )
    assert np.all(abs(error) < 6)
    # The 4,000 errors, two of each trial nearly independent, have a standard error of 0.022.
    assert np.mean(error**2) == pytest.approx(1, abs=0.15)


def test_snapshots_are_integrated():
    aperture, n = Aperture(LINE), 2000
    rng = np.random.default_rng(87)
    azimuth = rng.uniform(-1, 1, n)
    amplitudes = 5 * np.exp(2j * np.pi * rng.uniform(size=(n, 4, 1)))
    x = amplitudes * aperture.steering_vectors(azimuth)[:, None] + draw_noise((n, 4, 12), rng)
    estimates = Fft().find_directions(x, aperture, np.ones(n))
    bound = direction_std_rad(
        positions=LINE, azimuth_rad=[0.0], amplitudes=[[5, 5, 5, 5]], noise_power=1.0
    )[0, 0]
    error = (estimates.azimuth_rad[:, 0] - azimuth) * np.cos(azimuth) / bound
    assert np.sqrt(np.mean(error**2)) < 1.1
    assert np.median(estimates.azimuth_std_rad[:, 0] * np.cos(azimuth)) == pytest.approx(
        bound, rel=0.05
    )


def test_source_outside_field_of_view_is_clipped_to_edge():
    narrow = Aperture(LINE, FieldOfView(azimuth_rad=0.5))
    x = narrow.steering_vectors(0.55)[None, None]
    estimates = Bartlett().find_directions(x, narrow, np.full(1, 1e-2))
    assert estimates.azimuth_rad[0, 0] == pytest.approx(0.5)


def test_standard_error_is_limited_to_uniform_distribution():
    aperture = Aperture(LINE, replace(FIELD, azimuth_rad=1.0))
    x = draw_noise((50, 1, 12), np.random.default_rng(88))
    estimates = Bartlett().find_directions(x, aperture, np.full(50, 1e6))
    assert estimates.azimuth_std_rad == pytest.approx(1 / np.sqrt(3))


def test_rejects_unknown_window():
    with pytest.raises(dc.InvalidSetting, match="window"):
        Fft(window="triangle")
