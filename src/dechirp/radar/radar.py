"""A complete radar: frame, antenna array, hardware and calibration."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from dechirp.core.checks import check_field_classes
from dechirp.core.display import Displayable, Table, property_display_rows, settings_display_table
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_quantity
from dechirp.core.values import frozen_dataclass
from dechirp.radar.array import Array
from dechirp.radar.calibration import Calibration
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware


@frozen_dataclass
class Radar(Displayable):
    """Parameters of a radar, as simulation and processing use them."""

    frame: Frame
    array: Array = Array()
    hardware: Hardware | None = None
    """Power, gain and noise; none where unknown, as for most recordings: there are no absolute
    powers then."""
    calibration: Calibration | None = None
    """Corrections of the array; in files also the name of a file that `dechirp calibrate` wrote.
    None: an ideal array."""

    def __post_init__(self) -> None:
        check_field_classes(self, frame=Frame, array=Array)
        if self.hardware is not None:
            check_field_classes(self, hardware=Hardware)
        if self.calibration is not None:
            check_field_classes(self, calibration=Calibration)
        n_tx = len(self.array.tx_m)
        transmitters = sorted(
            {transmitter for slot in self.frame.slot_transmitters for transmitter in slot}
        )
        if transmitters == list(range(n_tx)):
            if self.calibration is not None:
                self.calibration.check_array(self.array)
            return
        expected_order = ", ".join(map(str, range(n_tx)))
        if self.frame.multiplexing is None:
            raise InvalidSetting(
                "Radar.frame.multiplexing",
                value=f"missing, with {n_tx} transmitters in the array",
                expected="a multiplexing scheme, since several transmitters share the chirps",
                fix=f"give multiplexing of kind tdm with order [{expected_order}], or keep one"
                " of array.tx",
            )
        raise InvalidSetting(
            "Radar.frame.multiplexing",
            value=f"{len(transmitters)} transmitter{'s' * (len(transmitters) != 1)}:"
            f" {', '.join(map(str, transmitters))}",
            expected=f"the {n_tx} in array.tx: {expected_order}",
            fix="correct the order or the code, or give the position of every transmitter in"
            " array.tx",
        )

    @property
    def element_positions_m(self) -> np.ndarray:
        """Positions of the virtual elements with their calibrated errors, (n_tx x n_rx, 3)."""
        if self.calibration is None:
            return self.array.virtual_positions_m
        return np.asarray(
            self.array.virtual_positions_m + self.calibration.element_position_errors_m()
        )

    @property
    def element_corrections(self) -> np.ndarray:
        """Complex factors by which to multiply the amplitudes of the virtual elements.

        (n_tx x n_rx,); 1 without a calibration.
        """
        if self.calibration is None:
            return np.ones(self.n_channels, complex)
        return self.calibration.element_corrections()

    def for_frame(self, frame_index: int) -> "Radar":
        """Return the radar with the single chirp interval of one frame, see `Frame.for_frame`."""
        frame = self.frame.for_frame(frame_index)
        return self if frame is self.frame else replace(self, frame=frame)

    def with_rising_ramps_only(self) -> "Radar":
        """Return the radar with only the rising ramps of its triangles."""
        frame = replace(self.frame, modulation=None, interval_s=self.frame.repetition_s)
        return replace(self, frame=frame)

    def select_receivers(self, receivers: Sequence[int]) -> "Radar":
        """Return the radar with some of its receivers, by their indices, in their order."""
        array = replace(self.array, rx_m=tuple(self.array.rx_m[rx] for rx in receivers))
        calibration = self.calibration and self.calibration.select_receivers(receivers)
        return replace(self, array=array, calibration=calibration)

    @property
    def n_channels(self) -> int:
        """Number of transmitter-receiver pairs, each of which observes the whole scene."""
        return self.array.n_rx * len(self.array.tx_m)

    @property
    def n_samples_per_frame(self) -> int:
        """Number of samples of all receivers in one frame."""
        frame = self.frame
        return frame.n_chirps_total * self.array.n_rx * frame.chirp.n_samples

    @property
    def n_summed_maps(self) -> int:
        """Number of maps whose powers are added: one for each slot of a round and each receiver."""
        return self.frame.n_slots * self.array.n_rx

    @property
    def integration_gain(self) -> float:
        """Gain of range, Doppler and channel integration in signal-to-noise ratio.

        N n_rx times the ramps that all transmitters send in a frame, without windows: N M n_tx
        n_rx where they take turns, n_slots times that where all send in every chirp, each with
        its full power. Half of it for real samples: noise of both halves of the spectrum lies in
        the half that is kept (Richards 2014).
        """
        chirp = self.frame.chirp
        n_ramps = self.frame.n_chirps * sum(len(slot) for slot in self.frame.slot_transmitters)
        gain = chirp.n_samples * n_ramps * self.array.n_rx
        return gain if chirp.sampling == "complex" else gain / 2

    def require_hardware(self) -> Hardware:
        """Return the hardware; raise `InvalidSetting` where it is not known."""
        if self.hardware is None:
            raise InvalidSetting(
                "Radar.hardware",
                value="missing",
                expected="the hardware, from which echo and noise powers follow",
                fix="give transmit_power, antenna_gain and noise_factor",
            )
        return self.hardware

    def _display_line(self) -> str:
        chirp, frame = self.frame.chirp, self.frame
        return (
            f"{format_quantity(chirp.start_frequency_hz, 'hz')},"
            f" {format_quantity(chirp.sampled_bandwidth_hz, 'hz')},"
            f" {frame.n_chirps:,} chirps of {chirp.n_samples:,} samples,"
            f" {len(self.array.tx_m)} x {self.array.n_rx} elements:"
            f" {format_quantity(chirp.range_resolution_m, 'm', 3)} to"
            f" {format_quantity(chirp.max_range_m, 'm', 3)}"
            f"{frame._format_velocity_resolution_and_limit()}"
        )

    def _display_tables(self) -> Iterable[Table]:
        yield settings_display_table(self.frame.chirp, "Chirp")
        frame = settings_display_table(self.frame, "Frame")
        yield frame._replace(rows=[row for row in frame.rows if row[0] != "chirp"])
        yield from self.array._display_tables()
        if self.hardware is not None:
            yield settings_display_table(self.hardware, "Hardware")
        rows = property_display_rows(self, "n_channels", "integration_gain")
        if self.hardware is not None:
            rows += property_display_rows(self.hardware, "eirp_w")
        beamwidth_rad = self.array.azimuth_beamwidth_rad(self.frame.chirp.wavelength_m)
        if not math.isnan(beamwidth_rad):
            rows.append(
                (
                    "azimuth beamwidth",
                    f"{math.degrees(beamwidth_rad):.3g}°",
                    "Half-power beamwidth of all virtual elements, straight ahead.",
                )
            )
        yield Table(
            "What follows",
            [*self.frame.chirp._derived_value_rows(), *self.frame._derived_value_rows(), *rows],
        )
