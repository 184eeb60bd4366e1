"""Multiplexing: base class, and the check of transmitter orders."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from dechirp.core.checks import as_tuple_or_none, check_integer
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family

# No array is as large: a larger index is an input error.
_MAX_TRANSMITTERS = 256
# Codes with a smaller overlap over a round count as orthogonal: it changes powers by 0.04 dB, and
# phases rounded to whole degrees stay below.
_MAX_OVERLAP = 1e-2


class Multiplexing(Family):
    """Sharing of the chirps of a frame among transmitters, in rounds of equal slots.

    A slot is one chirp; the next round starts after the last slot, or after a pause.
    """

    group: ClassVar[str] = "dechirp.multiplexing"

    @property
    @abstractmethod
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """Code matrix, (n_slots, n_tx): factor of each transmitter's echo in each slot of a round.

        Columns are indices into `Array.tx_m`. 0: the transmitter is silent; else of magnitude 1.
        The factor is that in the beat signal, Tx x conj(Rx), where Tx is the ramp before any
        phase shifter: a shifter that advances the transmitted signal by phi gives exp(-1j phi).
        """

    @property
    def round_pause_s(self) -> float:
        """Time from the end of the last interval of a round to the start of the next round."""
        return 0.0

    @property
    def slot_transmitters(self) -> tuple[tuple[int, ...], ...]:
        """Active transmitters in each slot of a round, indices into `Array.tx_m`."""
        return tuple(
            tuple(transmitter for transmitter, weight in enumerate(row) if weight)
            for row in self.weights
        )

    @property
    def non_orthogonal_pairs(self) -> tuple[tuple[int, int], ...]:
        """Pairs of transmitters whose codes are not orthogonal over a round."""
        code = np.array(self.weights)
        overlap = abs(np.triu(code.conj().T @ code, k=1))
        return tuple((int(i), int(j)) for i, j in np.argwhere(overlap > _MAX_OVERLAP * len(code)))

    @property
    def n_tx(self) -> int:
        """Number of transmitters in the code, silent ones included."""
        return len(self.weights[0])


def check_transmitter_order(setting: str, order: object) -> tuple[int, ...]:
    """Return a list of distinct transmitters as a tuple, or raise `InvalidSetting`."""
    transmitters = as_tuple_or_none(order)
    if not transmitters:
        raise InvalidSetting(
            setting,
            value=repr(order),
            expected="a list of at least one transmitter",
            fix="write [0, 1] for two",
        )
    for transmitter in transmitters:
        check_integer(setting, transmitter, at_least=0, at_most=_MAX_TRANSMITTERS - 1)
    if len(set(transmitters)) < len(transmitters):
        raise InvalidSetting(
            setting,
            value=f"{', '.join(map(str, transmitters))}",
            expected="every transmitter once",
            fix="list the transmitters of one round only; rounds repeat automatically",
        )
    return tuple(int(transmitter) for transmitter in transmitters)
