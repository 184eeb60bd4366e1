"""The reference target is found as often as theory allows, and nothing else is."""

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
from noise import looks, noise_cube, noisy


def chain_with(window, **bins):
    return dc.Chain(range_window=window, doppler_window=window, **bins)


# Theory for this target and a known noise level: 0.93 and 0.95, neighbours not counted. The
# standard error of 2,500 trials is 0.005: a chain as good as theory fails once in 1e8.
@pytest.mark.parametrize(("window", "snr_db"), [("rectangular", -40.5), ("hann", -37.0)])
def test_the_reference_target_is_found_nine_times_in_ten(reference, clean, window, snr_db):
    radar, truth = reference.radar, dc.truth(reference.scene, reference.radar).isel(frame=0)
    n_trials, hits = 2500, 0
    for cube in looks(clean, snr_db, np.random.default_rng(21), n_trials):
        found = detect_columns([cube], radar, chain_with(window))
        near = abs(found["range"] - float(truth.range[0])) <= radar.frame.chirp.range_resolution_m
        near &= (
            abs(found["velocity"] - float(truth.velocity[0]))
            <= radar.frame.velocity_resolution_m_per_s
        )
        hits += bool(near.any())
    assert hits / n_trials >= 0.9


def test_the_peak_rises_over_the_noise_as_the_transforms_add(reference, clean):
    radar = reference.radar
    rng = np.random.default_rng(22)
    for window in ("rectangular", "hann", "blackman"):
        chain = chain_with(window)
        over_range = chain.range_transform(radar.frame.chirp)
        over_velocity = chain.doppler_transform(radar.frame)
        echo = dc.power_map(clean.isel(frame=0), radar, chain).max()
        noise = dc.power_map((noisy(clean, -10, rng) - clean).isel(frame=0), radar, chain).mean()
        beat_range_m = 50.0047 + radar.frame.chirp.range_doppler_coupling_m(10.0)
        cells = beat_range_m / radar.frame.chirp.range_resolution_m / 2200
        turns = 2 * 10.0 / radar.frame.chirp.wavelength_m * radar.frame.interval_s
        expected = (
            0.1
            * 2200
            * 128
            * over_range.straddling_loss(cells)
            * over_velocity.straddling_loss(turns)
        )
        expected /= over_range.noise_bandwidth_bins * over_velocity.noise_bandwidth_bins
        # Mean of 281,600 cells, correlated over at most 6: 1 % is more than 5 standard errors.
        assert float(echo / noise) == pytest.approx(expected, rel=0.01)


def test_a_strong_target_is_one_detection_under_any_window(reference, clean):
    rng = np.random.default_rng(23)
    for window in get_args(Window):
        extra = 0
        for _ in range(20):
            found = dc.detect(noisy(clean, 0, rng), reference.radar, chain_with(window))
            truly = abs(found.range - 50) < 1
            assert int(truly.sum()) == 1
            extra += int((~truly).sum())
        # Noise adds 0.28 false alarms a map: 5.6 in 20 maps; 23 or more once in 3e7.
        assert extra < 23


@pytest.mark.parametrize("window", ["hann", "blackman-harris"])
def test_an_echo_without_any_noise_is_one_detection(radar, window):
    """What rounding leaves of it is the only noise of its map, and no target."""
    target = dc.Target(position_m=(31.4, 0, 0), velocity_m_per_s=(-7.3, 0, 0))
    cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=())
    assert dc.detect(cube, radar, chain_with(window)).sizes["detection"] == 1


def test_two_targets_two_and_a_half_cells_apart_are_two(reference):
    radar = reference.radar
    cell = radar.frame.chirp.range_resolution_m
    targets = [
        dc.Target(position_m=(50, 0, 0), rcs_m2=10),
        dc.Target(position_m=(50 + 2.5 * cell, 0, 0), rcs_m2=10),
    ]
    with pytest.warns(dc.PhysicsWarning):
        cube = dc.simulate(dc.Scene(targets=targets), radar, impairments=())
    found = dc.detect(noisy(cube, -20, np.random.default_rng(24)), radar).sortby("range")

    # At 34 dB the standard error is 7 mm for either alone; their sidelobes, which would move
    # each by 5 cm, are parted.
    strong = found.isel(detection=found.snr.values > 100)
    np.testing.assert_allclose(strong.range, [50, 50 + 2.5 * cell], atol=0.04)


@pytest.mark.parametrize("n_rx", [1, 3])
def test_a_tone_on_a_bin_is_found_as_often_as_theory_says(radar, n_rx):
    chirp = replace(radar.frame.chirp, n_samples=64)
    frame = replace(radar.frame, chirp=chirp, n_chirps=64)
    array = dc.Array(rx_m=[(0, 0.002 * k, 0) for k in range(n_rx)])
    radar = replace(radar, frame=frame, array=array)
    snr, pfa, n_trials = 4.0, 1e-3, 3000
    # A factor for the sum over receivers, which theory gives; the map holds their mean.
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(), offset=detection_threshold(pfa, n_summed=n_rx) / n_rx
    )
    chain = chain_with("rectangular", cfar=cfar)
    turns = np.arange(64)
    tone = np.exp(2j * np.pi * (5 * turns[:, None] + 20 * turns) / 64)[:, None, :]
    tone = (np.sqrt(snr) / 64 * tone).astype(np.complex64)
    rng = np.random.default_rng(25)
    hits = 0
    for _ in range(n_trials):
        cube = noise_cube(radar, rng).isel(frame=0) + tone
        power = dc.power_map(cube, radar, chain)
        over = dc.threshold_map(power, radar, chain)
        hits += bool(power[32 + 5, 20] > over[32 + 5, 20])

    # The mean of 644 cells scatters by 4 %, which moves the probability by 0.001; the
    # standard error of the trials is at most 0.009.
    expected = float(detection_probability(snr, pfa, n_summed=n_rx))
    assert hits / n_trials == pytest.approx(expected, abs=0.001 + 5 * 0.009)


def test_velocity_wraps_round_at_the_ends_of_the_map(radar):
    limit = radar.frame.max_velocity_m_per_s
    for velocity in (-limit, limit - 0.01, -limit + 0.3):
        target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=10)
        found = dc.detect(dc.simulate(dc.Scene(targets=[target]), radar, seed=1), radar)
        apart = (float(found.velocity[0]) - velocity + limit) % (2 * limit) - limit
        assert abs(apart) < 5 * float(found.velocity_std[0])


def test_detections_do_not_depend_on_the_order_of_axes_or_the_scale(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0), rcs_m2=10)])
    cube = dc.simulate(scene, radar, seed=2, n_frames=2)
    expected = dc.detect(cube, radar)

    turned = dc.detect(cube.transpose("rx", "sample", "frame", "chirp"), radar)
    assert turned.identical(expected)
    scaled = dc.detect(cube * np.float32(2.0**30), radar)
    # Single-precision logarithms start the refinement a little elsewhere.
    xr.testing.assert_allclose(scaled, expected, rtol=1e-6)
    assert set(expected.frame.values) == {0, 1}
    assert list(dict.fromkeys(expected.time.values)) == pytest.approx(
        [radar.frame.mid_frame_s, radar.frame.frame_start_s(1) + radar.frame.mid_frame_s]
    )


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_samples_that_are_not_finite_are_refused(radar, poison):
    cube = dc.simulate(dc.Scene(), radar, seed=3)
    cube.values[0, 17, 1, 200] = poison
    with pytest.raises(dc.InvalidSetting, match="not finite"):
        dc.detect(cube, radar)


def test_a_cube_of_another_radar_is_refused(radar, reference):
    cube = dc.simulate(dc.Scene(), radar, seed=3)
    with pytest.raises(
        dc.InvalidSetting, match="128, as the radar has|2200, as the radar has|1, as"
    ):
        dc.detect(cube, reference.radar)
    with pytest.raises(dc.InvalidSetting, match="complex samples, as the chirp specifies"):
        dc.detect(cube.real, radar)
    with pytest.raises(dc.InvalidSetting, match="over frame, chirp, rx, sample"):
        dc.detect(cube.isel(frame=0, drop=True), radar)


def test_a_ring_that_does_not_fit_is_refused(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=3)
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=10, velocity=80),
        false_alarm_probability=1e-6,
    )
    with pytest.raises(dc.InvalidSetting, match=r"169 velocity cells.*at most 128"):
        dc.detect(cube, radar, dc.Chain(cfar=cfar))


def test_a_guard_inside_the_main_lobe_is_remarked_upon(radar):
    assert chain_findings(radar, dc.Chain()) == []
    # 16 times padded, a Hann main lobe reaches 32 bins to either side.
    (finding,) = chain_findings(radar, dc.Chain(n_range_bins=4096))
    assert finding.setting == "chain.cfar.n_guard.range"
    assert "4 guard cells inside a main lobe of 32 bins" in finding.value
    assert finding.expected.startswith("31")
    # Without training cells along range, a target's own row is the only one there is.
    cfar = replace(dc.Chain().cfar, n_training=dc.Cells(range=0, velocity=8))
    assert chain_findings(radar, dc.Chain(n_range_bins=4096, cfar=cfar)) == []


@pytest.mark.parametrize(
    "wrong",
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
def test_a_detector_without_a_clear_threshold_is_refused(wrong):
    with pytest.raises(dc.InvalidSetting):
        dc.Cfar(estimator=dc.cfar.CellAveraging(), **wrong)


def test_a_constant_offset_of_the_samples_is_a_detection_at_range_zero(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=6)
    cube += np.complex64(1e-5)
    found = dc.detect(cube, radar).isel(detection=0)
    # as an echo from the middle of the array, beside the origin
    middle_m = np.linalg.norm(radar.element_positions_m.mean(axis=0) / 2)
    assert float(found.range) == pytest.approx(0, abs=5 * float(found.range_std) + middle_m)
    assert float(found.velocity) == pytest.approx(0, abs=5 * float(found.velocity_std))


def test_a_cube_in_double_precision_gives_the_same_detections(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0), rcs_m2=10)])
    single = dc.detect(dc.simulate(scene, radar, seed=7), radar)
    noise = dc.simulate(dc.Scene(), radar, seed=7)
    double = dc.simulate(scene, radar, impairments=(), dtype=np.complex128) + noise
    xr.testing.assert_allclose(dc.detect(double, radar), single, rtol=1e-4)


def test_silence_holds_no_detection(radar):
    assert dc.detect(dc.simulate(dc.Scene(), radar, impairments=()), radar).sizes["detection"] == 0


def test_a_map_larger_than_memory_is_refused_with_the_number(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=8)
    with pytest.raises(dc.NotEnoughMemory, match="range-Doppler map: .* GiB of memory"):
        dc.detect(cube, radar, dc.Chain(n_range_bins=10**9))


@pytest.mark.parametrize(
    "wrong",
    [
        {"n_range_bins": 0},
        {"n_range_bins": 300.5},
        {"n_velocity_bins": -1},
        {"range_window": "hanning"},
        {"cfar": None},
    ],
    ids=str,
)
def test_a_chain_that_cannot_work_is_refused(wrong):
    with pytest.raises(dc.InvalidSetting, match=f"Chain.{next(iter(wrong))}"):
        dc.Chain(**wrong)


def test_fewer_bins_than_points_are_refused(radar):
    with pytest.raises(dc.InvalidSetting, match="at least 256"):
        dc.detect(dc.simulate(dc.Scene(), radar, seed=9), radar, dc.Chain(n_range_bins=25))


def test_more_peaks_than_anyone_can_use_are_announced_and_the_strongest_kept(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=10)
    cfar = dc.Cfar(estimator=dc.cfar.CellAveraging(), offset=0.5)
    with pytest.warns(dc.PhysicsWarning, match="more than 2000 peaks over threshold"):
        found = dc.detect(cube, radar, dc.Chain(range_window="rectangular", cfar=cfar))
    assert 0 < found.sizes["detection"] <= 2000


@pytest.mark.parametrize("n_bins", [64, 65])
def test_a_sidelobe_beyond_the_end_of_an_axis_counts_as_near(n_bins):
    transform = Transform(window="rectangular", n_points=n_bins, n_bins=n_bins)
    noise = MapNoise(range_transform=transform, doppler_transform=transform)
    threshold = np.full((n_bins, n_bins), 1e-6, np.float32)
    # Two cells apart round the end, and as far apart as cells can be: sidelobe and target.
    for place, is_target in ((n_bins - 1, False), (1 + n_bins // 2, True)):
        power = np.zeros((n_bins, n_bins), np.float32)
        power[1, 30], power[place, 30] = 1.0, 0.02
        found = find_peaks(power, threshold, noise)
        assert len(found) == 1 + is_target


@pytest.mark.parametrize("n_chirps", [1, 2, 3, 4, 5, 8, 16, 24])
@pytest.mark.parametrize("n_samples", [8, 20, 64])
def test_the_default_chain_fits_every_radar(radar, n_chirps, n_samples):
    chirp = replace(radar.frame.chirp, n_samples=n_samples)
    small = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=n_chirps))
    target = dc.Target(position_m=(chirp.max_range_m / 3, 0, 0), rcs_m2=1e4)
    cube = dc.simulate(dc.Scene(targets=[target]), small, seed=1)

    found = dc.detect(cube, small)

    nearest = np.abs(found.range.values - chirp.max_range_m / 3).min(initial=np.inf)
    assert nearest < chirp.range_resolution_m


def test_cells_that_were_set_are_kept_and_default_ones_become_fewer(radar):
    short = replace(radar, frame=replace(radar.frame, n_chirps=16))
    default = dc.Chain().cfar

    fewer = dc.Chain().fit_to_radar(short).cfar

    assert dc.Chain().fit_to_radar(radar).cfar == default
    assert (fewer.n_training, fewer.n_guard) == (
        dc.Cells(range=10, velocity=4),
        dc.Cells(range=4, velocity=3),
    )
    own = replace(default, n_training=dc.Cells(range=10, velocity=9))
    assert dc.Chain(cfar=own).fit_to_radar(short).cfar == own


def test_what_is_no_cube_or_has_no_frames_is_refused(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=8)
    with pytest.raises(dc.InvalidSetting, match="cube: a ndarray"):
        dc.detect(cube.values, radar)
    with pytest.raises(dc.InvalidSetting, match="cube: 0 frames"):
        dc.detect(cube.isel(frame=slice(0, 0)), radar)
