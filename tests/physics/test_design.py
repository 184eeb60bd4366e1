"""Radar design from requirements: derived values, limits, findings and rejected requirements.

The reference report requires 200 m, 1 m and 100 m/s at 77 GHz.
"""

import re
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import to_decibels
from dechirp.radar.budget import sample_snr
from dechirp.radar.design.design import TYPICAL_HARDWARE, design
from dechirp.radar.design.requirements import BANDS_HZ, Limits, Requirements
from nightly import n_examples, nightly, nightly_except

REPORT_REQUIREMENTS = Requirements(
    max_range_m=200.0, range_resolution_m=1.0, max_velocity_m_per_s=100.0
)
EXTREME_REQUIREMENTS = Requirements(
    max_range_m=300.0, range_resolution_m=0.04, max_velocity_m_per_s=100.0
)
RULES = ["round-trips", "constraints"]


def derived_values(result):
    return {number.name: number.value for number in result.derived}


def test_round_trips_rule_reproduces_report_with_exact_speed_of_light():
    result = design(REPORT_REQUIREMENTS)
    chirp = result.radar.frame.chirp

    assert result.is_met
    assert result.findings == ()
    assert chirp.sampled_bandwidth_hz == pytest.approx(149.896229e6)
    assert derived_values(result)["round_trip"] == pytest.approx(1.334e-6, abs=5e-10)
    assert chirp.ramp_duration_s == pytest.approx(7.338e-6, abs=5e-10)
    assert chirp.n_samples == 2200
    assert chirp.range_resolution_m == pytest.approx(1.0, rel=1e-12)


def test_round_trips_rule_reproduces_report_with_rounded_speed_of_light():
    values = derived_values(design(REPORT_REQUIREMENTS, speed_of_light_m_per_s=3e8))

    assert values["bandwidth"] == pytest.approx(150e6)
    assert values["round_trip"] == pytest.approx(1.3333e-6, rel=1e-4)
    assert values["chirp_duration"] == pytest.approx(7.3333e-6, rel=1e-5)
    assert values["slope"] == pytest.approx(2.0455e13, rel=1e-4)
    assert values["max_beat_frequency"] == pytest.approx(27.27e6, abs=5e3)
    assert values["max_doppler_frequency"] == pytest.approx(51.3e3, abs=50)
    assert values["sample_rate"] == pytest.approx(300e6)
    assert values["n_samples"] == 2200
    assert values["n_chirps"] == 128


def test_accepts_requirements_as_keywords():
    result = design(max_range_m=200, range_resolution_m=1, max_velocity_m_per_s=100)

    assert result == design(REPORT_REQUIREMENTS)


@pytest.mark.parametrize("rule", RULES)
def test_every_derived_value_has_formula_and_unit(rule):
    result = design(replace(REPORT_REQUIREMENTS, rcs_m2=10.0), rule=rule)

    assert all(number.formula and number.unit for number in result.derived)
    assert len(derived_values(result)) == len(result.derived)


def test_fractional_sample_count_is_rounded_up_at_same_resolution():
    chirp = design(replace(REPORT_REQUIREMENTS, max_range_m=200.3)).radar.frame.chirp

    assert chirp.n_samples == 2204  # 11 x 200.3 = 2203.3
    assert chirp.range_resolution_m == pytest.approx(1.0, rel=1e-12)
    assert chirp.ramp_duration_s == pytest.approx(2204 / chirp.sample_rate_hz)


@pytest.mark.parametrize("rule", RULES)
def test_velocity_resolution_sets_number_of_chirps(rule):
    frame = design(
        replace(REPORT_REQUIREMENTS, velocity_resolution_m_per_s=0.5), rule=rule
    ).radar.frame

    assert frame.velocity_resolution_m_per_s <= 0.5 * (1 + 1e-9)
    assert replace(frame, n_chirps=frame.n_chirps - 1).velocity_resolution_m_per_s > 0.5


def test_constraints_rule_sums_interval_of_idle_echo_samples_and_margin():
    limits = Limits()
    frame = design(REPORT_REQUIREMENTS, rule="constraints").radar.frame
    chirp = frame.chirp

    assert chirp.adc_start_s == pytest.approx(400 / 299_792_458.0 + limits.settling_s)
    assert frame.interval_s == pytest.approx(
        limits.idle_s + chirp.adc_start_s + chirp.sampled_duration_s + limits.ramp_end_margin_s
    )
    # The interval is the longest that allows 100 m/s: a slower ramp aliases it.
    assert frame.max_velocity_m_per_s == pytest.approx(100.0, rel=1e-8)
    assert frame.max_velocity_m_per_s >= 100.0


def test_constraints_rule_needs_a_seventh_of_report_sample_rate():
    result = design(REPORT_REQUIREMENTS, rule="constraints")

    assert result.is_met
    # Doppler takes half a bin, and 0.9 of the band is usable: (200 + 0.5) / 0.9 = 222.8.
    assert result.radar.frame.chirp.n_samples == 223
    assert result.radar.frame.chirp.sample_rate_hz == pytest.approx(43.04e6, rel=1e-3)


def test_real_sampling_doubles_sample_rate():
    by_complex = design(REPORT_REQUIREMENTS, rule="constraints").radar.frame.chirp
    by_real = design(
        replace(REPORT_REQUIREMENTS, sampling="real"), rule="constraints"
    ).radar.frame.chirp

    # Sample counts are rounded up, from 222.8 and from 445.6.
    assert by_real.n_samples == 446
    assert by_real.sample_rate_hz / by_complex.sample_rate_hz == pytest.approx(2.0, rel=0.01)
    assert by_real.max_range_m == pytest.approx(by_complex.max_range_m, rel=0.01)


random_requirements = st.builds(
    Requirements,
    max_range_m=st.floats(5.0, 1000.0),
    range_resolution_m=st.floats(0.02, 5.0),
    max_velocity_m_per_s=st.floats(0.5, 150.0),
    velocity_resolution_m_per_s=st.none() | st.floats(0.05, 5.0),
    carrier_hz=st.floats(60e9, 81e9),
    sampling=st.sampled_from(["complex", "real"]),
    band=st.sampled_from([None, *BANDS_HZ]),
    rcs_m2=st.none() | st.floats(0.1, 100.0),
)


@settings(deadline=None, max_examples=n_examples(400))
@given(requirements=random_requirements, rule=st.sampled_from(RULES))
def test_radar_meets_requirements_without_finding(requirements, rule):
    result = design(requirements, rule=rule)
    frame, chirp = result.radar.frame, result.radar.frame.chirp
    missed_settings = {finding.setting.removeprefix("requirements.") for finding in result.findings}
    lower_tolerance, upper_tolerance = 1 - 1e-9, 1 + 1e-9  # rounding

    assert result.is_met == (not missed_settings)
    if "range_resolution" not in missed_settings:
        assert chirp.range_resolution_m <= requirements.range_resolution_m * upper_tolerance
    if "max_velocity" not in missed_settings:
        assert frame.max_velocity_m_per_s >= requirements.max_velocity_m_per_s * lower_tolerance
    if "max_range" not in missed_settings:
        # The fastest unambiguous target does not alias in range either.
        max_velocity = min(requirements.max_velocity_m_per_s, frame.max_velocity_m_per_s)
        max_range_m = requirements.max_range_m + chirp.range_doppler_coupling_m(max_velocity)
        assert chirp.max_range_m >= max_range_m * lower_tolerance
        if requirements.rcs_m2 is not None:
            single_sample_snr = sample_snr(
                result.radar, range_m=requirements.max_range_m, rcs_m2=requirements.rcs_m2
            )
            windowed_snr = single_sample_snr * result.radar.integration_gain / 1.5**2
            assert to_decibels(windowed_snr) >= 13.183
    if "velocity_resolution" not in missed_settings and requirements.velocity_resolution_m_per_s:
        resolution = requirements.velocity_resolution_m_per_s
        assert frame.velocity_resolution_m_per_s <= resolution * upper_tolerance
    if requirements.band is not None:
        low_hz, high_hz = BANDS_HZ[requirements.band]
        assert low_hz <= chirp.start_frequency_hz
        assert chirp.start_frequency_hz + chirp.ramp_bandwidth_hz <= high_hz * upper_tolerance


@nightly
@settings(deadline=None, max_examples=50)
@given(requirements=random_requirements)
def test_constraints_rule_keeps_limits_for_any_requirements(requirements):
    limits = Limits()
    values = derived_values(result := design(requirements, rule="constraints"))
    chirp = result.radar.frame.chirp

    assert chirp.slope_hz_per_s <= limits.max_slope_hz_per_s
    rate_hz = chirp.sample_rate_hz / (2 if chirp.sampling == "real" else 1)
    assert rate_hz <= limits.max_sample_rate_hz
    assert values["data_rate"] <= limits.max_data_rate_bits_per_s
    assert values["cube_memory"] <= limits.max_cube_bytes
    assert values["mean_eirp"] <= limits.max_mean_eirp_w


def test_300_m_at_4_cm_and_100_m_per_s_exceeds_every_part_limit():
    result = design(EXTREME_REQUIREMENTS, rule="constraints")

    assert not result.is_met
    text = " ".join(map(str, result.findings))
    for limit in ("max_slope", "max_sample_rate", "max_data_rate", "max_cube"):
        assert f"limits.{limit}" in text
    # The resolution offered by the finding leads to the same radar.
    offered_resolution_m = float(
        re.search(r"range_resolution of at least (\S+) m", result.findings[0].fix)[1]
    )
    feasible = design(
        replace(EXTREME_REQUIREMENTS, range_resolution_m=offered_resolution_m), rule="constraints"
    )
    assert feasible.is_met
    assert feasible.radar == result.radar


def test_every_fix_in_finding_is_feasible():
    result = design(replace(REPORT_REQUIREMENTS, max_velocity_m_per_s=140.0), rule="constraints")

    offers = re.findall(
        r"a (\w+) of at (?:least|most) (\d\S*)"
        r" (m\S*?)(?:,|$)",
        result.findings[0].fix,
    )
    assert {name for name, _, _ in offers} == {"max_velocity", "range_resolution", "max_range"}
    for name, number, unit in offers:
        field = f"{name}_{'m_per_s' if unit == 'm/s' else 'm'}"
        changes = {"max_velocity_m_per_s": 140.0, field: float(number)}
        assert design(replace(REPORT_REQUIREMENTS, **changes), rule="constraints").is_met


def test_10_cm_resolution_does_not_fit_into_one_gigahertz():
    requirements = Requirements(
        max_range_m=30.0, range_resolution_m=0.1, max_velocity_m_per_s=10.0, band="76-77 GHz"
    )

    for rule in RULES:
        result = design(requirements, rule=rule)
        (finding,) = result.findings
        assert finding.setting == "requirements.range_resolution"
        assert "at most 1000 MHz" in finding.expected
        # c / 2B of the full gigahertz is 0.1499 m, less the swept band without samples.
        assert result.radar.frame.chirp.range_resolution_m == pytest.approx(0.15, abs=0.004)
    assert design(replace(requirements, band="77-81 GHz"), rule="constraints").is_met


def test_ramp_starts_at_lower_band_edge():
    upper_band = replace(REPORT_REQUIREMENTS, band="77-81 GHz")
    lower_band = replace(REPORT_REQUIREMENTS, band="76-77 GHz")

    for rule in RULES:
        assert design(upper_band, rule=rule).radar.frame.chirp.start_frequency_hz == 77e9
        assert design(lower_band, rule=rule).radar.frame.chirp.start_frequency_hz == 76e9


def test_finding_reports_round_trip_too_long_for_velocity():
    result = design(replace(REPORT_REQUIREMENTS, max_range_m=400.0))

    (finding,) = result.findings
    assert finding.setting == "requirements.max_velocity"
    # Twice the range halves the velocity of 132.5 m/s, rounded down to three digits.
    assert finding.value.endswith("relaxed to 66.2 m/s")
    assert (
        finding.fix == "ask for a max_velocity of at most 66.2 m/s, or a max_range of at most 265 m"
    )
    assert design(replace(REPORT_REQUIREMENTS, max_range_m=265.0)).is_met


def test_finding_reports_echo_delay_longer_than_interval():
    result = design(replace(REPORT_REQUIREMENTS, max_range_m=3000.0), rule="constraints")

    assert "fly-back, round trip" in result.findings[0].expected
    assert result.radar.frame.max_velocity_m_per_s < 100.0


def test_finding_reports_unreachable_velocity_resolution():
    for rule in RULES:
        result = design(replace(REPORT_REQUIREMENTS, velocity_resolution_m_per_s=1e-9), rule=rule)

        assert not result.is_met


def test_finding_quantifies_fixes_for_weak_target():
    requirements = replace(REPORT_REQUIREMENTS, rcs_m2=10.0)
    result = design(requirements)

    (finding,) = result.findings
    assert finding.setting == "requirements.max_range"
    missing_db, gain_db, chirps, reduced_range_m = map(
        float, re.findall(r"(\d+\.\d+|\d+) (?:dB|chirps|m)\b", finding.fix)
    )
    power = replace(
        TYPICAL_HARDWARE,
        transmit_power_w=TYPICAL_HARDWARE.transmit_power_w * 10 ** (missing_db / 10),
    )
    gain = replace(
        TYPICAL_HARDWARE, antenna_gain=TYPICAL_HARDWARE.antenna_gain * 10 ** (gain_db / 10)
    )
    assert design(requirements, hardware=power).is_met
    assert design(requirements, hardware=gain).is_met
    longer_frame_radar = replace(
        result.radar, frame=replace(result.radar.frame, n_chirps=int(chirps))
    )
    snr = (
        sample_snr(longer_frame_radar, range_m=200.0, rcs_m2=10.0)
        * longer_frame_radar.integration_gain
        / 1.5**2
    )
    assert to_decibels(snr) == pytest.approx(13.183, abs=0.01)
    # Reduced range with the same chirp.
    snr = (
        sample_snr(result.radar, range_m=reduced_range_m, rcs_m2=10.0)
        * result.radar.integration_gain
        / 1.5**2
    )
    assert to_decibels(snr) == pytest.approx(13.183, abs=0.05)


def test_finding_reports_power_above_regulatory_limit():
    hardware = replace(TYPICAL_HARDWARE, transmit_power_w=100.0)  # 50 dBm and 10 dBi

    result = design(REPORT_REQUIREMENTS, rule="constraints", hardware=hardware)

    assert [finding.setting for finding in result.findings] == ["hardware.transmit_power"] * 2
    assert "60 dBm" in result.findings[0].value
    assert "lower the transmit power or the antenna gain by 5.0 dB" in result.findings[0].fix


def test_custom_limits_are_applied():
    limits = Limits(max_sample_rate_hz=22.5e6)

    result = design(REPORT_REQUIREMENTS, rule="constraints", limits=limits)

    (finding,) = result.findings
    assert "43.04 MS/s" in finding.value
    assert "22.5 MS/s" in finding.expected
    assert result.radar.frame.chirp.sample_rate_hz <= 22.5e6


INVALID_VALUES = [0.0, -1.0, float("nan"), float("inf"), "200", None]


@pytest.mark.parametrize("invalid_value", INVALID_VALUES)
@pytest.mark.parametrize("field", ["max_range_m", "range_resolution_m", "max_velocity_m_per_s"])
def test_rejects_nonpositive_requirements(field, invalid_value):
    with pytest.raises(InvalidSetting, match=f"Requirements.{field}"):
        replace(REPORT_REQUIREMENTS, **{field: invalid_value})


@pytest.mark.parametrize(
    "settings",
    [
        {"range_resolution_m": 1e-9},
        {"max_velocity_m_per_s": 3e8},
        {"sampling": "iq"},
        {"band": "24 GHz"},
        {"detection_probability": 1e-7},
        {"false_alarm_probability": 0.0},
        {"rcs_m2": -1.0},
        {"velocity_resolution_m_per_s": 0.0},
    ],
)
def test_rejects_implausible_requirements(settings):
    with pytest.raises(InvalidSetting, match=r"Requirements\."):
        replace(REPORT_REQUIREMENTS, **settings)


@pytest.mark.parametrize("rule", ["round-trips", "constraints"])
@pytest.mark.parametrize(
    "invalid_value",
    nightly_except((5e-324, 1.7e308), [5e-324, 1e-300, 1e-20, 1e20, 1e300, 1.7e308]),
)
@pytest.mark.parametrize(
    "field",
    [
        "max_range_m",
        "range_resolution_m",
        "max_velocity_m_per_s",
        "velocity_resolution_m_per_s",
        "carrier_hz",
        "rcs_m2",
    ],
)
def test_rejects_extreme_requirements_under_either_rule(field, invalid_value, rule):
    settings = {"max_range_m": 100.0, "range_resolution_m": 1.0, "max_velocity_m_per_s": 10.0}
    with pytest.raises(InvalidSetting, match=f"Requirements.{field}: .* a number from"):
        design(**settings | {field: invalid_value}, rule=rule)


def test_rejects_infeasible_limits():
    with pytest.raises(InvalidSetting, match="Limits"):
        design(REPORT_REQUIREMENTS, rule="constraints", limits=Limits(max_cube_bytes=1.0))


def test_rejects_missing_or_repeated_requirements_and_unknown_rule():
    with pytest.raises(InvalidSetting, match="missing"):
        design()
    with pytest.raises(InvalidSetting, match="cannot be combined with keywords"):
        design(REPORT_REQUIREMENTS, max_range_m=100.0)
    with pytest.raises(InvalidSetting, match="round-trips or constraints"):
        design(REPORT_REQUIREMENTS, rule="guess")
    with pytest.raises(InvalidSetting, match="speed_of_light"):
        design(REPORT_REQUIREMENTS, speed_of_light_m_per_s=340.0)


def test_finding_reports_ramp_wider_than_automotive_bands():
    for rule in ("round-trips", "constraints"):
        result = design(
            max_range_m=100, range_resolution_m=1e-3, max_velocity_m_per_s=10, rule=rule
        )
        assert not result.is_met
        assert result.radar.frame.chirp.ramp_bandwidth_hz <= 5e9 * (1 + 1e-9)
