"""Where the antennas are: x forward, y left, z up."""

from collections.abc import Iterable
from math import dist
from typing import Literal

import numpy as np

from dechirp.core.checks import Vector, vectors
from dechirp.core.displayed import Displayed, Table, cut, several, told
from dechirp.core.values import value

_APART_M = 1e-6  # 0.1 degree of phase at 77 GHz


@value
class Array(Displayed):
    """Positions of the transmitters and receivers; one of each at the origin by default."""

    tx_m: tuple[Vector, ...] = ((0.0, 0.0, 0.0),)
    """(n_tx, 3)."""
    rx_m: tuple[Vector, ...] = ((0.0, 0.0, 0.0),)
    """(n_rx, 3)."""

    def __post_init__(self) -> None:
        # Wider than any array on one oscillator: beyond, a unit is wrong.
        vectors(self, "tx_m", at_most=1e6)
        vectors(self, "rx_m", at_most=1e6)

    @property
    def n_rx(self) -> int:
        """Number of receivers."""
        return len(self.rx_m)

    @property
    def virtual_m(self) -> np.ndarray:
        """Positions of the virtual array, (n_tx x n_rx, 3): transmitter plus receiver.

        Element tx * n_rx + rx; a far target's echo over that pair has the phase of an antenna
        there that hears what one at the origin sends.
        """
        tx, rx = np.array(self.tx_m), np.array(self.rx_m)
        return np.asarray((tx[:, None] + rx).reshape(-1, 3))

    def coincident(self) -> tuple[tuple[Literal["tx", "rx"], int, int], ...]:
        """Pairs of elements at one place, within 1 um: of which kind, and their numbers.

        Two transmitters, or two receivers: a slip, since both tell the same. A transmitter
        may lie where a receiver lies.
        """
        kinds: tuple[tuple[Literal["tx", "rx"], tuple[Vector, ...]], ...]
        kinds = (("tx", self.tx_m), ("rx", self.rx_m))
        return tuple(
            (kind, first, second)
            for kind, at_m in kinds
            for second in range(len(at_m))
            for first in range(second)
            if dist(at_m[first], at_m[second]) < _APART_M
        )

    def _line(self) -> str:
        n_tx = len(self.tx_m)
        return f"{several(n_tx, 'transmitter')}, {several(self.n_rx, 'receiver')}"

    def _tables(self) -> Iterable[Table]:
        rows = [
            (f"{kind} {number}", *(told(one, "m") for one in at_m))
            for kind, all_m in (("tx", self.tx_m), ("rx", self.rx_m))
            for number, at_m in enumerate(all_m)
        ]
        return (cut("Positions", rows, len(rows), ("", "x", "y", "z")),)
