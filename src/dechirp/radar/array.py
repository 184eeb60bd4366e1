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
        vectors(self, "tx_m")
        vectors(self, "rx_m")

    @property
    def n_rx(self) -> int:
        """Number of receivers."""
        return len(self.rx_m)
