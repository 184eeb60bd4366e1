"""User-defined phase code: several transmitters send in a chirp."""

import cmath
from functools import cached_property

from dechirp.core.checks import as_tuple_or_none, check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.multiplexing.base import Multiplexing

_SETTING = "PhaseCode.phases_rad"
# Codes quadratic in the chirp number reach this; larger phases lose all significant digits.
_MAX_PHASE_RAD = 1e6


@frozen_dataclass
class PhaseCode(Multiplexing):
    """Simultaneous transmitters with the phases of a table.

    Only a code whose columns are orthogonal over a round separates the transmitters; any other
    forms a beam, whose direction may change from chirp to chirp. A code as long as the frame is
    one round: `Frame.n_chirps` is 1 then.
    """

    phases_rad: tuple[tuple[float | None, ...], ...]
    """A row for each chirp of a round, with the phase of each of the array's transmitters, None
    (null in a file) where it is silent. The phase advances the echo in the beat signal; a phase
    shifter that advances the transmitted signal by the same angle has the opposite sign."""

    def __post_init__(self) -> None:
        rows = as_tuple_or_none(self.phases_rad)
        if not rows:
            raise InvalidSetting(
                _SETTING,
                value=repr(self.phases_rad),
                expected="a list of at least one row of phases",
                fix="write [[0 deg, 0 deg], [0 deg, 180 deg]] for two transmitters",
            )
        checked = tuple(_check_phase_row(index, row) for index, row in enumerate(rows))
        for index, row in enumerate(checked):
            if len(row) != len(checked[0]):
                raise InvalidSetting(
                    f"{_SETTING}.{index}",
                    value=f"a row of {len(row)} phases",
                    expected=f"{len(checked[0])} phases, one for each transmitter, as in the first"
                    " row",
                    fix="give every transmitter a phase in every row",
                )
        for transmitter, phases in enumerate(zip(*checked, strict=True)):
            if all(phase is None for phase in phases):
                raise InvalidSetting(
                    _SETTING,
                    value=f"no phase of transmitter {transmitter} in any row",
                    expected="at least one, since a silent transmitter is no part of the array",
                    fix="give it a phase in a row, or remove it from the array and from all rows",
                )
        object.__setattr__(self, "phases_rad", checked)

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        return tuple(
            tuple(0j if phase is None else cmath.rect(1.0, phase) for phase in row)
            for row in self.phases_rad
        )


def _check_phase_row(row_index: int, row: object) -> tuple[float | None, ...]:
    setting = f"{_SETTING}.{row_index}"
    phases = as_tuple_or_none(row)
    if not phases:
        raise InvalidSetting(
            setting,
            value=repr(row),
            expected="a list of phases, one for each transmitter",
            fix="give every row as many phases as the array has transmitters",
        )
    checked = tuple(
        None
        if phase is None
        else check_number(setting, phase, at_least=-_MAX_PHASE_RAD, at_most=_MAX_PHASE_RAD)
        for phase in phases
    )
    if set(checked) == {None}:
        raise InvalidSetting(
            setting,
            value="a row without a phase",
            expected="at least one transmitter in every chirp",
            fix="remove the row, or give a transmitter its phase",
        )
    return checked
