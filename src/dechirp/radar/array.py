"""Where the antennas are: x forward, y left, z up."""

from dechirp.core.checks import Vector, vectors
from dechirp.core.values import value


@value
class Array:
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
