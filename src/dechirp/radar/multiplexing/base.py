"""What multiplexing is: which transmitters send in which chirp."""

from abc import abstractmethod
from typing import ClassVar

from dechirp.core.families import Family


class Multiplexing(Family):
    """Shares the chirps of a frame among the transmitters, in rounds of equal slots."""

    group: ClassVar[str] = "dechirp.multiplexing"

    @property
    @abstractmethod
    def slots(self) -> tuple[tuple[int, ...], ...]:
        """Transmitters that send in each slot of a round, indices into `Array.tx_m`.

        A slot is one chirp; the next round begins when all have passed. Simulation and
        processing know slots of one transmitter so far.
        """
