"""Maps of noise that are drawn directly are those that samples would give."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammainc, ndtri

import dechirp as dc
from dechirp.evaluation.noise_only import count_noise_alarms
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.noise_maps import can_draw_noise_maps, draw_noise_map
from dechirp.processing.range_doppler_map import range_doppler_power
from dechirp.processing.spectrum import noise_gain
from dechirp.processing.virtual_array import split_slots
from dechirp.theory import confidence_intervals
from nightly import NIGHTLY
from noise import noise_cube

# Two-sided, of each of the tests below.
CONFIDENCE = 1 - 1e-7
WINDOWS = [
    ("rectangular", "rectangular"),
    ("hann", "hann"),
    ("hamming", "blackman"),
    ("blackman-harris", "rectangular"),
]


def sized(radar, n_samples, n_chirps, n_rx=1, **chirp):
    """A radar whose map has that size."""
    chirp = replace(radar.frame.chirp, n_samples=n_samples, ramp_duration_s=1e-3, **chirp)
    frame = replace(radar.frame, chirp=chirp, n_chirps=n_chirps, interval_s=1e-3)
    array = dc.Array(rx_m=[(0, 0.002 * k, 0) for k in range(n_rx)])
    return replace(radar, frame=frame, array=array)


def chain_of(windows, radar, **cfar):
    cfar = dc.Cfar(**{"estimator": dc.cfar.CellAveraging(), "false_alarm_probability": 1e-3} | cfar)
    return dc.Chain(range_window=windows[0], doppler_window=windows[1], cfar=cfar).fit_to_radar(
        radar
    )


def by_samples(radar, chain, rng):
    """The long way: noise of unit power in every sample."""
    samples = noise_cube(radar, rng).values[0]
    return range_doppler_power(split_slots(samples, radar.frame), radar, chain)


@pytest.mark.parametrize(("windows", "n_rx"), [*((one, 1) for one in WINDOWS), (WINDOWS[1], 3)])
def test_every_two_cells_of_a_drawn_map_correlate_as_the_windows_tie_them(radar, windows, n_rx):
    """Of a small map every pair, those round its ends with them."""
    n_chirps, n_samples, n_maps = 7, 12, 40_000 if NIGHTLY else 6000
    radar = sized(radar, n_samples, n_chirps, n_rx)
    chain = dc.Chain(range_window=windows[0], doppler_window=windows[1])
    noise = chain.map_noise(radar)
    gain = noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    rng = np.random.default_rng(81)
    maps = np.array([draw_noise_map(radar, chain, 2.0, rng).ravel() for _ in range(n_maps)])
    off = maps.astype(float) / (2.0 * gain) - 1

    # Powers of jointly Gaussian amplitudes correlate by the square of what those do.
    ties = [
        abs(t.noise_correlation(t.n_bins)) ** 2
        for t in (noise.doppler_transform, noise.range_transform)
    ]
    expected = np.kron(*ties) / n_rx
    measured = off.T @ off / n_maps
    spread = np.sqrt((off**2).T @ off**2 / n_maps - measured**2)
    errors = (measured - expected) / spread * np.sqrt(n_maps)
    # 3,570 pairs, and the tail of sums of products of exponential powers, not quite normal.
    assert abs(errors).max() < -ndtri(1e-7 / 2 / len(off.T) ** 2) + 1.0
    assert abs(off.mean(axis=0)).max() < 7 / np.sqrt(n_rx * n_maps)


@pytest.mark.parametrize("windows", WINDOWS)
@pytest.mark.parametrize("n_rx", [1, 4])
def test_powers_of_a_drawn_map_are_gamma_variates(radar, windows, n_rx):
    radar = sized(radar, 128, 64, n_rx)
    chain = dc.Chain(range_window=windows[0], doppler_window=windows[1])
    noise = chain.map_noise(radar)
    gain = noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    rng = np.random.default_rng(82)
    # Windows reach three bins to either side: cells eight apart are independent.
    maps = [draw_noise_map(radar, chain, 0.5, rng)[3::8, 5::8] for _ in range(100)]
    power = np.sort(np.ravel(maps)) / (0.5 * gain)

    law, n = gammainc(n_rx, n_rx * power), power.size
    apart = max(np.max(np.arange(1, n + 1) / n - law), np.max(law - np.arange(n) / n))
    # Dvoretzky, Kiefer and Wolfowitz, with Massart's constant.
    assert apart < np.sqrt(np.log(2 / (1 - CONFIDENCE)) / (2 * n))


@pytest.mark.parametrize("windows", WINDOWS[1:] if NIGHTLY else WINDOWS[1:2])
def test_alarms_in_drawn_maps_come_and_cluster_as_in_those_of_samples(radar, windows):
    radar = sized(radar, 64, 48, n_rx=2)
    chain = chain_of(windows, radar)
    rng, n_maps = np.random.default_rng(83), 8_000 if NIGHTLY else 1000
    ways = (lambda: draw_noise_map(radar, chain, 1.0, rng), lambda: by_samples(radar, chain, rng))
    drawn, sampled = (
        np.array([[n.n_over, n.n_peaks, *edges(n, radar, chain)] for n in counts], float)
        for counts in (
            (count_noise_alarms(way(), radar, chain) for _ in range(n_maps)) for way in ways
        )
    )

    # About 3,000 alarms in 2,000 clusters each way; the means, then the spread between maps,
    # which clusters make.
    reach = -ndtri((1 - CONFIDENCE) / 2)
    for moments in (drawn, sampled), tuple((x - x.mean(0)) ** 2 for x in (drawn, sampled)):
        error = moments[0].mean(axis=0) - moments[1].mean(axis=0)
        spread = np.sqrt(sum(np.var(x, axis=0) for x in moments) / n_maps)
        assert np.all(abs(error) < reach * spread)
    # Tests of equality that had no power would pass: a fifth more alarms would be seen.
    assert reach * np.std(drawn[:, 0]) * np.sqrt(2 / n_maps) < 0.22 * drawn[:, 0].mean()


def edges(noise, radar, chain):
    """Alarms in the rows at either end of the range, where the ring moves off its middle."""
    over = chain.cfar.exceeds_threshold(noise.power, chain.map_noise(radar))
    return [over[:, :8].sum(), over[:, -8:].sum()]


def test_cells_of_a_drawn_map_alarm_as_designed(radar):
    radar = sized(radar, 128, 64)
    chain = chain_of(("hann", "hann"), radar, false_alarm_probability=1e-3)
    rng = np.random.default_rng(84)
    counts = [
        count_noise_alarms(draw_noise_map(radar, chain, 1.0, rng), radar, chain) for _ in range(600)
    ]
    assert {one.n_tested for one in counts} == {128 * 64}
    alarms = [one.n_over for one in counts]
    low, high = confidence_intervals.rate_interval(alarms, 128 * 64, confidence=CONFIDENCE)
    # 4,900 alarms in clusters of 1.5: 1.8 %, five of them either way.
    assert low < 1e-3 < high and high / low < 1.3


def test_maps_are_not_drawn_where_white_noise_is_not_white_over_bins(radar):
    usual = sized(radar, 64, 48)
    assert can_draw_noise_maps(usual, dc.Chain())
    walking = replace(dc.Chain(), range_walk="keystone")
    others = [
        (sized(radar, 64, 48, sampling="real"), dc.Chain()),
        (usual, dc.Chain(n_range_bins=65)),
        (usual, dc.Chain(n_velocity_bins=49)),
        (usual, dc.Chain(range_window="chebyshev-60")),
        (usual, dc.Chain(doppler_window="taylor-50")),
        (usual, dc.Chain(mitigation=[MeanSubtraction()])),
        (usual, walking),
    ]
    for one, chain in others:
        assert not can_draw_noise_maps(one, chain)
        with pytest.raises(dc.InvalidSetting, match="drawn directly"):
            draw_noise_map(one, chain, 1.0, np.random.default_rng(0))


@pytest.mark.parametrize("wrong", [-1.0, np.nan, np.inf])
def test_noise_has_a_power(radar, wrong):
    with pytest.raises(dc.InvalidSetting, match="noise_power_w"):
        draw_noise_map(sized(radar, 64, 48), dc.Chain(), wrong, np.random.default_rng(0))


def test_maps_drawn_by_two_threads_at_once_are_those_of_one(radar):
    radar, chain = sized(radar, 128, 64, n_rx=2), dc.Chain()

    def drawn(seed):
        return draw_noise_map(radar, chain, 1.0, np.random.default_rng(seed))

    with ThreadPoolExecutor(2) as threads:
        at_once = list(threads.map(drawn, range(50)))
    for seed, power in enumerate(at_once):
        np.testing.assert_array_equal(power, drawn(seed))
