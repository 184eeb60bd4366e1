"""The power map against discrete Fourier transforms in double precision, written out."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing import simd_fft, simd_range_doppler
from dechirp.processing.detect import FrameProcessor, detect_columns
from dechirp.processing.range_doppler_map import equalised_power
from dechirp.processing.spectrum import Transform, mean_power, split_spectrum

LENGTHS = [*range(1, 17), 22, 26, 30, 49, 121, 128, 169, 182, 200, 243, 2200, 4096]


@pytest.mark.parametrize("n", LENGTHS)
def test_sixteen_series_are_transformed_at_once(n):
    rng = np.random.default_rng(n)
    series = rng.standard_normal((n, 16)) + 1j * rng.standard_normal((n, 16))
    work = np.stack([series.real, series.imag], axis=1).astype(np.float32).ravel()
    stages = simd_fft.plan_stages(n)
    simd_fft.transform_points(work, 0, n, *stages)
    found = work.reshape(n, 2, 16)[simd_fft.frequency_positions(n)]
    exact = np.fft.fft(series, axis=0)
    # Each stage rounds by 6e-8 a few times; radix 13 adds thirteen numbers one by one.
    error = found[:, 0] + 1j * found[:, 1] - exact
    assert np.sqrt(np.mean(abs(error) ** 2)) < 4e-7 * np.sqrt(n)
    assert abs(error).max() < 3e-6 * np.sqrt(n)


def test_lengths_with_other_factors_are_left_to_others():
    assert simd_fft.plan_stages(17) is None
    assert simd_fft.plan_stages(2 * 19) is None
    assert not simd_range_doppler.can_transform(128, 2 * 17, 34)


SIZES = [
    (128, 220, 128, 220),
    (12, 16, 12, 16),
    (9, 40, 9, 64),
    (20, 33, 33, 33),
    (11, 100, 26, 105),
    (8, 17, 8, 34),  # a factor of 17: the other way
    (4, 60, 4, 60),  # too few velocities: the other way
]


@pytest.fixture(params=[1, 2], ids=["one_thread", "two_threads"])
def _threads(request, monkeypatch):
    monkeypatch.setattr("numba.get_num_threads", lambda: request.param)
    # Cut wherever it may be, however small the map is.
    monkeypatch.setattr(simd_range_doppler, "_FEWEST_CELLS", 1)


def exactly(n_chirps, n_samples, n_velocity, n_range, n_channels):
    """Samples, both transforms, and the spectrum (velocity, channel, range)."""
    rng = np.random.default_rng(1)
    shape = (n_chirps, n_channels, n_samples)
    samples = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)
    samples.setflags(write=False)
    over_range = Transform(window="hann", n_points=n_samples, n_bins=n_range)
    over_velocity = Transform(window="blackman", n_points=n_chirps, n_bins=n_velocity)
    slow, fast = (one.weights / one.weights.sum() for one in (over_velocity, over_range))
    tapered = samples * slow[:, None, None] * fast
    spectrum = np.fft.fft(np.fft.fft(tapered, n_range, axis=2), n_velocity, axis=0)
    return samples, over_range, over_velocity, np.fft.fftshift(spectrum, axes=0)


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("n_channels", [1, 3])
@pytest.mark.usefixtures("_threads")
def test_power_is_that_of_transforms_in_double_precision(size, n_channels):
    samples, over_range, over_velocity, spectrum = exactly(*size, n_channels)
    found = mean_power(samples, "complex", over_range, over_velocity)
    exact = np.mean(abs(spectrum) ** 2, axis=1)
    assert found.dtype == np.float32
    # Rounding leaves 1e-6 of the root mean square amplitude, and twice that of the power.
    assert abs(found - exact).max() < 1e-5 * np.sqrt(exact.max() * exact.mean())


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.usefixtures("_threads")
def test_a_split_spectrum_is_that_of_transforms_in_double_precision(size):
    samples, over_range, over_velocity, exact = exactly(*size, 3)
    found = split_spectrum(samples, "complex", over_range, over_velocity)
    assert found.dtype == np.float32 and found.flags.c_contiguous
    error = found[:, :, 0] + 1j * found[:, :, 1] - exact
    assert abs(error).max() < 5e-6 * np.sqrt(np.mean(abs(exact) ** 2))


@pytest.fixture(scope="module")
def looked_at():
    scenario = dc.reference(["radar.frame.n_chirps=32", "radar.frame.chirp.n_samples=200"])
    return scenario.radar, scenario.chain, scenario.scene


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_columns_are_those_of_the_labelled_detections(looked_at):
    radar, chain, scene = looked_at
    cube = dc.simulate(scene, radar, n_frames=3, seed=4)
    labelled = dc.detect(cube, radar, chain)
    assert labelled.sizes["detection"] >= 3
    one_by_one = [cube.isel(frame=slice(at, at + 1)) for at in range(3)]
    for cubes in ([cube], one_by_one, [cube.transpose("sample", "rx", "frame", "chirp")]):
        columns = detect_columns(cubes, radar, chain)
        assert list(columns) == list(labelled.data_vars)
        for name, column in columns.items():
            np.testing.assert_array_equal(column, labelled[name].values)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_scores_may_look_at_the_map_that_the_detector_saw(looked_at):
    radar, chain, scene = looked_at
    cube = dc.simulate(scene, radar, n_frames=2, seed=4)
    seen = []
    for frame in FrameProcessor(radar, chain).process([cube]):
        seen += frame.equalised_power
    assert len(seen) == 2
    for place, power in enumerate(seen):
        own = dc.power_map(cube.isel(frame=place), radar, chain).values
        np.testing.assert_array_equal(power, equalised_power(own, radar, chain))
