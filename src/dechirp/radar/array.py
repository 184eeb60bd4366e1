"""Antenna positions: x forward, y left, z up."""

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np

from dechirp.core.checks import Vector, check_and_convert_vectors_field
from dechirp.core.display import (
    Displayable,
    Table,
    format_count_with_noun,
    format_setting_value,
    truncated_display_table,
)
from dechirp.core.values import frozen_dataclass

_COINCIDENCE_M = 1e-6  # 0.1 degree of phase at 77 GHz


@frozen_dataclass
class Array(Displayable):
    """Positions of transmitters and receivers; by default one of each at the origin."""

    tx_m: tuple[Vector, ...] = ((0.0, 0.0, 0.0),)
    """Positions of the transmitters, (n_tx, 3)."""
    rx_m: tuple[Vector, ...] = ((0.0, 0.0, 0.0),)
    """Positions of the receivers, (n_rx, 3)."""

    def __post_init__(self) -> None:
        # No array on one oscillator is as wide: a value beyond has a wrong unit.
        check_and_convert_vectors_field(self, "tx_m", max_magnitude=1e6)
        check_and_convert_vectors_field(self, "rx_m", max_magnitude=1e6)

    @property
    def n_rx(self) -> int:
        """Number of receivers."""
        return len(self.rx_m)

    @property
    def virtual_positions_m(self) -> np.ndarray:
        """Positions of the virtual array, (n_tx x n_rx, 3): transmitter plus receiver.

        Element tx * n_rx + rx; a far target's echo over that pair has the phase of an antenna at
        this position that receives a transmission from the origin.
        """
        tx, rx = np.array(self.tx_m), np.array(self.rx_m)
        return np.asarray((tx[:, None] + rx).reshape(-1, 3))

    def azimuth_beamwidth_rad(self, wavelength_m: float) -> float:
        """Return the width in which the beam of all virtual elements has half its power or more.

        Straight ahead, with equal weights: 0.886 lambda / N d for N elements at the spacing d.
        NaN if the beam does not fall to half its power in front of the radar.
        """
        y_m = self.virtual_positions_m[:, 1]
        n_steps = 64 * math.ceil(np.ptp(y_m) / wavelength_m + 1)
        sines = np.linspace(0, 1, n_steps + 1)
        beam = np.exp(2j * np.pi / wavelength_m * np.outer(sines, y_m)).mean(axis=1)
        power = abs(beam) ** 2
        if power.min() > 0.5:
            return math.nan
        last = int(np.argmax(power <= 0.5))
        sine = np.interp(0.5, power[[last, last - 1]], sines[[last, last - 1]])
        return 2 * math.asin(sine)

    def find_coincident_elements(self) -> tuple[tuple[Literal["tx", "rx"], int, int], ...]:
        """Return pairs of elements within 1 um of each other: "tx" or "rx", and their numbers.

        Two transmitters, or two receivers, at one position are an input error, since they carry
        the same information. A transmitter may coincide with a receiver.
        """
        kinds: tuple[tuple[Literal["tx", "rx"], tuple[Vector, ...]], ...]
        kinds = (("tx", self.tx_m), ("rx", self.rx_m))
        return tuple(
            (kind, first, second)
            for kind, positions_m in kinds
            for second in range(len(positions_m))
            for first in range(second)
            if math.dist(positions_m[first], positions_m[second]) < _COINCIDENCE_M
        )

    def _display_line(self) -> str:
        n_tx = len(self.tx_m)
        receivers = format_count_with_noun(self.n_rx, "receiver")
        return f"{format_count_with_noun(n_tx, 'transmitter')}, {receivers}"

    def _display_tables(self) -> Iterable[Table]:
        rows = [
            (
                f"{kind} {number}",
                *(format_setting_value(coordinate, "m") for coordinate in position_m),
            )
            for kind, positions_m in (("tx", self.tx_m), ("rx", self.rx_m))
            for number, position_m in enumerate(positions_m)
        ]
        return (truncated_display_table("Positions", rows, len(rows), ("", "x", "y", "z")),)
