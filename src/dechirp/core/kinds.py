"""What numbers are of, by the suffix of their names: `slope_hz_per_s` is a slope, in Hz/s."""

from dataclasses import dataclass


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

_SUFFIXES = sorted((f"_{unit}" for unit in KINDS if unit), key=len, reverse=True)


def split(name: str) -> tuple[str, str | None]:
    """Name of a number without its unit, and the unit: a key of `KINDS`."""
    if name.endswith(("probability", "probabilities", "confidence")):
        return name, "probability"
    for suffix in _SUFFIXES:
        if name.endswith(suffix):
            return name.removesuffix(suffix), suffix[1:]
    return name, None
