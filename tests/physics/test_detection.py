"""Detection: probability and false alarms, resolution, invariants and rejected cubes and chains."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.processing.cfar.base import MapNoise
from dechirp.processing.chain_findings import chain_findings
from dechirp.processing.detect import detect_columns
from dechirp.processing.peaks import find_peaks
from dechirp.processing.spectrum import Transform
from dechirp.theory.detection import detection_probability, detection_threshold
from dechirp.theory.windows import Window
from nightly import NIGHTLY, nightly, nightly_except
from noise_cubes import add_noise, iter_noisy_trials, simulate_noise_cube


def make_chain(window, **bins):
    return dc.Chain(range_window=window, doppler_window=window, **bins)


# Theory predicts 0.93 and 0.95 for this target at known noise level, without neighbouring cells.
# The standard error of 2,500 trials is 0.005: a chain as good as theory fails once in 1e8. Of 60
# trials of the Hann window, 45 or fewer detect it once in 1e6.
@pytest.mark.parametrize(
    ("window", "snr_db"),
    nightly_except([("hann", -37.0)], [("rectangular", -40.5), ("hann", -37.0)]),
)
def test_detects_reference_target_in_ninety_percent_of_trials(reference, clean, window, snr_db):
    radar, truth = reference.radar, dc.truth(reference.scene, reference.radar).isel(frame=0)
    n_trials, limit, hits = (2500, 0.9, 0) if NIGHTLY else (60, 46 / 60, 0)
    for cube in iter_noisy_trials(clean, snr_db, np.random.default_rng(21), n_trials):
        detections = detect_columns([cube], radar, make_chain(window))
        is_near = (
            abs(detections["range"] - float(truth.range[0])) <= radar.frame.chirp.range_resolution_m
        )
        is_near &= (
            abs(detections["velocity"] - float(truth.velocity[0]))
            <= radar.frame.velocity_resolution_m_per_s
        )
        hits += bool(is_near.any())
    assert hits / n_trials >= limit


def test_peak_to_noise_ratio_follows_integration_gain(reference, clean):
    radar = reference.radar
    rng = np.random.default_rng(22)
    for window in ("rectangular", "hann", "blackman"):
        chain = make_chain(window)
        range_transform = chain.range_transform(radar.frame.chirp)
        doppler_transform = chain.doppler_transform(radar.frame)
        echo = dc.power_map(clean.isel(frame=0), radar, chain).max()
        noise = dc.power_map(
            (add_noise(clean, -10, rng) - clean).isel(frame=0), radar, chain
        ).mean()
        beat_range_m = 50.0047 + radar.frame.chirp.range_doppler_coupling_m(10.0)
        cycles_per_sample = beat_range_m / radar.frame.chirp.range_resolution_m / 2200
        cycles_per_chirp = 2 * 10.0 / radar.frame.chirp.wavelength_m * radar.frame.interval_s
        expected = (
            0.1
            * 2200
            * 128
            * range_transform.straddling_loss(cycles_per_sample)
            * doppler_transform.straddling_loss(cycles_per_chirp)
        )
        expected /= range_transform.noise_bandwidth_bins * doppler_transform.noise_bandwidth_bins
        # The mean covers 281,600 cells, correlated over at most 6: 1 % is more than 5 standard
        # errors.
        assert float(echo / noise) == pytest.approx(expected, rel=0.01)


@nightly
def test_strong_target_is_one_detection_under_any_window(reference, clean):
    rng = np.random.default_rng(23)
    # Noise adds 0.28 false alarms per map, 5.6 in 20 maps; 23 or more once in 3e7.
    n_maps, limit = 20, 23
    for window in get_args(Window):
        n_false_alarms = 0
        for _ in range(n_maps):
            detections = dc.detect(add_noise(clean, 0, rng), reference.radar, make_chain(window))
            is_target = abs(detections.range - 50) < 1
            assert int(is_target.sum()) == 1
            n_false_alarms += int((~is_target).sum())
        assert n_false_alarms < limit


@nightly
@pytest.mark.parametrize("window", ["hann", "blackman-harris"])
def test_noise_free_echo_is_one_detection(radar, window):
    """Detect the target once: rounding errors are the only noise of its map, and no target."""
    target = dc.Target(position_m=(31.4, 0, 0), velocity_m_per_s=(-7.3, 0, 0))
    cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=())
    assert dc.detect(cube, radar, make_chain(window)).sizes["detection"] == 1


def test_resolves_targets_two_and_a_half_cells_apart(reference):
    radar = reference.radar
    cell = radar.frame.chirp.range_resolution_m
    targets = [
        dc.Target(position_m=(50, 0, 0), rcs_m2=10),
        dc.Target(position_m=(50 + 2.5 * cell, 0, 0), rcs_m2=10),
    ]
    cube = dc.simulate(dc.Scene(targets=targets), radar, impairments=())
    detections = dc.detect(add_noise(cube, -20, np.random.default_rng(24)), radar).sortby("range")

    # The standard error of either target alone is 7 mm at 34 dB; their sidelobes, which bias each
    # by 5 cm, are separated.
    strong_detections = detections.isel(detection=detections.snr.values > 100)
    np.testing.assert_allclose(strong_detections.range, [50, 50 + 2.5 * cell], atol=0.04)


@nightly
@pytest.mark.parametrize("n_rx", [1, 3])
def test_detection_probability_of_tone_on_bin_matches_theory(radar, n_rx):
    chirp = replace(radar.frame.chirp, n_samples=64)
    frame = replace(radar.frame, chirp=chirp, n_chirps=64)
    array = dc.Array(rx_m=[(0, 0.002 * k, 0) for k in range(n_rx)])
    radar = replace(radar, frame=frame, array=array)
    snr, pfa, n_trials = 4.0, 1e-3, 3000
    # Theory gives a factor for the sum over receivers; the map contains their mean.
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(), offset=detection_threshold(pfa, n_summed=n_rx) / n_rx
    )
    chain = make_chain("rectangular", cfar=cfar)
    index = np.arange(64)
    tone = np.exp(2j * np.pi * (5 * index[:, None] + 20 * index) / 64)[:, None, :]
    tone = (np.sqrt(snr) / 64 * tone).astype(np.complex64)
    rng = np.random.default_rng(25)
    hits = 0
    for _ in range(n_trials):
        cube = simulate_noise_cube(radar, rng).isel(frame=0) + tone
        power = dc.power_map(cube, radar, chain)
        threshold = dc.threshold_map(power, radar, chain)
        hits += bool(power[32 + 5, 20] > threshold[32 + 5, 20])

    # The mean of 644 cells varies by 4 %, which changes the probability by 0.001. Five
    # standard errors of the trials are allowed.
    expected = float(detection_probability(snr, pfa, n_summed=n_rx))
    assert hits / n_trials == pytest.approx(
        expected, abs=0.001 + 5 * np.sqrt(expected * (1 - expected) / n_trials)
    )


def test_velocity_wraps_around_at_map_limits(radar):
    limit = radar.frame.max_velocity_m_per_s
    for velocity in (-limit, limit - 0.01, -limit + 0.3):
        target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=10)
        detections = dc.detect(dc.simulate(dc.Scene(targets=[target]), radar, seed=1), radar)
        error = (float(detections.velocity[0]) - velocity + limit) % (2 * limit) - limit
        assert abs(error) < 5 * float(detections.velocity_std[0])


def test_detections_do_not_depend_on_axis_order_or_scale(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0), rcs_m2=10)])
    cube = dc.simulate(scene, radar, seed=2, n_frames=2)
    expected = dc.detect(cube, radar)

    transposed = dc.detect(cube.transpose("rx", "sample", "frame", "chirp"), radar)
    assert transposed.identical(expected)
    scaled = dc.detect(cube * np.float32(2.0**30), radar)
    # Single-precision logarithms shift the start of the refinement slightly.
    xr.testing.assert_allclose(scaled, expected, rtol=1e-6)
    assert set(expected.frame.values) == {0, 1}
    assert list(dict.fromkeys(expected.time.values)) == pytest.approx(
        [radar.frame.mid_frame_s, radar.frame.frame_start_s(1) + radar.frame.mid_frame_s]
    )


@pytest.mark.parametrize("invalid_sample", [np.nan, np.inf])
def test_rejects_nonfinite_samples(radar, invalid_sample):
    cube = dc.simulate(dc.Scene(), radar, seed=3)
    cube.values[0, 17, 1, 200] = invalid_sample
    with pytest.raises(dc.InvalidSetting, match="not finite"):
        dc.detect(cube, radar)


def test_rejects_cube_of_another_radar(radar, reference):
    cube = dc.simulate(dc.Scene(), radar, seed=3)
    with pytest.raises(
        dc.InvalidSetting, match="128, as the radar has|2200, as the radar has|1, as"
    ):
        dc.detect(cube, reference.radar)
    with pytest.raises(dc.InvalidSetting, match="complex samples, as the chirp specifies"):
        dc.detect(cube.real, radar)
    with pytest.raises(dc.InvalidSetting, match="over frame, chirp, rx, sample"):
        dc.detect(cube.isel(frame=0, drop=True), radar)


def test_rejects_training_window_larger_than_map(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=3)
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=10, velocity=80),
        false_alarm_probability=1e-6,
    )
    with pytest.raises(dc.InvalidSetting, match=r"169 velocity cells.*at most 128"):
        dc.detect(cube, radar, dc.Chain(cfar=cfar))


@nightly
def test_finding_reports_guard_window_inside_main_lobe(radar):
    assert chain_findings(radar, dc.Chain()) == []
    # The main lobe of a Hann window, padded by 16, reaches 32 bins to either side.
    (finding,) = chain_findings(radar, dc.Chain(n_range_bins=4096))
    assert finding.setting == "chain.cfar.n_guard.range"
    assert "4 guard cells inside a main lobe of 32 bins" in finding.value
    assert finding.expected.startswith("31")
    # Without training cells along range, only the row of the target itself counts.
    cfar = replace(dc.Chain().cfar, n_training=dc.Cells(range=0, velocity=8))
    assert chain_findings(radar, dc.Chain(n_range_bins=4096, cfar=cfar)) == []


@pytest.mark.parametrize(
    "settings",
    [
        {"false_alarm_probability": 0.0},
        {"false_alarm_probability": 1.0},
        {"false_alarm_probability": 1e-6, "offset": 10.0},
        {},
        {"offset": -3.0},
        {"offset": 10.0, "n_training": dc.Cells(range=0, velocity=0)},
    ],
    ids=str,
)
def test_rejects_cfar_without_single_threshold_setting(settings):
    with pytest.raises(dc.InvalidSetting):
        dc.Cfar(estimator=dc.cfar.CellAveraging(), **settings)


def test_sample_offset_is_detected_at_range_zero(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=6)
    cube += np.complex64(1e-5)
    detection = dc.detect(cube, radar).isel(detection=0)
    # The echo comes from the array centre, next to the origin.
    phase_centre_m = np.linalg.norm(radar.element_positions_m.mean(axis=0) / 2)
    assert float(detection.range) == pytest.approx(
        0, abs=5 * float(detection.range_std) + phase_centre_m
    )
    assert float(detection.velocity) == pytest.approx(0, abs=5 * float(detection.velocity_std))


def test_double_precision_cube_yields_same_detections(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0), rcs_m2=10)])
    single = dc.detect(dc.simulate(scene, radar, seed=7), radar)
    noise = dc.simulate(dc.Scene(), radar, seed=7)
    double = dc.simulate(scene, radar, impairments=(), dtype=np.complex128) + noise
    xr.testing.assert_allclose(dc.detect(double, radar), single, rtol=1e-4)


def test_silent_cube_yields_no_detection(radar):
    assert dc.detect(dc.simulate(dc.Scene(), radar, impairments=()), radar).sizes["detection"] == 0


def test_rejects_map_larger_than_memory(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=8)
    with pytest.raises(dc.NotEnoughMemory, match="range-Doppler map: .* GiB of memory"):
        dc.detect(cube, radar, dc.Chain(n_range_bins=10**9))


@pytest.mark.parametrize(
    "settings",
    [
        {"n_range_bins": 0},
        {"n_range_bins": 300.5},
        {"n_velocity_bins": -1},
        {"range_window": "hanning"},
        {"cfar": None},
    ],
    ids=str,
)
def test_rejects_invalid_chain(settings):
    with pytest.raises(dc.InvalidSetting, match=f"Chain.{next(iter(settings))}"):
        dc.Chain(**settings)


def test_rejects_fewer_bins_than_samples(radar):
    with pytest.raises(dc.InvalidSetting, match="at least 256"):
        dc.detect(dc.simulate(dc.Scene(), radar, seed=9), radar, dc.Chain(n_range_bins=25))


@nightly
def test_excess_peaks_are_warned_and_strongest_ones_kept(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=10)
    cfar = dc.Cfar(estimator=dc.cfar.CellAveraging(), offset=0.5)
    with pytest.warns(dc.PhysicsWarning, match="more than 2000 peaks over threshold"):
        detections = dc.detect(cube, radar, dc.Chain(range_window="rectangular", cfar=cfar))
    assert 0 < detections.sizes["detection"] <= 2000


@pytest.mark.parametrize("n_bins", [64, 65])
def test_sidelobe_suppression_wraps_around_doppler_axis(n_bins):
    transform = Transform(window="rectangular", n_points=n_bins, n_bins=n_bins)
    noise = MapNoise(range_transform=transform, doppler_transform=transform)
    threshold = np.full((n_bins, n_bins), 1e-6, np.float32)
    # Two cells apart across the end, and at the largest possible distance: sidelobe and target.
    for velocity_bin, is_target in ((n_bins - 1, False), (1 + n_bins // 2, True)):
        power = np.zeros((n_bins, n_bins), np.float32)
        power[1, 30], power[velocity_bin, 30] = 1.0, 0.02
        peaks = find_peaks(power, threshold, noise)
        assert len(peaks) == 1 + is_target


@pytest.mark.parametrize(
    "n_chirps", nightly_except([1, 2, 3, 4, 8, 24], [1, 2, 3, 4, 5, 8, 16, 24])
)
@pytest.mark.parametrize("n_samples", nightly_except([8, 64], [8, 20, 64]))
def test_default_chain_works_for_every_map_size(radar, n_chirps, n_samples):
    chirp = replace(radar.frame.chirp, n_samples=n_samples)
    small_radar = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=n_chirps))
    target = dc.Target(position_m=(chirp.max_range_m / 3, 0, 0), rcs_m2=1e4)
    cube = dc.simulate(dc.Scene(targets=[target]), small_radar, seed=1)

    detections = dc.detect(cube, small_radar)

    smallest_error_m = np.abs(detections.range.values - chirp.max_range_m / 3).min(initial=np.inf)
    assert smallest_error_m < chirp.range_resolution_m


def test_fit_to_radar_shrinks_default_windows_and_keeps_custom_ones(radar):
    short_frame_radar = replace(radar, frame=replace(radar.frame, n_chirps=16))
    default = dc.Chain().cfar

    fitted = dc.Chain().fit_to_radar(short_frame_radar).cfar

    assert dc.Chain().fit_to_radar(radar).cfar == default
    assert (fitted.n_training, fitted.n_guard) == (
        dc.Cells(range=10, velocity=4),
        dc.Cells(range=4, velocity=3),
    )
    custom = replace(default, n_training=dc.Cells(range=10, velocity=9))
    assert dc.Chain(cfar=custom).fit_to_radar(short_frame_radar).cfar == custom


def test_rejects_plain_array_and_cube_without_frames(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=8)
    with pytest.raises(dc.InvalidSetting, match="cube: an ndarray"):
        dc.detect(cube.values, radar)
    with pytest.raises(dc.InvalidSetting, match="cube: 0 frames"):
        dc.detect(cube.isel(frame=slice(0, 0)), radar)
