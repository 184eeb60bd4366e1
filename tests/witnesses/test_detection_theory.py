"""Detection in known noise against published values, mpmath, closed forms and simulation.

The package sums the mixture by parts, over few terms. The reference here sums over all j in 120
digits: slow, but independent.
"""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import gammainc, gammaincc
from scipy.stats import ncx2

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels, to_decibels
from dechirp.theory.binary_integration import binary_integration_probability
from dechirp.theory.cfar import cell_averaging_factor, greatest_of_factor
from dechirp.theory.detection import (
    coherent_detection_probability,
    coherent_required_snr,
    detection_probability,
    detection_threshold,
    exceedance_probability,
    required_snr,
)
from dechirp.theory.snr_approximations import albersheim, shnidman
from nightly import nightly_except

CASES = range(5)


def sum_mixture(snr, threshold, *, n_summed, swerling):
    """Sum w(j) Q(K + j, T) as one minus the sum of w(j) P(K + j, T), which converges."""
    with mpmath.workdps(120):
        chi, t, k = mpmath.mpf(snr), mpmath.mpf(threshold), n_summed
        mean, shape = k * chi, (None, 1, k, 2, 2 * k)[swerling]
        weight = mpmath.exp(-mean) if swerling == 0 else (shape / (shape + mean)) ** shape
        cumulative = mpmath.gammainc(k, 0, t, regularized=True)
        step = mpmath.exp(k * mpmath.log(t) - t - mpmath.loggamma(k + 1))
        miss_probability, j = mpmath.mpf(0), 0
        while cumulative > mpmath.mpf("1e-40"):
            miss_probability += weight * cumulative
            cumulative -= step
            j += 1
            step *= t / (k + j)
            growth = mean if swerling == 0 else (shape + j - 1) * mean / (shape + mean)
            weight *= growth / j
        return float(1 - miss_probability), float(miss_probability)


# PHYSICS 1.3: SNR in dB for a detection probability of 0.9 at 1e-6.
@pytest.mark.parametrize(
    ("n_summed", "needed_db"),
    [(1, (13.183, 21.144, 21.144, 17.296, 17.296)), (10, (5.267, 13.500, 6.292, 9.601, 5.806))],
)
def test_required_snr_matches_published_values(n_summed, needed_db):
    snr = [required_snr(0.9, 1e-6, n_summed=n_summed, swerling=case) for case in CASES]

    np.testing.assert_allclose(to_decibels(snr), needed_db, atol=5e-4)


@pytest.mark.parametrize("swerling", nightly_except(5, CASES))
@pytest.mark.parametrize("n_summed", nightly_except((1, 3, 100), [1, 3, 100, 10_000]))
def test_exceedance_matches_mixture_from_minus_30_to_40_db(n_summed, swerling):
    for pfa in (1e-12, 1e-4, 0.5):
        threshold = detection_threshold(pfa, n_summed=n_summed)
        for snr in from_decibels([-30.0, -17.0, -10.0, 0.0, 13.0, 40.0]):
            exact, miss_probability = sum_mixture(
                snr, threshold, n_summed=n_summed, swerling=swerling
            )

            probability = float(
                exceedance_probability(snr, threshold, n_summed=n_summed, swerling=swerling)
            )

            # Largest error 3e-14, as for the incomplete gamma function of noise alone.
            assert probability == pytest.approx(exact, rel=1e-12)
            assert 1 - probability == pytest.approx(miss_probability, abs=1e-15, rel=1e-12)


@pytest.mark.parametrize("n_summed", [1, 4, 50])
def test_steady_target_follows_marcum_q_function(n_summed):
    snr = from_decibels(np.array([-10.0, 0.0, 6.0]))
    threshold = detection_threshold(1e-3, n_summed=n_summed)

    probability = exceedance_probability(snr, threshold, n_summed=n_summed)

    # Q_K(sqrt(2 K chi), sqrt(2 T)), as the tail of noncentral chi-square.
    marcum = ncx2.sf(2 * threshold, 2 * n_summed, 2 * n_summed * snr)
    np.testing.assert_allclose(probability, marcum, rtol=1e-9)


@pytest.mark.parametrize("swerling", CASES)
def test_probability_below_1e_140_keeps_its_digits(swerling):
    # 400 times the noise: 1e-144 for a weak target of case 1, less for the others.
    exact = sum_mixture_by_terms(0.1, 400.0, swerling=swerling)

    probability = float(exceedance_probability(0.1, 400.0, n_summed=2, swerling=swerling))

    assert 0 < probability < 1e-140
    assert probability == pytest.approx(exact, rel=1e-12)


def test_only_strong_targets_exceed_threshold_far_above_noise():
    threshold = 1e4
    snr = threshold * np.array([0.03, 0.1, 1.0, 10.0, 1000.0])

    probability = exceedance_probability(snr, threshold, swerling=1)

    # The logarithm has an error of about T times 1e-16.
    np.testing.assert_allclose(probability, np.exp(-threshold / (1 + snr)), rtol=1e-11)


def sum_mixture_by_terms(snr, threshold, *, swerling):
    """Sum the mixture for two powers term by term; terms fall below 1e-250 by j = 2000."""
    with mpmath.workdps(40):
        mean, shape, t = 2 * mpmath.mpf(snr), (None, 1, 2, 2, 4)[swerling], mpmath.mpf(threshold)
        weight = mpmath.exp(-mean) if swerling == 0 else (shape / (shape + mean)) ** shape
        tail, step, total = (1 + t) * mpmath.exp(-t), t**2 / 2 * mpmath.exp(-t), mpmath.mpf(0)
        for j in range(1, 2000):
            total += weight * tail
            tail += step
            step *= t / (j + 2)
            growth = mean if swerling == 0 else (shape + j - 1) * mean / (shape + mean)
            weight *= growth / j
        return float(total)


@pytest.mark.parametrize("pfa", [1e-12, 1e-6, 1e-2])
def test_rayleigh_target_probability_is_root_of_false_alarm_probability(pfa):
    snr = from_decibels([-30.0, 0.0, 20.0, 40.0])

    for swerling in (1, 2):
        probability = detection_probability(snr, pfa, swerling=swerling)
        np.testing.assert_allclose(probability, pfa ** (1 / (1 + snr)), rtol=1e-13)


@pytest.mark.parametrize("n_summed", [2, 10, 1000, 10_000])
def test_swerling_1_and_2_follow_closed_forms(n_summed):
    k, pfa = n_summed, 1e-6
    t = detection_threshold(pfa, n_summed=k)
    snr = from_decibels([-20.0, -10.0, 0.0, 10.0, 40.0])

    # Case 1, in logarithms: the power of K - 1 overflows for weak targets.
    ratio = 1 + 1 / (k * snr)
    log_share = (k - 1) * np.log(ratio) + np.log(gammainc(k - 1, t / ratio)) - t / (1 + k * snr)
    case_1 = gammaincc(k - 1, t) + np.exp(log_share)
    probability = detection_probability(snr, pfa, n_summed=k, swerling=1)
    # The closed form itself loses K times 1e-16.
    np.testing.assert_allclose(probability, case_1, rtol=1e-10)

    # Case 2: noise of a larger power.
    probability = detection_probability(snr, pfa, n_summed=k, swerling=2)
    np.testing.assert_allclose(probability, gammaincc(k, t / (1 + snr)), rtol=1e-11)


@pytest.mark.parametrize("n_summed", [1, 2])
def test_swerling_3_follows_closed_form(n_summed):
    k, t = n_summed, detection_threshold(1e-6, n_summed=n_summed)
    snr = from_decibels([-3.0, 10.0, 25.0])
    half = k * snr / 2

    exact = (1 + 1 / half) ** (k - 2) * (1 + t / (1 + half) - (k - 2) / half)
    exact *= np.exp(-t / (1 + half))

    probability = detection_probability(snr, 1e-6, n_summed=k, swerling=3)
    np.testing.assert_allclose(probability, exact, rtol=1e-12)


def test_slow_and_fast_fluctuation_agree_for_one_power():
    snr = from_decibels(np.arange(-30.0, 41.0, 10.0))

    for slow_case, fast_case in ((1, 2), (3, 4)):
        np.testing.assert_array_equal(
            detection_probability(snr, 1e-6, swerling=slow_case),
            detection_probability(snr, 1e-6, swerling=fast_case),
        )


@pytest.mark.parametrize("swerling", CASES)
@pytest.mark.parametrize("n_summed", [1, 8])
def test_simulated_detection_rate_matches_theory(n_summed, swerling):
    rng = np.random.default_rng(1_954 + swerling)
    n_trials, pfa = 100_000, 1e-2
    snr = required_snr(0.6, pfa, n_summed=n_summed, swerling=swerling)
    # Power of many equal scatterers: exponential; of one dominant among many: gamma of shape 2.
    power_shape = (n_trials, 1) if swerling in (1, 3) else (n_trials, n_summed)
    shape = 1.0 if swerling in (1, 2) else 2.0
    power = rng.gamma(shape, 1 / shape, power_shape) if swerling else np.ones(power_shape)
    parts = rng.normal(scale=math.sqrt(0.5), size=(n_trials, n_summed, 2))
    noise = parts[..., 0] + 1j * parts[..., 1]

    power_sums = np.sum(np.abs(np.sqrt(snr * power) + noise) ** 2, axis=1)
    hits = np.count_nonzero(power_sums > detection_threshold(pfa, n_summed=n_summed))

    # Tolerance of 5.5 standard errors: ten such draws fail once in 3 million.
    assert hits / n_trials == pytest.approx(0.6, abs=5.5 * math.sqrt(0.24 / n_trials))


power_counts = st.integers(0, 400).map(lambda k: round(10 ** (k / 100)))
false_alarms = st.floats(-12, -1).map(lambda lg: 10**lg)
ratios_db = st.floats(-30, 40)
cases = st.sampled_from(CASES)
# Relative error of a comparison of two probabilities, each accurate to 1e-12.
ROUNDING = 2e-12


@settings(max_examples=300)
@given(n_summed=power_counts, pfa=false_alarms, snr_db=ratios_db, swerling=cases)
def test_detection_probability_is_at_least_false_alarm_probability(n_summed, pfa, snr_db, swerling):
    probability = detection_probability(
        from_decibels(snr_db), pfa, n_summed=n_summed, swerling=swerling
    )

    assert pfa * (1 - ROUNDING) <= probability <= 1


@settings(max_examples=200)
@given(n_summed=power_counts, pfa=false_alarms, start_db=ratios_db, swerling=cases)
def test_detection_probability_rises_with_snr(n_summed, pfa, start_db, swerling):
    snr = from_decibels(start_db + np.array([-1.0, -0.1, 0.0, 1e-6, 0.1, 1.0]))

    probability = detection_probability(snr, pfa, n_summed=n_summed, swerling=swerling)

    assert np.all(probability[1:] >= probability[:-1] * (1 - ROUNDING))


@settings(max_examples=200)
@given(n_summed=power_counts, pfa=false_alarms, snr_db=ratios_db, swerling=cases)
def test_lower_threshold_raises_detection_probability(n_summed, pfa, snr_db, swerling):
    low, high = (
        float(
            detection_probability(from_decibels(snr_db), rate, n_summed=n_summed, swerling=swerling)
        )
        for rate in (pfa, 1.1 * pfa)
    )

    assert high >= low * (1 - ROUNDING)


@settings(max_examples=100)
@given(
    n_summed=power_counts,
    pfa=false_alarms,
    pd=st.floats(0.11, 0.999999),
    swerling=cases,
)
def test_required_snr_gives_requested_probability(n_summed, pfa, pd, swerling):
    snr = required_snr(pd, pfa, n_summed=n_summed, swerling=swerling)

    probability = detection_probability(snr, pfa, n_summed=n_summed, swerling=swerling)

    assert probability == pytest.approx(pd, rel=1e-11)
    assert 1 - probability == pytest.approx(1 - pd, rel=1e-8)


@pytest.mark.parametrize("swerling", CASES)
@pytest.mark.parametrize("n_summed", [1, 10_000])
def test_required_snr_exists_at_limits_of_floats(n_summed, swerling):
    for pfa in (1e-12, 0.5):
        for pd in (np.nextafter(pfa, 1), np.nextafter(1, 0)):
            snr = required_snr(pd, pfa, n_summed=n_summed, swerling=swerling)

            probability = float(
                detection_probability(snr, pfa, n_summed=n_summed, swerling=swerling)
            )

            assert snr > 0
            assert probability == pytest.approx(pd, rel=1e-12)


@pytest.mark.parametrize("swerling", CASES)
@pytest.mark.parametrize("n_summed", [1, 10_000])
def test_extreme_false_alarm_probabilities_have_thresholds(n_summed, swerling):
    law = {"n_summed": n_summed, "swerling": swerling}
    for pfa in (1e-300, 1 - 1e-9):
        # Noise alone has about 690 rounding errors here, the logarithm of 1e-300.
        noise = float(detection_probability(0.0, pfa, **law))
        assert noise == pytest.approx(pfa, rel=1e-11)
        for pd in (2e-300, 0.9, 1 - 1e-10):
            if pd > pfa:
                snr = required_snr(pd, pfa, **law)
                probability = float(detection_probability(snr, pfa, **law))
                assert probability == pytest.approx(pd, rel=1e-9)


@pytest.mark.parametrize("swerling", CASES)
@pytest.mark.parametrize("n_summed", [1, 30, 10_000])
def test_target_without_power_is_detected_at_false_alarm_rate(n_summed, swerling):
    for pfa in (1e-12, 1e-6, 0.5):
        probability = detection_probability(0.0, pfa, n_summed=n_summed, swerling=swerling)
        assert probability == pytest.approx(pfa, rel=1e-12)


def test_detection_probability_has_shape_of_snr():
    assert detection_probability(np.ones((2, 3, 1)), 1e-6, swerling=1).shape == (2, 3, 1)
    assert detection_probability(1.0, 1e-6).shape == ()
    assert coherent_detection_probability(np.ones((2, 3)), 1e-6).shape == (2, 3)


def test_known_phase_needs_12_6_db_and_less_than_unknown_phase():
    assert to_decibels(coherent_required_snr(0.9, 1e-6)) == pytest.approx(12.60, abs=0.005)
    for pd in (0.01, 0.5, 0.9, 0.999):
        snr = coherent_required_snr(pd, 1e-6)
        assert float(coherent_detection_probability(snr, 1e-6)) == pytest.approx(pd, rel=1e-12)
        assert snr < required_snr(pd, 1e-6)
    assert float(coherent_detection_probability(0.0, 1e-12)) == pytest.approx(1e-12, rel=1e-12)


def test_albersheim_and_shnidman_give_published_snr():
    assert to_decibels(albersheim(0.9, 1e-6)) == pytest.approx(13.114, abs=6e-4)
    assert to_decibels(shnidman(0.9, 1e-6)) == pytest.approx(13.12, abs=0.005)
    assert to_decibels(shnidman(0.9, 1e-6, swerling=1)) == pytest.approx(21.35, abs=0.005)


@pytest.mark.parametrize(
    ("pds", "error_range_db"),
    [((0.3, 0.5, 0.7, 0.9), (-0.34, 0.34)), ((0.2,), (-0.9, 0.05)), ((0.1,), (-4.1, 0.0))],
)
def test_albersheim_error_is_within_stated_range(pds, error_range_db):
    errors_db = [
        to_decibels(albersheim(pd, pfa, n_summed=n) / required_snr(pd, pfa, n_summed=n))
        for pd in pds
        for pfa in (1e-7, 1e-5, 1e-3)
        for n in (1, 5, 100, 8096)
    ]

    assert error_range_db[0] <= min(errors_db)
    assert max(errors_db) <= error_range_db[1]


@pytest.mark.parametrize(
    ("swerling", "max_error_db"), [(0, 0.3), (1, 1.2), (2, 1.2), (3, 0.9), (4, 0.6)]
)
def test_shnidman_error_is_within_stated_limit(swerling, max_error_db):
    for pd in (0.1, 0.5, 0.77, 0.87, 0.88, 0.97, 0.99):
        for pfa in (1e-9, 1e-6, 1e-3):
            for n in (1, 2, 39, 40, 100):
                approximate_snr = shnidman(pd, pfa, n_summed=n, swerling=swerling)
                exact_snr = required_snr(pd, pfa, n_summed=n, swerling=swerling)
                assert to_decibels(approximate_snr / exact_snr) == pytest.approx(
                    0.0, abs=max_error_db
                )


def test_m_of_n_matches_binomial_sum():
    for p in (1e-9, 0.1, 0.9):
        for n in (1, 4, 20):
            for m in range(1, n + 1):
                total = math.fsum(
                    math.comb(n, k) * p**k * (1 - p) ** (n - k) for k in range(m, n + 1)
                )
                assert float(binary_integration_probability(p, m=m, n=n)) == pytest.approx(
                    total, rel=1e-12
                )


def test_m_of_n_reduces_to_any_and_all_trials():
    p = np.array([[0.0, 0.2, 1.0]])

    np.testing.assert_allclose(
        binary_integration_probability(p, m=1, n=3), 1 - (1 - p) ** 3, rtol=1e-14
    )
    np.testing.assert_allclose(binary_integration_probability(p, m=3, n=3), p**3, rtol=1e-14)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: detection_threshold(0.0), "false_alarm_probability"),
        (lambda: detection_threshold(1e-6, n_summed=0), "n_summed"),
        (lambda: detection_probability(-10.0, 1e-6), "not dB"),
        (lambda: detection_probability([1.0, math.nan], 1e-6), "nan"),
        (lambda: detection_probability(math.inf, 1e-6), "finite"),
        (lambda: detection_probability(1.0, 1e-6, n_summed=2.5), "n_summed"),
        (lambda: detection_probability(1.0, 1e-6, swerling=5), "swerling"),
        (lambda: detection_probability([1.0], 1e-6, swerling=-1), "swerling"),
        (lambda: exceedance_probability(1.0, 0.0), "threshold"),
        (lambda: exceedance_probability(1.0, math.inf), "threshold"),
        (lambda: exceedance_probability(1.0, "13"), "threshold: '13'"),
        (lambda: exceedance_probability(1.0, [13.0, -1.0]), "threshold"),
        (lambda: exceedance_probability(1.0, None), "threshold"),
        (lambda: detection_probability("13", 1e-6), "snr: '13'"),
        (lambda: detection_probability([1j], 1e-6), "a real number"),
        (lambda: detection_probability([[1.0], [1.0, 2.0]], 1e-6), "rows of equal length"),
        (lambda: detection_probability(None, 1e-6), "a real number"),
        (lambda: detection_threshold(1e-310), "from 1e-300"),
        (lambda: detection_probability(1.0, np.nextafter(1, 0)), "to 1 - 1e-9"),
        (lambda: albersheim(0.9, 1e-310), "from 1e-300"),
        (lambda: binary_integration_probability("0.5", m=1, n=2), "a real number"),
        (lambda: required_snr(1e-6, 1e-6, swerling=1), "above the false-alarm probability"),
        (lambda: required_snr(1.0, 1e-6), "detection_probability"),
        (lambda: required_snr(0.9, 1e-6, n_summed=0), "n_summed"),
        (lambda: required_snr(0.9, 1e-6, swerling=1.0), "swerling"),
        (lambda: coherent_detection_probability(-1.0, 1e-6), "not dB"),
        (lambda: coherent_required_snr(1e-7, 1e-6), "above the false-alarm probability"),
        (lambda: albersheim(0.9, 1.0), "false_alarm_probability"),
        (lambda: albersheim(0.01, 1e-3), "exact"),
        (lambda: albersheim(0.9, 1e-6, n_summed=0), "n_summed"),
        (lambda: shnidman(1e-7, 1e-6), "false-alarm probability"),
        (lambda: shnidman(0.9, 1e-6, swerling=7), "swerling"),
        (lambda: detection_threshold("1e-6"), "false_alarm_probability: '1e-6'; expected between"),
        (lambda: detection_threshold(np.array([1e-6, 4.0])), "false_alarm_probability"),
        (lambda: detection_threshold(True), "false_alarm_probability"),
        (lambda: detection_probability([1.0, 2.0], [1e-6] * 3), "false_alarm_probability"),
        (lambda: detection_probability(1.0, None), "false_alarm_probability"),
        (lambda: detection_probability(1.0, math.nan), "false_alarm_probability"),
        (lambda: required_snr(np.array([0.5, 1.0]), 1e-6), "detection_probability"),
        (lambda: required_snr("0.9", 1e-6), "detection_probability"),
        (lambda: coherent_required_snr(0.9, "1e-6"), "false_alarm_probability"),
        (lambda: albersheim(0.9, np.array([1e-6, 2.0])), "false_alarm_probability"),
        (lambda: cell_averaging_factor("1e-6", n_training=16), "false_alarm_probability"),
        (lambda: greatest_of_factor([1e-6, 0.0], n_training=16), "false_alarm_probability"),
        (lambda: binary_integration_probability(1.1, m=1, n=2), "from 0 to 1"),
        (lambda: binary_integration_probability(0.5, m=3, n=2), "from 1 to 2"),
        (lambda: binary_integration_probability(0.5, m=0, n=2), "from 1 to 2"),
    ],
)
def test_rejects_invalid_arguments(call, message):
    with pytest.raises(InvalidSetting, match=message):
        call()


def test_computed_probability_is_accepted_as_setting():
    probability = detection_probability(from_decibels(13.0), np.float64(1e-6))  # zero-dimensional
    assert required_snr(probability, 1e-6) == pytest.approx(from_decibels(13.0), rel=1e-9)
