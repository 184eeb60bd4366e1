"""Numbers as a reader wants them: with a unit, a fitting prefix and no idle digits."""

import math
import re

import numpy as np

from dechirp.core.kinds import KINDS
from dechirp.core.units import decibels

MINUS, NONE, TIMES = "\N{MINUS SIGN}", "\N{EN DASH}", "\N{MULTIPLICATION SIGN}"

_PREFIXES = dict(
    zip(range(-24, 13, 3), ("y", "z", "a", "f", "p", "n", "µ", "m", "", *"kMGT"), strict=True)
)
_FACTORS = {"G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "": 1.0, "m": 1e-3, "u": 1e-6, "n": 1e-9}
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
    factor = number(10 ** (math.log10(probability) - exponent), 3)
    if factor == "10":  # 9.999e-7
        factor, exponent = "1", exponent + 1
    return power_of_ten(exponent) if factor == "1" else f"{factor} {TIMES} {power_of_ten(exponent)}"


def decimals_of(std: float) -> int:
    """Return the decimals that show two digits of a standard error, 1 to 9; 3 where unknown."""
    if not (math.isfinite(std) and std > 0):
        return 3
    exponent = int(f"{std:.1e}".partition("e")[2])  # of what is shown: 0.00998 becomes 0.010
    return min(max(1 - exponent, 1), 9)


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


def in_unit(amount: float, unit: str | None, digits: int = 4) -> str:
    """Write a number as its kind is told: 77 GHz, 12 dBm, 30°; `unit` is the suffix of its name."""
    kind = KINDS[unit]
    if unit in ("rad", "rad_per_s"):
        return f"{number(math.degrees(amount), digits)}°{'/s' * (unit != 'rad')}"
    if kind.levels and 0 < amount < math.inf:
        symbol, zero_db = kind.levels[0]
        return f"{number(round(ratio_db(amount) - zero_db, 3), digits)} {symbol}"
    if not kind.base:
        return small(amount) if 0 < amount < 1e-3 else number(amount, digits)
    factors = [(name, factor) for name in kind.scales if (factor := _factor(name, kind.base))]
    # 0.6 m, but 150 MHz.
    least = 10.0 if kind.base == "m" else 1.0
    fitting = [one for one in factors if one[1] <= abs(amount) * least * (1 + 1e-9)]
    name, factor = (fitting or factors[-1:])[0] if amount else (kind.base, 1.0)
    return f"{number(amount / factor, digits)} {typeset(name)}"


def typeset(unit: str) -> str:
    """Write a unit of settings files for people: MHz/µs, m², °."""
    unit = re.sub(r"\bu(?=[smW]\b)", "µ", unit)
    return unit.replace("^2", "²").replace("^3", "³").replace("deg", "°")


def _factor(name: str, base: str) -> float | None:
    """How many base units a unit is; None where prefixes alone do not tell."""
    parts = [
        _FACTORS.get(part.removesuffix(of))
        for part, of in zip(name.split("/"), base.split("/"), strict=True)
    ]
    above, below = parts[0], parts[1] if len(parts) > 1 else 1.0
    return None if above is None or below is None else above / below
