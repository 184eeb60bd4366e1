"""What a device is: a chip on a board whose antennas and limits are public."""

from abc import abstractmethod
from typing import ClassVar

from dechirp.core.checks import Vector, whole
from dechirp.core.families import Family
from dechirp.core.findings import Finding
from dechirp.radar.array import Array
from dechirp.radar.devices.limits import Limits
from dechirp.radar.devices.rules import broken_rules
from dechirp.radar.radar import Radar


class Device(Family):
    """A radar chip on its evaluation board."""

    group: ClassVar[str] = "dechirp.device"

    @property
    @abstractmethod
    def name(self) -> str:
        """What its vendor calls it."""

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
    def limits(self) -> Limits:
        """What the chip allows."""

    @property
    def lanes(self) -> int | None:
        """LVDS lanes over which raw samples leave; None where they leave otherwise."""
        return None

    def broken_rules(self, radar: Radar, *, demo: bool = True) -> tuple[Finding, ...]:
        """Say which rules of the device a radar breaks, each with its reason.

        Parameters
        ----------
        radar
            The radar that the device should be.
        demo
            Whether the vendor's program processes the frames on the chip. Its memory and
            the numbers of chirps it takes do not count where raw samples are captured.

        Returns
        -------
        Findings of level error; none for a radar within all limits that are known.
        """
        return broken_rules(
            radar,
            self.limits,
            name=self.name,
            n_tx=len(self.tx_m),
            n_rx=len(self.rx_m),
            demo=demo,
        )

    def part(self, tx_mask: int, rx_mask: int) -> Array:
        """Positions of the antennas that two masks switch on; bit 0 is the first.

        Raises
        ------
        InvalidSetting
            If a mask is not a whole number, switches on none, or one that is not there.
        """
        return Array(
            tx_m=_switched_on(f"{self.name} tx_mask", tx_mask, self.tx_m),
            rx_m=_switched_on(f"{self.name} rx_mask", rx_mask, self.rx_m),
        )


def _switched_on(where: str, mask: int, positions: tuple[Vector, ...]) -> tuple[Vector, ...]:
    whole(where, mask, at_least=1, at_most=2 ** len(positions) - 1)
    return tuple(position for bit, position in enumerate(positions) if mask >> bit & 1)
