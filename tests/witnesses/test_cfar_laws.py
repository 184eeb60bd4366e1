"""CFAR laws against integrals in many digits, and calibrated factors against exact ones."""

import math

import numpy as np
import pytest
import scipy
from mpmath import betainc, gammainc, mp, mpf
from scipy.special import comb

from dechirp.core.errors import InvalidSetting
from dechirp.processing.cfar.base import Cells, MapNoise, TrainingWindow
from dechirp.processing.spectrum import Transform
from dechirp.theory import cfar
from dechirp.theory.cfar_calibration import calibrate_factor
from dechirp.theory.cfar_correlated_cells import correlated_factor
from dechirp.theory.cfar_detection import (
    greatest_of_detection_probability,
    smallest_of_detection_probability,
)
from dechirp.theory.cfar_ordered_statistic import OrderedStatisticLaw
from dechirp.theory.cfar_trimmed_mean import (
    trimmed_mean_factor,
    trimmed_mean_false_alarm_probability,
)
from dechirp.theory.detection import exceedance_probability
from nightly import nightly, nightly_except


@pytest.mark.parametrize(
    ("n", "k", "factor"), [(24, 18, 16.293), (32, 24, 14.399), (16, 12, 20.954)]
)
def test_ordered_statistic_factors_match_published_values(n, k, factor):
    assert cfar.ordered_statistic_factor(1e-6, n_training=n, rank=k) == pytest.approx(
        factor, abs=6e-4
    )


def gamma_tail(shape, x):
    return gammainc(shape, x, mp.inf, regularized=True)


def gamma_cumulative(shape, x):
    return gammainc(shape, 0, x, regularized=True)


def gamma_density(shape, x):
    return x ** (shape - 1) * mp.exp(-x) / mp.gamma(shape)


@pytest.mark.parametrize(
    ("n", "k", "n_summed"), nightly_except(1, [(24, 18, 4), (16, 12, 8), (8, 1, 3), (8, 8, 2)])
)
def test_ordered_statistic_of_summed_powers_matches_integral(n, k, n_summed):
    factor = cfar.ordered_statistic_factor(1e-6, n_training=n, rank=k, n_summed=n_summed)
    mp.dps = 25

    def integrand(s):
        order = math.factorial(n) // (math.factorial(k - 1) * math.factorial(n - k))
        ranked = (
            order * gamma_cumulative(n_summed, s) ** (k - 1) * gamma_tail(n_summed, s) ** (n - k)
        )
        return ranked * gamma_density(n_summed, s) * gamma_tail(n_summed, factor * s)

    probability = mp.quad(integrand, [0, 0.1, 0.3, 1, 2, 4, 8, 16, 40, 120])
    assert float(probability) == pytest.approx(1e-6, rel=1e-9)


@pytest.mark.parametrize(("n", "k"), [(1, 1), (16, 12), (644, 483), (644, 644), (10_000, 7500)])
@pytest.mark.parametrize("pfa", [1e-12, 1e-6, 0.1])
def test_integral_for_one_power_equals_rohling_product(n, k, pfa):
    factor = cfar.ordered_statistic_factor(pfa, n_training=n, rank=k)
    law = OrderedStatisticLaw(n_training=n, rank=k, n_summed=1)
    assert np.exp(law.log_false_alarm_probability(factor)) == pytest.approx(pfa, rel=1e-9)


HALVES = [((4, 4), 1), ((5, 11), 1), ((8, 8), 4), ((3, 12), 5), ((20, 16), 2)]


@pytest.mark.parametrize(("sizes", "n_summed"), nightly_except(2, HALVES))
def test_half_windows_of_any_size_match_integrals(sizes, n_summed):
    law = {"n_training": sizes, "n_summed": n_summed}
    greatest, smallest = (find(1e-6, **law) for find in (
        cfar.greatest_of_factor, cfar.smallest_of_factor
    ))  # fmt: skip
    mp.dps = 25
    (n, m), (a, b) = sizes, (size * n_summed for size in sizes)
    ends = [0, 0.02, 0.1, 0.3, 0.6, 1, 1.5, 2, 3, 5, 10, 30]

    def compute_probability(factor, compare):
        def integrand(mean):  # of one half, with the other smaller or larger
            first_term = n * gamma_density(a, n * mean) * compare(b, m * mean)
            second_term = m * gamma_density(b, m * mean) * compare(a, n * mean)
            return (first_term + second_term) * gamma_tail(n_summed, factor * mean)

        return float(mp.quad(integrand, [end * n_summed for end in ends]))

    assert compute_probability(greatest, gamma_cumulative) == pytest.approx(1e-6, rel=1e-9)
    assert compute_probability(smallest, gamma_tail) == pytest.approx(1e-6, rel=1e-9)


@pytest.mark.parametrize("swerling", nightly_except(1, [0, 1, 3]))
def test_detection_over_unequal_halves_is_mean_over_noise_estimates(swerling):
    n, m = 5, 11
    factor = cfar.greatest_of_factor(1e-4, n_training=(n, m))
    rng, n_draws = np.random.default_rng(321), 200_000
    means = np.array([rng.gamma(size, 1 / size, n_draws) for size in (n, m)])
    for detection, mean in (
        (greatest_of_detection_probability, means.max(axis=0)),
        (smallest_of_detection_probability, means.min(axis=0)),
    ):
        # Quantiles give 2,000 thresholds of equal probability.
        quantiles = np.quantile(mean, (np.arange(2000) + 0.5) / 2000)
        probabilities = [float(exceedance_probability(30.0, factor * q, swerling=swerling))
                  for q in quantiles]  # fmt: skip
        probability = float(detection(30.0, factor, n_training=(n, m), swerling=swerling))
        # The standard error of the mean is below 0.5 / sqrt(n_draws); the tolerance is six of them.
        assert probability == pytest.approx(np.mean(probabilities), abs=6 * 0.5 / np.sqrt(n_draws))


@pytest.mark.parametrize(("n", "low", "high"), [(8, 2, 3), (10, 1, 1), (12, 0, 3), (12, 3, 0)])
def test_trimmed_mean_factor_matches_integral(n, low, high):
    factor = trimmed_mean_factor(1e-4, n_training=n, n_smallest=low, n_largest=high)
    n_kept = n - low - high
    t = factor / n_kept
    order = math.factorial(n) / (
        math.factorial(low) * math.factorial(high) * math.factorial(n_kept - 2)
    )
    # The smallest and the largest retained cell are at a and a + d; cells between them are
    # independent. Gauss-Legendre integration over u = exp(-a) and w = exp(-d), both from 0 to 1.
    nodes, weights = np.polynomial.legendre.leggauss(400)
    u, w = (nodes[:, None] + 1) / 2, (nodes + 1) / 2
    mean_between = (1 - w ** (1 + t)) / (1 + t)  # mean of exp(-t x) up to d, times probability
    density = (1 - u) ** low * u ** (n_kept + high - 1) * w**high
    integrand = order * density * u ** (n_kept * t) * w**t * mean_between ** (n_kept - 2)
    assert weights @ integrand @ weights / 4 == pytest.approx(1e-4, rel=1e-8)


def test_trimmed_mean_reduces_to_cell_averaging_and_ordered_statistic():
    for n in (16, 644):
        untrimmed_factor = trimmed_mean_factor(1e-6, n_training=n, n_smallest=0, n_largest=0)
        assert untrimmed_factor == pytest.approx(
            cfar.cell_averaging_factor(1e-6, n_training=n), rel=1e-12
        )
        single_cell_factor = trimmed_mean_factor(
            1e-6, n_training=n, n_smallest=n // 2 - 1, n_largest=n - n // 2
        )
        ordered_statistic_factor = cfar.ordered_statistic_factor(1e-6, n_training=n, rank=n // 2)
        assert single_cell_factor == pytest.approx(ordered_statistic_factor, rel=1e-12)


# Calibrated factors: within 5.5 of their standard errors, which chance exceeds once in 26 million.


def make_correlated_window(training, guard, window="rectangular", padding_factor=1, row=None):
    noise = MapNoise(
        range_transform=Transform(window=window, n_points=512, n_bins=512 * padding_factor),
        doppler_transform=Transform(window=window, n_points=128, n_bins=128 * padding_factor),
    )
    cells = [Cells(range=r, velocity=v) for r, v in (training, guard)]
    training_window = TrainingWindow(n_training=cells[0], n_guard=cells[1])
    return training_window.noise_covariance_in_box(
        noise, training_window.half_range if row is None else row
    )


def mean(cells):
    return cells.mean(axis=-1)


@nightly
@pytest.mark.parametrize("n_summed", [1, 4])
@pytest.mark.parametrize(
    ("training", "guard", "window", "padding_factor", "row"),
    [
        ((10, 8), (4, 4), "hann", 2, None),
        ((10, 8), (4, 4), "hann", 1, None),
        ((6, 4), (2, 2), "rectangular", 2, None),
        ((6, 4), (1, 1), "hann", 1, 0),
        ((8, 0), (2, 0), "hann", 1, None),
    ],
)
def test_calibrated_factor_of_mean_matches_exact_factor(
    training, guard, window, padding_factor, row, n_summed
):
    correlated_window = make_correlated_window(training, guard, window, padding_factor, row)
    calibration = calibrate_factor(1e-6, mean, correlated_window, n_summed=n_summed)
    assert calibration.relative_error <= 0.01
    high, low = (
        correlated_factor(
            1e-6 * (1 + side * calibration.relative_error), correlated_window, n_summed=n_summed
        )
        for side in (-5.5, 5.5)
    )
    assert low < calibration.value < high
    assert calibrate_factor(1e-6, mean, correlated_window, n_summed=n_summed) == calibration


@pytest.mark.parametrize("pfa", nightly_except([1e-6], [1e-2, 1e-6, 1e-9]))
@pytest.mark.parametrize("n_summed", nightly_except(1, [1, 4]))
def test_calibrated_factors_in_independent_cells_match_closed_forms(pfa, n_summed):
    correlated_window = make_correlated_window((4, 3), (2, 2))
    first = correlated_window.training_offsets[:, 1] < 0
    second = correlated_window.training_offsets[:, 1] > 0
    halves, n = (int(first.sum()), int(second.sum())), correlated_window.n_training
    sets = np.array([first, second])
    cases = {
        "ordered": (
            lambda cells: np.partition(cells, 87, axis=-1)[..., 87],
            None,
            lambda f: cfar.ordered_statistic_false_alarm_probability(
                f, n_training=n, rank=88, n_summed=n_summed
            ),
        ),
        "greatest": (
            lambda cells: np.maximum(mean(cells[..., first]), mean(cells[..., second])),
            sets.any(axis=0, keepdims=True),
            lambda f: cfar.greatest_of_false_alarm_probability(
                f, n_training=halves, n_summed=n_summed
            ),
        ),
        "smallest": (
            lambda cells: np.minimum(mean(cells[..., first]), mean(cells[..., second])),
            sets,
            lambda f: cfar.smallest_of_false_alarm_probability(
                f, n_training=halves, n_summed=n_summed
            ),
        ),
    }
    for statistic, low, law in cases.values():
        calibration = calibrate_factor(
            pfa, statistic, correlated_window, n_summed=n_summed, low_cell_masks=low
        )
        assert calibration.relative_error <= 0.02
        assert float(law(calibration.value)) == pytest.approx(
            pfa, rel=5.5 * calibration.relative_error
        )


def test_calibrated_trimmed_mean_factor_matches_closed_form():
    correlated_window = make_correlated_window((4, 3), (2, 2))
    n, n_largest = correlated_window.n_training, 30

    def trimmed_mean(cells):
        return np.sort(cells, axis=-1)[..., : n - n_largest].mean(axis=-1)

    calibration = calibrate_factor(1e-6, trimmed_mean, correlated_window)
    probability = trimmed_mean_false_alarm_probability(
        calibration.value, n_training=n, n_smallest=0, n_largest=n_largest
    )
    assert float(probability) == pytest.approx(1e-6, rel=5.5 * calibration.relative_error)


@nightly
@pytest.mark.parametrize(
    ("training", "guard", "padding_factor", "message"),
    [
        ((40, 30), (4, 4), 1, "at most 2000"),
        ((6, 4), (0, 0), 1, "guard cells beyond the main lobe"),
        ((10, 8), (4, 4), 16, "guard cells beyond the main lobe"),
        ((2, 0), (1, 0), 1, "within 25%"),
    ],
)
def test_rejects_windows_that_cannot_be_calibrated(training, guard, padding_factor, message):
    correlated_window = make_correlated_window(training, guard, "hann", padding_factor)

    def smallest(cells):
        return cells.min(axis=-1)

    with pytest.raises(InvalidSetting, match=message):
        calibrate_factor(1e-6, smallest, correlated_window)


def test_ratio_of_gamma_sums_follows_beta_distribution():
    # Basis of the closed forms: a sum of 3 powers exceeds 1.7 times a sum of 5.
    mp.dps = 20
    tail = sum(comb(3 + j - 1, j) * mpf(1.7) ** 3 / mpf(2.7) ** (3 + j) for j in range(5))
    beta_cumulative = betainc(3, 5, 0, mpf(1.7) / mpf(2.7), regularized=True)
    assert abs(tail - beta_cumulative) < 1e-15


@pytest.mark.parametrize(
    ("kind", "options"),
    nightly_except(
        1,
        [
            ("cell_averaging", {}),
            ("smallest_of", {}),
            ("greatest_of", {}),
            ("ordered_statistic", {"rank": 12}),
        ],
    ),
)
def test_factors_of_a_million_summed_powers_follow_normal_law(kind, options):
    n_training, n_summed = 16, 10**6
    laws = {"n_training": n_training, "n_summed": n_summed} | options

    factor = getattr(cfar, f"{kind}_factor")(1e-6, **laws)

    inverse = getattr(cfar, f"{kind}_false_alarm_probability")(factor, **laws)
    assert inverse == pytest.approx(1e-6, rel=1e-6)
    # Sums of K powers are normal numbers with a deviation of 1 / sqrt(K): the factor is 1 plus
    # that of normal cells, of the order 1 / sqrt(K), to a relative error of the same order.
    normal = np.random.default_rng(1).normal(size=(400_000, n_training))
    statistic = {
        "cell_averaging": lambda: normal.mean(axis=1),
        "greatest_of": lambda: np.maximum(normal[:, :8].mean(axis=1), normal[:, 8:].mean(axis=1)),
        "smallest_of": lambda: np.minimum(normal[:, :8].mean(axis=1), normal[:, 8:].mean(axis=1)),
        "ordered_statistic": lambda: np.partition(normal, 11, axis=1)[:, 11],
    }[kind]()
    excess = (factor - 1) * np.sqrt(n_summed)
    alarms = scipy.special.ndtr(-(excess + statistic)).mean()
    assert alarms == pytest.approx(1e-6, rel=0.15)


def test_more_summed_powers_than_the_law_can_add_are_refused():
    with pytest.raises(InvalidSetting, match="n_summed: 100000000; expected .* to 10000000"):
        cfar.greatest_of_factor(1e-6, n_training=16, n_summed=10**8)
