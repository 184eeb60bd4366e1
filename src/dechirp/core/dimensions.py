"""Physical dimensions by the unit suffix of a name: `slope_hz_per_s` is a slope in Hz/s."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Dimension:
    """Physical dimension of the fields with one unit suffix, and its units."""

    description: str
    """Noun with an example, for error messages."""
    si_unit: str = ""
    """SI unit of the suffix; empty for pure numbers."""
    scaled_units: tuple[str, ...] = ()
    """Units for output in falling order; numbers use the first that does not exceed them."""
    other_units: tuple[str, ...] = ()
    """Further units that are read, and offered in messages."""
    db_units: tuple[tuple[str, float], ...] = ()
    """Logarithmic units, each with the level of its zero relative to the SI unit."""
    offset_units: tuple[tuple[str, str], ...] = ()
    """Units of the same size with another zero, each with its offset."""
    fraction_units: tuple[tuple[str, str], ...] = ()
    """Units of pure numbers, each with its value."""

    @property
    def noun(self) -> str:
        """Noun without the example."""
        return self.description.partition(", such as ")[0]

    @property
    def units_for_messages(self) -> tuple[str, ...]:
        """Units that messages offer."""
        named = (*self.db_units, *self.offset_units, *self.fraction_units)
        return (*(name for name, _ in named), *self.scaled_units, *self.other_units)


DIMENSIONS = {
    "hz": Dimension(
        "a frequency, such as 77 GHz", "Hz", ("GHz", "MHz", "kHz", "Hz"), ("MS/s", "kS/s")
    ),
    "hz_per_s": Dimension(
        "a slope, such as 20 MHz/us", "Hz/s", ("MHz/us", "kHz/us", "Hz/s"), ("GHz/ms", "GHz/s")
    ),
    "s": Dimension("a time, such as 35 us", "s", ("s", "ms", "us", "ns"), ("min", "h")),
    "m": Dimension("a length, such as 50 m", "m", ("m", "mm", "um"), ("km", "cm")),
    "m_per_s": Dimension(
        "a velocity, such as 10 m/s", "m/s", ("m/s",), ("km/h", "mph", "mm/s", "mm/h")
    ),
    "m2_per_s3": Dimension("an acceleration density, such as 1 m^2/s^3", "m^2/s^3", ("m^2/s^3",)),
    "m_per_s2": Dimension("an acceleration, such as 3 m/s^2", "m/s^2", ("m/s^2",), ("mm/s^2",)),
    "m2": Dimension("a radar cross section, such as 10 dBsm", "m^2", ("m^2",), (), (("dBsm", 0),)),
    "w": Dimension(
        "a power, such as 12 dBm", "W", ("W", "mW", "uW", "nW"), (), (("dBm", -30), ("dBW", 0))
    ),
    "rad": Dimension("an angle, such as 30 deg", "rad", ("rad",), ("deg", "mrad")),
    "rad_per_s": Dimension("a rate of turn, such as 20 deg/s", "rad/s", ("rad/s",), ("deg/s",)),
    "k": Dimension(
        "a temperature, such as 15 degC", "K", ("K",), offset_units=(("degC", "273.15"),)
    ),
    "pa": Dimension("a pressure, such as 1013 hPa", "Pa", ("hPa", "Pa"), ("kPa",)),
    "kg_per_m3": Dimension("a density, such as 7.5 g/m^3", "kg/m^3", ("kg/m^3", "g/m^3")),
    "per_hz": Dimension("a spectral density, such as -90 dBc/Hz", db_units=(("dBc/Hz", 0),)),
    "bits_per_s": Dimension(
        "a data rate, such as 1 Gbit/s", "bit/s", ("Gbit/s", "Mbit/s", "bit/s")
    ),
    "bytes": Dimension(
        "a size, such as 4 MiB", "B", ("B",), ("KiB", "MiB", "GiB", "kB", "MB", "GB")
    ),
    "probability": Dimension("a bare number, such as 1e-6"),
    "number": Dimension("a bare number, such as 0.5"),
    "clock_error": Dimension(
        "a relative error, such as 50 ppm or 50e-6",
        fraction_units=(("ppm", "1e-6"), ("ppb", "1e-9")),
    ),
    None: Dimension("a number or a ratio, such as 4 or 6 dB", db_units=(("dB", 0), ("dBi", 0))),
}
"""Dimensions by the suffix of a field's name; None is a ratio."""

_SUFFIXES = sorted((f"_{unit}" for unit in DIMENSIONS if unit), key=len, reverse=True)
_NUMBER_NAMES = (
    *("per_frame", "share", "rank", "n_smallest", "n_largest", "usable_band", "corner"),
    *("axis", "damping", "permittivity", "relative_drift", "taper"),
)
"""Ends of the names of numbers that are no ratios of powers, so that decibels are wrong."""


def split_unit_suffix(name: str) -> tuple[str, str | None]:
    """Split the name of a number into the name without its unit and a key of `DIMENSIONS`."""
    if name.endswith(("probability", "probabilities", "confidence")):
        return name, "probability"
    if name.endswith(_NUMBER_NAMES):
        return name, "number"
    if name.endswith("clock_error"):
        return name, "clock_error"
    for suffix in _SUFFIXES:
        if name.endswith(suffix):
            return name.removesuffix(suffix), suffix[1:]
    return name, None
