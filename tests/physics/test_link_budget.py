"""Link budget: powers, noise, detection probability and Cramer-Rao bounds.

Reference scenario: 77 GHz, 150 MHz in 7.3333 us, 300 MS/s complex, 2200 samples, 128
chirps back to back.
"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest

from dechirp import link_budget
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels, to_decibels
from dechirp.radar.budget import noise_power_w, received_power_w, sample_snr
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar
from dechirp.theory.bounds import crlb_range, crlb_velocity, decoupled_range_std_m
from dechirp.theory.detection import detection_probability, detection_threshold, required_snr
from radars import REFERENCE_FRAME

FRAME, CHIRP = REFERENCE_FRAME, REFERENCE_FRAME.chirp
# 10 mW, 10 dBi, noise figure 12 dB, 3 dB of loss.
HARDWARE = Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10**1.2, loss=2.0)
RADAR = Radar(frame=FRAME, hardware=HARDWARE)


def test_received_power_matches_radar_equation():
    # Calculation by hand: 0.01 W x 10^2 x (3.8896 mm)^2 x 10 m2 / (1984.4 x (50 m)^4 x 2).
    assert received_power_w(RADAR, range_m=50.0, rcs_m2=10.0) == pytest.approx(6.0992e-15, rel=1e-4)


def test_doubling_range_costs_12_db():
    near, far = received_power_w(RADAR, range_m=[10.0, 20.0], rcs_m2=1.0)

    assert to_decibels(near / far) == pytest.approx(12.04, abs=0.01)


def test_noise_power_is_minus_174_dbm_per_hz_times_noise_factor_and_rate():
    noise_dbm = to_decibels(noise_power_w(RADAR)) + 30

    # kT0 = -173.975 dBm/Hz, 300 MHz = 84.771 dB Hz, 12 dB of noise figure.
    assert noise_dbm == pytest.approx(-173.975 + 84.771 + 12.0, abs=0.001)


def test_sample_snr_is_ratio_of_received_to_noise_power():
    ratio = sample_snr(RADAR, range_m=50.0, rcs_m2=10.0)

    assert ratio * noise_power_w(RADAR) == pytest.approx(
        received_power_w(RADAR, range_m=50.0, rcs_m2=10.0)
    )


def test_reference_frame_has_integration_gain_of_54_5_db():
    assert to_decibels(RADAR.integration_gain) == pytest.approx(54.496, abs=0.001)


def test_rejects_radar_without_hardware():
    with pytest.raises(InvalidSetting, match="transmit_power"):
        received_power_w(Radar(frame=FRAME), range_m=50.0, rcs_m2=1.0)


@pytest.mark.parametrize("range_m", [0.0, -1.0, float("nan")])
def test_rejects_range_that_is_not_positive(range_m):
    with pytest.raises(InvalidSetting, match="range_m"):
        received_power_w(RADAR, range_m=range_m, rcs_m2=1.0)


@pytest.mark.parametrize("name", ["noise_factor", "loss"])
def test_passive_parts_have_ratios_of_at_least_1(name):
    link = {"transmit_power_w": 0.01, "frequency_hz": 77e9, "noise_factor": 1, "loss": 1}
    link |= {"range_m": 50, "rcs_m2": 10, "sample_rate_hz": 1e6}
    assert link_budget.sample_snr(**link) > 0

    with pytest.raises(InvalidSetting, match=f"^{name}: 0.5; .* 1 or more, .* not dB$"):
        link_budget.sample_snr(**link | {name: 0.5})


def test_range_that_is_not_a_number_is_named_with_its_bound():
    with pytest.raises(InvalidSetting, match="^range_m: nan; expected finite and at least 0; "):
        link_budget.beat_frequency(np.nan, slope_hz_per_s=1e12)


def test_noise_exceeds_threshold_with_false_alarm_probability():
    assert detection_threshold(1e-6) == pytest.approx(13.8155, abs=1e-4)
    assert detection_probability(0.0, 1e-6) == pytest.approx(1e-6, rel=1e-9)


def test_pd_0_9_at_pfa_1e_6_requires_13_2_db():
    assert to_decibels(required_snr(0.9, 1e-6)) == pytest.approx(13.183, abs=0.0005)


@pytest.mark.parametrize("false_alarm_probability", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("snr_db", [-10.0, 3.0, 13.0, 17.0])
def test_detection_probability_matches_marcum_series(snr_db, false_alarm_probability):
    # Poisson mixture of incomplete gammas, 200 terms: the last ones are below 1e-40.
    chi, limit = mpmath.mpf(10) ** (snr_db / 10), -mpmath.log(false_alarm_probability)
    series = mpmath.fsum(
        mpmath.exp(-chi)
        * chi**j
        / mpmath.factorial(j)
        * mpmath.gammainc(j + 1, limit, regularized=1)
        for j in range(200)
    )

    probability = detection_probability(from_decibels(snr_db), false_alarm_probability)

    assert float(probability) == pytest.approx(float(series), abs=1e-14)


@pytest.mark.parametrize("probability", [0.01, 0.5, 0.9, 0.999])
def test_required_snr_gives_requested_probability(probability):
    assert detection_probability(required_snr(probability, 1e-6), 1e-6) == pytest.approx(
        probability, rel=1e-9
    )


def test_reference_target_at_minus_41_3_db_has_pd_0_9():
    sample_snr_db = to_decibels(required_snr(0.9, 1e-6) / RADAR.integration_gain)

    assert sample_snr_db == pytest.approx(-41.31, abs=0.005)


@pytest.mark.parametrize(
    ("pd", "pfa"), [(1e-7, 1e-6), (1.0, 1e-6), (0.9, 0.0), (0.9, float("nan"))]
)
def test_rejects_probabilities_that_no_snr_reaches(pd, pfa):
    with pytest.raises(InvalidSetting, match="probability"):
        required_snr(pd, pfa)


def test_rejects_snr_in_decibels():
    with pytest.raises(InvalidSetting, match="not dB"):
        detection_probability(-10.0, 1e-6)


# SNR per sample in dB, and the bounds on range and velocity: published to three digits,
# the first of them to two.
BOUNDS = [(-38.0, 0.058, 0.121), (-24.0, 0.0116, 0.0241), (-10.0, 2.32e-3, 4.82e-3)]
BOUNDS.append((0.0, 0.734e-3, 1.52e-3))


@pytest.mark.parametrize(("sample_snr_db", "expected_range_std_m", "expected_velocity_std"), BOUNDS)
def test_bounds_match_published_reference_scenario(
    sample_snr_db, expected_range_std_m, expected_velocity_std
):
    integrated_snr = from_decibels(sample_snr_db) * RADAR.integration_gain

    range_m = crlb_range(
        snr=integrated_snr,
        n_samples=CHIRP.n_samples,
        sample_rate_hz=CHIRP.sample_rate_hz,
        slope_hz_per_s=CHIRP.slope_hz_per_s,
    )
    velocity = crlb_velocity(
        snr=integrated_snr,
        n_chirps=FRAME.n_chirps,
        interval_s=FRAME.interval_s,
        wavelength_m=CHIRP.wavelength_m,
    )

    assert range_m == pytest.approx(expected_range_std_m, rel=0.01)
    assert velocity == pytest.approx(expected_velocity_std, rel=0.005)


def test_bounds_in_bins_match_asymptotic_tone_bound():
    # sigma = bin sqrt(6) / (2 pi sqrt(snr)) for many points; deviation 1 / 2 N^2 = 3e-5 for 128.
    bound_in_bins = np.sqrt(6) / (2 * np.pi * 10)

    range_m = crlb_range(
        snr=100.0,
        n_samples=CHIRP.n_samples,
        sample_rate_hz=CHIRP.sample_rate_hz,
        slope_hz_per_s=CHIRP.slope_hz_per_s,
    )
    velocity = crlb_velocity(
        snr=100.0,
        n_chirps=FRAME.n_chirps,
        interval_s=FRAME.interval_s,
        wavelength_m=CHIRP.wavelength_m,
    )

    assert range_m / CHIRP.range_resolution_m == pytest.approx(bound_in_bins, rel=1e-6)
    assert velocity / FRAME.velocity_resolution_m_per_s == pytest.approx(bound_in_bins, rel=1e-4)


def test_range_doppler_decoupling_adds_0_09_mm_at_minus_24_db():
    coupling_std_m = decoupled_range_std_m(
        range_std_m=0.0,
        velocity_std_m_per_s=0.0241,
        mid_window_frequency_hz=CHIRP.mid_window_frequency_hz,
        slope_hz_per_s=CHIRP.slope_hz_per_s,
    )

    assert coupling_std_m == pytest.approx(0.09e-3, rel=0.01)
    total_std_m = decoupled_range_std_m(
        range_std_m=0.0116,
        velocity_std_m_per_s=0.0241,
        mid_window_frequency_hz=CHIRP.mid_window_frequency_hz,
        slope_hz_per_s=CHIRP.slope_hz_per_s,
    )
    assert total_std_m == pytest.approx(np.sqrt(0.0116**2 + coupling_std_m**2))


def test_real_samples_double_range_variance_at_equal_snr_per_sample():
    real_radar = Radar(frame=replace(FRAME, chirp=replace(CHIRP, sampling="real")))

    complex_std_m, real_std_m = (
        crlb_range(
            snr=0.01 * radar.integration_gain,
            n_samples=CHIRP.n_samples,
            sample_rate_hz=CHIRP.sample_rate_hz,
            slope_hz_per_s=CHIRP.slope_hz_per_s,
        )
        for radar in (RADAR, real_radar)
    )

    assert (real_std_m / complex_std_m) ** 2 == pytest.approx(2.0)


@pytest.mark.parametrize("n_summed", [1, 2, 8])
def test_detection_probability_of_summed_receivers_matches_marcum(n_summed):
    # Poisson mixture of gamma tails, term by term, in forty digits.
    with mpmath.workdps(40):
        snr, pfa = mpmath.mpf(10) ** mpmath.mpf("0.7"), mpmath.mpf("1e-6")
        start = mpmath.mpf(detection_threshold(1e-6, n_summed=n_summed))
        t = mpmath.findroot(lambda x: mpmath.gammainc(n_summed, x, regularized=True) - pfa, start)
        mean = n_summed * snr
        exact = mpmath.nsum(
            lambda j: mpmath.exp(-mean) * mean**j / mpmath.factorial(j)
            * mpmath.gammainc(n_summed + j, t, regularized=True),
            [0, 200],
        )  # fmt: skip
    probability = float(detection_probability(float(snr), 1e-6, n_summed=n_summed))
    assert probability == pytest.approx(float(exact), rel=1e-9)
    snr_required = required_snr(probability, 1e-6, n_summed=n_summed)
    assert snr_required == pytest.approx(float(snr), rel=1e-6)
    # PHYSICS: ten summed receivers need 5.267 dB each for 0.9 at 1e-6.
    assert to_decibels(required_snr(0.9, 1e-6, n_summed=10)) == pytest.approx(5.267, abs=5e-4)
