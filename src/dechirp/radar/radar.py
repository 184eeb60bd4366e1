"""The radar: what it sends, where its antennas are, what its electronics do."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from dechirp.core.displayed import Displayed, Table, follows, settings
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.core.words import in_unit
from dechirp.radar.array import Array
from dechirp.radar.calibration import Calibration
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware


@value
class Radar(Displayed):
    """Everything that simulation and processing know of a radar."""

    frame: Frame
    array: Array = Array()
    hardware: Hardware | None = None
    """None where it is not known, as for most recordings: no absolute powers then."""
    calibration: Calibration | None = None
    """In files also the name of one that `dechirp calibrate` wrote; none: an ideal array."""

    def __post_init__(self) -> None:
        n_tx = len(self.array.tx_m)
        named = sorted({transmitter for slot in self.frame.slots for transmitter in slot})
        if named == list(range(n_tx)):
            if self.calibration is not None:
                self.calibration.must_fit(self.array)
            return
        every = ", ".join(map(str, range(n_tx)))
        if self.frame.multiplexing is None:
            raise InvalidSetting(
                "Radar.frame.multiplexing",
                got=f"none, with {n_tx} transmitters in the array",
                need="given where there are several: it says how they share the chirps",
                fix=f"Give multiplexing of kind tdm with order [{every}], or keep one of array.tx.",
            )
        raise InvalidSetting(
            "Radar.frame.multiplexing",
            got=f"of {len(named)} transmitter{'s' * (len(named) > 1)}:"
            f" {', '.join(map(str, named))}",
            need=f"of the {n_tx} in array.tx: {every}",
            fix="Correct the order or the code, or give the position of every transmitter in"
            " array.tx.",
        )

    @property
    def elements_m(self) -> np.ndarray:
        """Where the virtual elements are, (n_tx x n_rx, 3): the array's, as calibrated."""
        if self.calibration is None:
            return self.array.virtual_m
        return np.asarray(self.array.virtual_m + self.calibration.errors_m())

    @property
    def element_gain(self) -> np.ndarray:
        """Factors that the amplitudes of the virtual elements are to be multiplied by, complex.

        (n_tx x n_rx,); 1 without a calibration.
        """
        if self.calibration is None:
            return np.ones(self.n_channels, complex)
        return self.calibration.factors()

    def at(self, index: int) -> "Radar":
        """The radar as it is in a frame, counted from 0: with one interval, see `Frame.at`."""
        frame = self.frame.at(index)
        return self if frame is self.frame else replace(self, frame=frame)

    def one_sided(self) -> "Radar":
        """The radar as if it sent the rising ramps of its triangles alone."""
        frame = replace(self.frame, modulation=None, interval_s=self.frame.repetition_s)
        return replace(self, frame=frame)

    @property
    def n_channels(self) -> int:
        """Pairs of a transmitter and a receiver, each of which sees the whole scene."""
        return self.array.n_rx * len(self.array.tx_m)

    @property
    def n_summed(self) -> int:
        """Maps whose powers the range-Doppler map adds: of every slot of a round and receiver."""
        return self.frame.n_slots * self.array.n_rx

    @property
    def integration_gain(self) -> float:
        """Ratio by which range, Doppler and channels together raise the signal over noise.

        N n_rx times the ramps that all transmitters send in a frame, without windows: N M n_tx
        n_rx where they take turns, n_slots times that where all send in every chirp, each with
        its full power. Half of it for real samples: noise of both halves of the spectrum lies
        in the half that is kept (Richards 2014).
        """
        chirp = self.frame.chirp
        n_ramps = self.frame.n_chirps * sum(len(slot) for slot in self.frame.slots)
        gain = chirp.n_samples * n_ramps * self.array.n_rx
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

    def _line(self) -> str:
        chirp, frame = self.frame.chirp, self.frame
        return (
            f"{in_unit(chirp.start_frequency_hz, 'hz')},"
            f" {in_unit(chirp.sampled_bandwidth_hz, 'hz')},"
            f" {frame.n_chirps:,} chirps of {chirp.n_samples:,} samples,"
            f" {len(self.array.tx_m)} x {self.array.n_rx} elements:"
            f" {in_unit(chirp.range_resolution_m, 'm', 3)} to"
            f" {in_unit(chirp.max_range_m, 'm', 3)}{frame._seen()}"
        )

    def _tables(self) -> Iterable[Table]:
        yield settings(self.frame.chirp, "Chirp")
        frame = settings(self.frame, "Frame")
        yield frame._replace(rows=[row for row in frame.rows if row[0] != "chirp"])
        yield from self.array._tables()
        if self.hardware is not None:
            yield settings(self.hardware, "Hardware")
        own = follows(self, "n_channels", "integration_gain")
        if self.hardware is not None:
            own += follows(self.hardware, "eirp_w")
        yield Table("What follows", [*self.frame.chirp._follows(), *self.frame._follows(), *own])
