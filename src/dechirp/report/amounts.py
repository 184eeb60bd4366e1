"""A check in words and numbers: all of its figures in one unit, to the digits that count."""

import math
import re
from collections.abc import Mapping
from typing import Any

from dechirp.core.values import value
from dechirp.core.words import MINUS, NONE, TIMES, number, power_of_ten, quantity

_AT_LEAST, _AT_MOST = "≥ ", "≤ "


@value
class Shown:
    """One check, as the columns of a table; a dash where there is nothing."""

    published: str
    required: str
    measured: str
    interval: str
    """Empty where no chance is involved."""
    limit: str


def shown(check: Mapping[str, Any]) -> Shown:
    """Write the figures of a claim or of one of its checks.

    The interval decides on the decimals, two digits of its half width; without one the room
    that is required, and its distance from theory.
    """
    measured = _float(check["measured"])
    factor, unit = _scale(check["unit"], measured)
    decimals = _decimals(check, measured, factor)
    low, high = check["interval"] or (None, None)
    interval = ""
    if low is not None or high is not None:
        interval = f"{_fixed(low, factor, decimals)} to {_fixed(high, factor, decimals)}"
    said = check["published"]
    return Shown(
        published=said if isinstance(said, str) else _with(_short(said, factor), unit),
        required=_with(_required(check["required"] or {}, factor, decimals), unit),
        measured=_with(_fixed(measured, factor, decimals), unit),
        interval=interval,
        limit=_with(_fixed(check["limit"], factor, decimals), unit),
    )


def compared(published: float | None, here: float | None, unit: str) -> tuple[str, str]:
    """Write two figures of one quantity with three digits of what is between them."""
    factor, tail = _scale(unit, _float(published if here is None else here))
    apart = abs(_float(published) - _float(here)) / factor
    if not (math.isfinite(apart) and apart > 0):
        return _with(_short(published, factor), tail), _with(_short(here, factor), tail)
    decimals = max(2 - math.floor(math.log10(apart)), 0)
    said = _fixed(published, factor, decimals)
    said = said.rstrip("0").rstrip(".") if "." in said else said
    return _with(said, tail), _with(_fixed(here, factor, decimals), tail)


def amount(number_: float | None, unit: str, digits: int = 4) -> str:
    """Write one number with its unit: 6.823 MHz, 37.7 mm; a dash where there is none."""
    if unit in ("m", "m/s") and 0 < abs(_float(number_)) < 0.1:
        return quantity(_float(number_), unit, digits)
    factor, tail = _scale(unit, _float(number_))
    return _with(NONE if number_ is None else number(number_ / factor, digits), tail)


def counted(n: int | None) -> str:
    """Write a count in groups of three digits, which no line break parts."""
    return NONE if n is None else f"{n:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def typographic(text: str) -> str:
    """Write minus signs, powers of ten and quotation marks as such in what came as plain text."""
    text = re.sub(
        r"(?<![\w.])(\d[\d.]*)e([+-]?\d+)\b",
        lambda found: (
            ("" if found[1] == "1" else f"{found[1]} {TIMES} ") + power_of_ten(int(found[2]))
        ),
        text,
    )
    text = re.sub(r"\b10\^(-?\d+)", lambda found: power_of_ten(int(found[1])), text)
    text = re.sub(r"(?<![\w.)])-(?=\d)", MINUS, text)
    text = re.sub(r"(?<=\w)'", "\N{RIGHT SINGLE QUOTATION MARK}", text)
    return re.sub(r'"([^"]*)"', "“\\1”", text)


def _with(text: str, unit: str) -> str:
    if text in (NONE, "∞"):
        return text
    # A unit stays with its number, but a power of ten may go to the next line.
    return text + (unit.replace(" ", "\N{NO-BREAK SPACE}") if unit.count(" ") == 1 else unit)


def _fixed(amount: float | None, factor: float, decimals: int) -> str:
    if amount is None or not math.isfinite(amount):
        return NONE
    text = f"{amount / factor:.{decimals}f}"
    return (text.lstrip("-") if float(text) == 0 else text).replace("-", MINUS)


def _short(amount: float | None, factor: float, digits: int = 6) -> str:
    return NONE if amount is None else number(amount / factor, digits)


def _required(ends: Mapping[str, float | None], factor: float, decimals: int) -> str:
    texts = {name: _fixed(end, factor, decimals) for name, end in ends.items()}
    # Zeros that all ends have say nothing.
    while texts and all(re.search(r"\.\d*0$", text) for text in texts.values()):
        texts = {name: text[:-1].rstrip(".") for name, text in texts.items()}
    low, high = texts.get("at_least"), texts.get("at_most")
    if low is None:
        return NONE if high is None else _AT_MOST + high
    if high is None:
        return _AT_LEAST + low
    return low if low == high else f"{low} to {high}"


def _scale(unit: str, amount: float) -> tuple[float, str]:
    """What to divide by, and the unit that is left, with the space before it."""
    if unit == "1":
        return 1.0, ""
    if unit not in ("Hz/s", "Hz", "W", "s") or not (math.isfinite(amount) and amount):
        return 1.0, f" {unit}"
    exponent = math.floor(math.log10(abs(amount)) + 1e-9)
    if unit == "Hz/s":
        return 10.0**exponent, f" {TIMES} {power_of_ten(exponent)} {unit}"
    power = 3 * (exponent // 3)
    power = max(power, 0) if unit == "Hz" else power
    return 10.0**power, " " + quantity(10.0**power, unit).partition(" ")[2]


def _decimals(check: Mapping[str, Any], measured: float, factor: float) -> int:
    low, high = check["interval"] or (None, None)
    steps = [(_float(high) - _float(low)) / 2]
    if not math.isfinite(steps[0]):
        ends = [_float(end) for end in (check["required"] or {}).values()]
        steps = [abs(end - _float(check["limit"])) for end in ends]
        steps += [(max(ends) - min(ends)) / 2] if ends else []
    steps = [step / factor for step in steps if math.isfinite(step) and step / factor > 1e-9]
    if steps:
        return max(1 - math.floor(math.log10(min(steps))), 0)
    if not math.isfinite(measured):
        return 0
    # Four digits, without idle zeros.
    return len(number(measured / factor, 4).partition(".")[2])


def _float(amount: float | None) -> float:
    return math.nan if amount is None else float(amount)
