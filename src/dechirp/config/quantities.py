"""Numbers with units as text, to SI and back: `77 GHz`, `20 MHz/us`, `12 dBm`, `6 dB`."""

import math
import re
from decimal import Decimal

from dechirp.config.nearest import nearest
from dechirp.config.shown import shown
from dechirp.core.errors import InvalidSetting
from dechirp.core.kinds import KINDS, Kind

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
        Suffix of the field's name, a key of `core.kinds.KINDS`, as `hz`; None: a ratio.
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
