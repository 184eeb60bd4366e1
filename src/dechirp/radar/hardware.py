"""Hardware: transmit power, antenna gains, receiver noise and losses."""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.patterns.base import Pattern


@frozen_dataclass
class Hardware:
    """Power, gain, noise and loss as absolute, linear values."""

    transmit_power_w: float
    """Power into the transmit antenna."""
    antenna_gain: float | None = None
    """Gain of the transmit and of the receive antenna, each, in all directions, as a ratio (dBi
    in files); used only for antennas without a pattern, and required for them."""
    tx_pattern: Pattern | None = None
    """Antenna pattern of each transmitter."""
    rx_pattern: Pattern | None = None
    """Antenna pattern of each receiver."""
    noise_factor: float
    """Noise factor of the receiver, a ratio of at least 1 (noise figure in dB in files)."""
    loss: float = 1.0
    """Transmit and receive losses together, a ratio of at least 1."""

    def __post_init__(self) -> None:
        # The bounds span a leaking mixer to the largest dish: a value outside has a wrong unit.
        check_positive_fields(self, "transmit_power_w", at_least=1e-15, at_most=1e12)
        if self.antenna_gain is not None:
            check_positive_fields(self, "antenna_gain", at_least=1e-6, at_most=1e12)
        for name in ("tx_pattern", "rx_pattern"):
            self._check_pattern_or_antenna_gain(name)
        check_positive_fields(self, "noise_factor", "loss")
        for name in ("noise_factor", "loss"):
            if getattr(self, name) < 1:
                raise InvalidSetting(
                    f"Hardware.{name}",
                    value=f"{getattr(self, name):.4g}",
                    expected="at least 0 dB",
                    fix=f"give a {name.replace('_', ' ')} without a minus sign, such as 3 dB"
                    f" ({name}=2 in Python, a ratio of 1 or more)",
                )
        check_positive_fields(self, "noise_factor", "loss", at_least=1.0, at_most=1e12)

    def _check_pattern_or_antenna_gain(self, pattern_field: str) -> None:
        pattern = getattr(self, pattern_field)
        if pattern is None and self.antenna_gain is None:
            raise InvalidSetting(
                "Hardware.antenna_gain",
                value=f"missing, and {pattern_field} as well",
                expected="a gain for antennas without a pattern",
                fix=f"give antenna_gain, or {pattern_field}",
            )
        if not (pattern is None or isinstance(pattern, Pattern)):
            raise InvalidSetting(
                f"Hardware.{pattern_field}",
                value=pattern,
                expected=f"a pattern, one of {', '.join(Pattern.members())}",
                fix="give one gain in all directions as antenna_gain",
            )

    @property
    def eirp_w(self) -> float:
        """Effective isotropic radiated power: transmit power times the peak gain."""
        return float(self.transmit_power_w * self.tx_gain())

    def tx_gain(
        self, azimuth_rad: ArrayLike | None = None, elevation_rad: ArrayLike | None = None
    ) -> np.ndarray:
        """Return the power gain of a transmit antenna towards directions, a ratio.

        Directions are in the axes of the radar and of any shapes that broadcast. Without
        directions: the peak gain; without an elevation: the gain in the horizontal plane.
        """
        return self._pattern_or_constant_gain(self.tx_pattern, azimuth_rad, elevation_rad)

    def rx_gain(
        self, azimuth_rad: ArrayLike | None = None, elevation_rad: ArrayLike | None = None
    ) -> np.ndarray:
        """Return the power gain of a receive antenna towards directions, as `tx_gain`."""
        return self._pattern_or_constant_gain(self.rx_pattern, azimuth_rad, elevation_rad)

    def _pattern_or_constant_gain(
        self,
        pattern: Pattern | None,
        azimuth_rad: ArrayLike | None,
        elevation_rad: ArrayLike | None,
    ) -> np.ndarray:
        if azimuth_rad is None and elevation_rad is None:
            return np.asarray(self.antenna_gain if pattern is None else pattern.peak_gain)
        azimuth = np.asarray(0.0 if azimuth_rad is None else azimuth_rad)
        elevation = np.asarray(0.0 if elevation_rad is None else elevation_rad)
        if pattern is not None:
            return pattern.gain_towards(azimuth, elevation)
        return np.full(np.broadcast_shapes(azimuth.shape, elevation.shape), self.antenna_gain)
