"""Quantities with units: parsing, suggestions for wrong units, and formatting."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.config.quantities import format_exact_quantity, parse_quantity
from dechirp.core.dimensions import DIMENSIONS
from dechirp.core.errors import InvalidSetting
from nightly import n_examples


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("77 GHz", "hz", 77e9),
        ("77GHz", "hz", 77e9),
        ("300 MS/s", "hz", 300e6),
        ("20.4545 MHz/us", "hz_per_s", 20.4545e12),
        ("7.3333 us", "s", 7.3333e-6),
        ("7.3333 µs", "s", 7.3333e-6),
        ("7.776 mm", "m", 0.007776),
        (".5 m", "m", 0.5),
        ("-5 m/s", "m_per_s", -5.0),
        ("36 km/h", "m_per_s", 10.0),
        ("2.5 m^2", "m2", 2.5),
        ("90 deg", "rad", math.pi / 2),
        ("4 MiB", "bytes", 2.0**22),
        ("1 Gbit/s", "bits_per_s", 1e9),
        ("1e-6", "probability", 1e-6),
        ("2.5", None, 2.5),
        ("0", "m", 0.0),
        ("15 degC", "k", 288.15),
        ("15 °C", "k", 288.15),
        ("-40 degC", "k", 233.15),
        ("1013.25 hPa", "pa", 101325.0),
        ("7.5 g/m^3", "kg_per_m3", 0.0075),
        ("36 mm/h", "m_per_s", 1e-5),
        ("500 fs", "s", 5e-13),
    ],
)
def test_parsed_quantity_is_nearest_float(text, unit, number):
    assert parse_quantity(text, unit) == number


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("12 dBm", "w", 0.0158489),
        ("-3 dBW", "w", 0.501187),
        ("10 dBsm", "m2", 10.0),
        ("10 dBi", None, 10.0),
        ("-24 dB", None, 0.00398107),
        ("-90 dBc/Hz", "per_hz", 1e-9),
    ],
)
def test_decibels_are_converted_to_linear_values(text, unit, number):
    assert parse_quantity(text, unit) == pytest.approx(number, rel=1e-5)  # six digits


INVALID_LENGTHS = (
    *("1,5 m", "9**9**9 m", "2*3 m", "1 2 m", "1_0 m", "0x10 m", "٣ m", "1 m; 2", "m", ""),
    *("nan m", "inf m", "1e999 m", "35", "5 mms", "5 m/s", "5 m/", "5 /m", "12 dBm"),
    f"{'9' * 200} m",
)


@pytest.mark.parametrize("text", INVALID_LENGTHS)
def test_rejects_text_that_is_no_length(text):
    with pytest.raises(InvalidSetting):
        parse_quantity(text, "m")


@pytest.mark.parametrize(
    ("text", "unit", "fix"),
    [
        ("77 Ghz", "hz", "did you mean GHz?"),
        ("10 ms", "m_per_s", "did you mean m/s?"),
        ("10 MHz", "hz_per_s", "did you mean MHz/us?"),
        ("12 dB", "w", "did you mean dBm?"),
        ("7 apples", "s", "units that fit: s, ms, us"),
        ("6 m", None, "units that fit: dB"),
        ("-60 dB", "probability", "omit the unit"),
        ("1,5 m", "m", "decimal separator"),
    ],
)
def test_wrong_unit_is_quoted_and_fix_is_suggested(text, unit, fix):
    with pytest.raises(InvalidSetting) as error:
        parse_quantity(text, unit)

    (mistake,) = error.value.mistakes
    assert mistake.value == text
    assert mistake.expected == DIMENSIONS[unit].description
    assert fix in mistake.fix


@pytest.mark.parametrize(
    ("number", "unit", "text"),
    [
        (77e9, "hz", "77 GHz"),
        (20.4545e12, "hz_per_s", "20.4545 MHz/us"),
        (35e-6, "s", "35 us"),
        (0.007776, "m", "7.776 mm"),
        (60, "m", "60 m"),
        (0.0, "m", "0 m"),
        (10.0, "m2", "10 dBsm"),
        (2.5, "m2", "2.5 m^2"),
        (10**1.2 / 1e3, "w", "12 dBm"),
        (2.5, None, "2.5"),
        (1e-6, "probability", "1e-06"),
    ],
)
def test_quantity_is_formatted_with_readable_unit(number, unit, text):
    assert format_exact_quantity(number, unit) == text


@settings(max_examples=n_examples(500), deadline=None)
@given(
    number=st.floats(allow_nan=False, allow_infinity=False),
    unit=st.sampled_from(list(DIMENSIONS)),
)
def test_any_number_reads_back_exactly(number, unit):
    assert parse_quantity(format_exact_quantity(number, unit), unit) == number


@settings(max_examples=n_examples(500), deadline=None)
@given(
    text=st.text() | st.from_regex(r"[-+]?[0-9.e]{1,20} ?[A-Za-z/^]{0,8}", fullmatch=True),
    unit=st.sampled_from(list(DIMENSIONS)),
)
def test_any_text_gives_finite_number_or_error(text, unit):
    try:
        assert math.isfinite(parse_quantity(text, unit))
    except InvalidSetting as error:
        assert all(mistake.fix for mistake in error.mistakes)
