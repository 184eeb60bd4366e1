"""Numbers as text: with units, prefixes and significant digits only."""

import math
import re
from collections.abc import Iterable

import numpy as np

from dechirp.core.dimensions import DIMENSIONS
from dechirp.core.units import is_absolute, to_decibels

MINUS_SIGN, EN_DASH, TIMES_SIGN = "\N{MINUS SIGN}", "\N{EN DASH}", "\N{MULTIPLICATION SIGN}"

_PREFIXES = dict(
    zip(range(-24, 13, 3), ("y", "z", "a", "f", "p", "n", "µ", "m", "", *"kMGT"), strict=True)
)
_FACTORS = {"G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "": 1.0, "m": 1e-3, "u": 1e-6, "n": 1e-9}
_MAX_RANGES = 6  # of numbers that a message lists
_SMALLEST_POWER = 1e-30  # -270 dBm: a map of zeros still has decibels


def format_number(amount: float, digits: int = 4) -> str:
    """Write significant digits without an exponent or trailing zeros, with a true minus sign."""
    if not math.isfinite(amount):
        return "∞" if amount == math.inf else EN_DASH
    if amount == 0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(amount))), 0)
    text = f"{amount:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return text.replace("-", MINUS_SIGN)


def format_with_si_prefix(amount: float, unit: str, digits: int = 4) -> str:
    """Write a number with a prefix that leaves it between 1 and 1000: 150 MHz."""
    if not math.isfinite(amount) or amount == 0:
        return f"{format_number(amount)} {unit}"
    thousands = math.floor(math.log10(abs(amount)) / 3 + 1e-9)
    power = min(max(3 * thousands, min(_PREFIXES)), max(_PREFIXES))
    return f"{format_number(amount / 10.0**power, digits)} {_PREFIXES[power]}{unit}"


def format_fixed(amount: float, decimals: int, *, sign: bool = False) -> str:
    """Write a number with fixed decimals, for columns; a dash if it is not finite."""
    if not math.isfinite(amount):
        return EN_DASH
    text = f"{amount:+.{decimals}f}" if sign else f"{amount:.{decimals}f}"
    if float(text) == 0:
        text = text.lstrip("+-")
    return text.replace("-", MINUS_SIGN)


def format_power_of_ten(exponent: int) -> str:
    """Write 10⁻⁶ for -6."""
    return "10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def format_probability(probability: float) -> str:
    """Write a probability as 10⁻⁶, or with a factor in front."""
    exponent = math.floor(math.log10(probability) + 1e-12)
    factor = format_number(10 ** (math.log10(probability) - exponent), 3)
    if factor == "10":  # 9.999e-7
        factor, exponent = "1", exponent + 1
    return (
        format_power_of_ten(exponent)
        if factor == "1"
        else f"{factor} {TIMES_SIGN} {format_power_of_ten(exponent)}"
    )


def decimals_for_std(std: float) -> int:
    """Return the decimals that show two digits of a standard error, 1 to 9; 3 where unknown."""
    if not (math.isfinite(std) and std > 0):
        return 3
    exponent = int(f"{std:.1e}".partition("e")[2])  # of what is shown: 0.00998 becomes 0.010
    return min(max(1 - exponent, 1), 9)


def decimals_for_column(
    stds: np.ndarray, *, digits: int, at_most: int = 6, smallest: float = 0.0
) -> int:
    """Return the decimals that show some digits of the smallest standard error, 1 to `at_most`.

    Errors below `smallest` count as that. All rows of a column share the decimals, as columns of
    one unit do; 3 where no error is known.
    """
    known_stds = stds[np.isfinite(stds) & (stds > 0)]
    if not known_stds.size:
        return 3
    shown_std = max(float(known_stds.min()), smallest)
    return min(max(decimals_for_std(shown_std) + digits - 2, 1), at_most)


def format_with_std(value: float, std: float, decimals: int) -> str:
    """Write a value with its standard error."""
    return f"{format_fixed(value, decimals)} ±\N{NO-BREAK SPACE}{format_std(std, decimals)}"


def format_std(std: float, decimals: int) -> str:
    """Write a standard error; one that rounds to zero as less than one of the last decimal."""
    error = format_fixed(std, decimals)
    if std > 0 and math.isfinite(std) and float(error) == 0:
        return f"<{10.0**-decimals:.{decimals}f}"
    return error


def ratio_db(ratio: float) -> float:
    """Convert one power ratio to dB; minus infinity for none at all."""
    return float(to_decibels(ratio)) if ratio > 0 else -math.inf


def power_to_dbm_or_dbfs(power: np.ndarray, sample_units: str) -> np.ndarray:
    """Convert power to dBm for samples in sqrt(W), else to dB relative to full scale."""
    floor = np.maximum(np.asarray(power, dtype=float), _SMALLEST_POWER)
    return to_decibels(floor) + (30.0 if is_absolute(sample_units) else 0.0)


def sample_unit_symbol(sample_units: object) -> str:
    """Return the unit of samples as figures show it."""
    return "√W" if is_absolute(sample_units) else "full scale"


def power_level_unit(sample_units: str) -> str:
    """Return the unit of `power_to_dbm_or_dbfs` for samples in these units."""
    return "dBm" if is_absolute(sample_units) else "dBFS"


def format_quantity(amount: float, unit: str | None, digits: int = 4) -> str:
    """Write a number in the usual unit of its dimension: 77 GHz, 12 dBm, 30°.

    `unit` is the suffix of the field's name, a key of `DIMENSIONS`.
    """
    kind = DIMENSIONS[unit]
    if unit in ("rad", "rad_per_s"):
        return f"{format_number(math.degrees(amount), digits)}°{'/s' * (unit != 'rad')}"
    if kind.db_units and 0 < amount < math.inf:
        symbol, zero_db = kind.db_units[0]
        return f"{format_number(round(ratio_db(amount) - zero_db, 3), digits)} {symbol}"
    if not kind.si_unit:
        return format_probability(amount) if 0 < amount < 1e-3 else format_number(amount, digits)
    factors = [
        (name, factor)
        for name in kind.scaled_units
        if (factor := _unit_to_base_factor(name, kind.si_unit))
    ]
    # 0.6 m, but 150 MHz.
    min_amount = 10.0 if kind.si_unit == "m" else 1.0
    fitting_units = [pair for pair in factors if pair[1] <= abs(amount) * min_amount * (1 + 1e-9)]
    name, factor = (fitting_units or factors[-1:])[0] if amount else (kind.si_unit, 1.0)
    return f"{format_number(amount / factor, digits)} {format_unit(name)}"


def format_si(amount: float, unit: str, digits: int = 6) -> str:
    """Write a quantity for a message in ASCII, as settings files accept it: 20 us, 30 MHz/us.

    `unit` is the suffix of the field's name, a key of `DIMENSIONS`.
    """
    if not math.isfinite(amount):
        return f"{amount} {DIMENSIONS[unit].si_unit}"
    text = format_quantity(float(amount), unit, digits)
    for symbol, letters in (("µ", "u"), (MINUS_SIGN, "-"), ("²", "^2"), ("³", "^3"), ("°", " deg")):
        text = text.replace(symbol, letters)
    return text


def format_unit(unit: str) -> str:
    """Write a unit of settings files with typographic symbols: MHz/µs, m², °."""
    unit = re.sub(r"\bu(?=[smW]\b)", "µ", unit)
    return unit.replace("^2", "²").replace("^3", "³").replace("deg", "°")


def format_number_ranges(noun: str, numbers: Iterable[int]) -> str:
    """Write ascending numbers with their noun: `frames 3, 7 to 9 and 12`."""
    values = np.fromiter(numbers, np.int64)
    cuts = np.flatnonzero(np.diff(values) > 1) + 1
    runs = [(int(run[0]), int(run[-1])) for run in np.split(values, cuts) if run.size]
    parts = [f"{low}" if low == high else f"{low} to {high}" for low, high in runs[:_MAX_RANGES]]
    if len(runs) > _MAX_RANGES:
        parts.append(f"{len(runs) - _MAX_RANGES} more places")
    text = ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + "".join(parts[-1:])
    return f"{noun}{'s' if values.size > 1 else ''} {text}"


def join_names(names: Iterable[str], *, at_most: int = 16) -> str:
    """Join names with commas, and count those that are left out: `a, b and 7 more`."""
    names = list(names)
    more = f" and {len(names) - at_most} more" if len(names) > at_most else ""
    return ", ".join(names[:at_most]) + more


def _unit_to_base_factor(name: str, base: str) -> float | None:
    """Return the size of a unit in base units; None if the two differ by more than prefixes."""
    parts = [
        _FACTORS.get(part.removesuffix(base_part))
        for part, base_part in zip(name.split("/"), base.split("/"), strict=True)
    ]
    above, below = parts[0], parts[1] if len(parts) > 1 else 1.0
    return None if above is None or below is None else above / below
