"""Quantities as text, to SI and back: `77 GHz`, `20 MHz/us`, `12 dBm`, `6 dB`."""

import math
import re
from decimal import Decimal

from dechirp.config.units import convert_unit
from dechirp.core.dimensions import DIMENSIONS, Dimension
from dechirp.core.errors import InvalidSetting, quote_for_message
from dechirp.core.suggestions import nearest_name

_GRAMMAR = re.compile(
    r"(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>[A-Za-z]\S*)?", re.ASCII
)
_SPELLINGS = str.maketrans({"µ": "u", "μ": "u", "²": "2", "°": "deg"})
_MAX_LENGTH = 100  # characters: more than any number needs, and quick to parse


def parse_quantity(text: str, unit_suffix: str | None, *, setting: str = "quantity") -> float:
    """Convert `number [unit]` to SI.

    Parameters
    ----------
    text : str
        Such as `77 GHz`. 0 needs no unit; a ratio is bare or in dB; a probability is bare.
    unit_suffix : str, optional
        Suffix of the field's name, a key of `core.dimensions.DIMENSIONS`, such as `hz`; None for
        a ratio.
    setting : str
        Name of the setting in the error.

    Raises
    ------
    InvalidSetting
        If the text has another form, or exceeds the range of floats.
    """
    kind = DIMENSIONS[unit_suffix]
    match = None
    if len(text) <= _MAX_LENGTH:
        match = _GRAMMAR.fullmatch(text.strip().translate(_SPELLINGS))
    if match is None:
        raise InvalidSetting(
            setting,
            value=quote_for_message(text),
            expected=kind.description,
            fix=_suggest_valid_units(text, "", kind),
        )
    symbol = (match["unit"] or "").replace("^", "")
    number = _convert_to_si_or_none(match["number"], symbol, kind)
    if number is None:
        fix = _suggest_valid_units(text, match["unit"] or "", kind)
        raise InvalidSetting(
            setting, value=quote_for_message(text), expected=kind.description, fix=fix
        )
    if math.isinf(number):
        raise InvalidSetting(
            setting,
            value=quote_for_message(text),
            expected="a number below 1e308",
            fix="check the exponent",
        )
    return number


def split_number_and_unit(text: str, unit_suffix: str | None) -> tuple[Decimal, str]:
    """Split a quantity that `parse_quantity` accepts into its number and its unit as written."""
    parse_quantity(text, unit_suffix)
    match = _GRAMMAR.fullmatch(text.strip().translate(_SPELLINGS))
    assert match is not None
    return Decimal(match["number"]), match["unit"] or ""


def convert_quantity_to_unit(
    target_unit: str, text: str, unit_suffix: str | None
) -> Decimal | None:
    """Convert a quantity to another unit of its dimension; None if impossible, as 0 W to dBm.

    Exact between units that are multiples of one another, else rounded to twelve digits.
    """
    number, own_symbol = split_number_and_unit(text, unit_suffix)
    if own_symbol == target_unit:
        return number
    kind, si_value = DIMENSIONS[unit_suffix], parse_quantity(text, unit_suffix)
    levels, zeros = dict(kind.db_units), dict(kind.offset_units)
    fractions = dict(kind.fraction_units)
    if target_unit in fractions:
        return Decimal(repr(si_value)) / Decimal(fractions[target_unit])
    if target_unit in levels:
        return (
            Decimal(f"{10 * math.log10(si_value) - levels[target_unit]:.12g}")
            if si_value > 0
            else None
        )
    if target_unit in zeros:
        return Decimal(repr(si_value)) - Decimal(zeros[target_unit])
    if own_symbol in levels or own_symbol in zeros or not target_unit:
        number, own_symbol = Decimal(f"{si_value:.12g}"), kind.si_unit
    if not own_symbol or not target_unit:
        return number  # without a unit, or 0, which is the same in all units
    return convert_unit(number, own_symbol.replace("^", ""), target_unit.replace("^", ""))


def convert_difference_to_unit(target_unit: str, text: str, unit_suffix: str | None) -> Decimal:
    """Convert a difference of quantities that are given in a unit to a number.

    Differences of levels (dBsm, dBm) are in dB, of degC in K; others in the unit itself.

    Raises
    ------
    InvalidSetting
        If the text is not such a difference.
    """
    kind = DIMENSIONS[unit_suffix]
    levels, zeros = dict(kind.db_units), dict(kind.offset_units)
    if target_unit in levels or target_unit in zeros:
        difference_symbol = "dB" if target_unit in levels else "K"
        match = _GRAMMAR.fullmatch(text.strip()) if len(text) <= _MAX_LENGTH else None
        if match is not None and match["unit"] == difference_symbol:
            return Decimal(match["number"])
        raise InvalidSetting(
            "quantity",
            value=quote_for_message(text),
            expected=f"a difference of two values in {target_unit}, such as 2 {difference_symbol}",
            fix=f"write a number and {difference_symbol}",
        )
    _, own_symbol = split_number_and_unit(text, unit_suffix)
    number = convert_quantity_to_unit(target_unit, text, unit_suffix)
    if own_symbol in levels or own_symbol in zeros or number is None:
        raise InvalidSetting(
            "quantity",
            value=quote_for_message(text),
            expected=f"a difference, {kind.description}"
            if target_unit
            else "a number without unit, like the values",
            fix="write it in the unit of the values",
        )
    return number


def format_shortest_decimal(number: Decimal) -> str:
    """Write a number in the shortest form that `parse_quantity` accepts."""
    number = number.normalize()
    return f"{number:f}" if -5 <= number.adjusted() <= 15 else f"{number:e}"


def format_exact_quantity(number: float, unit_suffix: str | None) -> str:
    """Write a number with unit so that `parse_quantity` returns exactly the same float.

    In dB if the dimension has a logarithmic unit and six digits suffice, else in the largest
    unit that does not exceed the number.
    """
    kind = DIMENSIONS[unit_suffix]
    number = float(number)
    for text in _rounded_quantity_texts(number, unit_suffix, kind):
        if parse_quantity(text, unit_suffix) == number:
            return text
    digits = Decimal(repr(number))
    if not kind.scaled_units:
        return repr(number)
    # Moving the decimal point of the shortest digits is exact.
    sizes = {
        name: Decimal(repr(parse_quantity(f"1 {name}", unit_suffix))) for name in kind.scaled_units
    }
    fitting_units = [name for name, size in sizes.items() if size <= abs(digits)]
    symbol = (
        fitting_units[0] if fitting_units else kind.scaled_units[-1] if number else kind.si_unit
    )
    scaled = (digits / sizes[symbol]).normalize()
    is_short = -7 <= scaled.adjusted() <= 15
    return f"{scaled:f} {symbol}" if is_short else f"{scaled:e} {symbol}"


def _convert_to_si_or_none(number_text: str, unit: str, dimension: Dimension) -> float | None:
    """Convert to SI; None if the unit does not fit, infinite beyond the range of floats."""
    number = float(number_text)
    if not unit:
        return number if number == 0 or not dimension.si_unit else None
    for level, zero_db in dimension.db_units:
        if unit == level:
            return _level_to_ratio(number, zero_db)
    for name, zero in dimension.offset_units:
        if unit == name and math.isfinite(number):
            return float(Decimal(number_text) + Decimal(zero))
    fraction = dict(dimension.fraction_units).get(unit)
    if not (dimension.si_unit or fraction):
        return None
    # Decimal has larger exponents than float.
    exact = Decimal(number_text) if math.isfinite(number) and number else Decimal(0)
    converted = (
        exact * Decimal(fraction)
        if fraction
        else convert_unit(exact, unit, dimension.si_unit.replace("^", ""))
    )
    if converted is None:
        return None
    return float(converted) if math.isfinite(number) else number


def _level_to_ratio(level_db: float, zero_level_db: float) -> float:
    try:
        return float(10 ** ((level_db + zero_level_db) / 10))
    except OverflowError:
        return math.inf


def _rounded_quantity_texts(
    number: float, unit_suffix: str | None, dimension: Dimension
) -> list[str]:
    """Return short texts that equal the number or approximate it."""
    if dimension.db_units and 1e-300 < number < 1e300:  # rounding up could overflow beyond
        symbol, zero_db = dimension.db_units[0]
        return [f"{10 * math.log10(number) - zero_db:.6g} {symbol}"]
    if unit_suffix in ("rad", "rad_per_s") and abs(number) < 1e3:
        return [f"{math.degrees(number):.12g} {dimension.other_units[0]}"]
    return []


def _suggest_valid_units(text: str, wrong_unit: str, dimension: Dimension) -> str:
    if not dimension.units_for_messages:
        return "omit the unit" if wrong_unit else "write it without a unit"
    units = f"units that fit: {', '.join(dimension.units_for_messages)}"
    if "," in text:
        return f"write the decimal separator as a point; {units}"
    suggestion = nearest_name(wrong_unit, dimension.units_for_messages) if wrong_unit else None
    return f"did you mean {suggestion}? {units}" if suggestion else units
