"""False-alarm rate of cell averaging: map edges, windows, padding and receivers."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.range_doppler_map import range_doppler_power
from dechirp.processing.spectrum import noise_gain, rows_with_circular_noise
from dechirp.theory.windows import Window
from nightly import nightly, nightly_except
from noise_cubes import simulate_noise_cube


def resize_map(radar, n_samples, n_chirps, n_rx=1, sampling="complex"):
    """Return the radar with another map size."""
    chirp = replace(radar.frame.chirp, n_samples=n_samples, ramp_duration_s=1e-3, sampling=sampling)
    frame = replace(radar.frame, chirp=chirp, n_chirps=n_chirps, interval_s=1e-3)
    return replace(
        radar, frame=frame, array=dc.Array(rx_m=[(0, 0.002 * k, 0) for k in range(n_rx)])
    )


def make_chain(window, n_range_bins, pfa, **cfar):
    return dc.Chain(
        range_window=window,
        doppler_window=window,
        n_range_bins=n_range_bins,
        cfar=dc.Cfar(estimator=dc.cfar.CellAveraging(), false_alarm_probability=pfa, **cfar),
    )


def count_alarms(radar, chain, n_maps, seed):
    """Return the alarms of each cell over maps of noise, and the number of searched rows."""
    rng = np.random.default_rng(seed)
    noise = chain.map_noise_statistics(radar)
    rows = rows_with_circular_noise(radar.frame.chirp, noise.range_transform)
    counts = 0
    for _ in range(n_maps):
        power = range_doppler_power(simulate_noise_cube(radar, rng).values[0], radar, chain)
        is_alarm = np.zeros(power.shape, bool)
        is_alarm[:, rows] = chain.cfar.exceeds_threshold(
            np.ascontiguousarray(power[:, rows]), noise
        )
        counts = counts + is_alarm
    return counts, rows.stop - rows.start


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_alarms_are_cells_above_threshold_map(radar, sampling):
    radar, chain = resize_map(radar, 64, 64, sampling=sampling), make_chain("hann", None, 1e-2)
    cube = simulate_noise_cube(radar, np.random.default_rng(9)).isel(frame=0)
    power = dc.power_map(cube, radar, chain)
    is_alarm = power > dc.threshold_map(power, radar, chain)

    counts, n_rows = count_alarms(radar, chain, 1, seed=9)
    rows = rows_with_circular_noise(
        radar.frame.chirp, chain.map_noise_statistics(radar).range_transform
    )
    assert counts.sum() > 5
    assert np.array_equal(counts[:, rows], is_alarm[:, rows])
    is_finite = np.isfinite(dc.threshold_map(power, radar, chain)).values
    # At zero velocity and at the largest one, cells about DC and half the sample rate are excluded.
    assert is_finite[[0, 32]].sum() == 2 * n_rows
    assert is_finite[[5, 27], 1:].all()


# Alarms are clustered where bins are correlated: at most 4.2 per cluster here (Hann, padded), so
# that n alarms are as uncertain as n / 4.2 independent ones. The standard error for 4e7 cells at
# 1e-4 is 3.2 %, a sixth of the lower tolerance.
@pytest.mark.parametrize(
    "n_range_bins", nightly_except(1, [None, 4096]), ids=["unpadded", "padded"]
)
@pytest.mark.parametrize("window", nightly_except(["hann"], ["rectangular", "hann"]))
def test_false_alarm_rate_on_reference_map_matches_setting(radar, window, n_range_bins):
    radar = resize_map(radar, 2200, 128)
    n_maps = 140 if n_range_bins is None else 76
    counts, _ = count_alarms(radar, make_chain(window, n_range_bins, 1e-4), n_maps, seed=1)

    assert n_maps * counts.size > 3.9e7
    assert 0.8 < counts.sum() / (n_maps * counts.size) / 1e-4 < 1.25


# The cell under test is independent of its training cells, which are at least four bins away: its
# alarm probability follows from its threshold, and the mean over maps is the rate.
@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_expected_rate_matches_setting_in_every_row_and_column(radar, window):
    radar = resize_map(radar, 64, 64)
    chain, rng, n_maps = make_chain(window, None, 1e-3), np.random.default_rng(22), 600
    noise = chain.map_noise_statistics(radar)
    mean = noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    rates = np.zeros((64, 64))
    for _ in range(n_maps):
        power = range_doppler_power(simulate_noise_cube(radar, rng).values[0], radar, chain)
        rates += np.exp(-chain.cfar.threshold(power, noise).astype(float) / mean)
    rates /= n_maps * 1e-3
    # Thresholds vary by 5 % and rates by seven times that; two training windows fit side by side
    # into a row: 1 % standard error, six of which are allowed.
    assert rates.mean(axis=0) == pytest.approx(np.ones(64), abs=0.06)
    assert rates.mean(axis=1) == pytest.approx(np.ones(64), abs=0.06)


@nightly
@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_false_alarm_rate_matches_setting_in_edge_rows_and_columns(radar, window):
    radar = resize_map(radar, 64, 64)
    n_maps = 28_000
    counts, _ = count_alarms(radar, make_chain(window, None, 1e-3), n_maps, seed=2)

    # 1.8e6 cells per row or column yield 1,790 alarms in clusters of at most 1.9: 3.3 % standard
    # error, a sixth of 20 %.
    per_cell = counts / n_maps / 1e-3
    half_range, half_velocity = 14, 12
    for rates in (
        per_cell.mean(axis=0)[:half_range],
        per_cell.mean(axis=0)[-half_range:],
        per_cell.mean(axis=1)[:half_velocity],
        per_cell.mean(axis=1)[-half_velocity:],
    ):
        assert rates.min() > 0.8
        assert rates.max() < 1.25


@pytest.mark.parametrize(
    "window", nightly_except(2, sorted(set(get_args(Window)) - {"rectangular", "hann"}))
)
def test_false_alarm_rate_matches_setting_for_every_window(radar, window):
    radar = resize_map(radar, 128, 64)
    n_maps = 600
    counts, _ = count_alarms(radar, make_chain(window, None, 1e-3), n_maps, seed=7)
    # 4,915 alarms in clusters of at most 2.4 (Blackman-Harris): 2.2 % standard error, six of which
    # are allowed. The factor for independent cells is exceeded 23 % too often with that window.
    assert counts.sum() / (n_maps * counts.size) / 1e-3 == pytest.approx(1, abs=0.13)


@nightly
@pytest.mark.parametrize("window", ["rectangular", "hann"])
@pytest.mark.parametrize("n_rx", [3, 8])
def test_false_alarm_rate_of_several_receivers_matches_setting(radar, window, n_rx):
    radar = resize_map(radar, 128, 64, n_rx=n_rx)
    n_maps = 1500
    counts, _ = count_alarms(radar, make_chain(window, None, 1e-3), n_maps, seed=3)
    # 12,288 alarms in clusters of at most 1.9: 1.2 % standard error, six of which are allowed.
    assert counts.sum() / (n_maps * counts.size) / 1e-3 == pytest.approx(1, abs=0.075)


@nightly
@pytest.mark.parametrize("window", ["rectangular", "hann"])
@pytest.mark.parametrize("n_range_bins", [None, 256])
def test_false_alarm_rate_of_real_samples_matches_setting(radar, window, n_range_bins):
    radar = resize_map(radar, 128, 64, sampling="real")
    n_maps = 3000
    counts, n_rows = count_alarms(radar, make_chain(window, n_range_bins, 1e-3), n_maps, seed=4)
    # 10,000 alarms in clusters of at most 3: 1.7 % standard error; cells near zero velocity in the
    # outer rows, whose noise has a correlation of a tenth with its mirror image, add at most 2 %.
    rate = counts.sum() / (n_maps * 64 * n_rows) / 1e-3
    assert rate == pytest.approx(1, abs=0.12)
    # Half the rows except those at DC and half the sample rate: 1 or 2 at either end without
    # padding.
    assert 0 < counts.shape[1] - n_rows <= (4 if n_range_bins is None else 6)


@nightly
@pytest.mark.parametrize(
    ("n_training", "n_guard"),
    [((6, 0), (2, 0)), ((0, 5), (0, 2)), ((3, 2), (0, 0)), ((1, 1), (3, 3))],
    ids=["range only", "velocity only", "no guard", "thin window"],
)
def test_false_alarm_rate_matches_setting_for_any_training_window(radar, n_training, n_guard):
    radar = resize_map(radar, 128, 64)
    cells = [dc.Cells(range=r, velocity=v) for r, v in (n_training, n_guard)]
    chain = make_chain("hann", None, 1e-3, n_training=cells[0], n_guard=cells[1])
    n_maps = 3000
    counts, _ = count_alarms(radar, chain, n_maps, seed=5)
    # 24,576 alarms in clusters of at most 1.9: 0.9 % standard error, seven of which are allowed.
    assert counts.sum() / (n_maps * counts.size) / 1e-3 == pytest.approx(1, abs=0.065)


def test_offset_is_ratio_of_powers(radar):
    radar = resize_map(radar, 128, 64)
    cfar = dc.Cfar(estimator=dc.cfar.CellAveraging(), offset=10.0)
    chain = dc.Chain(range_window="rectangular", doppler_window="rectangular", cfar=cfar)
    counts, _ = count_alarms(radar, chain, 2000, seed=6)
    # Ten times the mean of N = 644 cells is exceeded with probability (1 + 10 / N)^-N, more at the
    # range ends where N is up to 680: 4.90e-5, about 800 alarms, 3.5 % standard error, five of
    # which are allowed.
    assert counts.sum() / (2000 * counts.size) == pytest.approx(4.9e-5, rel=0.18)


def test_strong_target_raises_threshold_in_training_window_only(radar):
    rng = np.random.default_rng(8)
    power = rng.exponential(size=(64, 128)).astype(np.float32)
    training_window = dc.Cfar(
        estimator=dc.cfar.CellAveraging(), false_alarm_probability=1e-4
    ).training_window
    noise_threshold = dc.cfar.CellAveraging().threshold(
        power, training_window, np.ones(power.shape[1], np.float32)
    )
    power_with_target = power.copy()
    power_with_target[30, 60] = 1e12  # 120 dB above the noise
    threshold = dc.cfar.CellAveraging().threshold(
        power_with_target, training_window, np.ones(power.shape[1], np.float32)
    )

    is_far = np.ones(power.shape, bool)
    is_far[30 - 12 : 30 + 13, 60 - 14 : 60 + 15] = False
    np.testing.assert_allclose(threshold[is_far], noise_threshold[is_far], rtol=1e-3)
    guard = (slice(30 - 4, 30 + 5), slice(60 - 4, 60 + 5))
    np.testing.assert_allclose(threshold[guard], noise_threshold[guard], rtol=1e-3)


def test_threshold_is_mean_of_training_cells():
    rng = np.random.default_rng(9)
    power = rng.exponential(size=(26, 40)).astype(np.float32)
    for training, guard in [
        ((10, 8), (4, 4)),
        ((3, 0), (0, 0)),
        ((0, 3), (2, 1)),
        ((5, 7), (1, 0)),
    ]:
        cells = [dc.Cells(range=r, velocity=v) for r, v in (training, guard)]
        training_window = dc.Cfar(
            estimator=dc.cfar.CellAveraging(), n_training=cells[0], n_guard=cells[1], offset=1.0
        ).training_window
        threshold = dc.cfar.CellAveraging().threshold(
            power, training_window, np.ones(power.shape[1], np.float32)
        )
        box_offsets = training_window.tested_rows_in_training_box(40)
        for v in range(26):
            for j in range(40):
                rows = j - box_offsets[j] + np.arange(2 * training_window.half_range + 1)
                columns = np.arange(
                    -training_window.half_velocity, training_window.half_velocity + 1
                )
                is_guard = (abs(columns)[:, None] <= guard[1]) & (abs(rows - j) <= guard[0])
                box_power = power[np.ix_((v + columns) % 26, rows)]
                # Sums contain up to 700 single-precision cells.
                assert threshold[v, j] == pytest.approx(box_power[~is_guard].mean(), rel=5e-6)


# Noise in the rows about DC and half the sample rate is circular for velocities of two cells or
# more. Thresholds are those of training cells in the next rows, which are independent of it.
@nightly
@pytest.mark.parametrize("n_range_bins", [None, 256])
@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_false_alarm_rate_of_real_samples_matches_setting_at_range_ends(
    radar, window, n_range_bins
):
    radar = resize_map(radar, 128, 64, sampling="real")
    chain = make_chain(window, n_range_bins, 1e-3)
    rng, n_maps = np.random.default_rng(5), 800
    noise = chain.map_noise_statistics(radar)
    rows = rows_with_circular_noise(radar.frame.chirp, noise.range_transform)
    mean = noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    cube = simulate_noise_cube(radar, rng).isel(frame=0)
    expected = power_sum = 0.0
    for _ in range(n_maps):
        cube.values[:] = simulate_noise_cube(radar, rng).values[0]
        power = dc.power_map(cube, radar, chain)
        threshold = dc.threshold_map(power, radar, chain).values
        at_ends = np.delete(np.arange(power.shape[1]), rows)
        is_tested = np.isfinite(threshold[:, at_ends])
        level = threshold[:, at_ends][is_tested].astype(float)
        expected += np.exp(-level / mean).mean() / n_maps
        power_sum += power.values[:, at_ends][is_tested].mean() / n_maps
    # Two to twelve rows of 58 cells or more: noise of 7e5 samples at least, of which a third is
    # independent under Hann windows with padding: 0.2 % standard error.
    assert power_sum / mean == pytest.approx(1, abs=0.012)
    # Thresholds vary by 5 % and rates by seven times that; three training windows fit beside each
    # other at either end: 1 % standard error, six of which are allowed.
    assert expected / 1e-3 == pytest.approx(1, abs=0.06)
