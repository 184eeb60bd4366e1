"""Invariants of the processing chain: superposition, scale, power, order and reproducibility."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.config import loading
from dechirp.config.dumping import dump_yaml
from dechirp.core.threads import limit_threads
from dechirp.processing.detect import FrameProcessor
from dechirp.processing.spectrum import (
    Transform,
    mean_range_doppler_power,
    range_doppler_real_and_imaginary,
    range_doppler_spectrum,
    range_spectrum,
)
from nightly import nightly_except
from small_radars import CODES, WINDOWS, scene_strategy, simulate_echoes, small_chain, small_radar

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
EPS = float(np.finfo(np.float32).eps)
few_examples = settings(max_examples=8)
seeds = st.integers(0, 2**32 - 1)


@few_examples
@given(scene_strategy(), st.data())
def test_echoes_superpose_linearly(radar_and_scene, data):
    radar, scene = radar_and_scene
    first = data.draw(st.integers(0, len(scene.targets)))
    parts = [scene.targets[:first], scene.targets[first:]]
    separate_sum = sum(simulate_echoes(dc.Scene(targets=part), radar) for part in parts)
    combined = simulate_echoes(scene, radar)
    np.testing.assert_allclose(combined, separate_sum, rtol=0, atol=1e-11 * abs(combined).max())


@few_examples
@given(scene_strategy(), st.integers(-10, 10))
def test_fourfold_cross_section_doubles_echo_bit_exactly(radar_and_scene, k):
    radar, scene = radar_and_scene
    scaled_targets = [replace(target, rcs_m2=target.rcs_m2 * 4.0**k) for target in scene.targets]
    np.testing.assert_array_equal(
        simulate_echoes(dc.Scene(targets=scaled_targets), radar),
        2.0**k * simulate_echoes(scene, radar),
    )


def compute_spectra(samples, sampling, window, n_more):
    transforms = [
        Transform(window=window, n_points=n, n_bins=n + n_more)
        for n in (samples.shape[2], samples.shape[0])
    ]
    parts = range_doppler_real_and_imaginary(samples, sampling, *transforms)
    range_only = range_spectrum(samples, sampling, transforms[0])
    return [
        range_doppler_spectrum(samples, sampling, *transforms),
        parts[:, :, 0] + 1j * parts[:, :, 1],
        range_only,
    ]


def draw_samples(rng, sampling, shape):
    samples = rng.standard_normal(shape)
    if sampling == "real":
        return samples.astype(np.float32)
    return (samples + 1j * rng.standard_normal(shape)).astype(np.complex64)


@few_examples
@given(
    seeds,
    st.sampled_from(["complex", "real"]),
    st.sampled_from(WINDOWS),
    st.sampled_from([0, 32]),
    st.floats(-3, 3),
)
def test_spectra_are_linear(seed, sampling, window, n_more, share):
    rng = np.random.default_rng(seed)
    x, y = (draw_samples(rng, sampling, (32, 2, 64)) for _ in range(2))
    sums = compute_spectra((x + np.float32(share) * y).astype(x.dtype), sampling, window, n_more)
    for of_sum, of_x, of_y in zip(
        sums,
        compute_spectra(x, sampling, window, n_more),
        compute_spectra(y, sampling, window, n_more),
        strict=True,
    ):
        size = np.sqrt(np.mean(abs(of_sum) ** 2))
        # Three spectra enter, the parts up to four times the sum, each cell accurate to 10 eps of
        # its rms.
        assert abs(of_sum - (of_x + np.float32(share) * of_y)).max() < 100 * EPS * size


@few_examples
@given(
    seeds,
    st.sampled_from(WINDOWS),
    st.sampled_from([0, 7, 64]),
    st.sampled_from(["complex", "real"]),
)
def test_map_power_equals_power_of_windowed_samples(seed, window, n_more, sampling):
    """Check Parseval's theorem with windows, zero padding and the half spectrum of real samples."""
    samples = draw_samples(np.random.default_rng(seed), sampling, (32, 2, 96))
    fast, slow = (
        Transform(window=window, n_points=n, n_bins=n + n_more)
        for n in (samples.shape[2], samples.shape[0])
    )
    power = mean_range_doppler_power(samples, sampling, fast, slow).astype(float)
    windowed = samples * slow.weights[:, None, None] * fast.weights
    windowed /= slow.weights.sum() * fast.weights.sum()
    expected = fast.n_bins * slow.n_bins * (abs(windowed) ** 2).sum() / samples.shape[1]
    if sampling == "real":
        # The half spectrum has twice the power, so that a tone keeps its own; the rows 0 and N / 2
        # are their own images.
        self_image_power = power[:, 0].sum() + (power[:, -1].sum() if fast.n_bins % 2 == 0 else 0.0)
        assert power.sum() == pytest.approx(expected + self_image_power / 2, rel=10 * EPS)
    else:
        assert power.sum() == pytest.approx(expected, rel=10 * EPS)


def assert_columns_equal(result, expected, **tolerance):
    assert result.sizes == expected.sizes
    for name in expected.data_vars:
        np.testing.assert_allclose(result[name], expected[name], err_msg=name, **tolerance)


@few_examples
@given(scene_strategy(), seeds, st.sampled_from(WINDOWS), st.floats(-12, 6), st.integers(-40, 20))
def test_detections_do_not_depend_on_sample_scale(
    radar_and_scene, seed, window, decades, doublings
):
    radar, scene = radar_and_scene
    # Rounding may exchange ranks of training cells slightly for real samples.
    cube = dc.simulate(scene, radar, seed=seed)
    expected = dc.detect(cube, radar, small_chain(window))
    binary_scaled = dc.detect(cube * np.float32(2.0**doublings), radar, small_chain(window))
    assert_columns_equal(binary_scaled, expected, rtol=0, atol=0)
    decimal_scaled = dc.detect(
        (cube * np.float32(10.0**decades)).astype(cube.dtype), radar, small_chain(window)
    )
    # Rounding of samples adds noise at -150 dB.
    assert_columns_equal(decimal_scaled, expected, rtol=1e-4, atol=1e-6)


@few_examples
@given(scene_strategy(), seeds, st.integers(-20, 20))
def test_map_scales_with_squared_amplitude_bit_exactly(radar_and_scene, seed, doublings):
    radar, scene = radar_and_scene
    frame_cube = dc.simulate(scene, radar, seed=seed).isel(frame=0)
    power, scaled = (
        dc.power_map(cube, radar, small_chain())
        for cube in (frame_cube, frame_cube * np.float32(2.0**doublings))
    )
    np.testing.assert_array_equal(scaled, power * np.float32(4.0**doublings))


@pytest.mark.parametrize("exponent", [-100, -60, 50, 90])
def test_equalised_power_keeps_unit_of_samples(exponent):
    radar = small_radar()
    cube = dc.simulate(dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))]), radar, seed=1)
    level = np.float32(2.0 ** -np.frexp(float(abs(cube).max()))[1])
    maps = []
    for scale in (1.0, np.float32(2.0**exponent)):
        (frame,) = FrameProcessor(radar, small_chain()).process_cubes([cube * level * scale])
        maps += frame.equalised_power
    with np.errstate(over="ignore", under="ignore"):
        np.testing.assert_array_equal(maps[1], np.ldexp(maps[0], 2 * exponent))


@few_examples
@given(scene_strategy(), seeds)
def test_frame_order_does_not_change_detections(radar_and_scene, seed):
    radar, scene = radar_and_scene
    cube = dc.simulate(scene, radar, n_frames=2, seed=seed)
    forward = dc.detect(cube, radar, small_chain())
    backward = dc.detect(cube.isel(frame=[1, 0]), radar, small_chain())
    for number in (0, 1):
        expected = forward.isel(detection=forward.frame.values == number)
        result = backward.isel(detection=backward.frame.values == 1 - number)
        assert_columns_equal(result.drop_vars("frame"), expected.drop_vars("frame"), rtol=0, atol=0)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("code", nightly_except(2, CODES), ids=str)
def test_detections_are_bit_identical_for_any_number_of_threads(sampling, code):
    radar = small_radar(sampling, code)
    targets = [dc.Target(position_m=(x, y, 0), rcs_m2=10) for x, y in ((10, 1), (18, -3), (27, 0))]
    results = []
    for n_threads in (1, 2, 5):
        with limit_threads(n_threads):
            cube = dc.simulate(dc.Scene(targets=targets), radar, seed=3)
            results.append(dc.detect(cube, radar, small_chain()))
    assert results[0].sizes["detection"] >= 3
    for result in results[1:]:
        assert result.identical(results[0])


@few_examples
@given(scene_strategy(), st.integers(0, 10**6), st.sampled_from(WINDOWS))
def test_reloaded_scenario_reproduces_cube_and_detections(radar_and_scene, seed, window):
    radar, scene = radar_and_scene
    scene = dc.Scene(targets=[replace(t, name=f"t{i}") for i, t in enumerate(scene.targets)])
    scenario = dc.Scenario(radar=radar, scene=scene, seed=seed, chain=small_chain(window))
    reloaded = loading.parse_settings(dump_yaml(scenario), dc.Scenario)
    cubes, results = [], []
    for case in (scenario, reloaded):
        cubes.append(dc.simulate(case.scene, case.radar, seed=case.seed))
        results.append(dc.detect(cubes[-1], case.radar, case.chain))
    assert cubes[1].identical(cubes[0])
    assert results[1].identical(results[0])
