"""The units that settings files may use: our own few, and nothing that comes with pint.

Its default registry would read 12 dBi as deci-biots and MS/s as mega-siemens.
"""

from decimal import Decimal
from functools import cache
from typing import Any

import pint

DEFINITIONS = {
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
"""Each unit by the ones before it; a setting may divide one by another."""


def convert(number: Decimal, unit: str, wanted: str) -> Decimal | None:
    """Convert to the unit wanted, or give None where `unit` is unknown or of another kind.

    Decimal, so that 7.776 mm is the float nearest to 0.007776 m.
    """
    # pint alone would take a plural, mms, for mm.
    if not all(part in DEFINITIONS for part in unit.split("/")):
        return None
    try:
        return Decimal(_registry().convert(number, unit, wanted))
    except pint.DimensionalityError:
        return None


def alike(base: str) -> list[tuple[tuple[str, ...], ...]]:
    """Units of the kind of a base unit: names that may stand at each place of A or A/B."""
    registry, wanted = _registry(), _registry().get_dimensionality(base)
    of_kind: dict[Any, list[str]] = {}
    for name in DEFINITIONS:
        of_kind.setdefault(registry.get_dimensionality(name), []).append(name)
    alone: list[tuple[tuple[str, ...], ...]] = [
        (tuple(names),) for kind, names in of_kind.items() if kind == wanted
    ]
    over: list[tuple[tuple[str, ...], ...]] = [
        (tuple(above), tuple(below))
        for kind, above in of_kind.items()
        for other, below in of_kind.items()
        if other and kind / other == wanted
    ]
    return alone + over


@cache
def _registry() -> "pint.UnitRegistry[Decimal]":
    registry: pint.UnitRegistry[Decimal] = pint.UnitRegistry(None, non_int_type=Decimal)
    registry.load_definitions([f"{name} = {meaning}" for name, meaning in DEFINITIONS.items()])
    return registry
