"""Units of settings files: a registry of pint with only these definitions.

The default registry of pint would read 12 dBi as deci-biots and MS/s as mega-siemens.
"""

import re
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pint

UNIT_DEFINITIONS = {
    "s": "[time]",
    "s2": "s ** 2",
    "s3": "s ** 3",
    "ms": "1e-3 s",
    "us": "1e-6 s",
    "ns": "1e-9 s",
    "ps": "1e-12 s",
    "fs": "1e-15 s",
    "min": "60 s",
    "h": "3600 s",
    "Hz": "1 / s",
    "kHz": "1e3 Hz",
    "MHz": "1e6 Hz",
    "GHz": "1e9 Hz",
    "THz": "1e12 Hz",
    "S": "[]",  # a sample: MS/s is MHz
    "kS": "1e3 S",
    "MS": "1e6 S",
    "GS": "1e9 S",
    "m": "[length]",
    "km": "1e3 m",
    "cm": "1e-2 m",
    "mm": "1e-3 m",
    "um": "1e-6 m",
    "nm": "1e-9 m",
    "m2": "m ** 2",
    "cm2": "1e-4 m2",
    "m3": "m ** 3",
    "mph": "0.44704 m / s",
    "W": "[power]",
    "kW": "1e3 W",
    "mW": "1e-3 W",
    "uW": "1e-6 W",
    "nW": "1e-9 W",
    "pW": "1e-12 W",
    "kg": "[mass]",
    "g": "1e-3 kg",
    "Pa": "[pressure]",
    "hPa": "100 Pa",
    "kPa": "1e3 Pa",
    "K": "[temperature]",
    "rad": "[angle]",
    "mrad": "1e-3 rad",
    "deg": "0.017453292519943295769237 rad",
    "bit": "[information]",
    "kbit": "1e3 bit",
    "Mbit": "1e6 bit",
    "Gbit": "1e9 bit",
    "B": "8 bit",
    "kB": "1e3 B",
    "MB": "1e6 B",
    "GB": "1e9 B",
    "KiB": "1024 B",
    "MiB": "1048576 B",
    "GiB": "1073741824 B",
}
"""Units defined by earlier ones; settings may divide one by another."""

_MULTIPLE = re.compile(r"(?P<number>[\d.e-]+) (?P<unit>\w+)")


def convert_unit(number: Decimal, unit: str, target_unit: str) -> Decimal | None:
    """Convert a number to `target_unit`; None if `unit` is unknown or of another dimension.

    Decimal arithmetic makes 7.776 mm the float nearest to 0.007776 m.
    """
    # pint itself would accept plurals such as mms.
    if not all(part in UNIT_DEFINITIONS for part in unit.split("/")):
        return None
    scale, target = _scale_of_unit(unit), _scale_of_unit(target_unit)
    if scale.bases == target.bases:  # most are: pint takes 0.2 s to import
        return number * (scale.factor * target.divisor) / (scale.divisor * target.factor)
    import pint

    try:
        return Decimal(_pint_registry().convert(number, unit, target_unit))
    except pint.DimensionalityError:
        return None


class _Scale(NamedTuple):
    """Unit as a multiple of other units; factor and divisor are apart, as 1/3600 is not exact."""

    factor: Decimal
    divisor: Decimal
    bases: tuple[str, ...]
    """Names for each part of A or A/B, that are no multiples of other units."""


@cache
def _scale_of_unit(unit: str) -> _Scale:
    scales, bases = [Decimal(1), Decimal(1)], []
    for index, name in enumerate(unit.split("/")):
        base = name
        while multiple := _MULTIPLE.fullmatch(UNIT_DEFINITIONS[base]):
            scales[min(index, 1)] *= Decimal(multiple["number"])
            base = multiple["unit"]
        bases.append(base)
    return _Scale(scales[0], scales[1], tuple(bases))


def units_of_same_dimension(si_unit: str) -> list[tuple[tuple[str, ...], ...]]:
    """Return the units of the dimension of an SI unit: names for each part of A or A/B."""
    registry, target = _pint_registry(), _pint_registry().get_dimensionality(si_unit)
    names_by_dimension: dict[Any, list[str]] = {}
    for name in UNIT_DEFINITIONS:
        names_by_dimension.setdefault(registry.get_dimensionality(name), []).append(name)
    plain_units: list[tuple[tuple[str, ...], ...]] = [
        (tuple(names),) for dimension, names in names_by_dimension.items() if dimension == target
    ]
    quotients: list[tuple[tuple[str, ...], ...]] = [
        (tuple(numerators), tuple(denominators))
        for dimension, numerators in names_by_dimension.items()
        for denominator, denominators in names_by_dimension.items()
        if denominator and dimension / denominator == target
    ]
    return plain_units + quotients


@cache
def _pint_registry() -> "pint.UnitRegistry[Decimal]":
    import pint

    registry: pint.UnitRegistry[Decimal] = pint.UnitRegistry(None, non_int_type=Decimal)
    registry.load_definitions([f"{name} = {meaning}" for name, meaning in UNIT_DEFINITIONS.items()])
    return registry
