"""Laws of detectors against integrals in many digits, and calibrated factors against exact ones."""

import math

import numpy as np
import pytest
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


@pytest.mark.parametrize(
    ("n", "k", "factor"), [(24, 18, 16.293), (32, 24, 14.399), (16, 12, 20.954)]
)
def test_ordered_statistics_have_their_published_factors(n, k, factor):
    assert cfar.ordered_statistic_factor(1e-6, n_training=n, rank=k) == pytest.approx(
        factor, abs=6e-4
    )


def beyond(shape, x):
    return gammainc(shape, x, mp.inf, regularized=True)


def below(shape, x):
    return gammainc(shape, 0, x, regularized=True)


def density(shape, x):
    return x ** (shape - 1) * mp.exp(-x) / mp.gamma(shape)


@pytest.mark.parametrize(("n", "k", "n_summed"), [(24, 18, 4), (16, 12, 8), (8, 1, 3), (8, 8, 2)])
def test_an_ordered_statistic_of_summed_powers_alarms_as_its_integral_says(n, k, n_summed):
    factor = cfar.ordered_statistic_factor(1e-6, n_training=n, rank=k, n_summed=n_summed)
    mp.dps = 25

    def share(s):
        order = math.factorial(n) // (math.factorial(k - 1) * math.factorial(n - k))
        ranked = order * below(n_summed, s) ** (k - 1) * beyond(n_summed, s) ** (n - k)
        return ranked * density(n_summed, s) * beyond(n_summed, factor * s)

    found = mp.quad(share, [0, 0.1, 0.3, 1, 2, 4, 8, 16, 40, 120])
    assert float(found) == pytest.approx(1e-6, rel=1e-9)


@pytest.mark.parametrize(("n", "k"), [(1, 1), (16, 12), (644, 483), (644, 644), (10_000, 7500)])
@pytest.mark.parametrize("pfa", [1e-12, 1e-6, 0.1])
def test_of_one_power_the_integral_is_the_product_of_rohling(n, k, pfa):
    factor = cfar.ordered_statistic_factor(pfa, n_training=n, rank=k)
    law = OrderedStatisticLaw(n_training=n, rank=k, n_summed=1)
    assert np.exp(law.log_probability(factor)) == pytest.approx(pfa, rel=1e-9)


HALVES = [((4, 4), 1), ((5, 11), 1), ((8, 8), 4), ((3, 12), 5), ((20, 16), 2)]


@pytest.mark.parametrize(("sizes", "n_summed"), HALVES)
def test_halves_of_any_size_and_summed_powers_alarm_as_their_integrals_say(sizes, n_summed):
    law = {"n_training": sizes, "n_summed": n_summed}
    greatest, smallest = (find(1e-6, **law) for find in (
        cfar.greatest_of_factor, cfar.smallest_of_factor
    ))  # fmt: skip
    mp.dps = 25
    (n, m), (a, b) = sizes, (size * n_summed for size in sizes)
    ends = [0, 0.02, 0.1, 0.3, 0.6, 1, 1.5, 2, 3, 5, 10, 30]

    def alarms(factor, compare):
        def share(mean):  # of either half, the other compares so
            one = n * density(a, n * mean) * compare(b, m * mean)
            other = m * density(b, m * mean) * compare(a, n * mean)
            return (one + other) * beyond(n_summed, factor * mean)

        return float(mp.quad(share, [end * n_summed for end in ends]))

    assert alarms(greatest, below) == pytest.approx(1e-6, rel=1e-9)
    assert alarms(smallest, beyond) == pytest.approx(1e-6, rel=1e-9)


@pytest.mark.parametrize("swerling", [0, 1, 3])
def test_detection_over_unequal_halves_is_the_mean_over_their_means(swerling):
    n, m = 5, 11
    factor = cfar.greatest_of_factor(1e-4, n_training=(n, m))
    rng, n_draws = np.random.default_rng(321), 200_000
    means = np.array([rng.gamma(size, 1 / size, n_draws) for size in (n, m)])
    for detection, mean in (
        (greatest_of_detection_probability, means.max(axis=0)),
        (smallest_of_detection_probability, means.min(axis=0)),
    ):
        # By their quantiles: 2,000 thresholds of equal chance.
        quantiles = np.quantile(mean, (np.arange(2000) + 0.5) / 2000)
        passed = [float(exceedance_probability(30.0, factor * q, swerling=swerling))
                  for q in quantiles]  # fmt: skip
        found = float(detection(30.0, factor, n_training=(n, m), swerling=swerling))
        # The mean of n_draws has a standard error below 0.5 / sqrt(n_draws); six of them.
        assert found == pytest.approx(np.mean(passed), abs=6 * 0.5 / np.sqrt(n_draws))


@pytest.mark.parametrize(("n", "low", "high"), [(8, 2, 3), (10, 1, 1), (12, 0, 3), (12, 3, 0)])
def test_a_trimmed_mean_alarms_as_the_integral_over_its_ends_says(n, low, high):
    factor = trimmed_mean_factor(1e-4, n_training=n, n_smallest=low, n_largest=high)
    kept = n - low - high
    t = factor / kept
    order = math.factorial(n) / (
        math.factorial(low) * math.factorial(high) * math.factorial(kept - 2)
    )
    # The smallest and the largest kept are at a and a + d; between them cells are independent.
    # Over u = exp(-a) and w = exp(-d), both from 0 to 1, by Gauss and Legendre.
    nodes, weights = np.polynomial.legendre.leggauss(400)
    u, w = (nodes[:, None] + 1) / 2, (nodes + 1) / 2
    between = (1 - w ** (1 + t)) / (1 + t)  # mean of exp(-t x) for x up to d, times its chance
    density = (1 - u) ** low * u ** (kept + high - 1) * w**high
    share = order * density * u ** (kept * t) * w**t * between ** (kept - 2)
    assert weights @ share @ weights / 4 == pytest.approx(1e-4, rel=1e-8)


def test_a_trimmed_mean_is_cell_averaging_at_one_end_and_an_ordered_statistic_at_the_other():
    for n in (16, 644):
        whole = trimmed_mean_factor(1e-6, n_training=n, n_smallest=0, n_largest=0)
        assert whole == pytest.approx(cfar.cell_averaging_factor(1e-6, n_training=n), rel=1e-12)
        one = trimmed_mean_factor(1e-6, n_training=n, n_smallest=n // 2 - 1, n_largest=n - n // 2)
        ordered = cfar.ordered_statistic_factor(1e-6, n_training=n, rank=n // 2)
        assert one == pytest.approx(ordered, rel=1e-12)


# Calibrated factors: each within 5.5 of its own standard errors, which chance exceeds once in
# 26 million.


def box_of(training, guard, window="rectangular", padded=1, place=None):
    noise = MapNoise(
        range_transform=Transform(window=window, n_points=512, n_bins=512 * padded),
        doppler_transform=Transform(window=window, n_points=128, n_bins=128 * padded),
    )
    cells = [Cells(range=r, velocity=v) for r, v in (training, guard)]
    ring = TrainingWindow(n_training=cells[0], n_guard=cells[1])
    return ring.noise_box(noise, ring.half_range if place is None else place)


def mean(cells):
    return cells.mean(axis=-1)


@pytest.mark.parametrize("n_summed", [1, 4])
@pytest.mark.parametrize(
    ("training", "guard", "window", "padded", "place"),
    [
        ((10, 8), (4, 4), "hann", 1, None),
        ((10, 8), (4, 4), "hann", 2, None),
        ((6, 4), (2, 2), "rectangular", 2, None),
        ((6, 4), (1, 1), "hann", 1, 0),
        ((8, 0), (2, 0), "hann", 1, None),
    ],
)
def test_calibrated_over_the_mean_the_factor_is_the_exact_one(
    training, guard, window, padded, place, n_summed
):
    box = box_of(training, guard, window, padded, place)
    found = calibrate_factor(1e-6, mean, box, n_summed=n_summed)
    assert found.relative_error <= 0.01
    high, low = (
        correlated_factor(1e-6 * (1 + side * found.relative_error), box, n_summed=n_summed)
        for side in (-5.5, 5.5)
    )
    assert low < found.value < high
    assert calibrate_factor(1e-6, mean, box, n_summed=n_summed) == found


@pytest.mark.parametrize("pfa", [1e-2, 1e-6, 1e-9])
@pytest.mark.parametrize("n_summed", [1, 4])
def test_calibrated_in_independent_cells_the_factors_are_those_of_the_closed_forms(pfa, n_summed):
    box = box_of((4, 3), (2, 2))
    first = box.offsets[:, 1] < 0
    second = box.offsets[:, 1] > 0
    halves, n = (int(first.sum()), int(second.sum())), box.n_training
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
        found = calibrate_factor(pfa, statistic, box, n_summed=n_summed, low=low)
        assert found.relative_error <= 0.02
        assert float(law(found.value)) == pytest.approx(pfa, rel=5.5 * found.relative_error)


def test_the_factor_of_a_trimmed_mean_holds_for_one_power_by_both_ways():
    box = box_of((4, 3), (2, 2))
    n, n_largest = box.n_training, 30

    def trimmed(cells):
        return np.sort(cells, axis=-1)[..., : n - n_largest].mean(axis=-1)

    found = calibrate_factor(1e-6, trimmed, box)
    passed = trimmed_mean_false_alarm_probability(
        found.value, n_training=n, n_smallest=0, n_largest=n_largest
    )
    assert float(passed) == pytest.approx(1e-6, rel=5.5 * found.relative_error)


@pytest.mark.parametrize(
    ("training", "guard", "padded", "says"),
    [
        ((40, 30), (4, 4), 1, "at most 2000"),
        ((6, 4), (0, 0), 1, "guard cells beyond the main lobe"),
        ((10, 8), (4, 4), 16, "guard cells beyond the main lobe"),
        ((2, 0), (1, 0), 1, "within 25%"),
    ],
)
def test_what_cannot_be_calibrated_is_refused(training, guard, padded, says):
    box = box_of(training, guard, "hann", padded)

    def smallest(cells):
        return cells.min(axis=-1)

    with pytest.raises(InvalidSetting, match=says):
        calibrate_factor(1e-6, smallest, box)


def test_a_beta_distribution_compares_two_halves():
    # What the closed forms rest on: a sum of 3 powers exceeds 1.7 times one of 5.
    mp.dps = 20
    tail = sum(comb(3 + j - 1, j) * mpf(1.7) ** 3 / mpf(2.7) ** (3 + j) for j in range(5))
    part = betainc(3, 5, 0, mpf(1.7) / mpf(2.7), regularized=True)
    assert abs(tail - part) < 1e-15
