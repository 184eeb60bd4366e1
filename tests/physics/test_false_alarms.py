"""False alarms come at the designed rate: everywhere in the map, for any window and padding."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.range_doppler_map import range_doppler_power
from dechirp.processing.spectrum import independent_rows, noise_gain
from dechirp.theory.windows import Window
from nightly import nightly
from noise import noise_cube


def with_size(radar, n_samples, n_chirps, n_rx=1, sampling="complex"):
    """A radar whose map has that size."""
    chirp = replace(radar.frame.chirp, n_samples=n_samples, ramp_duration_s=1e-3, sampling=sampling)
    frame = replace(radar.frame, chirp=chirp, n_chirps=n_chirps, interval_s=1e-3)
    return replace(
        radar, frame=frame, array=dc.Array(rx_m=[(0, 0.002 * k, 0) for k in range(n_rx)])
    )


def chain_at(window, n_range_bins, pfa, **cfar):
    return dc.Chain(
        range_window=window,
        doppler_window=window,
        n_range_bins=n_range_bins,
        cfar=dc.Cfar(estimator=dc.cfar.CellAveraging(), false_alarm_probability=pfa, **cfar),
    )


def alarms(radar, chain, n_maps, seed):
    """Alarms in each cell over so many maps of noise, and the number of rows searched."""
    rng = np.random.default_rng(seed)
    noise = chain.map_noise(radar)
    rows = independent_rows(radar.frame.chirp, noise.range_transform)
    counts = 0
    for _ in range(n_maps):
        power = range_doppler_power(noise_cube(radar, rng).values[0], radar, chain)
        over = np.zeros(power.shape, bool)
        over[:, rows] = chain.cfar.exceeds_threshold(np.ascontiguousarray(power[:, rows]), noise)
        counts = counts + over
    return counts, rows.stop - rows.start


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_a_cell_alarms_where_the_map_is_over_the_map_of_the_threshold(radar, sampling):
    radar, chain = with_size(radar, 64, 64, sampling=sampling), chain_at("hann", None, 1e-2)
    cube = noise_cube(radar, np.random.default_rng(9)).isel(frame=0)
    power = dc.power_map(cube, radar, chain)
    over = power > dc.threshold_map(power, radar, chain)

    counts, n_rows = alarms(radar, chain, 1, seed=9)
    assert counts.sum() > 5
    assert np.array_equal(counts, over)
    assert n_rows == np.isfinite(dc.threshold_map(power, radar, chain)[0]).sum()


# Alarms come in clusters where bins are correlated: 4.2 to a cluster at the most here (Hann,
# padded), so that n alarms are as uncertain as n / 4.2 independent ones. 4e7 cells at 1e-4
# then give a standard error of 3.2 %; the band is 6 of them wide on the near side.
@pytest.mark.parametrize("n_range_bins", [None, 4096], ids=["unpadded", "padded"])
@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_alarms_on_the_reference_map_come_as_often_as_designed(radar, window, n_range_bins):
    radar = with_size(radar, 2200, 128)
    n_maps = 140 if n_range_bins is None else 76
    counts, _ = alarms(radar, chain_at(window, n_range_bins, 1e-4), n_maps, seed=1)

    assert n_maps * counts.size > 3.9e7
    assert 0.8 < counts.sum() / (n_maps * counts.size) / 1e-4 < 1.25


# The cell under test is independent of its training cells, four bins off or more: given its
# threshold it alarms with a known probability, whose mean over maps is the rate.
@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_every_edge_row_and_column_has_the_rate_that_was_designed(radar, window):
    radar = with_size(radar, 64, 64)
    chain, rng, n_maps = chain_at(window, None, 1e-3), np.random.default_rng(22), 600
    noise = chain.map_noise(radar)
    mean = noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    rates = np.zeros((64, 64))
    for _ in range(n_maps):
        power = range_doppler_power(noise_cube(radar, rng).values[0], radar, chain)
        rates += np.exp(-chain.cfar.threshold(power, noise).astype(float) / mean)
    rates /= n_maps * 1e-3
    # A threshold is 5 % off, and the rate seven times that; two rings fit side by side into a
    # row: 1 % standard error of each, and six of them.
    assert rates.mean(axis=0) == pytest.approx(np.ones(64), abs=0.06)
    assert rates.mean(axis=1) == pytest.approx(np.ones(64), abs=0.06)


@nightly
@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_alarms_in_every_edge_row_and_column_come_as_often_as_designed(radar, window):
    radar = with_size(radar, 64, 64)
    n_maps = 28_000
    counts, _ = alarms(radar, chain_at(window, None, 1e-3), n_maps, seed=2)

    # 1.8e6 cells a row or column, 1,790 alarms; clusters of at most 1.9: 3.3 % standard error,
    # and 20 % is 6 of them.
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


@pytest.mark.parametrize("window", sorted(set(get_args(Window)) - {"rectangular", "hann"}))
def test_alarms_under_every_other_window_come_as_often_as_designed(radar, window):
    radar = with_size(radar, 128, 64)
    n_maps = 600
    counts, _ = alarms(radar, chain_at(window, None, 1e-3), n_maps, seed=7)
    # 4,915 alarms in clusters of at most 2.4 (Blackman-Harris): 2.2 %; six of them.
    # Under it the factor for independent cells would be 23 % too often exceeded.
    assert counts.sum() / (n_maps * counts.size) / 1e-3 == pytest.approx(1, abs=0.13)


@pytest.mark.parametrize("window", ["rectangular", "hann"])
@pytest.mark.parametrize("n_rx", [3, 8])
def test_power_of_several_receivers_has_its_own_factor(radar, window, n_rx):
    radar = with_size(radar, 128, 64, n_rx=n_rx)
    n_maps = 1500
    counts, _ = alarms(radar, chain_at(window, None, 1e-3), n_maps, seed=3)
    # 12,288 alarms in clusters of at most 1.9: 1.2 %; six of them.
    assert counts.sum() / (n_maps * counts.size) / 1e-3 == pytest.approx(1, abs=0.075)


@pytest.mark.parametrize("window", ["rectangular", "hann"])
@pytest.mark.parametrize("n_range_bins", [None, 256])
def test_real_samples_alarm_as_designed_in_the_rows_that_are_searched(radar, window, n_range_bins):
    radar = with_size(radar, 128, 64, sampling="real")
    n_maps = 3000
    counts, n_rows = alarms(radar, chain_at(window, n_range_bins, 1e-3), n_maps, seed=4)
    # 10,000 alarms in clusters of at most 3: 1.7 %; the cells near zero velocity in the outer
    # rows, whose noise is a tenth correlated with its mirror image, add 2 % at the most.
    rate = counts.sum() / (n_maps * 64 * n_rows) / 1e-3
    assert rate == pytest.approx(1, abs=0.12)
    # Half the rows less those at DC and half the sample rate: 1 or 2 at either end unpadded.
    assert 0 < counts.shape[1] - n_rows <= (4 if n_range_bins is None else 6)


@pytest.mark.parametrize(
    ("n_training", "n_guard"),
    [((6, 0), (2, 0)), ((0, 5), (0, 2)), ((3, 2), (0, 0)), ((1, 1), (3, 3))],
    ids=["range alone", "velocity alone", "no guard", "thin ring"],
)
def test_rings_of_any_shape_keep_the_rate(radar, n_training, n_guard):
    radar = with_size(radar, 128, 64)
    cells = [dc.Cells(range=r, velocity=v) for r, v in (n_training, n_guard)]
    chain = chain_at("hann", None, 1e-3, n_training=cells[0], n_guard=cells[1])
    n_maps = 3000
    counts, _ = alarms(radar, chain, n_maps, seed=5)
    # 24,576 alarms in clusters of at most 1.9: 0.9 %; seven of them.
    assert counts.sum() / (n_maps * counts.size) / 1e-3 == pytest.approx(1, abs=0.065)


def test_an_offset_is_a_ratio_of_powers(radar):
    radar = with_size(radar, 128, 64)
    cfar = dc.Cfar(estimator=dc.cfar.CellAveraging(), offset=10.0)
    chain = dc.Chain(range_window="rectangular", doppler_window="rectangular", cfar=cfar)
    counts, _ = alarms(radar, chain, 2000, seed=6)
    # Ten times the mean of N = 644 cells is exceeded with probability (1 + 10 / N)^-N, more at
    # the ends of the range where N is up to 680: 4.90e-5, about 800 alarms, 3.5 %; five.
    assert counts.sum() / (2000 * counts.size) == pytest.approx(4.9e-5, rel=0.18)


def test_a_strong_target_leaves_the_noise_beside_it_whole(radar):
    rng = np.random.default_rng(8)
    power = rng.exponential(size=(64, 128)).astype(np.float32)
    ring = dc.Cfar(estimator=dc.cfar.CellAveraging(), false_alarm_probability=1e-4).training_window
    calm = dc.cfar.CellAveraging().threshold(power, ring, np.ones(power.shape[1], np.float32))
    struck = power.copy()
    struck[30, 60] = 1e12  # 120 dB over the noise
    level = dc.cfar.CellAveraging().threshold(struck, ring, np.ones(power.shape[1], np.float32))

    apart = np.ones(power.shape, bool)
    apart[30 - 12 : 30 + 13, 60 - 14 : 60 + 15] = False
    np.testing.assert_allclose(level[apart], calm[apart], rtol=1e-3)
    guard = (slice(30 - 4, 30 + 5), slice(60 - 4, 60 + 5))
    np.testing.assert_allclose(level[guard], calm[guard], rtol=1e-3)


def test_the_level_is_the_mean_of_the_ring_cell_by_cell():
    rng = np.random.default_rng(9)
    power = rng.exponential(size=(26, 40)).astype(np.float32)
    for training, guard in [
        ((10, 8), (4, 4)),
        ((3, 0), (0, 0)),
        ((0, 3), (2, 1)),
        ((5, 7), (1, 0)),
    ]:
        cells = [dc.Cells(range=r, velocity=v) for r, v in (training, guard)]
        ring = dc.Cfar(
            estimator=dc.cfar.CellAveraging(), n_training=cells[0], n_guard=cells[1], offset=1.0
        ).training_window
        found = dc.cfar.CellAveraging().threshold(power, ring, np.ones(power.shape[1], np.float32))
        places = ring.box_rows(40)
        for v in range(26):
            for j in range(40):
                rows = j - places[j] + np.arange(2 * ring.half_range + 1)
                columns = np.arange(-ring.half_velocity, ring.half_velocity + 1)
                inside = (abs(columns)[:, None] <= guard[1]) & (abs(rows - j) <= guard[0])
                cells_there = power[np.ix_((v + columns) % 26, rows)]
                # Sums of up to 700 single-precision cells.
                assert found[v, j] == pytest.approx(cells_there[~inside].mean(), rel=5e-6)
