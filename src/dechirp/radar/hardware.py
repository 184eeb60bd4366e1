"""What the electronics send and add, and what the antennas make of it."""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.patterns.base import Pattern


@value
class Hardware:
    """Power, gain, noise and loss, as absolute and linear numbers."""

    transmit_power_w: float
    """Power into the transmit antenna."""
    antenna_gain: float | None = None
    """Gain of the transmit and of the receive antenna, each, in all directions, as a ratio
    (dBi in files); needed by those that have no pattern, and only used by them."""
    tx_pattern: Pattern | None = None
    """How each transmit antenna sees directions."""
    rx_pattern: Pattern | None = None
    """How each receive antenna sees directions."""
    noise_factor: float
    """Noise added by the receiver, a ratio of at least 1 (the noise figure in dB in files)."""
    loss: float = 1.0
    """Losses on the way out and in together, a ratio of at least 1."""

    def __post_init__(self) -> None:
        # Wider than from a leaking mixer to the largest dish: outside, a unit is wrong.
        positive(self, "transmit_power_w", at_least=1e-15, at_most=1e12)
        if self.antenna_gain is not None:
            positive(self, "antenna_gain", at_least=1e-6, at_most=1e12)
        for name in ("tx_pattern", "rx_pattern"):
            self._check_pattern(name)
        positive(self, "noise_factor", "loss")
        for name in ("noise_factor", "loss"):
            if getattr(self, name) < 1:
                raise InvalidSetting(
                    f"Hardware.{name}",
                    got=f"{getattr(self, name):.4g}",
                    need="a ratio of at least 1 (0 dB)",
                    fix="A loss of 3 dB is written 3 dB, not -3 dB.",
                )
        positive(self, "noise_factor", "loss", at_least=1.0, at_most=1e12)

    def _check_pattern(self, name: str) -> None:
        pattern = getattr(self, name)
        if pattern is None and self.antenna_gain is None:
            raise InvalidSetting(
                "Hardware.antenna_gain",
                got=f"none, and no {name}",
                need="given for antennas without a pattern",
                fix=f"Give antenna_gain, or {name}.",
            )
        if not (pattern is None or isinstance(pattern, Pattern)):
            raise InvalidSetting(
                f"Hardware.{name}",
                got=pattern,
                need=f"a pattern, one of {', '.join(Pattern.members())}",
                fix="Give one gain in all directions as antenna_gain.",
            )

    @property
    def eirp_w(self) -> float:
        """Radiated power times the largest gain: what the regulator limits."""
        return float(self.transmit_power_w * self.tx_gain())

    def tx_gain(
        self, azimuth_rad: ArrayLike | None = None, elevation_rad: ArrayLike | None = None
    ) -> np.ndarray:
        """Power gain of a transmit antenna towards directions, a ratio.

        In the axes of the radar, any shapes that broadcast; the peak without any, in the
        horizon without an elevation.
        """
        return self._gain(self.tx_pattern, azimuth_rad, elevation_rad)

    def rx_gain(
        self, azimuth_rad: ArrayLike | None = None, elevation_rad: ArrayLike | None = None
    ) -> np.ndarray:
        """Power gain of a receive antenna towards directions, as `tx_gain`."""
        return self._gain(self.rx_pattern, azimuth_rad, elevation_rad)

    def _gain(
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
