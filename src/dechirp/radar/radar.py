"""The radar: what it sends, where its antennas are, what its electronics do."""

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.array import Array
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware


@value
class Radar:
    """Everything that simulation and processing know of a radar."""

    frame: Frame
    array: Array = Array()
    hardware: Hardware | None = None
    """None where it is not known, as for most recordings: no absolute powers then."""

    def __post_init__(self) -> None:
        if len(self.array.tx_m) != 1:
            raise InvalidSetting(
                "Radar.array",
                got=f"{len(self.array.tx_m)} transmitters",
                need="1 transmitter: transmitters that take turns are not supported yet",
                fix="Keep one of array.tx; every receiver may stay.",
            )

    @property
    def integration_gain(self) -> float:
        """Ratio by which range, Doppler and receivers together raise the signal over noise.

        N M n_rx without windows. Half of it for real samples: noise of both halves of the
        spectrum lies in the half that is kept (Richards 2014).
        """
        chirp = self.frame.chirp
        gain = chirp.n_samples * self.frame.n_chirps * self.array.n_rx
        return gain if chirp.sampling == "complex" else gain / 2

    def known_hardware(self) -> Hardware:
        """The hardware, or an `InvalidSetting` that says what needs it."""
        if self.hardware is None:
            raise InvalidSetting(
                "Radar.hardware",
                got="none",
                need="given: echo and noise powers follow from it",
                fix="Give transmit_power, antenna_gain and noise_factor.",
            )
        return self.hardware
