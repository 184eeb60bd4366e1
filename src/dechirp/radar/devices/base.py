"""Radar devices: base class of chips on boards with published antennas and limits."""

from abc import abstractmethod
from typing import ClassVar

from dechirp.core.checks import Vector, check_integer
from dechirp.core.families import Family
from dechirp.core.findings import Finding
from dechirp.radar.array import Array
from dechirp.radar.calibration import Calibration
from dechirp.radar.devices.limits import DeviceLimits
from dechirp.radar.devices.rules import find_broken_rules
from dechirp.radar.radar import Radar


class Device(Family):
    """A radar chip on its evaluation board."""

    group: ClassVar[str] = "dechirp.device"

    @property
    @abstractmethod
    def name(self) -> str:
        """Vendor's name."""

    @property
    @abstractmethod
    def tx_m(self) -> tuple[Vector, ...]:
        """Positions of all transmitters, (n_tx, 3), in the vendor's order."""

    @property
    @abstractmethod
    def rx_m(self) -> tuple[Vector, ...]:
        """Positions of all receivers, (n_rx, 3), in the vendor's order."""

    @property
    @abstractmethod
    def limits(self) -> DeviceLimits:
        """Limits of the chip."""

    @property
    def lvds_lanes(self) -> int | None:
        """Number of LVDS lanes for raw samples; None for devices with another interface."""
        return None

    @property
    def rx_signs(self) -> tuple[int, ...]:
        """Sign of the samples of each receiver; -1 where its antenna is fed from the other side."""
        return (1,) * len(self.rx_m)

    def find_broken_rules(self, radar: Radar, *, demo: bool = True) -> tuple[Finding, ...]:
        """Return the rules of the device that a radar breaks, each with its reason.

        Parameters
        ----------
        radar
            Radar to run on the device.
        demo
            True if the vendor's demo processes the frames on the chip. Its memory and chirp
            counts do not apply where raw samples are captured.

        Returns
        -------
        Findings of level error; none for a radar within all known limits.
        """
        return find_broken_rules(
            radar,
            self.limits,
            name=self.name,
            n_tx=len(self.tx_m),
            n_rx=len(self.rx_m),
            demo=demo,
        )

    def select_antennas(self, tx_mask: int, rx_mask: int) -> Array:
        """Return the array of the antennas that two bit masks enable; bit 0 is the first.

        Raises
        ------
        InvalidSetting
            If a mask is not an integer, enables no antenna, or one that does not exist.
        """
        return Array(
            tx_m=_select_positions_by_bit_mask(f"{self.name} tx_mask", tx_mask, self.tx_m),
            rx_m=_select_positions_by_bit_mask(f"{self.name} rx_mask", rx_mask, self.rx_m),
        )

    def sign_calibration(self, tx_mask: int, rx_mask: int) -> Calibration | None:
        """Return the calibration that corrects the signs of the receivers; None if all are +1.

        Simulated samples have no such signs.
        """
        n_tx = tx_mask.bit_count()
        signs = [sign for bit, sign in enumerate(self.rx_signs) if rx_mask >> bit & 1]
        if len(set(signs)) < 2:
            return None
        return Calibration(
            elements=tuple((tx, rx) for tx in range(n_tx) for rx in range(len(signs))),
            gain=tuple((float(sign), 0.0) for sign in signs) * n_tx,
        )


def _select_positions_by_bit_mask(
    setting: str, mask: int, positions: tuple[Vector, ...]
) -> tuple[Vector, ...]:
    check_integer(setting, mask, at_least=1, at_most=2 ** len(positions) - 1)
    return tuple(position for bit, position in enumerate(positions) if mask >> bit & 1)
