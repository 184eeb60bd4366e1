"""Numbers as a reader wants them: with a unit, a fitting prefix and no idle digits."""

import math

import numpy as np

from dechirp.core.units import decibels

MINUS, NONE, TIMES = "\N{MINUS SIGN}", "\N{EN DASH}", "\N{MULTIPLICATION SIGN}"

_PREFIXES = dict(
    zip(range(-24, 13, 3), ("y", "z", "a", "f", "p", "n", "µ", "m", "", *"kMGT"), strict=True)
)
_SMALLEST_POWER = 1e-30  # -270 dBm: a map of zeros still has decibels


def number(amount: float, digits: int = 4) -> str:
    """Write significant digits without an exponent or trailing zeros, with a true minus sign."""
    if not math.isfinite(amount):
        return "∞" if amount == math.inf else NONE
    if amount == 0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(amount))), 0)
    text = f"{amount:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return text.replace("-", MINUS)


def quantity(amount: float, unit: str, digits: int = 4) -> str:
    """Write a number with a prefix that leaves it between 1 and 1000: 150 MHz."""
    if not math.isfinite(amount) or amount == 0:
        return f"{number(amount)} {unit}"
    thousands = math.floor(math.log10(abs(amount)) / 3 + 1e-9)
    power = min(max(3 * thousands, min(_PREFIXES)), max(_PREFIXES))
    return f"{number(amount / 10.0**power, digits)} {_PREFIXES[power]}{unit}"


def fixed(amount: float, decimals: int, *, sign: bool = False) -> str:
    """Write a number with so many decimals, for columns; a dash where there is none."""
    if not math.isfinite(amount):
        return NONE
    text = f"{amount:+.{decimals}f}" if sign else f"{amount:.{decimals}f}"
    if float(text) == 0:
        text = text.lstrip("+-")
    return text.replace("-", MINUS)


def power_of_ten(exponent: int) -> str:
    """Write 10⁻⁶ for -6."""
    return "10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def small(probability: float) -> str:
    """Write a probability as 10⁻⁶, or with a factor in front."""
    exponent = math.floor(math.log10(probability) + 1e-12)
    factor = number(probability / 10.0**exponent, 3)
    return power_of_ten(exponent) if factor == "1" else f"{factor} {TIMES} {power_of_ten(exponent)}"


def decimals_of(std: float) -> int:
    """Return the decimals that show two digits of a standard error, 1 to 9; 3 where unknown."""
    if not (math.isfinite(std) and std > 0):
        return 3
    return min(max(1 - math.floor(math.log10(std)), 1), 9)


def ratio_db(ratio: float) -> float:
    """Convert one power ratio to dB; minus infinity for none at all."""
    return float(decibels(ratio)) if ratio > 0 else -math.inf


def power_db(power: np.ndarray, units: str) -> np.ndarray:
    """Convert power to dBm for samples in sqrt(W), else to dB relative to full scale."""
    floor = np.maximum(np.asarray(power, dtype=float), _SMALLEST_POWER)
    return decibels(floor) + (30.0 if units == "sqrt(W)" else 0.0)


def power_unit(units: str) -> str:
    """Return the unit of `power_db` for samples in these units."""
    return "dBm" if units == "sqrt(W)" else "dBFS"
