"""Numbers with units as text, to SI and back: `77 GHz`, `20 MHz/us`, `12 dBm`, `6 dB`."""

import math
import re
from dataclasses import dataclass
from decimal import Decimal

from dechirp.config.nearest import nearest
from dechirp.config.shown import shown
from dechirp.core.errors import InvalidSetting


@dataclass(frozen=True)
class Kind:
    """What the fields of one unit suffix hold, and how it is written."""

    words: str
    """With an example, to follow `must be`."""
    base: str = ""
    """The SI unit of the suffix; empty where there is none."""
    scales: tuple[str, ...] = ()
    """Powers of ten of it to write numbers in, falling: the first that is not above them."""
    others: tuple[str, ...] = ()
    """Read as well, and offered in messages."""
    levels: tuple[tuple[str, float], ...] = ()
    """Units in dB, and the level of their zero over the SI unit."""
    zeros: tuple[tuple[str, str], ...] = ()
    """Units of the same size whose zero is elsewhere, and where."""

    @property
    def good(self) -> tuple[str, ...]:
        """Units to offer."""
        named = (*self.levels, *self.zeros)
        return (*(name for name, _ in named), *self.scales, *self.others)


KINDS = {
    "hz": Kind("a frequency, as 77 GHz", "Hz", ("GHz", "MHz", "kHz", "Hz"), ("MS/s", "kS/s")),
    "hz_per_s": Kind(
        "a slope, as 20 MHz/us", "Hz/s", ("MHz/us", "kHz/us", "Hz/s"), ("GHz/ms", "GHz/s")
    ),
    "s": Kind("a time, as 35 us", "s", ("s", "ms", "us", "ns"), ("min", "h")),
    "m": Kind("a length, as 50 m", "m", ("m", "mm", "um"), ("km", "cm")),
    "m_per_s": Kind("a velocity, as 10 m/s", "m/s", ("m/s",), ("km/h", "mph", "mm/s", "mm/h")),
    "m2_per_s3": Kind("an acceleration density, as 1 m^2/s^3", "m^2/s^3", ("m^2/s^3",)),
    "m_per_s2": Kind("an acceleration, as 3 m/s^2", "m/s^2", ("m/s^2",), ("mm/s^2",)),
    "m2": Kind("a radar cross section, as 10 dBsm", "m^2", ("m^2",), (), (("dBsm", 0),)),
    "w": Kind("a power, as 12 dBm", "W", ("W", "mW", "uW", "nW"), (), (("dBm", -30), ("dBW", 0))),
    "rad": Kind("an angle, as 30 deg", "rad", ("rad",), ("deg", "mrad")),
    "rad_per_s": Kind("a rate of turn, as 20 deg/s", "rad/s", ("rad/s",), ("deg/s",)),
    "k": Kind("a temperature, as 15 degC", "K", ("K",), zeros=(("degC", "273.15"),)),
    "pa": Kind("a pressure, as 1013 hPa", "Pa", ("hPa", "Pa"), ("kPa",)),
    "kg_per_m3": Kind("a density, as 7.5 g/m^3", "kg/m^3", ("kg/m^3", "g/m^3")),
    "per_hz": Kind("a spectral density, as -90 dBc/Hz", levels=(("dBc/Hz", 0),)),
    "bits_per_s": Kind("a data rate, as 1 Gbit/s", "bit/s", ("Gbit/s", "Mbit/s", "bit/s")),
    "bytes": Kind("a size, as 4 MiB", "B", ("B",), ("KiB", "MiB", "GiB", "kB", "MB", "GB")),
    "probability": Kind("a bare number, as 1e-6"),
    None: Kind("a ratio, as 4 or 6 dB", levels=(("dB", 0), ("dBi", 0))),
}
"""By the suffix of the field's name; None: a ratio."""

_GRAMMAR = re.compile(
    r"(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>[A-Za-z]\S*)?", re.ASCII
)
_SPELLINGS = str.maketrans({"µ": "u", "μ": "u", "²": "2", "°": "deg"})
_LONGEST = 100  # characters; no number needs them, and none then takes long


def quantity(text: str, unit: str | None, *, setting: str = "quantity") -> float:
    """Read `number [unit]` as SI.

    Parameters
    ----------
    text : str
        Such as `77 GHz`. 0 needs no unit; a ratio is bare or in dB; a probability is bare.
    unit : str, optional
        Suffix of the field's name: `hz`, `hz_per_s`, `s`, `m`, `m_per_s`, `m_per_s2`, `m2`,
        `m2_per_s3`, `w`, `rad`, `rad_per_s`, `k`, `pa`, `kg_per_m3`, `per_hz`, `bits_per_s`,
        `bytes`, or `probability`; None: a ratio.
    setting : str
        What a mistake calls it.

    Raises
    ------
    InvalidSetting
        If the text is anything else, or too large for a float.
    """
    kind = KINDS[unit]
    match = None
    if len(text) <= _LONGEST:
        match = _GRAMMAR.fullmatch(text.strip().translate(_SPELLINGS))
    if match is None:
        raise InvalidSetting(setting, got=shown(text), need=kind.words, fix=_fix(text, "", kind))
    symbol = (match["unit"] or "").replace("^", "")
    number = _number(match["number"], symbol, kind)
    if number is None:
        fix = _fix(text, match["unit"] or "", kind)
        raise InvalidSetting(setting, got=shown(text), need=kind.words, fix=fix)
    if math.isinf(number):
        raise InvalidSetting(
            setting, got=shown(text), need="a number below 1e308", fix="Check the exponent."
        )
    return number


def written(text: str, unit: str | None) -> tuple[Decimal, str]:
    """Split a quantity that `quantity` would read into its number and its unit as written."""
    quantity(text, unit)
    match = _GRAMMAR.fullmatch(text.strip().translate(_SPELLINGS))
    assert match is not None
    return Decimal(match["number"]), match["unit"] or ""


def number_in(symbol: str, text: str, unit: str | None) -> Decimal | None:
    """Number of a quantity in another unit of its kind; None where it has none, as 0 W in dBm.

    Exact between units that are multiples of one another, else rounded to twelve digits.
    """
    number, own = written(text, unit)
    if own == symbol:
        return number
    kind, plain = KINDS[unit], quantity(text, unit)
    levels, zeros = dict(kind.levels), dict(kind.zeros)
    if symbol in levels:
        return Decimal(f"{10 * math.log10(plain) - levels[symbol]:.12g}") if plain > 0 else None
    if symbol in zeros:
        return Decimal(repr(plain)) - Decimal(zeros[symbol])
    if own in levels or own in zeros or not symbol:
        number, own = Decimal(f"{plain:.12g}"), kind.base
    if not own or not symbol:
        return number  # without a unit, or 0, which is so in all of them
    from dechirp.config.units import convert  # as in `_number`

    return convert(number, own.replace("^", ""), symbol.replace("^", ""))


def difference_in(symbol: str, text: str, unit: str | None) -> Decimal:
    """Number of a difference of quantities that are told in a unit.

    Of levels, dBsm or dBm, it is told in dB, of degC in K; else as the quantities are.

    Raises
    ------
    InvalidSetting
        If the text is none.
    """
    kind = KINDS[unit]
    levels, zeros = dict(kind.levels), dict(kind.zeros)
    if symbol in levels or symbol in zeros:
        apart = "dB" if symbol in levels else "K"
        match = _GRAMMAR.fullmatch(text.strip()) if len(text) <= _LONGEST else None
        if match is not None and match["unit"] == apart:
            return Decimal(match["number"])
        raise InvalidSetting(
            "quantity",
            got=shown(text),
            need=f"a difference between two values in {symbol}, as 2 {apart}",
            fix=f"Write a number and {apart}.",
        )
    _, own = written(text, unit)
    number = number_in(symbol, text, unit)
    if own in levels or own in zeros or number is None:
        raise InvalidSetting(
            "quantity",
            got=shown(text),
            need=f"a difference, {kind.words}" if symbol else "a bare number, as the values are",
            fix="Write it in the unit of the values.",
        )
    return number


def digits_of(number: Decimal) -> str:
    """Write a number in the shortest way that `quantity` reads."""
    number = number.normalize()
    return f"{number:f}" if -5 <= number.adjusted() <= 15 else f"{number:e}"


def text_of(number: float, unit: str | None) -> str:
    """Text for people, which `quantity` reads back to the last bit.

    In dB where the unit has them and six digits are enough, else in the nearest scale below.
    """
    kind = KINDS[unit]
    number = float(number)
    for text in _rounded(number, unit, kind):
        if quantity(text, unit) == number:
            return text
    digits = Decimal(repr(number))
    if not kind.scales:
        return repr(number)
    # Moving the decimal point of the shortest digits is exact.
    sizes = {name: Decimal(repr(quantity(f"1 {name}", unit))) for name in kind.scales}
    fitting = [name for name, size in sizes.items() if size <= abs(digits)]
    symbol = fitting[0] if fitting else kind.scales[-1] if number else kind.base
    scaled = (digits / sizes[symbol]).normalize()
    plain = -7 <= scaled.adjusted() <= 15
    return f"{scaled:f} {symbol}" if plain else f"{scaled:e} {symbol}"


def _number(digits: str, symbol: str, kind: Kind) -> float | None:
    """SI value; None where the unit does not fit, infinite where no float is so large."""
    number = float(digits)
    if not symbol:
        return number if number == 0 or not kind.base else None
    for level, zero_db in kind.levels:
        if symbol == level:
            return _power(number, zero_db)
    for name, zero in kind.zeros:
        if symbol == name and math.isfinite(number):
            return float(Decimal(digits) + Decimal(zero))
    if not kind.base:
        return None
    from dechirp.config.units import convert  # pint takes 0.3 s; dB and bare numbers need none

    # The exponents of Decimal would go on where those of float end.
    exact = Decimal(digits) if math.isfinite(number) and number else Decimal(0)
    made = convert(exact, symbol, kind.base.replace("^", ""))
    if made is None:
        return None
    return float(made) if math.isfinite(number) else number


def _power(level_db: float, zero_db: float) -> float:
    try:
        return float(10 ** ((level_db + zero_db) / 10))
    except OverflowError:
        return math.inf


def _rounded(number: float, unit: str | None, kind: Kind) -> list[str]:
    """Short texts that may be the number, or only near it."""
    if kind.levels and 1e-300 < number < 1e300:  # rounded up, the largest would be infinite
        symbol, zero_db = kind.levels[0]
        return [f"{10 * math.log10(number) - zero_db:.6g} {symbol}"]
    if unit in ("rad", "rad_per_s") and abs(number) < 1e3:
        return [f"{math.degrees(number):.12g} {kind.others[0]}"]
    return []


def _fix(text: str, symbol: str, kind: Kind) -> str:
    if not kind.good:
        return "Leave the unit out." if symbol else "Write it without a unit."
    units = f"Units that fit: {', '.join(kind.good)}."
    if "," in text:
        return f"Write the decimal point as a point. {units}"
    meant = nearest(symbol, kind.good) if symbol else None
    return f"Did you mean {meant}? {units}" if meant else units
