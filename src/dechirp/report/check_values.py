"""Formatting of the values of a check, in one unit and with matching digits."""

import math
import re
from collections.abc import Mapping
from typing import Any

from dechirp.core.text import (
    EN_DASH,
    MINUS_SIGN,
    TIMES_SIGN,
    format_number,
    format_power_of_ten,
    format_with_si_prefix,
)
from dechirp.core.values import frozen_dataclass

_AT_LEAST, _AT_MOST = "≥ ", "≤ "


@frozen_dataclass
class CheckRow:
    """Formatted values of one check; missing values are dashes."""

    published: str
    required: str
    measured: str
    interval: str
    """Empty for deterministic measurements."""
    limit: str


def format_check_row(check: Mapping[str, Any]) -> CheckRow:
    """Format the values of a claim or of one of its checks.

    The number of decimals follows from the interval (two digits of its half width), otherwise from
    the requirement and its distance from theory.
    """
    measured = _float_or_nan(check["measured"])
    factor, unit = _divisor_and_prefixed_unit(check["unit"], measured)
    decimals = _decimals_from_interval_or_requirement(check, measured, factor)
    low, high = check["interval"] or (None, None)
    interval = ""
    if low is not None or high is not None:
        low_text, high_text = (_format_scaled_fixed(end, factor, decimals) for end in (low, high))
        interval = f"{low_text} to {high_text}"
    published = check["published"]
    return CheckRow(
        published=published
        if isinstance(published, str)
        else _append_unit(_format_scaled_significant(published, factor), unit),
        required=_append_unit(
            _format_required_interval(check["required"] or {}, factor, decimals), unit
        ),
        measured=_append_unit(_format_scaled_fixed(measured, factor, decimals), unit),
        interval=interval,
        limit=_append_unit(_format_scaled_fixed(check["limit"], factor, decimals), unit),
    )


def format_pair(published: float | None, computed: float | None, unit: str) -> tuple[str, str]:
    """Format two values of one quantity with three digits of their difference."""
    factor, unit_text = _divisor_and_prefixed_unit(
        unit, _float_or_nan(published if computed is None else computed)
    )
    difference = abs(_float_or_nan(published) - _float_or_nan(computed)) / factor
    if not (math.isfinite(difference) and difference > 0):
        return _append_unit(_format_scaled_significant(published, factor), unit_text), _append_unit(
            _format_scaled_significant(computed, factor), unit_text
        )
    decimals = max(2 - math.floor(math.log10(difference)), 0)
    published_text = _format_scaled_fixed(published, factor, decimals)
    published_text = (
        published_text.rstrip("0").rstrip(".") if "." in published_text else published_text
    )
    return _append_unit(published_text, unit_text), _append_unit(
        _format_scaled_fixed(computed, factor, decimals), unit_text
    )


def format_amount(amount: float | None, unit: str, digits: int = 4) -> str:
    """Format a number with its unit: 6.823 MHz, 37.7 mm; None is a dash."""
    if unit in ("m", "m/s") and 0 < abs(_float_or_nan(amount)) < 0.1:
        return format_with_si_prefix(_float_or_nan(amount), unit, digits)
    factor, tail = _divisor_and_prefixed_unit(unit, _float_or_nan(amount))
    return _append_unit(EN_DASH if amount is None else format_number(amount / factor, digits), tail)


def format_count(n: int | None) -> str:
    """Format a count in groups of three digits with non-breaking spaces."""
    return EN_DASH if n is None else f"{n:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def apply_typography(text: str) -> str:
    """Replace hyphens, powers of ten and quotation marks of plain text by typographic ones."""
    text = re.sub(
        r"(?<![\w.])(\d[\d.]*)e([+-]?\d+)\b",
        lambda match: (
            ("" if match[1] == "1" else f"{match[1]} {TIMES_SIGN} ")
            + format_power_of_ten(int(match[2]))
        ),
        text,
    )
    text = re.sub(r"\b10\^(-?\d+)", lambda match: format_power_of_ten(int(match[1])), text)
    text = re.sub(r"(?<![\w.)])-(?=\d)", MINUS_SIGN, text)
    text = re.sub(r"(?<=\w)'", "\N{RIGHT SINGLE QUOTATION MARK}", text)
    return re.sub(r'"([^"]*)"', "“\\1”", text)


def _append_unit(text: str, unit: str) -> str:
    if text in (EN_DASH, "∞"):
        return text
    # The unit stays on the line of its number, but a power of ten may wrap.
    return text + (unit.replace(" ", "\N{NO-BREAK SPACE}") if unit.count(" ") == 1 else unit)


def _format_scaled_fixed(amount: float | None, divisor: float, decimals: int) -> str:
    if amount is None or not math.isfinite(amount):
        return EN_DASH
    text = f"{amount / divisor:.{decimals}f}"
    return (text.lstrip("-") if float(text) == 0 else text).replace("-", MINUS_SIGN)


def _format_scaled_significant(amount: float | None, divisor: float, digits: int = 6) -> str:
    return EN_DASH if amount is None else format_number(amount / divisor, digits)


def _format_required_interval(
    bounds: Mapping[str, float | None], divisor: float, decimals: int
) -> str:
    texts = {name: _format_scaled_fixed(bound, divisor, decimals) for name, bound in bounds.items()}
    # Trailing zeros common to all bounds are dropped.
    while texts and all(re.search(r"\.\d*0$", text) for text in texts.values()):
        texts = {name: text[:-1].rstrip(".") for name, text in texts.items()}
    low, high = texts.get("at_least"), texts.get("at_most")
    if low is None:
        return EN_DASH if high is None else _AT_MOST + high
    if high is None:
        return _AT_LEAST + low
    return low if low == high else f"{low} to {high}"


def _divisor_and_prefixed_unit(unit: str, amount: float) -> tuple[float, str]:
    """Return the divisor of a value, and its unit with prefix, preceded by a space."""
    if unit == "1":
        return 1.0, ""
    if unit not in ("Hz/s", "Hz", "W", "s") or not (math.isfinite(amount) and amount):
        return 1.0, f" {unit}"
    exponent = math.floor(math.log10(abs(amount)) + 1e-9)
    if unit == "Hz/s":
        return 10.0**exponent, f" {TIMES_SIGN} {format_power_of_ten(exponent)} {unit}"
    power = 3 * (exponent // 3)
    power = max(power, 0) if unit == "Hz" else power
    return 10.0**power, " " + format_with_si_prefix(10.0**power, unit).partition(" ")[2]


def _decimals_from_interval_or_requirement(
    check: Mapping[str, Any], measured: float, divisor: float
) -> int:
    low, high = check["interval"] or (None, None)
    steps = [(_float_or_nan(high) - _float_or_nan(low)) / 2]
    if not math.isfinite(steps[0]):
        ends = [_float_or_nan(end) for end in (check["required"] or {}).values()]
        steps = [abs(end - _float_or_nan(check["limit"])) for end in ends]
        steps += [(max(ends) - min(ends)) / 2] if ends else []
    steps = [step / divisor for step in steps if math.isfinite(step) and step / divisor > 1e-9]
    if steps:
        return max(1 - math.floor(math.log10(min(steps))), 0)
    if not math.isfinite(measured):
        return 0
    # Four digits, without trailing zeros.
    return len(format_number(measured / divisor, 4).partition(".")[2])


def _float_or_nan(amount: float | None) -> float:
    return math.nan if amount is None else float(amount)
