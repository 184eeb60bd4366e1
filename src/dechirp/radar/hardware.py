"""What the electronics send and add."""

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value


@value
class Hardware:
    """Power, gain, noise and loss, as absolute and linear numbers."""

    transmit_power_w: float
    """Power into the transmit antenna."""
    antenna_gain: float
    """Gain of the transmit and of the receive antenna, each, as a ratio (dBi in files)."""
    noise_factor: float
    """Noise added by the receiver, a ratio of at least 1 (the noise figure in dB in files)."""
    loss: float = 1.0
    """Losses on the way out and in together, a ratio of at least 1."""

    def __post_init__(self) -> None:
        # Wider than from a leaking mixer to the largest dish: outside, a unit is wrong.
        positive(self, "transmit_power_w", at_least=1e-15, at_most=1e12)
        positive(self, "antenna_gain", at_least=1e-6, at_most=1e12)
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

    @property
    def eirp_w(self) -> float:
        """Radiated power times gain: what the regulator limits."""
        return self.transmit_power_w * self.antenna_gain
