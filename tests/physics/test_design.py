"""Requirements to a radar: the report's numbers, and what cannot be had.

The requirements of the reference report: 200 m, 1 m, 100 m/s, at 77 GHz.
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

REPORT = Requirements(max_range_m=200.0, range_resolution_m=1.0, max_velocity_m_per_s=100.0)
HARD = Requirements(max_range_m=300.0, range_resolution_m=0.04, max_velocity_m_per_s=100.0)
RULES = ["round-trips", "constraints"]


def numbers(made):
    return {number.name: number.value for number in made.derived}


def test_the_report_by_round_trips_with_the_exact_speed_of_light():
    made = design(REPORT)
    chirp = made.radar.frame.chirp

    assert made.is_met
    assert made.findings == ()
    assert chirp.sampled_bandwidth_hz == pytest.approx(149.896229e6)
    assert numbers(made)["round_trip"] == pytest.approx(1.334e-6, abs=5e-10)
    assert chirp.ramp_duration_s == pytest.approx(7.338e-6, abs=5e-10)
    assert chirp.n_samples == 2200
    assert chirp.range_resolution_m == pytest.approx(1.0, rel=1e-12)


def test_the_report_by_round_trips_with_its_rounded_speed_of_light():
    found = numbers(design(REPORT, speed_of_light_m_per_s=3e8))

    assert found["bandwidth"] == pytest.approx(150e6)
    assert found["round_trip"] == pytest.approx(1.3333e-6, rel=1e-4)
    assert found["chirp_duration"] == pytest.approx(7.3333e-6, rel=1e-5)
    assert found["slope"] == pytest.approx(2.0455e13, rel=1e-4)
    assert found["max_beat_frequency"] == pytest.approx(27.27e6, abs=5e3)
    assert found["max_doppler_frequency"] == pytest.approx(51.3e3, abs=50)
    assert found["sample_rate"] == pytest.approx(300e6)
    assert found["n_samples"] == 2200
    assert found["n_chirps"] == 128


def test_requirements_may_be_given_as_keywords():
    made = design(max_range_m=200, range_resolution_m=1, max_velocity_m_per_s=100)

    assert made == design(REPORT)


@pytest.mark.parametrize("rule", RULES)
def test_every_number_has_a_formula_and_a_unit(rule):
    made = design(replace(REPORT, rcs_m2=10.0), rule=rule)

    assert all(number.formula and number.unit for number in made.derived)
    assert len(numbers(made)) == len(made.derived)


def test_samples_that_are_not_whole_are_rounded_up_at_the_same_resolution():
    chirp = design(replace(REPORT, max_range_m=200.3)).radar.frame.chirp

    assert chirp.n_samples == 2204  # 11 x 200.3 = 2203.3
    assert chirp.range_resolution_m == pytest.approx(1.0, rel=1e-12)
    assert chirp.ramp_duration_s == pytest.approx(2204 / chirp.sample_rate_hz)


@pytest.mark.parametrize("rule", RULES)
def test_a_finer_velocity_takes_more_chirps(rule):
    frame = design(replace(REPORT, velocity_resolution_m_per_s=0.5), rule=rule).radar.frame

    assert frame.velocity_resolution_m_per_s <= 0.5 * (1 + 1e-9)
    assert replace(frame, n_chirps=frame.n_chirps - 1).velocity_resolution_m_per_s > 0.5


def test_by_constraints_the_interval_holds_fly_back_echo_samples_and_margin():
    limits = Limits()
    frame = design(REPORT, rule="constraints").radar.frame
    chirp = frame.chirp

    assert chirp.adc_start_s == pytest.approx(400 / 299_792_458.0 + limits.settling_s)
    assert frame.interval_s == pytest.approx(
        limits.idle_s + chirp.adc_start_s + chirp.sampled_duration_s + limits.ramp_end_margin_s
    )
    # The interval is the longest that keeps 100 m/s: a slower ramp would fold it.
    assert frame.max_velocity_m_per_s == pytest.approx(100.0, rel=1e-8)
    assert frame.max_velocity_m_per_s >= 100.0


def test_by_constraints_the_report_needs_a_seventh_of_its_sample_rate():
    made = design(REPORT, rule="constraints")

    assert made.is_met
    # Half a bin more for Doppler, 0.9 of the band usable: (200 + 0.5) / 0.9 = 222.8.
    assert made.radar.frame.chirp.n_samples == 223
    assert made.radar.frame.chirp.sample_rate_hz == pytest.approx(43.04e6, rel=1e-3)


def test_real_samples_are_taken_twice_as_fast():
    by_complex = design(REPORT, rule="constraints").radar.frame.chirp
    by_real = design(replace(REPORT, sampling="real"), rule="constraints").radar.frame.chirp

    # Rounded up to whole samples, of 222.8 and of 445.6.
    assert by_real.n_samples == 446
    assert by_real.sample_rate_hz / by_complex.sample_rate_hz == pytest.approx(2.0, rel=0.01)
    assert by_real.max_range_m == pytest.approx(by_complex.max_range_m, rel=0.01)


asked = st.builds(
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


@settings(deadline=None, max_examples=150)
@given(requirements=asked, rule=st.sampled_from(RULES))
def test_what_has_no_finding_is_met_by_the_radar(requirements, rule):
    made = design(requirements, rule=rule)
    frame, chirp = made.radar.frame, made.radar.frame.chirp
    found = {finding.setting.removeprefix("requirements.") for finding in made.findings}
    enough, little = 1 - 1e-9, 1 + 1e-9  # rounding

    assert made.is_met == (not found)
    if "range_resolution" not in found:
        assert chirp.range_resolution_m <= requirements.range_resolution_m * little
    if "max_velocity" not in found:
        assert frame.max_velocity_m_per_s >= requirements.max_velocity_m_per_s * enough
    if "max_range" not in found:
        # The fastest target that does not fold does not alias in range either.
        fastest = min(requirements.max_velocity_m_per_s, frame.max_velocity_m_per_s)
        farthest_m = requirements.max_range_m + chirp.range_doppler_coupling_m(fastest)
        assert chirp.max_range_m >= farthest_m * enough
        if requirements.rcs_m2 is not None:
            one_sample = sample_snr(
                made.radar, range_m=requirements.max_range_m, rcs_m2=requirements.rcs_m2
            )
            after_windows = one_sample * made.radar.integration_gain / 1.5**2
            assert to_decibels(after_windows) >= 13.183
    if "velocity_resolution" not in found and requirements.velocity_resolution_m_per_s:
        finest = requirements.velocity_resolution_m_per_s
        assert frame.velocity_resolution_m_per_s <= finest * little
    if requirements.band is not None:
        low_hz, high_hz = BANDS_HZ[requirements.band]
        assert low_hz <= chirp.start_frequency_hz
        assert chirp.start_frequency_hz + chirp.ramp_bandwidth_hz <= high_hz * little


@settings(deadline=None, max_examples=50)
@given(requirements=asked)
def test_a_radar_by_constraints_keeps_the_limits_whatever_is_asked(requirements):
    limits = Limits()
    found = numbers(made := design(requirements, rule="constraints"))
    chirp = made.radar.frame.chirp

    assert chirp.slope_hz_per_s <= limits.max_slope_hz_per_s
    rate_hz = chirp.sample_rate_hz / (2 if chirp.sampling == "real" else 1)
    assert rate_hz <= limits.max_sample_rate_hz
    assert found["data_rate"] <= limits.max_data_rate_bits_per_s
    assert found["cube_memory"] <= limits.max_cube_bytes
    assert found["mean_eirp"] <= limits.max_mean_eirp_w


def test_300_m_at_4_cm_and_100_m_per_s_breaks_every_limit_of_the_parts():
    made = design(HARD, rule="constraints")

    assert not made.is_met
    text = " ".join(map(str, made.findings))
    for limit in ("max_slope", "max_sample_rate", "max_data_rate", "max_cube"):
        assert f"limits.{limit}" in text
    # Asked again for what the finding offers, there is a radar, and it is the one given.
    offered = float(re.search(r"range_resolution of at least (\S+) m", made.findings[0].fix)[1])
    again = design(replace(HARD, range_resolution_m=offered), rule="constraints")
    assert again.is_met
    assert again.radar == made.radar


def test_each_way_out_that_a_finding_offers_works():
    made = design(replace(REPORT, max_velocity_m_per_s=140.0), rule="constraints")

    offers = re.findall(
        r"a (\w+) of at (?:least|most) (\d\S*)"
        r" (m\S*?)(?:,|$)",
        made.findings[0].fix,
    )
    assert {name for name, _, _ in offers} == {"max_velocity", "range_resolution", "max_range"}
    for name, number, unit in offers:
        field = f"{name}_{'m_per_s' if unit == 'm/s' else 'm'}"
        changed = {"max_velocity_m_per_s": 140.0, field: float(number)}
        assert design(replace(REPORT, **changed), rule="constraints").is_met


def test_10_cm_do_not_fit_into_one_gigahertz():
    asked = Requirements(
        max_range_m=30.0, range_resolution_m=0.1, max_velocity_m_per_s=10.0, band="76-77 GHz"
    )

    for rule in RULES:
        made = design(asked, rule=rule)
        (finding,) = made.findings
        assert finding.setting == "requirements.range_resolution"
        assert "at most 1000 MHz" in finding.expected
        # c / 2B of the whole gigahertz is 0.1499 m, less what is swept but not sampled.
        assert made.radar.frame.chirp.range_resolution_m == pytest.approx(0.15, abs=0.004)
    assert design(replace(asked, band="77-81 GHz"), rule="constraints").is_met


def test_a_ramp_that_would_leave_the_band_starts_at_its_lower_edge():
    inside = replace(REPORT, band="77-81 GHz")
    above = replace(REPORT, band="76-77 GHz")

    for rule in RULES:
        assert design(inside, rule=rule).radar.frame.chirp.start_frequency_hz == 77e9
        assert design(above, rule=rule).radar.frame.chirp.start_frequency_hz == 76e9


def test_round_trips_too_long_for_the_velocity_are_found():
    made = design(replace(REPORT, max_range_m=400.0))

    (finding,) = made.findings
    assert finding.setting == "requirements.max_velocity"
    # Twice the range, half the velocity of 132.5 m/s: floored to three digits.
    assert finding.value.startswith("66.2 m/s")
    assert (
        finding.fix == "ask for a max_velocity of at most 66.2 m/s, or a max_range of at most 265 m"
    )
    assert design(replace(REPORT, max_range_m=265.0)).is_met


def test_an_echo_that_takes_longer_than_the_interval_leaves_no_time_to_sample():
    made = design(replace(REPORT, max_range_m=3000.0), rule="constraints")

    assert "time left to sample" in made.findings[0].expected
    assert made.radar.frame.max_velocity_m_per_s < 100.0


def test_a_velocity_resolution_that_no_frame_counts_is_a_finding():
    for rule in RULES:
        made = design(replace(REPORT, velocity_resolution_m_per_s=1e-9), rule=rule)

        assert not made.is_met


def test_a_weak_target_is_found_with_what_would_mend_it():
    asked = replace(REPORT, rcs_m2=10.0)
    made = design(asked)

    (finding,) = made.findings
    assert finding.setting == "requirements.max_range"
    missing_db, gain_db, chirps, nearer_m = map(
        float, re.findall(r"(\d+\.\d+|\d+) (?:dB|chirps|m)\b", finding.fix)
    )
    power = replace(
        TYPICAL_HARDWARE,
        transmit_power_w=TYPICAL_HARDWARE.transmit_power_w * 10 ** (missing_db / 10),
    )
    gain = replace(
        TYPICAL_HARDWARE, antenna_gain=TYPICAL_HARDWARE.antenna_gain * 10 ** (gain_db / 10)
    )
    assert design(asked, hardware=power).is_met
    assert design(asked, hardware=gain).is_met
    more = replace(made.radar, frame=replace(made.radar.frame, n_chirps=int(chirps)))
    reached = sample_snr(more, range_m=200.0, rcs_m2=10.0) * more.integration_gain / 1.5**2
    assert to_decibels(reached) == pytest.approx(13.183, abs=0.01)
    # Nearer, at the same chirp.
    reached = (
        sample_snr(made.radar, range_m=nearer_m, rcs_m2=10.0) * made.radar.integration_gain / 1.5**2
    )
    assert to_decibels(reached) == pytest.approx(13.183, abs=0.05)


def test_power_over_what_the_regulator_allows_is_a_finding():
    strong = replace(TYPICAL_HARDWARE, transmit_power_w=100.0)  # 50 dBm and 10 dBi

    made = design(REPORT, rule="constraints", hardware=strong)

    assert [finding.setting for finding in made.findings] == ["hardware.transmit_power"] * 2
    assert "60 dBm" in made.findings[0].value
    assert "lower the transmit power or the antenna gain by 5.0 dB" in made.findings[0].fix


def test_limits_are_those_of_the_parts_that_are_given():
    slow = Limits(max_sample_rate_hz=22.5e6)

    made = design(REPORT, rule="constraints", limits=slow)

    (finding,) = made.findings
    assert "43.04 MS/s" in finding.value
    assert "22.5 MS/s" in finding.expected
    assert made.radar.frame.chirp.sample_rate_hz <= 22.5e6


WRONG = [0.0, -1.0, float("nan"), float("inf"), "200", None]


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("field", ["max_range_m", "range_resolution_m", "max_velocity_m_per_s"])
def test_requirements_that_make_no_sense_are_refused(field, wrong):
    with pytest.raises(InvalidSetting, match=f"Requirements.{field}"):
        replace(REPORT, **{field: wrong})


@pytest.mark.parametrize(
    "wrong",
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
def test_requirements_out_of_this_world_are_refused(wrong):
    with pytest.raises(InvalidSetting, match=r"Requirements\."):
        replace(REPORT, **wrong)


@pytest.mark.parametrize("rule", ["round-trips", "constraints"])
@pytest.mark.parametrize("wrong", [5e-324, 1e-300, 1e-20, 1e20, 1e300, 1.7e308])
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
def test_requirements_of_no_size_are_refused_by_name_under_either_rule(field, wrong, rule):
    asked = {"max_range_m": 100.0, "range_resolution_m": 1.0, "max_velocity_m_per_s": 10.0}
    with pytest.raises(InvalidSetting, match=f"Requirements.{field}: .* a number from"):
        design(**asked | {field: wrong}, rule=rule)


def test_limits_that_no_radar_keeps_are_refused():
    with pytest.raises(InvalidSetting, match="Limits"):
        design(REPORT, rule="constraints", limits=Limits(max_cube_bytes=1.0))


def test_a_design_needs_requirements_once_and_a_rule_it_knows():
    with pytest.raises(InvalidSetting, match="not given"):
        design()
    with pytest.raises(InvalidSetting, match="given twice"):
        design(REPORT, max_range_m=100.0)
    with pytest.raises(InvalidSetting, match="round-trips or constraints"):
        design(REPORT, rule="guess")
    with pytest.raises(InvalidSetting, match="speed_of_light"):
        design(REPORT, speed_of_light_m_per_s=340.0)


def test_a_ramp_wider_than_all_automotive_bands_is_a_finding_under_either_rule():
    for rule in ("round-trips", "constraints"):
        made = design(max_range_m=100, range_resolution_m=1e-3, max_velocity_m_per_s=10, rule=rule)
        assert not made.is_met
        assert made.radar.frame.chirp.ramp_bandwidth_hz <= 5e9 * (1 + 1e-9)
