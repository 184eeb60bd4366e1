"""A phase code of the user's own: all transmitters send in every chirp."""

import cmath
from functools import cached_property

from dechirp.core.checks import listed, number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.multiplexing.base import Multiplexing

_WHERE = "PhaseCode.phases_rad"
# Codes that grow with the square of the chirp go so far; beyond, phases have no digits left.
_MOST_RAD = 1e6


@value
class PhaseCode(Multiplexing):
    """Every transmitter sends in every chirp, at the phases of a table.

    Only a code whose columns are orthogonal over a round parts the transmitters; any other
    forms a beam, whose direction may change from chirp to chirp. A code as long as the frame
    is one round: `Frame.n_chirps` is 1 then.
    """

    phases_rad: tuple[tuple[float, ...], ...]
    """A row for each chirp of a round, in it the phase of each of the array's transmitters.
    By so much its echoes are turned in the beat signal; a phase shifter that advances what is
    sent by as much gives minus this."""

    def __post_init__(self) -> None:
        rows = listed(self.phases_rad)
        if not rows:
            raise InvalidSetting(
                _WHERE,
                got=repr(self.phases_rad),
                need="a list of at least one row of phases",
                fix="Write [[0 deg, 0 deg], [0 deg, 180 deg]] for two transmitters.",
            )
        kept = tuple(_phases(index, row) for index, row in enumerate(rows))
        for index, row in enumerate(kept):
            if len(row) != len(kept[0]):
                raise InvalidSetting(
                    f"{_WHERE}.{index}",
                    got=f"a row of {len(row)} phases",
                    need=f"of {len(kept[0])} as the first row, one for each transmitter",
                    fix="Give every transmitter a phase in every row.",
                )
        object.__setattr__(self, "phases_rad", kept)

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """The phase factors, see `Multiplexing.weights`."""
        return tuple(tuple(cmath.rect(1.0, phase) for phase in row) for row in self.phases_rad)


def _phases(index: int, row: object) -> tuple[float, ...]:
    where = f"{_WHERE}.{index}"
    phases = listed(row)
    if not phases:
        raise InvalidSetting(
            where,
            got=repr(row),
            need="a list of phases, one for each transmitter",
            fix="Give every row as many phases as the array has transmitters.",
        )
    return tuple(number(where, phase, at_least=-_MOST_RAD, at_most=_MOST_RAD) for phase in phases)
