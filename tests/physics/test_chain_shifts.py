"""Shift invariance of the processing chain in time, range and velocity."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from small_radars import WINDOWS, scene_strategy, simulate_echoes, small_chain, small_radar

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
EPS = float(np.finfo(np.float32).eps)
few_examples = settings(max_examples=8)


@few_examples
@given(
    st.integers(0, 2**32 - 1), st.sampled_from(WINDOWS), st.integers(-40, 40), st.integers(-40, 40)
)
def test_modulated_samples_shift_map_cyclically(seed, window, rows, columns):
    """Shift the map by k rows for k cycles per chirp, by q columns for q cycles per frame."""
    rng = np.random.default_rng(seed)
    n_chirps, n_samples, padded = 32, 96, 2
    samples = rng.standard_normal((n_chirps, 2, n_samples, 2)) @ (1, 1j)
    modulated = samples * np.exp(2j * np.pi * rows * np.arange(n_samples) / n_samples)
    modulated *= np.exp(2j * np.pi * columns * np.arange(n_chirps) / n_chirps)[:, None, None]
    fast, slow = (
        Transform(window=window, n_points=n, n_bins=padded * n) for n in (n_samples, n_chirps)
    )
    original, modulated_map = (
        mean_range_doppler_power(cube.astype(np.complex64), "complex", fast, slow)
        for cube in (samples, modulated)
    )
    rolled = np.roll(original, (padded * columns, padded * rows), axis=(0, 1))
    assert abs(modulated_map - rolled).max() < 40 * EPS * original.max()


@few_examples
@given(
    st.floats(0.2, 0.6),
    st.integers(1, 8),
    st.sampled_from(["complex", "real"]),
    st.sampled_from(WINDOWS),
)
def test_range_shift_by_cells_shifts_peak_by_bins(range_share, cells, sampling, window):
    radar = small_radar(sampling)
    chirp = radar.frame.chirp
    bin_m = float(chirp.range_bins_m(chirp.n_samples)[1])
    row = round(range_share * chirp.max_range_m / bin_m)
    peaks = []
    for k in (row, row + cells):
        scene = dc.Scene(targets=[dc.Target(position_m=(k * bin_m, 0, 0))])
        cube = dc.simulate(scene, radar, impairments=()).isel(frame=0)
        power = dc.power_map(cube, radar, small_chain(window))
        peaks.append(np.unravel_index(int(np.argmax(power.values)), power.shape))
    (slow, fast), (slow_2, fast_2) = peaks
    assert slow == slow_2 == radar.frame.n_chirps // 2
    assert (fast, fast_2) == (row, row + cells)


@few_examples
@given(st.floats(0.2, 0.8), st.floats(-0.05, 0.05), st.sampled_from(["complex", "real"]))
def test_echo_phase_follows_delay_at_mid_window(range_share, extra_range_m, sampling):
    radar = small_radar(sampling, n_rx=1)
    chirp = radar.frame.chirp
    mid_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * (
        chirp.adc_start_s + (chirp.n_samples - 1) / 2 / chirp.sample_rate_hz
    )
    phases, cycles = [], []
    for range_m in (
        range_share * chirp.max_range_m,
        range_share * chirp.max_range_m + extra_range_m,
    ):
        scene = dc.Scene(targets=[dc.Target(position_m=(range_m, 0, 0))])
        cube = dc.simulate(scene, radar, impairments=())
        trace = dc.slow_time.slow_time(cube, radar, range_m, window="blackman-harris")
        phases.append(np.angle(complex(trace.values[0, 0])))
        delay_s = 2 * range_m / SPEED_OF_LIGHT
        # The delay includes the residual video phase: tau (f - S tau / 2).
        cycles.append(delay_s * (mid_hz - chirp.slope_hz_per_s * delay_s / 2))
    expected_rad = 2 * np.pi * (cycles[1] - cycles[0])
    error_rad = (phases[1] - phases[0] - expected_rad + np.pi) % (2 * np.pi) - np.pi
    # The image of real samples, 29 rows away or more, leaks at -92 dB.
    assert abs(error_rad) < (1e-5 if sampling == "complex" else 1e-4)


@few_examples
@given(scene_strategy(), st.integers(1, 50))
def test_later_frame_equals_first_frame_of_moved_scene(radar_and_scene, number):
    radar, scene = radar_and_scene
    at_s = number * radar.frame.period_s
    moved_targets = [
        replace(t, position_m=tuple(np.add(t.position_m, np.multiply(at_s, t.velocity_m_per_s))))
        for t in scene.targets
    ]
    ego = dc.Ego(position_m=(at_s * 3.0, -at_s, 0), velocity_m_per_s=(3, -1, 0))
    moving_scene = replace(scene, ego=dc.Ego(velocity_m_per_s=(3, -1, 0)))
    later_frame = simulate_echoes(moving_scene, radar, n_frames=number + 1)[number]
    expected = simulate_echoes(dc.Scene(targets=moved_targets, ego=ego), radar)[0]
    # Positions at 60 m are rounded to 7e-15 m, 5e-11 cycles, several times.
    np.testing.assert_allclose(later_frame, expected, rtol=0, atol=1e-8 * abs(expected).max())


@settings(max_examples=15)
@given(scene_strategy(max_targets=1), st.integers(0, 2**32 - 1), st.sampled_from(WINDOWS))
def test_detection_agrees_with_truth_within_standard_errors(radar_and_scene, seed, window):
    radar, scene = radar_and_scene
    scene = dc.Scene(targets=[replace(detection, rcs_m2=100.0) for detection in scene.targets])
    detections = dc.detect(dc.simulate(scene, radar, seed=seed), radar, small_chain(window))
    truth = dc.truth(scene, radar).isel(target=0, frame=0)
    detection = detections.isel(detection=int(np.argmax(detections.snr.values)))
    # The image of a real tone shifts the peak by some thousandths of a cell.
    frame, chirp = radar.frame, radar.frame.chirp
    image_bias_cells = 0.01 if chirp.sampling == "real" else 0.0
    cells = {
        "range": float(chirp.range_bins_m(chirp.n_samples)[1]),
        "velocity": 2 * frame.max_velocity_m_per_s / frame.n_chirps,
        "azimuth": 0.3,
    }
    for name, cell in cells.items():
        # Six standard errors are exceeded once in 5e8 numbers.
        error = float(detection[name]) - float(truth[name])
        assert abs(error) < 6 * float(detection[f"{name}_std"]) + image_bias_cells * cell, name
