"""Range-Doppler transforms against discrete Fourier transforms in double precision."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.threads import limit_threads
from dechirp.processing import simd_fft, simd_range_doppler
from dechirp.processing.detect import FrameProcessor, detect_columns
from dechirp.processing.range_doppler_map import fill_unusable_cells_with_noise
from dechirp.processing.spectrum import (
    Transform,
    mean_range_doppler_power,
    range_doppler_real_and_imaginary,
)

LENGTHS = [*range(1, 17), 22, 26, 30, 49, 121, 128, 169, 182, 200, 243, 2200, 4096]


@pytest.mark.parametrize("n", LENGTHS)
def test_sixteen_series_match_numpy_fft(n):
    rng = np.random.default_rng(n)
    series = rng.standard_normal((n, 16)) + 1j * rng.standard_normal((n, 16))
    work = np.stack([series.real, series.imag], axis=1).astype(np.float32).ravel()
    stages = simd_fft.plan_fft_stages(n)
    simd_fft.fft_sixteen_series_in_place(work, 0, n, *stages)
    output = work.reshape(n, 2, 16)[simd_fft.output_position_of_frequency(n)]
    exact = np.fft.fft(series, axis=0)
    # Each stage has a few rounding errors of 6e-8; radix 13 adds thirteen numbers one by one.
    error = output[:, 0] + 1j * output[:, 1] - exact
    assert np.sqrt(np.mean(abs(error) ** 2)) < 4e-7 * np.sqrt(n)
    assert abs(error).max() < 3e-6 * np.sqrt(n)


def test_lengths_with_large_prime_factors_are_not_planned():
    assert simd_fft.plan_fft_stages(17) is None
    assert simd_fft.plan_fft_stages(2 * 19) is None
    assert not simd_range_doppler.can_transform_sizes(128, 2 * 17, 34)


SIZES = [
    (128, 220, 128, 220),
    (12, 16, 12, 16),
    (9, 40, 9, 64),
    (20, 33, 33, 33),
    (11, 100, 26, 105),
    (8, 17, 8, 34),  # the prime factor 17 uses the fallback transform
    (4, 60, 4, 60),  # too few velocities for the SIMD transform
]


@pytest.fixture(params=[1, 2], ids=["one_thread", "two_threads"])
def _threads(request, monkeypatch):
    # Divide maps of any size among threads.
    monkeypatch.setattr(simd_range_doppler, "_FEWEST_CELLS", 1)
    with limit_threads(request.param):
        yield


def simulate_exact_spectrum(n_chirps, n_samples, n_velocity, n_range, n_channels):
    """Return samples, both transforms, and the exact spectrum (velocity, channel, range)."""
    rng = np.random.default_rng(1)
    shape = (n_chirps, n_channels, n_samples)
    samples = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)
    samples.setflags(write=False)
    range_transform = Transform(window="hann", n_points=n_samples, n_bins=n_range)
    doppler_transform = Transform(window="blackman", n_points=n_chirps, n_bins=n_velocity)
    slow, fast = (
        transform.weights / transform.weights.sum()
        for transform in (doppler_transform, range_transform)
    )
    tapered_samples = samples * slow[:, None, None] * fast
    spectrum = np.fft.fft(np.fft.fft(tapered_samples, n_range, axis=2), n_velocity, axis=0)
    return samples, range_transform, doppler_transform, np.fft.fftshift(spectrum, axes=0)


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("n_channels", [1, 3])
@pytest.mark.usefixtures("_threads")
def test_power_matches_double_precision_transforms(size, n_channels):
    samples, range_transform, doppler_transform, spectrum = simulate_exact_spectrum(
        *size, n_channels
    )
    power = mean_range_doppler_power(samples, "complex", range_transform, doppler_transform)
    exact = np.mean(abs(spectrum) ** 2, axis=1)
    assert power.dtype == np.float32
    # Rounding errors are 1e-6 of the RMS amplitude, and twice that of the power.
    assert abs(power - exact).max() < 1e-5 * np.sqrt(exact.max() * exact.mean())


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.usefixtures("_threads")
def test_split_spectrum_matches_double_precision_transforms(size):
    samples, range_transform, doppler_transform, exact = simulate_exact_spectrum(*size, 3)
    spectrum = range_doppler_real_and_imaginary(
        samples, "complex", range_transform, doppler_transform
    )
    assert spectrum.dtype == np.float32 and spectrum.flags.c_contiguous
    error = spectrum[:, :, 0] + 1j * spectrum[:, :, 1] - exact
    assert abs(error).max() < 5e-6 * np.sqrt(np.mean(abs(exact) ** 2))


@pytest.fixture(scope="module")
def scenario_parts():
    scenario = dc.reference(["radar.frame.n_chirps=32", "radar.frame.chirp.n_samples=200"])
    return scenario.radar, scenario.chain, scenario.scene


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_columns_match_labelled_detections(scenario_parts):
    radar, chain, scene = scenario_parts
    cube = dc.simulate(scene, radar, n_frames=3, seed=4)
    labelled_detections = dc.detect(cube, radar, chain)
    assert labelled_detections.sizes["detection"] >= 3
    frame_cubes = [cube.isel(frame=slice(frame, frame + 1)) for frame in range(3)]
    for cubes in ([cube], frame_cubes, [cube.transpose("sample", "rx", "frame", "chirp")]):
        columns = detect_columns(cubes, radar, chain)
        assert list(columns) == list(labelled_detections.data_vars)
        for name, column in columns.items():
            np.testing.assert_array_equal(column, labelled_detections[name].values)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_frame_processor_returns_map_of_detector(scenario_parts):
    radar, chain, scene = scenario_parts
    cube = dc.simulate(scene, radar, n_frames=2, seed=4)
    maps = []
    for frame in FrameProcessor(radar, chain).process_cubes([cube]):
        maps += frame.equalised_power
    assert len(maps) == 2
    for index, power in enumerate(maps):
        frame_power = dc.power_map(cube.isel(frame=index), radar, chain).values
        np.testing.assert_array_equal(
            power, fill_unusable_cells_with_noise(frame_power, radar, chain)
        )
