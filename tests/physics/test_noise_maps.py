"""Noise maps drawn directly: same statistics as maps of simulated noise samples."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammainc, ndtri

import dechirp as dc
from dechirp.evaluation.false_alarms import count_noise_alarms
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.noise_maps import can_draw_noise_maps, draw_noise_map
from dechirp.processing.range_doppler_map import range_doppler_power
from dechirp.processing.spectrum import noise_gain
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.theory import confidence_intervals
from nightly import NIGHTLY, nightly, nightly_except
from noise_cubes import simulate_noise_cube

# Two-sided confidence of each test below.
CONFIDENCE = 1 - 1e-7
WINDOWS = [
    ("rectangular", "rectangular"),
    ("hann", "hann"),
    ("hamming", "blackman"),
    ("blackman-harris", "rectangular"),
]


def resize_radar(radar, n_samples, n_chirps, n_rx=1, **chirp):
    """Resize the radar so that its map has that size."""
    chirp = replace(radar.frame.chirp, n_samples=n_samples, ramp_duration_s=1e-3, **chirp)
    frame = replace(radar.frame, chirp=chirp, n_chirps=n_chirps, interval_s=1e-3)
    array = dc.Array(rx_m=[(0, 0.002 * k, 0) for k in range(n_rx)])
    return replace(radar, frame=frame, array=array)


def build_chain(windows, radar, **cfar):
    cfar = dc.Cfar(**{"estimator": dc.cfar.CellAveraging(), "false_alarm_probability": 1e-3} | cfar)
    return dc.Chain(range_window=windows[0], doppler_window=windows[1], cfar=cfar).fit_to_radar(
        radar
    )


def simulate_noise_map(radar, chain, rng):
    """Simulate a noise map from samples of unit power."""
    samples = simulate_noise_cube(radar, rng).values[0]
    return range_doppler_power(split_chirps_into_slots(samples, radar.frame), radar, chain)


@pytest.mark.parametrize(
    ("windows", "n_rx"),
    nightly_except(
        [(WINDOWS[2], 1), (WINDOWS[1], 3)],
        [*((pair, 1) for pair in WINDOWS), (WINDOWS[1], 3)],
    ),
)
def test_drawn_cells_correlate_as_windows_predict(radar, windows, n_rx):
    # All pairs of cells of a small map, including pairs across its ends.
    n_chirps, n_samples, n_maps = 7, 12, 40_000 if NIGHTLY else 6000
    radar = resize_radar(radar, n_samples, n_chirps, n_rx)
    chain = dc.Chain(range_window=windows[0], doppler_window=windows[1])
    noise = chain.map_noise_statistics(radar)
    gain = noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    rng = np.random.default_rng(81)
    maps = np.array([draw_noise_map(radar, chain, 2.0, rng).ravel() for _ in range(n_maps)])
    deviations = maps.astype(float) / (2.0 * gain) - 1

    # Power correlation of jointly Gaussian amplitudes: square of the amplitude correlation.
    correlations = [
        abs(t.noise_correlation_of_bins(t.n_bins)) ** 2
        for t in (noise.doppler_transform, noise.range_transform)
    ]
    expected = np.kron(*correlations) / n_rx
    measured = deviations.T @ deviations / n_maps
    spread = np.sqrt((deviations**2).T @ deviations**2 / n_maps - measured**2)
    errors = (measured - expected) / spread * np.sqrt(n_maps)
    # 3,570 pairs; sums of products of exponential powers have slightly heavier than normal tails.
    assert abs(errors).max() < -ndtri(1e-7 / 2 / len(deviations.T) ** 2) + 1.0
    assert abs(deviations.mean(axis=0)).max() < 7 / np.sqrt(n_rx * n_maps)


@pytest.mark.parametrize("windows", WINDOWS)
@pytest.mark.parametrize("n_rx", [1, 4])
def test_drawn_powers_are_gamma_distributed(radar, windows, n_rx):
    radar = resize_radar(radar, 128, 64, n_rx)
    chain = dc.Chain(range_window=windows[0], doppler_window=windows[1])
    noise = chain.map_noise_statistics(radar)
    gain = noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    rng = np.random.default_rng(82)
    # Windows spread over three bins to either side: cells eight apart are independent.
    maps = [draw_noise_map(radar, chain, 0.5, rng)[3::8, 5::8] for _ in range(100)]
    power = np.sort(np.ravel(maps)) / (0.5 * gain)

    law, n = gammainc(n_rx, n_rx * power), power.size
    distance = max(np.max(np.arange(1, n + 1) / n - law), np.max(law - np.arange(n) / n))
    # Dvoretzky, Kiefer and Wolfowitz, with Massart's constant.
    assert distance < np.sqrt(np.log(2 / (1 - CONFIDENCE)) / (2 * n))


@nightly
@pytest.mark.parametrize("windows", WINDOWS[1:])
def test_drawn_and_simulated_maps_have_same_alarm_statistics(radar, windows):
    radar = resize_radar(radar, 64, 48, n_rx=2)
    chain = build_chain(windows, radar)
    rng, n_maps = np.random.default_rng(83), 8_000
    generators = (
        lambda: draw_noise_map(radar, chain, 1.0, rng),
        lambda: simulate_noise_map(radar, chain, rng),
    )
    drawn_counts, simulated_counts = (
        np.array(
            [[n.n_over, n.n_peaks, *count_edge_alarms(n, radar, chain)] for n in counts], float
        )
        for counts in (
            (count_noise_alarms(generate(), radar, chain) for _ in range(n_maps))
            for generate in generators
        )
    )

    # About 25,000 alarms in 16,000 clusters per method; means first, then the variance between
    # maps, which depends on clustering.
    n_deviations = -ndtri((1 - CONFIDENCE) / 2)
    for moments in (
        (drawn_counts, simulated_counts),
        tuple((x - x.mean(0)) ** 2 for x in (drawn_counts, simulated_counts)),
    ):
        error = moments[0].mean(axis=0) - moments[1].mean(axis=0)
        spread = np.sqrt(sum(np.var(x, axis=0) for x in moments) / n_maps)
        assert np.all(abs(error) < n_deviations * spread)
    # Power of the test: it would detect a tenth more alarms.
    assert (
        n_deviations * np.std(drawn_counts[:, 0]) * np.sqrt(2 / n_maps)
        < 0.1 * drawn_counts[:, 0].mean()
    )


def count_edge_alarms(noise, radar, chain):
    """Count alarms at either end of the range, where the training window is off-centre."""
    is_alarm = chain.cfar.exceeds_threshold(noise.power, chain.map_noise_statistics(radar))
    return [is_alarm[:, :8].sum(), is_alarm[:, -8:].sum()]


def test_drawn_maps_have_designed_false_alarm_rate(radar):
    radar = resize_radar(radar, 128, 64)
    chain = build_chain(("hann", "hann"), radar, false_alarm_probability=1e-3)
    rng = np.random.default_rng(84)
    counts = [
        count_noise_alarms(draw_noise_map(radar, chain, 1.0, rng), radar, chain) for _ in range(600)
    ]
    assert {count.n_tested for count in counts} == {128 * 64}
    alarms = [count.n_over for count in counts]
    low, high = confidence_intervals.rate_interval(alarms, 128 * 64, confidence=CONFIDENCE)
    # 4,900 alarms in clusters of 1.5: a standard error of 1.8 %, five of them to either side.
    assert low < 1e-3 < high and high / low < 1.3


def test_rejects_direct_drawing_where_noise_is_not_white_over_bins(radar):
    plain_radar = resize_radar(radar, 64, 48)
    assert can_draw_noise_maps(plain_radar, dc.Chain())
    keystone_chain = replace(dc.Chain(), range_walk="keystone")
    cases = [
        (resize_radar(radar, 64, 48, sampling="real"), dc.Chain()),
        (plain_radar, dc.Chain(n_range_bins=65)),
        (plain_radar, dc.Chain(n_velocity_bins=49)),
        (plain_radar, dc.Chain(range_window="chebyshev-60")),
        (plain_radar, dc.Chain(doppler_window="taylor-50")),
        (plain_radar, dc.Chain(mitigation=[MeanSubtraction()])),
        (plain_radar, keystone_chain),
    ]
    for case_radar, chain in cases:
        assert not can_draw_noise_maps(case_radar, chain)
        with pytest.raises(dc.InvalidSetting, match="drawn directly"):
            draw_noise_map(case_radar, chain, 1.0, np.random.default_rng(0))


@pytest.mark.parametrize("power_w", [-1.0, np.nan, np.inf])
def test_rejects_invalid_noise_power(radar, power_w):
    with pytest.raises(dc.InvalidSetting, match="noise_power_w"):
        draw_noise_map(resize_radar(radar, 64, 48), dc.Chain(), power_w, np.random.default_rng(0))


def test_maps_drawn_in_two_threads_match_sequential_maps(radar):
    radar, chain = resize_radar(radar, 128, 64, n_rx=2), dc.Chain()

    def draw_map(seed):
        return draw_noise_map(radar, chain, 1.0, np.random.default_rng(seed))

    with ThreadPoolExecutor(2) as threads:
        maps = list(threads.map(draw_map, range(50)))
    for seed, power in enumerate(maps):
        np.testing.assert_array_equal(power, draw_map(seed))
