"""Windows against published losses and sidelobes, SciPy, and their polynomials."""

from typing import get_args

import mpmath
import numpy as np
import pytest
import scipy.signal.windows

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import to_decibels
from dechirp.theory.windows import (
    Window,
    bin_correlation,
    chebyshev_weights,
    coherent_gain,
    half_main_lobe_bins,
    kaiser_weights,
    noise_bandwidth_bins,
    scalloping_loss,
    taylor_weights,
    window_weights,
)

# Coherent gain, noise bandwidth in bins and in dB, scalloping in dB. Cosine-sum windows are
# periodic, the others symmetric. Periodic versions of the latter would have 1.5178 (Chebyshev
# 60 dB), 1.1701, 1.4118 and 1.4668 in the second column.
TABLE = [
    ("rectangular", 256, 1.0, 1.0, 0.0, 3.922),
    ("hann", 256, 0.5, 1.5, 1.761, 1.424),
    ("hamming", 256, 0.54, 1.3628, 1.344, 1.751),
    ("blackman", 256, 0.42, 1.7268, 2.372, 1.099),
    ("blackman-harris", 256, 0.35875, 2.0044, 3.020, 0.826),
    ("chebyshev-60", 256, 0.4776, 1.5221, 1.825, 1.414),
    ("chebyshev-80", 256, 0.4130, 1.7477, 2.425, 1.081),
    ("taylor-30", 256, 0.6418, 1.1718, 0.689, 2.358),
    ("taylor-50", 128, 0.5145, 1.4208, 1.525, 1.614),
    ("kaiser-6", 256, 0.4981, 1.4722, 1.680, 1.498),
]


@pytest.mark.parametrize(("window", "n", "gain", "bins", "loss_db", "scalloping_db"), TABLE)
def test_window_losses_match_table(window, n, gain, bins, loss_db, scalloping_db):
    weights = window_weights(window, n)

    # The last digit of the table is rounded up or down.
    assert coherent_gain(weights) == pytest.approx(gain, abs=1e-4)
    assert noise_bandwidth_bins(weights) == pytest.approx(bins, abs=1e-4)
    assert to_decibels(noise_bandwidth_bins(weights)) == pytest.approx(loss_db, abs=1e-3)
    assert to_decibels(scalloping_loss(weights)) == pytest.approx(scalloping_db, abs=1e-3)


def test_table_covers_every_window():
    assert [row[0] for row in TABLE] == list(get_args(Window))


def compute_spectrum(window, n, per_bin=64):
    """Compute the amplitude relative to the peak at `per_bin` frequencies per bin."""
    weights = window_weights(window, n)
    return abs(np.fft.rfft(weights, per_bin * n)) / weights.sum()


def find_first_null(amplitude):
    falls, rises = amplitude[1:-1] < amplitude[:-2], amplitude[1:-1] <= amplitude[2:]
    return int(np.argmax(falls & rises)) + 1


# Levels from Harris's table and from the designs of Dolph, Taylor and Kaiser. Taylor sidelobes
# reach -30.3 dB; with 6 shifted nulls, where 50 dB needs 9, they reach -49.3 dB.
HIGHEST_SIDELOBE_DB = {
    "rectangular": -13.26,
    "hann": -31.47,
    "hamming": -42.7,
    "blackman": -58.1,
    "blackman-harris": -92.0,
    "chebyshev-60": -60.0,
    "chebyshev-80": -80.0,
    "taylor-30": -30.3,
    "taylor-50": -49.3,
    "kaiser-6": -43.8,
}


@pytest.mark.parametrize("window", get_args(Window))
def test_highest_sidelobe_matches_published_level(window):
    amplitude = compute_spectrum(window, 256)
    sidelobes = amplitude[find_first_null(amplitude) :]
    # 64 points per bin miss the peak of a lobe by 0.001 dB.
    assert 2 * to_decibels(sidelobes.max()) == pytest.approx(HIGHEST_SIDELOBE_DB[window], abs=0.06)


@pytest.mark.parametrize("n", [16, 33, 2200])
@pytest.mark.parametrize("level_db", [20.0, 60.0, 120.0])
def test_chebyshev_sidelobes_are_equal(n, level_db):
    weights = chebyshev_weights(n, level_db)
    # 256 points per bin miss the peaks by at most 0.004 dB.
    amplitude = abs(np.fft.rfft(weights, 256 * n)) / weights.sum()
    sidelobes = amplitude[find_first_null(amplitude) : -1]
    peaks = sidelobes[1:-1][(sidelobes[1:-1] > sidelobes[:-2]) & (sidelobes[1:-1] > sidelobes[2:])]
    assert len(peaks) >= n // 2 - 7
    np.testing.assert_allclose(2 * to_decibels(peaks), -level_db, atol=0.01)


@pytest.mark.parametrize("n", [2, 7, 32])
def test_chebyshev_transform_matches_polynomial_in_thirty_digits(n):
    weights = chebyshev_weights(n, 60.0)
    frequency = 2 * np.pi * np.linspace(0, 0.5, 41)
    middle = np.arange(n) - (n - 1) / 2
    transform = np.cos(frequency[:, None] * middle) @ weights / weights.sum()
    with mpmath.workdps(30):
        edge_argument = mpmath.cosh(mpmath.acosh(1000) / (n - 1))
        expected = [
            float(mpmath.chebyt(n - 1, edge_argument * mpmath.cos(mpmath.mpf(w) / 2)) / 1000)
            for w in frequency
        ]
    np.testing.assert_allclose(transform, expected, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 8, 13, 64, 255, 2200])
def test_windows_match_scipy(n):
    scipy_windows = scipy.signal.windows
    for level_db in (50.0, 60.0, 80.0, 100.0):
        np.testing.assert_allclose(
            chebyshev_weights(n, level_db), scipy_windows.chebwin(n, level_db), rtol=0, atol=1e-11
        )
    for n_bar, level_db in ((1, 20.0), (4, 30.0), (6, 50.0)):
        np.testing.assert_allclose(
            taylor_weights(n, n_bar, level_db),
            scipy_windows.taylor(n, n_bar, level_db),
            rtol=0,
            atol=1e-12,
        )
    np.testing.assert_allclose(
        kaiser_weights(n, 6.0), scipy_windows.kaiser(n, 6.0), rtol=0, atol=1e-12
    )
    for window in ("hann", "hamming", "blackman"):
        expected = scipy_windows.get_window(window, n, fftbins=True)
        np.testing.assert_allclose(window_weights(window, n), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("n", [64, 63])
def test_peak_weight_is_one(n):
    for window in get_args(Window):
        weights = window_weights(window, n)
        periodic = window in ("rectangular", "hann", "hamming", "blackman", "blackman-harris")
        # Periodic windows have a central point if n is even, symmetric windows if n is odd.
        if periodic == (n % 2 == 0):
            assert weights[n // 2] == pytest.approx(1.0, rel=1e-12)
        elif window.startswith("chebyshev"):
            assert weights.max() == 1.0
        elif window != "rectangular":
            assert 0.99 < weights.max() < 1.0
    assert np.argmax(chebyshev_weights(5000, 60.0)) in (0, 4999)


def test_hann_window_correlates_powers_of_adjacent_bins_by_four_ninths():
    correlation = bin_correlation(window_weights("hann", 128), 128, np.arange(64))
    expected = np.zeros(64)
    expected[:3] = 1, 4 / 9, 1 / 36
    np.testing.assert_allclose(abs(correlation) ** 2, expected, atol=1e-12)


@pytest.mark.parametrize("n_bins", (128, 200, 96), ids=("as many", "padded", "folded"))
def test_bin_correlation_matches_defining_sum(n_bins):
    weights, lags = window_weights("chebyshev-60", 128), np.array([[0, 1, -3], [70, 500, -129]])
    turns = np.exp(-2j * np.pi * np.outer(lags, np.arange(128)) / n_bins)
    expected = (turns @ weights**2 / np.sum(weights**2)).reshape(lags.shape)
    np.testing.assert_allclose(bin_correlation(weights, n_bins, lags), expected, atol=1e-13)


@pytest.mark.parametrize("window", get_args(Window))
def test_single_point_window_is_one(window):
    weights = window_weights(window, 1)
    np.testing.assert_array_equal(weights, [1.0])
    assert coherent_gain(weights) == noise_bandwidth_bins(weights) == 1.0


@pytest.mark.parametrize("window", get_args(Window))
@pytest.mark.parametrize("n", [32, 128, 2200])
def test_main_lobe_ends_at_first_null(window, n):
    null = find_first_null(compute_spectrum(window, n)) / 64
    # Nulls are located within half of 1 / 64 bin; windows of 32 points are up to 4 % wider.
    assert null == pytest.approx(half_main_lobe_bins(window), abs=0.008, rel=1.28 / n)


@pytest.mark.parametrize(
    ("window", "mean_db"), [("rectangular", -1.114), ("hann", -0.451)], ids=str
)
def test_mean_power_of_tone_between_bins(window, mean_db):
    weights = window_weights(window, 256)
    offsets = np.linspace(-0.5, 0.5, 2001)[:-1] / 256
    tones = np.exp(2j * np.pi * offsets[:, None] * np.arange(256))
    power = abs(tones @ weights / weights.sum()) ** 2
    assert to_decibels(power.mean()) == pytest.approx(mean_db, abs=5e-4)
    assert power.min() == pytest.approx(1 / scalloping_loss(weights), rel=1e-12)


@pytest.mark.parametrize("window", get_args(Window))
@pytest.mark.parametrize("n", [2, 3, 16, 1023, 40_000])
def test_weights_are_at_most_one_and_noise_bandwidth_is_at_least_one(window, n):
    weights = window_weights(window, n)
    assert np.all(np.isfinite(weights))
    # The first Blackman weight is the difference 0.42 - 0.5 + 0.08, zero up to rounding.
    assert -1e-9 < weights.min() <= weights.max() <= 1 + 1e-12
    assert 0 < coherent_gain(weights) <= 1
    assert noise_bandwidth_bins(weights) >= 1 - 1e-12
    assert scalloping_loss(weights) >= 1 - 1e-12


@pytest.mark.parametrize(
    "make_window",
    [
        lambda: chebyshev_weights(0, 60.0),
        lambda: chebyshev_weights(64, 0.0),
        lambda: chebyshev_weights(64, float("nan")),
        lambda: taylor_weights(64, 0, 30.0),
        lambda: taylor_weights(64, 4, -30.0),
        lambda: taylor_weights(6.5, 4, 30.0),
        lambda: kaiser_weights(64, -1.0),
        lambda: kaiser_weights(64, 1e4),
        lambda: kaiser_weights(64, "6"),
        lambda: kaiser_weights(64, None),
        lambda: kaiser_weights(64, float("nan")),
        lambda: chebyshev_weights(64, "60"),
        lambda: chebyshev_weights(64, None),
        lambda: chebyshev_weights(64, 301.0),
        lambda: taylor_weights(64, 4, [30.0]),
        lambda: taylor_weights(64, [4], 30.0),
        lambda: half_main_lobe_bins("x"),
        lambda: half_main_lobe_bins(["hann"]),
        lambda: half_main_lobe_bins(None),
        lambda: window_weights(np.array(["hann", "hamming"]), 64),
        lambda: window_weights("chebyshev-70", 64),
        lambda: window_weights(["hann"], 64),
        lambda: window_weights("hann", 0),
        lambda: window_weights("rectangular", -1),
        lambda: window_weights("hann", 64.0),
        lambda: window_weights("hann", "64"),
        lambda: window_weights("hann", np.array([64])),
        lambda: window_weights("taylor-30", True),
    ],
)
def test_rejects_invalid_window_settings(make_window):
    # Equal valid keys (64 for 64.0, 1 for True) in the cache must not hide the error.
    window_weights("hann", 64)
    window_weights("taylor-30", 1)
    with pytest.raises(InvalidSetting):
        make_window()
