"""Functions on plain arrays: the chain's own results, SciPy, closed forms and published values."""

import inspect
import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage
import scipy.signal
import scipy.stats
import xarray as xr

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT, from_decibels, to_decibels
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.radar.budget import sample_snr
from nightly import nightly_except

CASES = {
    case["id"]: case
    for case in json.loads((Path(__file__).parent / "theory_public.json").read_text())["cases"]
}
SCIPY_WINDOWS = {
    "rectangular": "boxcar",
    "hann": "hann",
    "hamming": "hamming",
    "blackman": "blackman",
    "blackman-harris": "blackmanharris",
}
SPECS_OF_SCIPY = ["boxcar", "flattop", "tukey", ("chebwin", 80), ("taylor", 4, 30), 8.6]
SPECS_OF_SCIPY += [("general_cosine", (0.5, 0.3, 0.2)), ("dpss", 2.5)]
CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=20e12,
    ramp_duration_s=30e-6,
    sample_rate_hz=5e6,
    n_samples=96,
    sampling="complex",
)
HARDWARE = dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=15.0, loss=1.2)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=40, interval_s=40e-6),
    array=dc.Array(rx_m=[(0, 0, 0), (0, 1.9e-3, 0)]),
    hardware=HARDWARE,
)
LINK = {
    "transmit_power_w": 0.01,
    "frequency_hz": SPEED_OF_LIGHT / CHIRP.wavelength_m,
    "tx_gain": 10.0,
    "rx_gain": 10.0,
    "loss": 1.2,
}
NOISE = {"noise_factor": 15.0, "sample_rate_hz": 5e6}
HALF_WAVE_LINE = 0.5 * np.arange(8)


def assert_published(case_id, compute):
    """Compare a function of the inputs with the expected value of a case."""
    case = CASES[case_id]
    expected = (
        pytest.approx(case["expected"], abs=case["tol_abs"], rel=0)
        if "tol_abs" in case
        else pytest.approx(case["expected"], rel=case["tol_rel"], abs=0)
    )
    assert float(compute(case["inputs"])) == expected


def noise_samples(*shape, seed):
    """Draw circular white noise of unit power, complex64."""
    rng = np.random.default_rng(seed)
    parts = rng.standard_normal((2, *shape)) * np.sqrt(0.5)
    return (parts[0] + 1j * parts[1]).astype(np.complex64)


def chain_of(kind, windows, n_bins):
    slow, fast = windows
    return dc.Chain(
        range_window=fast,
        doppler_window=slow,
        n_velocity_bins=n_bins[0],
        n_range_bins=n_bins[1],
        cfar=dc.Cfar(
            estimator=kind,
            n_training=dc.Cells(range=6, velocity=5),
            n_guard=dc.Cells(range=2, velocity=3),
            false_alarm_probability=1e-4,
        ),
    )


@pytest.mark.parametrize(
    ("kind", "windows", "n_bins"),
    nightly_except(
        2,
        [
            (dc.cfar.CellAveraging(), ("rectangular", "rectangular"), (40, 96)),
            (dc.cfar.CellAveraging(), ("hann", "taylor-50"), (48, 128)),
            (dc.cfar.OrderedStatistic(rank=0.6), ("rectangular", "rectangular"), (40, 96)),
            (dc.cfar.GreatestOf(), ("rectangular", "rectangular"), (40, 96)),
            (dc.cfar.TwoStep(), ("rectangular", "rectangular"), (40, 96)),
        ],
    ),
)
def test_map_and_threshold_equal_those_of_chain_edges_included(kind, windows, n_bins):
    tone = 3 * np.exp(2j * np.pi * (0.2 * np.arange(96) + 0.1 * np.arange(40)[:, None, None]))
    samples = (1e-9 * (noise_samples(40, 2, 96, seed=5) + tone)).astype(np.complex64)
    cube = xr.DataArray(samples, dims=("chirp", "rx", "sample"), attrs={"units": "W**0.5"})
    chain = chain_of(kind, windows, n_bins)
    chain_power = dc.power_map(cube, RADAR, chain)
    chain_threshold = dc.threshold_map(chain_power, RADAR, chain)

    power = dc.maps.range_doppler_map(samples.transpose(1, 0, 2), windows, n_bins=n_bins)
    threshold = dc.cfar.cfar_threshold(
        power, (5, 6), (3, 2), 1e-4, kind, n_summed=2, window=windows, n_points=(40, 96)
    )

    # Scaling by a power of two keeps every digit of single precision.
    np.testing.assert_array_equal(power.astype(np.float32), chain_power.values)
    np.testing.assert_array_equal(threshold.astype(np.float32), chain_threshold.values)


def test_map_of_tone_has_its_power_in_its_cell():
    chirp, sample = np.arange(32)[:, None], np.arange(64)
    amplitude = 3e-30  # its power is below the range of single precision
    tone = amplitude * np.exp(2j * np.pi * (5 * chirp / 32 + 20 * sample / 64))
    for window in dc.windows.window_names():
        power = dc.maps.range_doppler_map(tone, window)
        assert power.shape == (32, 64)
        assert np.unravel_index(power.argmax(), power.shape) == (16 + 5, 20)
        assert power.max() == pytest.approx(amplitude**2, rel=1e-5)
    real_power = dc.maps.range_doppler_map(tone.real)
    assert real_power.shape == (32, 33)
    assert real_power[16 + 5, 20] == pytest.approx(amplitude**2 / 2, rel=1e-5)


@pytest.mark.parametrize("scale", [1e-310, 1e-200, 1e150, 1e300])
def test_threshold_scales_with_power_over_range_of_double_precision(scale):
    power = np.random.default_rng(9).exponential(size=(16, 32))
    np.testing.assert_allclose(
        dc.cfar.cfar_threshold(scale * power, 3, 1, 1e-3) / scale,
        dc.cfar.cfar_threshold(power, 3, 1, 1e-3),
        rtol=1e-6,
    )


def test_map_takes_axes_in_any_order_within_memory_that_it_checks(monkeypatch):
    samples = noise_samples(16, 3, 2, 32, seed=8)  # chirp, transmitter, receiver, sample
    power = dc.maps.range_doppler_map(samples, axes=(0, -1))
    channels = samples.transpose(1, 2, 0, 3).reshape(6, 16, 32)
    np.testing.assert_array_equal(power, dc.maps.range_doppler_map(channels))

    monkeypatch.setattr("dechirp.core.memory.available_memory_bytes", lambda: 2**26)
    with pytest.raises(dc.NotEnoughMemory, match="the map of 8388608 samples"):
        dc.maps.range_doppler_map(np.broadcast_to(np.complex64(1), (2, 2**11, 2**11)))


@pytest.mark.parametrize("is_complex", [True, False])
def test_spectrum_of_channels_has_powers_of_map_and_direct_phases(is_complex):
    samples = 1e-30 * noise_samples(2, 3, 15, 32, seed=8)
    samples = samples if is_complex else samples.real
    options = {"window": ("hann", "rectangular"), "n_bins": (16, 40)}
    spectrum = dc.maps.range_doppler_spectrum(samples, **options)

    power = dc.maps.range_doppler_map(samples, **options)
    np.testing.assert_allclose(np.mean(abs(spectrum) ** 2, axis=(0, 1)), power, rtol=1e-4)
    # Bin (3, 5) as a sum, with windows that keep the power of a tone.
    phase = np.arange(15)[:, None] * (3 - 8) / 16 + np.arange(32) * 5 / 40
    weights = dc.windows.window_weights("hann", 15)[:, None] / np.sqrt(1 if is_complex else 0.5)
    direct = np.sum(weights * samples * np.exp(-2j * np.pi * phase), axis=(2, 3))
    direct /= dc.windows.window_weights("hann", 15).sum() * 32
    scale = spectrum[..., 3, 5] / direct
    np.testing.assert_allclose(abs(scale), abs(scale).mean(), rtol=1e-4)
    np.testing.assert_allclose(scale.imag, 0, atol=1e-4 * abs(scale).max())


def test_range_spectrum_of_tone_has_its_power_along_any_axis():
    tone = 3 * np.exp(2j * np.pi * 5 * np.arange(32) / 32)
    samples = np.stack([tone, 2 * tone], axis=1)
    power = abs(dc.maps.range_spectrum(samples, axis=0, n_bins=64)) ** 2
    assert power.shape == (64, 2)
    # Range windows are in single precision.
    np.testing.assert_allclose(power[10], [9, 36], rtol=1e-6)
    real_power = abs(dc.maps.range_spectrum(samples.real, "rectangular", axis=0)) ** 2
    assert real_power.shape == (17, 2)
    np.testing.assert_allclose(real_power[5], [4.5, 18], rtol=1e-6)


def test_map_needs_less_memory_than_it_checks():
    samples = noise_samples(4, 512, 512, seed=1)
    dc.maps.range_doppler_map(samples)  # compiled
    tracemalloc.start()
    dc.maps.range_doppler_map(samples)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < samples.size * 9 + 512 * 512 * 56


def test_map_averages_power_of_channels():
    samples = noise_samples(3, 16, 32, seed=8)
    each = [dc.maps.range_doppler_map(channel) for channel in samples]
    np.testing.assert_allclose(
        dc.maps.range_doppler_map(samples), np.mean(each, axis=0), rtol=1e-5, atol=1e-7
    )


def test_threshold_of_spectrum_equals_training_means_by_hand():
    power = np.random.default_rng(2).exponential(size=50)
    n, guard, pfa = 4, 1, 1e-3
    threshold = dc.cfar.cfar_threshold(power, n, guard, pfa)
    for cell in range(50):
        first = np.clip(cell - n - guard, 0, 50 - 2 * (n + guard) - 1)  # the nearest that exist
        box = np.arange(first, first + 2 * (n + guard) + 1)
        training = box[abs(box - cell) > guard]
        factor = training.size * (pfa ** (-1 / training.size) - 1)
        assert threshold[cell] == pytest.approx(factor * power[training].mean(), rel=1e-5)


def test_thresholds_along_axes_equal_those_of_single_spectra_and_maps():
    power = np.random.default_rng(7).exponential(size=(3, 24, 40)) * [[[1.0]], [[1e-60]], [[1e60]]]
    maps = dc.cfar.cfar_threshold(power, 3, 1, 1e-3, window="hann")
    spectra = dc.cfar.cfar_threshold(power, 3, 1, 1e-3, axis=1)
    turned = dc.cfar.cfar_threshold(power.T, (2, 3), 1, 1e-3, axis=(1, 0))
    for number, single in enumerate(power):
        np.testing.assert_array_equal(
            maps[number], dc.cfar.cfar_threshold(single, 3, 1, 1e-3, window="hann")
        )
        np.testing.assert_array_equal(
            turned[..., number].T, dc.cfar.cfar_threshold(single, (2, 3), 1, 1e-3)
        )
        for column in (0, 39):
            np.testing.assert_array_equal(
                spectra[number, :, column], dc.cfar.cfar_threshold(single[:, column], 3, 1, 1e-3)
            )


def test_pairs_of_cells_may_be_arrays():
    power = np.random.default_rng(8).exponential(size=(16, 32))
    pairs = [cells((2, 4)) for cells in (tuple, list, np.array)]
    thresholds = [dc.cfar.cfar_threshold(power, pair, np.array([0, 1]), 1e-3) for pair in pairs]
    for threshold in thresholds:
        np.testing.assert_array_equal(threshold, thresholds[0])
    padded = dc.maps.range_doppler_map(power, n_bins=np.array([32, 64]))
    np.testing.assert_array_equal(padded, dc.maps.range_doppler_map(power, n_bins=(32, 64)))
    with pytest.raises(dc.InvalidSetting, match="n_guard: .* one value for a single axis"):
        dc.cfar.cfar_threshold(power, 4, np.array([1, 2]), 1e-3, axis=-1)


@pytest.mark.parametrize(
    "kind", nightly_except(1, ["cell-averaging", "ordered-statistic", "smallest-of"])
)
def test_false_alarm_rate_of_spectrum_is_its_design_value_at_edges(kind):
    rng, n_trials, pfa = np.random.default_rng(3), 400, 0.02
    alarms = np.zeros(48)
    for _ in range(n_trials):
        power = rng.exponential(size=48)
        alarms += power > dc.cfar.cfar_threshold(power, 8, 2, pfa, kind)
    # The ten cells at either end, whose training cells lie to one side. Alarms of neighbouring
    # cells share training cells: their correlation adds less than 1 to the variance.
    n_alarms = alarms[:10].sum() + alarms[-10:].sum()
    expected = 20 * n_trials * pfa
    assert abs(n_alarms - expected) < 5.5 * np.sqrt(2 * expected)


@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_false_alarm_rate_of_real_samples_is_kept_in_all_cells_with_circular_noise(window):
    n_trials, pfa, n_training = 4000, 1e-2, 8
    noise = np.random.default_rng(7).standard_normal((n_trials, 64))
    power = abs(dc.maps.range_spectrum(noise, window)) ** 2

    settings = {"n_training": n_training, "n_guard": 2, "pfa": pfa, "window": window, "axis": 1}
    threshold = dc.cfar.cfar_threshold(power, sampling="real", **settings)

    omitted = {"rectangular": [0, 32], "hann": [0, 1, 31, 32]}[window]
    np.testing.assert_array_equal(np.flatnonzero(np.isinf(threshold[0])), omitted)
    n_alarms = np.count_nonzero(power > threshold)
    expected = (33 - len(omitted)) * n_trials * pfa
    # Cells share training cells: their correlation adds less than 1 to the variance.
    assert abs(n_alarms - expected) < 5 * np.sqrt(2 * expected)
    assert len(dc.cfar.find_peaks(power[0], threshold[0])) <= 5
    if window == "rectangular":
        # One degree of freedom over 32 of 16 training cells: the law of Fisher's F.
        at_ends = power[:, 0] > dc.cfar.cfar_threshold(power, **settings)[:, 0]
        factor = dc.theory.cfar_factor(pfa, 2 * n_training)
        rate = scipy.stats.f.sf(factor, 1, 4 * n_training)
        assert abs(at_ends.mean() - rate) < 5 * np.sqrt(rate / n_trials)


def test_threshold_of_real_samples_accepts_weights_for_all_of_them():
    samples = np.random.default_rng(8).standard_normal((16, 64))
    power = dc.maps.range_doppler_map(samples, "hann")
    weights = scipy.signal.get_window("hann", 16), scipy.signal.get_window("hann", 64)
    thresholds = [
        dc.cfar.cfar_threshold(power, 2, 1, 1e-3, window=window, sampling="real")
        for window in ("hann", weights)
    ]
    np.testing.assert_allclose(*thresholds, rtol=1e-6)
    with pytest.raises(dc.InvalidSetting, match="power: 1 cell of range"):
        dc.cfar.cfar_threshold(power[:, :1], (2, 0), 0, 1e-3, sampling="real")
    with pytest.raises(dc.InvalidSetting, match="sampling: iq; expected complex or real"):
        dc.cfar.cfar_threshold(power, 2, 1, 1e-3, sampling="iq")


def test_windows_equal_those_of_scipy():
    for name, scipy_name in SCIPY_WINDOWS.items():
        np.testing.assert_allclose(
            dc.windows.window_weights(name, 64),
            scipy.signal.windows.get_window(scipy_name, 64, fftbins=True),
            atol=1e-12,
        )
    np.testing.assert_allclose(
        dc.windows.chebyshev_weights(64, 60), scipy.signal.windows.chebwin(64, 60), atol=1e-9
    )
    assert set(SCIPY_WINDOWS) < set(dc.windows.window_names())
    assert dc.windows.noise_bandwidth_bins([1, 1, 1, 1]) == 1
    assert dc.windows.coherent_gain(scipy.signal.windows.hann(8, sym=False)) == 0.5


@pytest.mark.parametrize("name", ["coherent_gain", "noise_bandwidth_bins", "scalloping_loss"])
def test_figures_of_merit_are_scalars_of_a_window_and_arrays_of_rows_of_windows(name):
    function = getattr(dc.windows, name)
    rows = np.array([dc.windows.window_weights(window, 64) for window in SCIPY_WINDOWS])

    figures = [function(row) for row in rows]

    assert {type(figure) for figure in figures} == {np.float64}
    np.testing.assert_allclose(function(rows), figures, rtol=1e-13)
    assert function(rows[:, None]).shape == (len(rows), 1)
    with pytest.raises(dc.InvalidSetting, match=r"give the weights.*window_weights\('hann', n\)"):
        function("hann")


@pytest.mark.parametrize("window", SPECS_OF_SCIPY)
@pytest.mark.parametrize("n", [1, 7, 64])
def test_windows_of_scipy_are_periodic_as_get_window_returns_them(window, n):
    expected = scipy.signal.get_window(window, n)
    np.testing.assert_array_equal(dc.windows.window_weights(window, n), expected)
    np.testing.assert_array_equal(dc.windows.window_weights(expected, n), expected)


def test_map_and_threshold_accept_windows_of_scipy_and_weights():
    samples = noise_samples(3, 16, 32, seed=5)
    windows = ("chebwin", 80), ("taylor", 4, 30)
    slow = scipy.signal.get_window(windows[0], 16)
    fast = scipy.signal.get_window(windows[1], 32)
    spectra = np.fft.fft2(samples * np.outer(slow, fast) / (slow.sum() * fast.sum()))
    power = np.mean(abs(np.fft.fftshift(spectra, axes=1)) ** 2, axis=0)

    maps = [dc.maps.range_doppler_map(samples, window) for window in (windows, (slow, fast))]

    np.testing.assert_array_equal(*maps)
    # Single precision: rounding errors of 1e-7 of the largest amplitude.
    np.testing.assert_allclose(maps[0], power, rtol=1e-4, atol=1e-6 * power.max())
    thresholds = [
        dc.cfar.cfar_threshold(power, 2, 1, 1e-3, n_summed=3, window=window)
        for window in (windows, (slow, fast))
    ]
    np.testing.assert_array_equal(*thresholds)
    for window in (scipy.signal.get_window("hann", 16), "hann", ("general_cosine", [0.5, 0.5])):
        np.testing.assert_allclose(
            dc.maps.range_doppler_map(samples[..., :16], window),
            dc.maps.range_doppler_map(samples[..., :16], ("hann", "hann")),
            rtol=1e-5,
        )
        # The factor of the window, not that of independent cells: 1.5 times the false alarms.
        np.testing.assert_allclose(
            dc.cfar.cfar_threshold(power[:, :16], 2, 1, 1e-3, window=window),
            dc.cfar.cfar_threshold(power[:, :16], 2, 1, 1e-3, window="hann"),
            rtol=1e-6,
        )


def test_main_lobe_of_window_of_scipy_ends_at_its_first_null():
    for name, scipy_name in SCIPY_WINDOWS.items():
        if name != scipy_name:
            expected = dc.windows.half_main_lobe_bins(name)
            assert abs(dc.windows.half_main_lobe_bins(scipy_name) - expected) <= 1 / 64
    assert dc.windows.half_main_lobe_bins(np.ones(50)) == 1
    assert dc.windows.half_main_lobe_bins([1.0]) == np.inf


@pytest.mark.parametrize(
    ("window", "text"),
    [
        ("hanning", "'hanning'; expected rectangular or hann .* or kaiser-6; or a window of SciPy"),
        (("hann", "hnn"), "'hnn'; expected rectangular"),
        (("kaiser", "a"), r"\('kaiser', 'a'\) \(.*; expected rectangular"),
        (("hann", 3), "'hann' does not allow parameters"),
        ("kaiser", "'kaiser'; expected rectangular"),
        (None, "None; expected rectangular"),
        ({}, "{}; expected rectangular"),
        (["hann"], r"\['hann'\]; expected rectangular"),
        (np.ones(5), "5 weights; expected 8"),
        (np.ones((8, 8)), "expected one row of weights"),
        (-np.ones(8), "expected one row of weights with a sum above 0"),
    ],
)
def test_wrong_window_is_explained_with_all_names(window, text):
    with pytest.raises(dc.InvalidSetting, match=rf"^window: .*{text}"):
        dc.maps.range_doppler_map(np.ones((8, 8)), window)


def test_detection_theory_broadcasts_and_equals_scipy():
    snr, pfa = from_decibels(np.array([[3.0], [10.0], [14.0]])), np.array([1e-6, 1e-4])
    limit = -2 * np.log(pfa)  # Marcum's function as the tail of noncentral chi-square
    expected = scipy.stats.ncx2.sf(limit, 2, 2 * snr)
    probability = dc.theory.detection_probability(snr, pfa)
    np.testing.assert_allclose(probability, expected, rtol=1e-9)

    required = dc.theory.required_snr(probability, pfa)
    np.testing.assert_allclose(required, np.broadcast_to(snr, (3, 2)), rtol=1e-8)
    # Albersheim's and Shnidman's formulas are within 0.34 and 0.3 dB in their range.
    pd = np.array([[0.5], [0.9]])
    exact = dc.theory.required_snr(pd, pfa)
    for formula in (dc.theory.albersheim, dc.theory.shnidman):
        assert formula(pd, pfa).shape == (2, 2)
        assert np.max(abs(to_decibels(formula(pd, pfa) / exact))) < 0.34


def test_cfar_factor_broadcasts_over_its_closed_forms():
    pfa, cells = np.array([[1e-3], [1e-6]]), np.array([8, 24, 100])
    np.testing.assert_allclose(
        dc.theory.cfar_factor(pfa, cells), cells * (pfa ** (-1 / cells) - 1), rtol=1e-12
    )
    assert_published("goca_alpha_N20_pfa1em4", lambda case: cfar_factor(case, "greatest-of"))
    assert_published("soca_alpha_N20_pfa1em4", lambda case: cfar_factor(case, "smallest-of"))
    assert_published("os_alpha_N16_k10_pfa1em4", lambda case: cfar_factor(case, rank=case["k"]))
    assert_published(
        "ca_alpha_nci_K4_N24_pfa1em5",
        lambda case: cfar_factor(case, n_summed=case["n_channels_summed"]),
    )
    # Without trimming the mean of all cells, and of one kept cell an ordered statistic.
    for n_smallest, n_largest, other in (
        (0, 0, {}),
        (11, 4, {"kind": "ordered-statistic", "rank": 12}),
    ):
        np.testing.assert_allclose(
            dc.theory.cfar_factor(
                pfa, 16, "trimmed-mean", n_smallest=n_smallest, n_largest=n_largest
            ),
            dc.theory.cfar_factor(pfa, 16, **other),
            rtol=1e-9,
        )


@pytest.mark.parametrize("n_training", [16, 21, 50])
def test_cfar_factor_has_the_defaults_of_the_detectors(n_training):
    cells = np.random.default_rng(2).exponential(size=(1, n_training))
    in_order = np.sort(cells[0])
    offsets = np.zeros((n_training, 2))

    rank = 1 + list(in_order).index(dc.cfar.OrderedStatistic().statistic(cells, offsets)[0])
    assert dc.theory.cfar_factor(1e-4, n_training, "ordered-statistic") == dc.theory.cfar_factor(
        1e-4, n_training, "ordered-statistic", rank=rank
    )
    trimmed = dc.cfar.TrimmedMean().statistic(cells, offsets)[0]
    n_kept = np.argmin(abs(np.cumsum(in_order) / np.arange(1, n_training + 1) - trimmed)) + 1
    assert dc.theory.cfar_factor(1e-4, n_training, "trimmed-mean") == dc.theory.cfar_factor(
        1e-4, n_training, "trimmed-mean", n_smallest=0, n_largest=n_training - n_kept
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "ordered-statistic", "rank": 0.9}, "^rank: 0.9; .*a number of cells; multiply"),
        ({"kind": "trimmed-mean", "n_largest": [2, 0.2]}, "^n_largest: 0.2; .*a number of cells"),
        ({"kind": "two-step"}, "^kind: two-step; .*no factor of its own: .*cfar_threshold"),
        ({"kind": "cell-averaging", "rank": 3}, "^rank: 3, .*; expected n_training and n_summed "),
    ],
)
def test_settings_of_another_kind_of_cfar_and_shares_are_explained(arguments, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        dc.theory.cfar_factor(1e-4, 16, **arguments)


LINE_OF_TWO = {"positions_m": [0, 0.002], "wavelength_m": 0.004}


@pytest.mark.parametrize(
    ("function", "count", "arguments"),
    [
        (dc.theory.detection_probability, "n_summed", {"snr": 3.0, "swerling": 4}),
        (dc.theory.required_snr, "n_summed", {"detection_probability": 0.9, "swerling": 2}),
        (dc.theory.albersheim, "n_summed", {"detection_probability": 0.9}),
        (dc.theory.shnidman, "n_summed", {"detection_probability": 0.9, "swerling": 2}),
        (dc.theory.cfar_factor, "n_summed", {"n_training": 8}),
        (dc.theory.cfar_factor, "rank", {"n_training": 44, "kind": "ordered-statistic"}),
        (
            dc.theory.cfar_factor,
            "n_largest",
            {"n_training": 50, "n_smallest": 0, "kind": "trimmed-mean"},
        ),
        (dc.theory.frequency_variance, "n_points", {"snr": 20.0}),
        (dc.theory.noncoherent_effective_snr, "n_channels", {"snr": 20.0}),
        (
            dc.theory.crlb_range,
            "n_samples",
            {"snr": 20.0, "sample_rate_hz": 1e7, "slope_hz_per_s": 2e13},
        ),
        (
            dc.theory.crlb_velocity,
            "n_chirps",
            {"snr": 20.0, "interval_s": 5e-5, "wavelength_m": 4e-3},
        ),
    ],
)
def test_counts_broadcast_and_must_be_whole(function, count, arguments):
    counts, pfa = np.array([[2], [3], [41]]), np.array([1e-3, 1e-5])
    has_pfa = "false_alarm_probability" in inspect.signature(function).parameters
    other = {"false_alarm_probability": pfa} if has_pfa else {"snr": np.array([5.0, 50.0])}
    arguments = {**arguments, **other}

    result = function(**arguments, **{count: counts})

    assert result.shape == (3, 2)
    for row, number in zip(result, (2, 3, 41), strict=True):
        np.testing.assert_array_equal(row, function(**arguments, **{count: number}))
    for wrong in (2.5, [2, 2.5], np.nan, -1, True):
        with pytest.raises(dc.InvalidSetting, match=rf"^{count}: ") as caught:
            function(**arguments, **{count: wrong})
        assert len(caught.value.mistakes) == 1
    with pytest.raises(dc.InvalidSetting, match=rf"{count}.*expected shapes that broadcast"):
        function(**arguments, **{count: [2, 3, 4]})


def test_bound_of_angle_names_arrays_that_do_not_broadcast():
    with pytest.raises(dc.InvalidSetting, match="snr and angle_rad: arrays"):
        dc.theory.crlb_angle(snr=[1, 2], angle_rad=[0.1, 0.2, 0.3], **LINE_OF_TWO)


def cfar_factor(case, kind="cell-averaging", **settings):
    kind = "ordered-statistic" if "rank" in settings else kind
    return dc.theory.cfar_factor(case["pfa"], case["n_train"], kind, **settings)


def test_tracking_gains_solve_the_steady_state_of_a_kalman_filter():
    assert_published(
        "alpha_L0p5", lambda case: dc.theory.alpha_beta_gains(case["tracking_index"]).alpha
    )
    index = np.array([1e-3, 0.1, 1.0, 30.0])
    gains = dc.theory.alpha_beta_gains(index)
    # The two equations of the steady state (Bar-Shalom, Li and Kirubarajan 2001, 6.5.3).
    np.testing.assert_allclose(index**2, gains.beta**2 / (1 - gains.alpha), rtol=1e-10)
    np.testing.assert_allclose(
        gains.beta, 2 * (2 - gains.alpha) - 4 * np.sqrt(1 - gains.alpha), rtol=1e-9
    )


def test_gate_is_quantile_of_chi_square():
    assert_published(
        "gate_p0p95_d2",
        lambda case: dc.theory.gate_threshold(case["probability"], case["dof"]),
    )
    probability = np.array([0.1, 0.99, 0.999])
    np.testing.assert_allclose(
        dc.theory.gate_threshold(probability, 3), scipy.stats.chi2.ppf(probability, 3), rtol=1e-10
    )


def test_link_budget_equals_that_of_radar():
    ranges_m = np.array([1.0, 20.0, 300.0])
    np.testing.assert_allclose(
        dc.link_budget.sample_snr(ranges_m, 3.0, **LINK, **NOISE),
        sample_snr(RADAR, range_m=ranges_m, rcs_m2=3.0),
        rtol=1e-12,
    )
    assert_published("rx_power_pubcar80", received_power_dbm)
    bandwidth_hz = CHIRP.sampled_bandwidth_hz
    assert dc.link_budget.range_resolution(bandwidth_hz) == CHIRP.range_resolution_m
    beat_hz = dc.link_budget.beat_frequency(20.0, slope_hz_per_s=20e12)
    assert beat_hz == pytest.approx(CHIRP.beat_frequency_hz(20.0), rel=1e-15)
    assert dc.link_budget.range_from_beat(beat_hz, slope_hz_per_s=20e12) == pytest.approx(20.0)
    limits = {"sample_rate_hz": 5e6, "slope_hz_per_s": 20e12}
    assert dc.link_budget.unambiguous_range(**limits) == pytest.approx(CHIRP.max_range_m)
    with pytest.raises(dc.InvalidSetting, match=r"is_complex: 'yes'; expected True or False"):
        dc.link_budget.unambiguous_range(**limits, is_complex="yes")
    frame, frequency_hz = RADAR.frame, LINK["frequency_hz"]
    velocity = dc.link_budget.unambiguous_velocity(frequency_hz=frequency_hz, interval_s=40e-6)
    assert velocity == pytest.approx(frame.max_velocity_m_per_s, rel=1e-12)
    resolution = dc.link_budget.velocity_resolution(
        frequency_hz=frequency_hz, duration_s=40 * 40e-6
    )
    assert resolution == pytest.approx(frame.velocity_resolution_m_per_s, rel=1e-12)


def received_power_dbm(case):
    power_w = dc.link_budget.received_power(
        case["range_m"],
        from_decibels(case["rcs_dbsm"]),
        transmit_power_w=from_decibels(case["pt_dbm"] - 30),
        frequency_hz=case["fc_hz"],
        tx_gain=from_decibels(case["gt_dbi"]),
        rx_gain=from_decibels(case["gr_dbi"]),
        loss=from_decibels(case["loss_db"]),
    )
    return to_decibels(power_w) + 30


def test_beat_frequency_includes_doppler_of_receding_target():
    # The coupling v f / S of range (case rd_coupling_pub), as a frequency.
    shift_hz = dc.link_budget.beat_frequency(
        0.0, slope_hz_per_s=10e12, velocity_m_per_s=20.0, frequency_hz=77e9
    )
    assert dc.link_budget.range_from_beat(shift_hz, slope_hz_per_s=10e12) == pytest.approx(0.154)


def test_max_range_has_the_required_snr():
    required = dc.theory.required_snr([0.5, 0.9], 1e-6)
    gain = 96 * 40 / 1.5**2
    range_m = dc.link_budget.max_range(required, 2.0, integration_gain=gain, **LINK, **NOISE)
    assert range_m.shape == (2,)
    np.testing.assert_allclose(
        gain * dc.link_budget.sample_snr(range_m, 2.0, **LINK, **NOISE), required, rtol=1e-12
    )


def test_beamwidth_of_line_halves_power_at_both_edges():
    assert_published("hpbw_16", beamwidth_deg)
    # Steered, the edges are no longer symmetric: power at both, from the sum of phasors.
    width, angle = dc.link_budget.ula_beamwidth(12, spacing=0.6, angle_rad=0.4), 0.4
    theta = np.linspace(angle - width, angle + width, 200_001)
    phase = 2 * np.pi * 0.6 * np.arange(12)[:, None] * (np.sin(theta) - np.sin(angle))
    inside = theta[abs(np.exp(1j * phase).mean(axis=0)) ** 2 >= 0.5]
    assert np.ptp(inside) == pytest.approx(width, abs=3e-6 * width + 2 * np.diff(theta[:2])[0])
    # Two elements an eighth of a wavelength apart stay above half power everywhere.
    assert dc.link_budget.ula_beamwidth(2, spacing=0.125) == pytest.approx(np.pi)


def beamwidth_deg(case):
    width = dc.link_budget.ula_beamwidth(case["n_elements"], spacing=case["spacing_wavelengths"])
    return np.degrees(width)


@pytest.mark.parametrize("kind", sorted(DirectionEstimator.members()))
def test_directions_equal_those_of_estimator(kind):
    n_sources = 1 if kind == "monopulse" else 2
    azimuth = np.array([0.35, -0.2])[:n_sources]
    steering = np.exp(-2j * np.pi * HALF_WAVE_LINE * np.sin(azimuth)[:, None])
    amplitudes = noise_samples(3, 30, n_sources, seed=4) * [1.0, 0.9][:n_sources]
    snapshots = amplitudes @ steering + 0.02 * noise_samples(3, 30, 8, seed=6)

    directions = dc.angle.estimate_directions(
        snapshots, HALF_WAVE_LINE, n_sources, kind, noise_power=4e-4
    )

    positions = np.stack([np.zeros(8), HALF_WAVE_LINE, np.zeros(8)], axis=1)
    estimator = DirectionEstimator.members()[kind](n_sources=n_sources)
    expected = estimator.find_directions(
        snapshots.astype(complex), Aperture(positions), np.full(3, 4e-4)
    )
    by_name = getattr(dc.angle, kind.replace("-", "_"))(
        np.moveaxis(snapshots, -1, 0), HALF_WAVE_LINE, n_sources, axis=0, noise_power=4e-4
    )
    for values, named_values, expected_values in zip(directions, by_name, expected, strict=True):
        np.testing.assert_array_equal(values, expected_values)
        np.testing.assert_array_equal(named_values, expected_values)
    of_fortran_order = getattr(dc.angle, kind.replace("-", "_"))(
        np.asfortranarray(snapshots), HALF_WAVE_LINE, n_sources, noise_power=4e-4
    )
    np.testing.assert_array_equal(of_fortran_order.azimuth_rad, directions.azimuth_rad)
    # 30 snapshots at 34 dB: the bound is 0.3 mrad, and 10 of it cover the leakage of two beams.
    error = np.sort(directions.azimuth_rad, axis=1) - np.sort(azimuth)
    assert np.max(abs(error)) < 3e-3
    assert np.isnan(directions.elevation_rad).all()


def test_directions_of_single_snapshot_and_of_planar_array():
    azimuth, elevation = 0.3, -0.15
    rows, columns = np.meshgrid(np.arange(4), np.arange(4))
    plane = np.stack([np.zeros(16), 0.5 * rows.ravel(), 0.5 * columns.ravel()], axis=1)
    line = dc.angle.estimate_directions(
        np.exp(-2j * np.pi * HALF_WAVE_LINE * np.sin(azimuth)), HALF_WAVE_LINE, kind="fft"
    )
    unit = [np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    flat = dc.angle.estimate_directions(
        np.exp(-2j * np.pi * plane[:, 1:] @ unit), plane, kind="maximum-likelihood"
    )
    assert line.azimuth_rad.shape == (1,)
    assert line.azimuth_rad[0] == pytest.approx(azimuth, abs=1e-5)
    assert np.isnan(line.azimuth_std_rad).all()  # without the noise
    assert flat.azimuth_rad[0] == pytest.approx(azimuth, abs=1e-5)
    assert flat.elevation_rad[0] == pytest.approx(elevation, abs=1e-5)


@pytest.mark.parametrize("kind", ["bartlett", "capon", "fft", "iterative-adaptive", "music"])
def test_spectrum_peaks_at_source_with_its_power(kind):
    azimuth = np.linspace(-0.5, 0.5, 1001)
    amplitude = noise_samples(2, 40, 1, seed=3) * [[[3.0]], [[0.5]]]
    steering = np.exp(-2j * np.pi * HALF_WAVE_LINE * np.sin(0.2))
    snapshots = amplitude * steering + 1e-3 * noise_samples(2, 40, 8, seed=4)

    spectrum = dc.angle.direction_spectrum(
        snapshots, HALF_WAVE_LINE, azimuth[:, None], [0.0], kind=kind, noise_power=1e-6
    )

    assert spectrum.shape == (2, 1001, 1)
    # The iterative spectrum peaks at its grid of 1 / 32 in the sine.
    tolerance = 1 / 64 if kind == "iterative-adaptive" else 1.1e-3
    np.testing.assert_allclose(azimuth[spectrum[..., 0].argmax(axis=1)], 0.2, atol=tolerance)
    if kind in {"bartlett", "capon", "fft"}:
        power = np.mean(abs(amplitude) ** 2, axis=(1, 2))
        # Noise, 1e-6 / 0.25 of the weaker source, and the inverse of 40 snapshots of 8 elements.
        np.testing.assert_allclose(spectrum.max(axis=(1, 2)), power, rtol=0.01)
    cells = np.stack([np.zeros((1, 8)), np.ones((1, 8))])
    empty, full = dc.angle.direction_spectrum(cells, HALF_WAVE_LINE, azimuth, kind=kind)
    assert np.isnan(empty).all()
    assert np.isfinite(full).all()


@pytest.mark.parametrize("kind", sorted(DirectionEstimator.members()))
def test_frame_without_detections_has_no_directions(kind):
    snapshots = np.empty((0, 1, 8), complex)
    directions = dc.angle.estimate_directions(snapshots, HALF_WAVE_LINE, 1, kind)
    assert all(values.shape == (0, 1) for values in directions)
    if kind in {"bartlett", "capon", "fft", "iterative-adaptive", "music"}:
        spectrum = dc.angle.direction_spectrum(snapshots, HALF_WAVE_LINE, [0.1, 0.2], kind=kind)
        assert spectrum.shape == (0, 2)
    for wrong in (np.empty((0, 8)), np.empty((3, 0, 8)), np.empty((0, 1, 7))):
        with pytest.raises(dc.InvalidSetting, match="^snapshots: "):
            dc.angle.estimate_directions(wrong, HALF_WAVE_LINE, 1, kind)


POWER = np.ones((20, 30))
SNAPSHOT = np.ones(8)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: dc.maps.range_doppler_map(np.ones(8)), "samples"),
        (lambda: dc.maps.range_doppler_map(np.empty((0, 8))), "samples"),
        (lambda: dc.maps.range_doppler_map([[1.0, np.nan]]), "samples"),
        (lambda: dc.maps.range_doppler_map(["a"]), "samples"),
        (lambda: dc.maps.range_doppler_map(np.ones((4, 8)), "hanning"), "window"),
        (lambda: dc.maps.range_doppler_map(np.ones((4, 8)), n_bins=(2, 8)), "n_bins"),
        (lambda: dc.maps.range_doppler_map(np.ones((4, 8)), n_bins=(4, 8, 1)), "n_bins"),
        (lambda: dc.cfar.cfar_threshold([], 1, 0, 0.1), "power"),
        (lambda: dc.cfar.cfar_threshold(1.0, 1, 0, 0.1), "power"),
        (lambda: dc.cfar.cfar_threshold([1.0, np.nan, 1.0], 1, 0, 0.1), "power"),
        (lambda: dc.cfar.cfar_threshold(-POWER, 1, 0, 0.1), "power"),
        (lambda: dc.cfar.cfar_threshold(POWER, 1, 0, 0.0), "pfa"),
        (lambda: dc.cfar.cfar_threshold(POWER, 1, 0, 1.5), "pfa"),
        (lambda: dc.cfar.cfar_threshold(POWER, 20, 0, 0.1), "n_training"),
        (lambda: dc.cfar.cfar_threshold(POWER, 0, 0, 0.1), "n_training"),
        (lambda: dc.cfar.cfar_threshold(POWER[0], (1, 1), 0, 0.1), "n_training"),
        (lambda: dc.cfar.cfar_threshold(POWER, 1, 0.5, 0.1), "n_guard"),
        (lambda: dc.cfar.cfar_threshold(POWER, 1, 0, 0.1, "os"), "kind"),
        (lambda: dc.cfar.cfar_threshold(POWER, 1, 0, 0.1, n_summed=0), "n_summed"),
        (lambda: dc.cfar.cfar_threshold(POWER, 1, 0, 0.1, window="kaiser"), "window"),
        (lambda: dc.cfar.cfar_threshold(POWER, 1, 0, 0.1, n_points=25), "n_points"),
        (lambda: dc.angle.estimate_directions([], HALF_WAVE_LINE), "snapshots"),
        (lambda: dc.angle.estimate_directions(SNAPSHOT[:7], HALF_WAVE_LINE), "snapshots"),
        (lambda: dc.angle.estimate_directions(SNAPSHOT * np.nan, HALF_WAVE_LINE), "snapshots"),
        (lambda: dc.angle.estimate_directions(SNAPSHOT, []), "positions"),
        (lambda: dc.angle.estimate_directions(SNAPSHOT, np.zeros(8)), "positions"),
        (lambda: dc.angle.estimate_directions(SNAPSHOT, np.ones((8, 2))), "positions"),
        (lambda: dc.angle.estimate_directions(SNAPSHOT, HALF_WAVE_LINE, 8), "n_sources"),
        (lambda: dc.angle.estimate_directions(SNAPSHOT, HALF_WAVE_LINE, kind="esprit2"), "kind"),
        (lambda: dc.angle.estimate_directions(SNAPSHOT, HALF_WAVE_LINE, "mdl"), "noise_power"),
        (
            lambda: dc.angle.estimate_directions(SNAPSHOT, HALF_WAVE_LINE, noise_power=[1.0, 2.0]),
            "noise_power",
        ),
        (lambda: dc.windows.coherent_gain([]), "weights"),
        (lambda: dc.windows.scalloping_loss([1.0, np.nan]), "weights"),
        (lambda: dc.windows.noise_bandwidth_bins(1.0), "weights"),
        (lambda: dc.windows.coherent_gain([[1.0, 2.0], [1.0, -1.0]]), "weights"),
        (lambda: dc.windows.noise_bandwidth_bins([1.0, -1.0]), "weights"),
        (lambda: dc.theory.detection_probability([1.0, 2.0], [0.1] * 3), "snr and false_alarm"),
        (lambda: dc.theory.cfar_factor(1.0, 8), "false_alarm_probability"),
        (lambda: dc.theory.cfar_factor(0.1, 8.5), "n_training"),
        (lambda: dc.theory.cfar_factor(0.1, 7, "greatest-of"), "n_training"),
        (lambda: dc.theory.cfar_factor(0.1, 8, "median"), "kind"),
        (lambda: dc.theory.cfar_factor(0.1, 8, "ordered-statistic", rank=0.9), "rank"),
        (lambda: dc.theory.cfar_factor(0.1, 8, rank=3), "rank"),
        (lambda: dc.theory.alpha_beta_gains([0.5, 0.0]), "tracking_index"),
        (lambda: dc.theory.gate_threshold(1.0, 2), "gate_probability"),
        (lambda: dc.theory.gate_threshold(0.9, 0), "n_dimensions"),
        (lambda: dc.link_budget.beat_frequency(-1.0, slope_hz_per_s=1e12), "range_m"),
        (
            lambda: dc.link_budget.beat_frequency(1.0, slope_hz_per_s=1e12, velocity_m_per_s=10),
            "frequency_hz",
        ),
        (lambda: dc.link_budget.received_power([0.0], 1.0, **LINK), "range_m"),
        (lambda: dc.link_budget.received_power([1.0], [1.0, np.nan], **LINK), "rcs_m2"),
        (lambda: dc.link_budget.sample_snr([1, 2], [1, 2, 3], **LINK, **NOISE), "range_m and rcs"),
        (lambda: dc.link_budget.max_range("9", 1.0, **LINK, **NOISE), "required_snr"),
        (lambda: dc.link_budget.range_resolution(0.0), "bandwidth_hz"),
        (lambda: dc.link_budget.ula_beamwidth(1), "n_elements"),
        (lambda: dc.link_budget.ula_beamwidth(8, angle_rad=2.0), "angle_rad"),
    ],
)
def test_invalid_argument_is_named(call, argument):
    with pytest.raises(dc.InvalidSetting) as caught:
        call()

    (mistake,) = caught.value.mistakes
    assert argument in mistake.setting


@pytest.mark.parametrize("shape", [(20, 33), (2, 33), (33,)])
def test_peaks_are_maxima_of_their_neighbourhood(shape):
    rng = np.random.default_rng(4)
    power = rng.exponential(size=shape)
    footprint = (3,) * len(shape)
    modes = ("wrap", "constant")[-len(shape) :]
    highest = scipy.ndimage.maximum_filter(power, footprint, mode=modes)
    expected = np.argwhere((power == highest) & (power > 1.5))

    peaks = dc.cfar.find_peaks(power, 1.5)

    assert sorted(peaks.tolist()) == expected.tolist()
    assert np.all(np.diff(power[tuple(peaks.T)]) < 0)


def test_plateau_is_one_peak():
    assert dc.cfar.find_peaks([0, 2, 2, 2, 0, 1, 0], 0.5).tolist() == [[1], [5]]


def test_each_echo_is_one_peak():
    chirp, sample = np.arange(64)[:, None], np.arange(128)
    rng = np.random.default_rng(1)
    samples = 0.5 * (rng.standard_normal((8, 64, 128)) + 1j * rng.standard_normal((8, 64, 128)))
    for doppler, beat in ((10 / 64, 38 / 128), (-0.5, 77 / 128)):
        samples += 0.1 * np.exp(2j * np.pi * (doppler * chirp + beat * sample))
    power = dc.maps.range_doppler_map(samples, "hann")
    threshold = dc.cfar.cfar_threshold(power, 8, 3, 1e-6, n_summed=8, window="hann")

    # By chance another of 8192 cells exceeds its threshold with a probability of 0.8 %, seeded.
    peaks = dc.cfar.find_peaks(power, threshold)

    assert sorted(peaks.tolist()) == [[0, 77], [42, 38]]
    assert np.count_nonzero(power > threshold) > len(peaks)


@pytest.mark.parametrize(
    ("power", "threshold", "named"),
    [
        (np.ones((2, 3, 4)), 1, "power"),
        ([1.0, np.nan], 1, "power"),
        ([], 1, "power"),
        ([1.0, -1.0], 1, "power"),
        (np.ones((3, 4)), np.ones(4), "threshold"),
        (np.ones(4), np.nan, "threshold"),
    ],
)
def test_peaks_of_wrong_arrays_are_refused(power, threshold, named):
    with pytest.raises(dc.InvalidSetting, match=f"^{named}: "):
        dc.cfar.find_peaks(power, threshold)
