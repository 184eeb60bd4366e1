"""CFAR factors and detection probabilities against tables, 30 digits and simulation."""

import math
from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import betainc, binomial, mp, mpf
from scipy.special import chndtr, gammainccinv, gammaincinv, gammaln

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels, to_decibels
from dechirp.theory import cfar, cfar_detection
from dechirp.theory.detection import exceedance_probability
from nightly import nightly, nightly_except

SWERLING = (0, 1, 2, 3, 4)


# Published values


def test_ordered_statistic_factor_matches_published_value():
    factor = cfar.ordered_statistic_factor(1e-6, n_training=24, rank=18)
    assert factor == pytest.approx(16.293, abs=6e-4)


def test_greatest_of_and_smallest_of_factors_match_published_values():
    assert cfar.greatest_of_factor(1e-6, n_training=16) == pytest.approx(19.356, abs=6e-4)
    assert cfar.smallest_of_factor(1e-6, n_training=16) == pytest.approx(41.057, abs=6e-4)


def test_factors_of_one_and_eight_powers_match_published_values():
    factor_of_one = cfar.cell_averaging_factor(1e-6, n_training=32)
    factor_of_eight = cfar.cell_averaging_factor(1e-6, n_training=32, n_summed=8)
    assert factor_of_one == pytest.approx(17.28, abs=6e-3)
    assert factor_of_eight == pytest.approx(3.807, abs=6e-4)


@pytest.mark.parametrize(
    ("n_training", "swerling", "loss_db"),
    [(16, 1, 2.01), (32, 1, 0.97), (644, 1, 0.047), (16, 0, 2.05), (32, 0, 0.98), (644, 0, 0.047)],
)
def test_cell_averaging_loss_matches_published_values(n_training, swerling, loss_db):
    loss = cfar_detection.cell_averaging_loss(0.9, 1e-6, n_training=n_training, swerling=swerling)
    assert to_decibels(loss) == pytest.approx(loss_db, abs=6e-3 if loss_db > 0.1 else 6e-4)


@pytest.mark.parametrize("n_training", [2, 16, 644, 10_000])
@pytest.mark.parametrize(
    ("pd", "tolerance"), [(0.1, 1e-10), (0.9, 1e-10), (1 - 1e-6, 1e-10), (1 - 1e-9, 1e-7)]
)
def test_required_snr_of_swerling_1_matches_closed_form(n_training, pd, tolerance):
    snr = cfar_detection.cell_averaging_required_snr(pd, 1e-6, n_training=n_training, swerling=1)
    exact = np.expm1(-np.log(1e-6) / n_training) / np.expm1(-np.log(pd) / n_training) - 1
    assert snr == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize("swerling", SWERLING)
@pytest.mark.parametrize(("n_training", "n_summed"), [(2, 1), (24, 1), (24, 8)])
def test_required_snr_gives_requested_detection_probability(swerling, n_training, n_summed):
    law = {"n_training": n_training, "n_summed": n_summed}
    factor = cfar.cell_averaging_factor(1e-5, **law)
    for pd in (2e-5, 0.5, 0.999999):
        snr = cfar_detection.cell_averaging_required_snr(pd, 1e-5, swerling=swerling, **law)
        probability = cfar_detection.cell_averaging_detection_probability(
            snr, factor, swerling=swerling, **law
        )
        assert probability == pytest.approx(pd, rel=1e-10)


# Thirty digits

EXTREMES = [(2, 1e-12), (16, 1e-6), (644, 1e-6), (10_000, 1e-12), (10_000, 0.1)]


@pytest.mark.parametrize(("n_training", "pfa"), EXTREMES)
def test_half_window_factors_match_alternating_sum_in_fifty_digits(n_training, pfa):
    greatest = cfar.greatest_of_factor(pfa, n_training=n_training)
    smallest = cfar.smallest_of_factor(pfa, n_training=n_training)
    # Terms of the sum for the greatest-of statistic cancel to 1e-12 of their value.
    mp.dps = 50
    half = n_training // 2

    def smallest_of_probability(factor):
        t = mpf(factor) / half
        term, total = (2 + t) ** -half, mpf(0)
        for k in range(half):
            total += term
            term *= mpf(half + k) / (k + 1) / (2 + t)
        return 2 * total

    def greatest_of_probability(factor):
        return 2 * (1 + mpf(factor) / half) ** -half - smallest_of_probability(factor)

    assert float(smallest_of_probability(smallest)) == pytest.approx(pfa, rel=1e-11)
    assert float(greatest_of_probability(greatest)) == pytest.approx(pfa, rel=1e-11)


@pytest.mark.parametrize(("n_training", "pfa"), nightly_except(2, EXTREMES))
@pytest.mark.parametrize("rank_fraction", [0.0, 0.5, 0.75, 1.0])
def test_ordered_statistic_factor_matches_product_in_thirty_digits(n_training, pfa, rank_fraction):
    rank = max(1, round(rank_fraction * n_training))
    mp.dps = 30
    factor = mpf(cfar.ordered_statistic_factor(pfa, n_training=n_training, rank=rank))
    probability = mpf(1)
    for i in range(rank):
        probability *= (n_training - i) / (n_training - i + factor)
    assert float(probability) == pytest.approx(pfa, rel=1e-11)


def iter_weights(swerling, mean, n_summed):
    """Yield P(J = j) for j = 0, 1, ... in mpmath, without end."""
    j, shape = 0, {1: 1, 2: n_summed, 3: 2, 4: 2 * n_summed}.get(swerling)
    weight = mp.exp(-mean) if swerling == 0 else (1 + mean / shape) ** -shape
    while True:
        yield weight
        j += 1
        if swerling == 0:
            weight *= mean / j
        else:
            weight *= (shape + j - 1) / mpf(j) * mean / (shape + mean)


@pytest.mark.parametrize("swerling", nightly_except(2, SWERLING))
@pytest.mark.parametrize(
    ("n_training", "n_summed", "pfa", "snr_db"),
    [(2, 1, 1e-12, 10), (16, 1, 1e-6, 13), (16, 4, 1e-12, 3), (10_000, 1, 1e-12, 10),
     (10_000, 30, 1e-6, -8), (24, 8, 1e-6, -30)],
)  # fmt: skip
def test_detection_probability_matches_beta_mixture(n_training, n_summed, pfa, snr_db, swerling):
    law = {"n_training": n_training, "n_summed": n_summed}
    factor, snr = cfar.cell_averaging_factor(pfa, **law), float(from_decibels(snr_db))
    mp.dps = 30
    a, shape = mpf(factor) / n_training, n_training * n_summed
    # Finite sum of P(gamma of K + j > a gamma of N K); the sum over J ends at 1e-14 of the total.
    step, cell, total, remaining = (1 + a) ** -shape, mpf(0), mpf(0), mpf(1)
    for m in range(n_summed):
        cell += step
        step *= mpf(shape + m) / (m + 1) * a / (1 + a)
    for j, weight in enumerate(iter_weights(swerling, mpf(snr) * n_summed, n_summed)):
        total, remaining = total + weight * cell, remaining - weight
        cell += step
        step *= mpf(shape + n_summed + j) / (n_summed + j + 1) * a / (1 + a)
        if remaining < 1e-14 * total:
            break

    probability = cfar_detection.cell_averaging_detection_probability(
        snr, factor, swerling=swerling, **law
    )
    assert probability == pytest.approx(float(total), rel=1e-12)


def test_finite_sum_of_mixture_equals_beta_distribution():
    mp.dps = 30
    a, shape = mpf("0.7"), 24
    total = sum(binomial(shape + m - 1, m) * a**m / (1 + a) ** (shape + m) for m in range(9))
    assert abs(total - betainc(shape, 9, 0, 1 / (1 + a), regularized=True)) < 1e-25


# Averages over the threshold


@pytest.mark.parametrize("swerling", nightly_except(2, SWERLING))
@pytest.mark.parametrize(("n_training", "n_summed"), [(16, 1), (8, 5), (60, 2)])
def test_detection_probability_is_mean_over_noise_estimates(n_training, n_summed, swerling):
    law = {"n_training": n_training, "n_summed": n_summed}
    snr = from_decibels(np.array([-5.0, 5.0, 12.0, 18.0]))
    a = cfar.cell_averaging_factor(1e-4, **law) / n_training
    # Equal steps of the logarithm of the training sum cover all but 1e-15 of its distribution.
    shape = n_training * n_summed
    log_ends = np.log([gammaincinv(shape, 1e-15), gammainccinv(shape, 1e-15)])
    log_sum, step = np.linspace(*log_ends, 300, retstep=True)
    shares = np.exp(shape * log_sum - np.exp(log_sum) - gammaln(shape)) * step
    expected = sum(
        share * exceedance_probability(snr, a * noise_sum, n_summed=n_summed, swerling=swerling)
        for noise_sum, share in zip(np.exp(log_sum), shares, strict=True)
    )
    probability = cfar_detection.cell_averaging_detection_probability(
        snr, a * n_training, swerling=swerling, **law
    )
    assert probability == pytest.approx(expected, abs=1e-9)


def compute_known_noise_probability(threshold, snr, swerling):
    """Compute the detection probability of one power over a known threshold in closed form."""
    if swerling == 0:
        return 1 - chndtr(2 * threshold, 2, 2 * snr)
    if swerling in (1, 2):
        return np.exp(-threshold / (1 + snr))
    c = 1 + snr / 2
    return (1 + threshold * (c - 1) / c**2) * np.exp(-threshold / c)


def compute_half_mean_distribution(z, n):
    """Compute the density and the distribution of the mean of n cells."""
    density = np.exp(n * np.log(n) + (n - 1) * np.log(z) - n * z - gammaln(n))
    middle = (density[1:] * z[1:] + density[:-1] * z[:-1]) / 2 * np.diff(np.log(z))
    return density, np.concatenate([[0], np.cumsum(middle)])


STATISTICS = {
    "ordered": (
        cfar.ordered_statistic_factor,
        cfar.ordered_statistic_false_alarm_probability,
        cfar_detection.ordered_statistic_detection_probability,
        {"n_training": 12, "rank": 9},
    ),
    "greatest": (
        cfar.greatest_of_factor,
        cfar.greatest_of_false_alarm_probability,
        cfar_detection.greatest_of_detection_probability,
        {"n_training": 12},
    ),
    "smallest": (
        cfar.smallest_of_factor,
        cfar.smallest_of_false_alarm_probability,
        cfar_detection.smallest_of_detection_probability,
        {"n_training": 12},
    ),
}


def compute_density(kind, z, n, rank):
    """Compute the density of the noise statistic over z."""
    if kind == "ordered":
        choose = gammaln(n + 1) - gammaln(rank) - gammaln(n - rank + 1)
        cumulative = np.log(-np.expm1(-z))
        return np.exp(choose + (rank - 1) * cumulative - (n - rank + 1) * z)
    half_density, cumulative = compute_half_mean_distribution(z, n // 2)
    return 2 * half_density * (cumulative if kind == "greatest" else 1 - cumulative)


def compute_exact_known_noise_probability(threshold, snr, swerling):
    """Compute detection over a known threshold in many digits: steady target or Swerling 3."""
    if swerling == 3:
        c = 1 + mpf(snr) / 2
        return (1 + threshold * (c - 1) / c**2) * mp.exp(-threshold / c)
    step = tail = mp.exp(-threshold)
    total = mpf(0)
    for j, weight in enumerate(islice(iter_weights(0, mpf(snr), 1), 120)):
        total += weight * tail
        step *= threshold / (j + 1)
        tail += step
    return total


def compute_exact_density(kind, x):
    """Compute the density of the 9th of 12 cells, or of the larger or smaller sum of 6 and 6."""
    if kind == "ordered":
        return 12 * binomial(11, 8) * (1 - mp.exp(-x)) ** 8 * mp.exp(-4 * x)
    half_density = x**5 / 120 * mp.exp(-x)
    half_tail = mp.exp(-x) * sum(x**m / mp.factorial(m) for m in range(6))
    return 2 * half_density * (1 - half_tail if kind == "greatest" else half_tail)


@pytest.mark.parametrize("swerling", [0, 3])
@pytest.mark.parametrize("kind", nightly_except(1, STATISTICS))
@pytest.mark.parametrize(
    ("pfa", "snr"), nightly_except([(1e-3, 20.0)], [(1e-9, 1.0), (1e-3, 0.1), (1e-3, 20.0)])
)
def test_detection_probability_over_statistic_keeps_nine_digits(kind, swerling, pfa, snr):
    find_factor, _, detection, law = STATISTICS[kind]
    factor = find_factor(pfa, **law)
    mp.dps = 25
    scale = mpf(factor) if kind == "ordered" else mpf(factor) / 6

    def integrand(x):
        return compute_exact_density(kind, x) * compute_exact_known_noise_probability(
            scale * x, snr, swerling
        )

    # Integration intervals are as narrow as the densities of the statistic and of the target.
    expected = mp.quad(integrand, [0, 0.05, 0.2, 0.6, 1.5, 4, 10, 30, 100], maxdegree=5)

    probability = detection(snr, factor, swerling=swerling, **law)
    assert float(probability) == pytest.approx(float(expected), rel=1e-9)


@pytest.mark.parametrize("swerling", SWERLING)
@pytest.mark.parametrize("kind", STATISTICS)
def test_detection_probability_is_mean_over_statistic(kind, swerling):
    find_factor, _, detection, law = STATISTICS[kind]
    factor = find_factor(1e-3, **law)
    # 40,000 steps of 0.05 %: the density integrates to 1 within 1e-7.
    z = np.exp(np.linspace(np.log(1e-6), np.log(60.0), 40_000))
    weights = compute_density(kind, z, 12, 9) * z * np.log(z[1] / z[0])
    snr = from_decibels(np.array([-10.0, 5.0, 12.0, 20.0]))
    expected = [
        weights @ compute_known_noise_probability(factor * z, ratio, swerling) for ratio in snr
    ]

    assert weights.sum() == pytest.approx(1, abs=1e-7)
    probabilities = detection(snr, factor, swerling=swerling, **law)
    assert probabilities == pytest.approx(expected, abs=1e-6)


# Simulation: within 5.5 standard errors, which chance exceeds once in 26 million.


def approx_proportion(p, n_trials):
    return pytest.approx(p, rel=0, abs=5.5 * math.sqrt(p * (1 - p) / n_trials))


def test_simulated_false_alarm_rates_match_setting():
    rng = np.random.default_rng(141)
    n_trials = 1_000_000
    training_cells = rng.exponential(size=(n_trials, 12)).astype(np.float32)
    cells_under_test = rng.exponential(size=n_trials)
    halves = training_cells.reshape(n_trials, 2, 6).mean(axis=2)
    statistics = {
        "ordered": np.partition(training_cells, 8, axis=1)[:, 8],
        "greatest": halves.max(axis=1),
        "smallest": halves.min(axis=1),
    }
    for kind, (find_factor, _, _, law) in STATISTICS.items():
        factor = find_factor(1e-2, **law)
        assert np.mean(cells_under_test > factor * statistics[kind]) == approx_proportion(
            1e-2, n_trials
        )


def draw_fluctuation(swerling, rng, shape):
    """Draw the power of a target over its mean, (trial, power)."""
    if swerling == 0:
        return np.ones(shape)
    is_fast = swerling in (2, 4)
    draw_shape = (shape[0], shape[1] if is_fast else 1)
    return rng.exponential(size=draw_shape) if swerling < 3 else rng.gamma(2, 0.5, size=draw_shape)


@pytest.mark.parametrize("swerling", SWERLING)
@pytest.mark.parametrize("n_summed", [1, 3])
def test_simulated_detection_rate_of_cell_averaging_matches_theory(swerling, n_summed):
    rng = np.random.default_rng([142, swerling, n_summed])
    n_trials, n_training, snr = 200_000, 10, 6.0
    law = {"n_training": n_training, "n_summed": n_summed}
    factor = cfar.cell_averaging_factor(1e-2, **law)
    noise = rng.normal(scale=math.sqrt(0.5), size=(2, n_trials, n_summed))
    power = snr * draw_fluctuation(swerling, rng, (n_trials, n_summed))
    cell = np.sum((noise[0] + np.sqrt(power)) ** 2 + noise[1] ** 2, axis=1)
    mean = rng.gamma(n_training * n_summed, size=n_trials) / n_training

    expected = cfar_detection.cell_averaging_detection_probability(
        snr, factor, swerling=swerling, **law
    )
    assert np.mean(cell > factor * mean) == approx_proportion(float(expected), n_trials)


# Properties over the whole parameter range

PFA = st.floats(-12, -1).map(lambda exponent: 10.0**exponent)
HALF = st.floats(0, math.log10(5000)).map(lambda exponent: round(10**exponent))
SNR_DB = np.linspace(-30, 40, 15)


@st.composite
def laws(draw):
    """Draw a CFAR statistic: its three functions and its parameters."""
    n_training = 2 * draw(HALF)
    kind = draw(st.sampled_from(["mean", *STATISTICS]))
    if kind == "mean":
        n_summed = draw(st.sampled_from([1, 2, 8, 50]))
        return (
            cfar.cell_averaging_factor,
            cfar.cell_averaging_false_alarm_probability,
            cfar_detection.cell_averaging_detection_probability,
            {"n_training": n_training, "n_summed": n_summed},
        )
    law = {"n_training": n_training}
    if kind == "ordered":
        law["rank"] = draw(st.integers(1, n_training))
    return (*STATISTICS[kind][:3], law)


@settings(max_examples=100, deadline=None)
@given(law=laws(), pfa=PFA)
def test_factor_gives_its_probability_and_falls_with_false_alarm_rate(law, pfa):
    find_factor, false_alarms, _, parameters = law
    factor = find_factor(pfa, **parameters)
    assert 0 < factor < math.inf
    assert false_alarms(factor, **parameters) == pytest.approx(pfa, rel=1e-11)
    assert find_factor(pfa * 1.001, **parameters) < factor


@nightly
@settings(max_examples=100, deadline=None)
# Swerling 3 and 4 take 4e5 terms (1 s) for halves of one cell at 1e-12 and 40 dB.
@given(law=laws(), pfa=PFA, swerling=st.sampled_from([0, 1, 2]))
def test_detection_probability_rises_with_snr(law, pfa, swerling):
    find_factor, _, detection, parameters = law
    factor = find_factor(pfa, **parameters)
    probabilities = detection(from_decibels(SNR_DB), factor, swerling=swerling, **parameters)
    assert np.all(np.isfinite(probabilities))
    assert np.all((probabilities >= 0) & (probabilities <= 1))
    assert np.all(np.diff(probabilities) >= -1e-14 * probabilities[1:])
    assert detection(0.0, factor, swerling=swerling, **parameters) == pytest.approx(pfa, rel=1e-9)


@pytest.mark.parametrize("kind", STATISTICS)
def test_swerling_3_and_4_agree_for_one_power(kind):
    find_factor, _, detection, law = STATISTICS[kind]
    snr, factor = from_decibels(SNR_DB), find_factor(1e-6, **law)
    np.testing.assert_array_equal(
        detection(snr, factor, swerling=3, **law), detection(snr, factor, swerling=4, **law)
    )


@pytest.mark.parametrize("swerling", SWERLING)
@pytest.mark.parametrize("kind", STATISTICS)
def test_extreme_false_alarm_probabilities_have_factors(kind, swerling):
    find_factor, false_alarms, detection, law = STATISTICS[kind]
    for pfa in (1e-300, 1 - 1e-9):
        factor = find_factor(pfa, **law)
        assert float(false_alarms(factor, **law)) == pytest.approx(pfa, rel=1e-9)
        probabilities = detection(np.array([0.0, 1.0]), factor, swerling=swerling, **law)
        assert probabilities[0] == pytest.approx(pfa, rel=1e-9)
        assert probabilities[0] <= probabilities[1] <= 1


def test_factor_of_many_cells_approaches_known_noise():
    for pfa in (1e-12, 1e-6, 0.1):
        excess = cfar.cell_averaging_factor(pfa, n_training=10**6) / -math.log(pfa) - 1
        # First term of the series: -ln Pfa / 2 N.
        assert excess == pytest.approx(-math.log(pfa) / 2e6, rel=1e-4)


def test_threshold_far_above_noise_still_detects_strong_targets():
    # 15 dB of amplitude in the report are 29 dB of power: false alarms below 1e-240. The 569th of
    # 900 cells lies at the mean, with at most twice its spread.
    snr = from_decibels(np.array([27.0, 28.95, 30.0]))
    mean = cfar_detection.cell_averaging_detection_probability(snr, 785.0, n_training=900)
    ordered = cfar_detection.ordered_statistic_detection_probability(
        snr, 785.0, n_training=900, rank=569
    )
    assert cfar.cell_averaging_false_alarm_probability(785.0, n_training=900) < 1e-240
    assert mean == pytest.approx([0.0, 0.5, 1.0], abs=0.02)
    assert ordered == pytest.approx(mean, abs=0.02)


def test_result_has_shape_of_snr():
    snr = np.ones((2, 3))
    for find_factor, _, detection, law in STATISTICS.values():
        for swerling in SWERLING:
            probabilities = detection(snr, find_factor(1e-2, **law), swerling=swerling, **law)
            assert probabilities.shape == (2, 3)
            assert detection(1.0, 5.0, swerling=swerling, **law).shape == ()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: cfar.cell_averaging_factor(0.0, n_training=8), "false_alarm_probability"),
        (lambda: cfar.cell_averaging_factor(1e-3, n_training=0), "n_training"),
        (lambda: cfar.cell_averaging_factor(1e-3, n_training=8, n_summed=0), "n_summed"),
        (lambda: cfar.ordered_statistic_factor(1.0, n_training=8, rank=6), "between 0 and 1"),
        (lambda: cfar.ordered_statistic_factor(1e-3, n_training=8, rank=9), "rank: 9"),
        (lambda: cfar.ordered_statistic_factor(1e-3, n_training=8, rank=0), "from 1 to 8"),
        (lambda: cfar.greatest_of_factor(1e-3, n_training=9), "even"),
        (lambda: cfar.greatest_of_factor(-1e-3, n_training=8), "between 0 and 1"),
        (lambda: cfar.smallest_of_factor(1e-3, n_training=9), "even"),
        (lambda: cfar.smallest_of_factor(math.nan, n_training=8), "between 0 and 1"),
        (lambda: cfar.cell_averaging_false_alarm_probability(-1.0, n_training=8), "factor"),
        (
            lambda: cfar_detection.cell_averaging_detection_probability(-1.0, 9.0, n_training=8),
            "not dB",
        ),
        (
            lambda: cfar_detection.greatest_of_detection_probability(math.inf, 9.0, n_training=8),
            "finite",
        ),
        (
            lambda: cfar_detection.smallest_of_detection_probability(1.0, 0.0, n_training=8),
            "above 0",
        ),
        (
            lambda: cfar_detection.ordered_statistic_detection_probability(
                1.0, 9.0, n_training=8, rank=6, swerling=5
            ),
            "swerling",
        ),
        (
            lambda: cfar_detection.cell_averaging_detection_probability(
                1.0, [10, -20], n_training=8
            ),
            "factor",
        ),
        (
            lambda: cfar_detection.greatest_of_detection_probability(
                1.0, np.array([0.0]), n_training=8
            ),
            "factor",
        ),
        (
            lambda: cfar_detection.ordered_statistic_detection_probability(
                1.0, "9", n_training=8, rank=6
            ),
            "factor: '9'",
        ),
        (lambda: cfar.cell_averaging_false_alarm_probability("9", n_training=8), "a real number"),
        (lambda: cfar.cell_averaging_factor(1e-310, n_training=8), "from 1e-300"),
        (lambda: cfar.ordered_statistic_factor(1e-310, n_training=8, rank=1), "from 1e-300"),
        (lambda: cfar.greatest_of_factor(np.nextafter(1, 0), n_training=644), "to 1 - 1e-9"),
        (
            lambda: cfar_detection.cell_averaging_required_snr(0.9999, 1e-300, n_training=8),
            "terms",
        ),
        (lambda: cfar_detection.cell_averaging_required_snr(1e-4, 1e-3, n_training=8), "above"),
        (
            lambda: cfar_detection.cell_averaging_loss(1.0, 1e-3, n_training=8),
            "detection_probability",
        ),
    ],
)
def test_rejects_invalid_arguments_by_name(call, message):
    with pytest.raises(InvalidSetting, match=message):
        call()
