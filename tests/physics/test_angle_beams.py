"""Bartlett and the angle FFT: beams, and the tops of their peaks."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture, FieldOfView
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.fft import Fft
from dechirp.theory.direction_bounds import direction_std_rad

LINE = np.stack([np.zeros(12), np.arange(12) / 2, np.zeros(12)], axis=1)
PLANE = np.array([(0, y / 2, z / 2) for y in range(5) for z in range(4)])
HOLES = PLANE[[0, 1, 2, 4, 5, 7, 9, 10, 11, 13, 15, 19]]
ANYWHERE = np.random.default_rng(81).uniform(-2, 2, (16, 3)) * [0.1, 1, 1]
ARRAYS = {
    "line": LINE,
    "upright": LINE[:, [0, 2, 1]],
    "plane": PLANE,
    "holes": HOLES,
    "anywhere": ANYWHERE,
}
FIELD = FieldOfView(elevation_rad=1.0)


def noise(shape, rng):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


@pytest.mark.parametrize("kind", [Fft, Bartlett])
@pytest.mark.parametrize("array", ARRAYS)
def test_one_source_is_found_to_the_bound_and_errors_are_as_reported(kind, array):
    seen, n = Aperture(ARRAYS[array], FIELD), 2000
    rng = np.random.default_rng(82)
    truth = [
        rng.uniform(-most, most, n) * told
        for most, told in zip((1.2, 0.6), seen.resolves, strict=True)
    ]
    phase = np.exp(2j * np.pi * rng.uniform(size=(n, 1)))
    x = 10 * phase * seen.steering_vectors(*truth) + noise((n, seen.n_elements), rng)
    found = kind().find_directions(x[:, None].astype(np.complex64), seen, np.ones(n))
    bound = np.array(
        [
            direction_std_rad(
                positions=seen.positions,
                azimuth_rad=[azimuth],
                elevation_rad=[elevation],
                amplitudes=[10.0],
                noise_power=1.0,
                unknown=seen.resolves,
            )[0]
            for azimuth, elevation in zip(*truth, strict=True)
        ]
    )
    for axis, told in enumerate(seen.resolves):
        error = found[axis][:, 0] - truth[axis]
        if not told:
            assert np.isnan(error).all() and np.isnan(found[axis + 2]).all()
            continue
        assert np.sqrt(np.mean((error / bound[:, axis]) ** 2)) < 1.2
        # Of 2,000 squared normal errors the mean has a standard error of 0.032.
        assert 0.85 < np.mean((error / found[axis + 2][:, 0]) ** 2) < 1.15
    # |s + w / sqrt N|^2: standard error of the mean 2 A sigma / sqrt(2 N n), below 0.1.
    assert np.mean(found.power) == pytest.approx(100, abs=0.5)


@pytest.mark.parametrize("array", ["line", "upright"])
@pytest.mark.parametrize("n_looks", [1, 3])
def test_the_fft_over_a_line_is_the_product_with_steering_vectors(array, n_looks):
    seen = Aperture(ARRAYS[array], FIELD)
    x = noise((5, n_looks, seen.n_elements), np.random.default_rng(83)).astype(np.complex64)
    fft, product = (kind().spectrum(x, seen, np.ones(5)) for kind in (Fft, Bartlett))
    assert fft == pytest.approx(product, abs=1e-5 * float(product.max()))


@pytest.mark.parametrize("array", ["plane", "holes"])
def test_the_fft_over_a_plane_is_read_within_an_eighth_of_a_beam(array):
    seen = Aperture(ARRAYS[array], FIELD)
    x = seen.steering_vectors(0.5, -0.3)[None, None]
    fft, product = (kind().spectrum(x, seen, np.ones(1))[0] for kind in (Fft, Bartlett))
    # Beams of power fall by at most pi / 2 of their top within a beam's length.
    assert abs(fft - product).max() < np.pi / 16
    assert np.unravel_index(fft.argmax(), fft.shape)[0] == product.argmax() // product.shape[1]


def test_steps_off_half_a_wavelength_and_doubled_elements_have_their_fft():
    for apart in (0.35, 0.5234, 0.8):
        line = LINE * 2 * apart
        seen = Aperture(np.concatenate([line, line[3:6]]))
        x = noise((3, 1, 15), np.random.default_rng(84)).astype(np.complex64)
        fft, product = (kind().spectrum(x, seen, np.ones(3)) for kind in (Fft, Bartlett))
        assert fft == pytest.approx(product, abs=1e-4 * float(product.max()))


def test_a_window_lowers_sidelobes_and_leaves_the_estimate_at_the_bound():
    seen, n = Aperture(LINE), 2000
    rng = np.random.default_rng(85)
    at = np.array([-0.3, 0.5])
    # 30 dB between them: the weak one is below the first sidelobes, at -13 dB.
    x = seen.steering_vectors(at).T @ np.array([100.0, 3.2])
    found = Fft(n_sources=2, window="chebyshev-60").find_directions(
        x + noise((n, 1, 12), rng), seen, np.ones(n)
    )
    bound = direction_std_rad(
        positions=LINE, azimuth_rad=at, amplitudes=[100.0, 3.2], noise_power=1.0
    )[:, 0]
    error = found.azimuth_rad - at
    assert np.all(np.sqrt(np.mean((error / bound) ** 2, axis=0)) < 1.2)
    squared = np.mean((error / found.azimuth_std_rad) ** 2, axis=0)
    assert np.all(abs(squared - 1) < 0.15)
    plain = Fft(n_sources=2).find_directions(x[None, None], seen, np.ones(1))
    assert abs(plain.azimuth_rad[0, 1] - 0.5) > 0.1


@pytest.mark.parametrize("window", ["hann", "chebyshev-60", "taylor-30", "kaiser-6"])
def test_a_window_keeps_the_power_of_the_beam_and_is_symmetric(window):
    seen = Aperture(HOLES)
    x = 3 * seen.steering_vectors(0.4, -0.2)[None, None]
    spectrum = Fft(window=window)
    prepared = spectrum.prepare_snapshots(x, seen, np.ones(1))
    top = spectrum.spectrum_at(prepared, seen.steering_vectors(0.4, -0.2)[None])
    assert float(top[0, 0]) == pytest.approx(9, rel=1e-5)
    line = Aperture(LINE)
    weights = abs(spectrum.prepare_snapshots(np.ones((1, 1, 12)), line, np.ones(1)))[0, 0]
    assert weights == pytest.approx(weights[::-1]) and weights.min() > 0


def test_two_sources_three_beams_apart_do_not_move_each_other():
    seen, n = Aperture(LINE), 2000
    rng = np.random.default_rng(86)
    at = np.arcsin([-0.25, 0.25])
    amplitudes = 10 * np.exp(2j * np.pi * rng.uniform(size=(n, 1, 2)))
    x = amplitudes @ seen.steering_vectors(at) + noise((n, 1, 12), rng)
    found = Bartlett(n_sources=2).find_directions(x, seen, np.ones(n))
    azimuth = np.sort(found.azimuth_rad, axis=1)
    error = (azimuth - at) / np.take_along_axis(
        found.azimuth_std_rad, np.argsort(found.azimuth_rad, axis=1), axis=1
    )
    assert np.all(abs(error) < 6)
    # 4,000 errors, two of each trial nearly independent: standard error 0.022.
    assert np.mean(error**2) == pytest.approx(1, abs=0.15)


def test_looks_add_up():
    seen, n = Aperture(LINE), 2000
    rng = np.random.default_rng(87)
    azimuth = rng.uniform(-1, 1, n)
    amplitudes = 5 * np.exp(2j * np.pi * rng.uniform(size=(n, 4, 1)))
    x = amplitudes * seen.steering_vectors(azimuth)[:, None] + noise((n, 4, 12), rng)
    found = Fft().find_directions(x, seen, np.ones(n))
    bound = direction_std_rad(
        positions=LINE, azimuth_rad=[0.0], amplitudes=[[5, 5, 5, 5]], noise_power=1.0
    )[0, 0]
    error = (found.azimuth_rad[:, 0] - azimuth) * np.cos(azimuth) / bound
    assert np.sqrt(np.mean(error**2)) < 1.1
    assert np.median(found.azimuth_std_rad[:, 0] * np.cos(azimuth)) == pytest.approx(
        bound, rel=0.05
    )


def test_a_source_beyond_the_field_of_view_is_put_at_its_edge():
    narrow = Aperture(LINE, FieldOfView(azimuth_rad=0.5))
    x = narrow.steering_vectors(0.55)[None, None]
    found = Bartlett().find_directions(x, narrow, np.full(1, 1e-2))
    assert found.azimuth_rad[0, 0] == pytest.approx(0.5)


def test_standard_errors_are_no_more_than_those_of_any_direction():
    seen = Aperture(LINE, replace(FIELD, azimuth_rad=1.0))
    x = noise((50, 1, 12), np.random.default_rng(88))
    found = Bartlett().find_directions(x, seen, np.full(50, 1e6))
    assert found.azimuth_std_rad == pytest.approx(1 / np.sqrt(3))


def test_a_window_of_no_name_is_refused():
    with pytest.raises(dc.InvalidSetting, match="window"):
        Fft(window="triangle")
