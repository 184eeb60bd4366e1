"""What multiplexing is: what each transmitter sends in which chirp."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from dechirp.core.checks import listed, whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family

# More than the largest arrays have: it is a slip, for which no code is made up.
_MOST_TRANSMITTERS = 256
# Overlap of two transmitters over a round, up to which they are apart: it moves their power by
# 0.04 dB, and phases that are rounded to whole degrees stay below.
_ORTHOGONAL = 1e-2


class Multiplexing(Family):
    """Shares the chirps of a frame among the transmitters, in rounds of equal slots.

    A slot is one chirp; the next round begins when all have passed.
    """

    group: ClassVar[str] = "dechirp.multiplexing"

    @property
    @abstractmethod
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """The code, (n_slots, n_tx): factor of each transmitter's echo in each slot of a round.

        Columns are places in `Array.tx_m`. 0: the transmitter is silent; else of magnitude 1.
        The factor is that in the beat signal, Tx x conj(Rx), where Tx is the ramp before any
        phase shifter: a shifter that advances what is sent by phi gives exp(-1j phi).
        """

    @property
    def slots(self) -> tuple[tuple[int, ...], ...]:
        """Transmitters that send in each slot of a round, indices into `Array.tx_m`."""
        return tuple(
            tuple(transmitter for transmitter, weight in enumerate(row) if weight)
            for row in self.weights
        )

    @property
    def mixed(self) -> tuple[tuple[int, int], ...]:
        """Pairs of transmitters whose factors are not orthogonal over a round."""
        code = np.array(self.weights)
        overlap = abs(np.triu(code.conj().T @ code, k=1))
        return tuple((int(i), int(j)) for i, j in np.argwhere(overlap > _ORTHOGONAL * len(code)))

    @property
    def n_tx(self) -> int:
        """Transmitters of which the code tells, silent ones too."""
        return len(self.weights[0])


def transmitters_in(where: str, order: object) -> tuple[int, ...]:
    """Keep a list of different transmitters, or raise `InvalidSetting`, about `where`."""
    named = listed(order)
    if not named:
        raise InvalidSetting(
            where,
            got=repr(order),
            need="a list of at least one transmitter",
            fix="Write [0, 1] for two.",
        )
    for transmitter in named:
        whole(where, transmitter, at_least=0, at_most=_MOST_TRANSMITTERS - 1)
    if len(set(named)) < len(named):
        raise InvalidSetting(
            where,
            got=f"{', '.join(map(str, named))}",
            need="every transmitter once",
            fix="Name the transmitters of one round; the rounds repeat by themselves.",
        )
    return tuple(int(transmitter) for transmitter in named)
