"""Doppler-division multiple access: simultaneous transmitters in separate Doppler sub-bands."""

import cmath
from functools import cached_property

from dechirp.core.checks import as_tuple_or_none, check_integer, check_integer_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.multiplexing.base import Multiplexing, check_transmitter_order


@frozen_dataclass
class Ddma(Multiplexing):
    """Simultaneous transmitters with phases that advance in equal steps from chirp to chirp.

    The transmitter of sub-band k advances by 2 pi k / n_sub_bands from chirp to chirp, which raises
    the Doppler frequency of its echoes by k / (n_sub_bands x interval): one sub-band for each
    transmitter. Empty sub-bands later identify the first transmitter (Jansen 2019). A round is
    n_sub_bands chirps, over which the echoes are orthogonal.
    """

    order: tuple[int, ...]
    """Transmitter of each sub-band, from the one without a shift upwards: zero-based index into
    the transmitters of the array."""
    n_sub_bands: int
    """Number of sub-bands, at least that of transmitters; the others stay empty."""
    sub_bands: tuple[int, ...] | None = None
    """Sub-band of each transmitter of the order, from 0; None: the first ones without a gap.
    Differences that occur once identify the first transmitter best, as in [0, 1, 3]."""
    is_order_known: bool = True
    """Whether the order is that of the array. If it is only assumed, as by a recording whose
    samples do not show it, directions are not estimated."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", check_transmitter_order("Ddma.order", self.order))
        check_integer_fields(self, "n_sub_bands", at_most=4096)
        if self.n_sub_bands < len(self.order):
            raise InvalidSetting(
                "Ddma.n_sub_bands",
                value=self.n_sub_bands,
                expected=f"at least {len(self.order)}, one for each transmitter of the order",
                fix="take more sub-bands, or name fewer transmitters",
            )

        if not isinstance(self.is_order_known, bool):
            raise InvalidSetting(
                "Ddma.is_order_known",
                value=repr(self.is_order_known),
                expected="true or false",
                fix="write false to leave directions out",
            )
        if self.sub_bands is not None:
            object.__setattr__(self, "sub_bands", self._checked_sub_bands())

    def _checked_sub_bands(self) -> tuple[int, ...]:
        bands = as_tuple_or_none(self.sub_bands) or ()
        for band in bands:
            check_integer("Ddma.sub_bands", band, at_least=0, at_most=self.n_sub_bands - 1)
        if len(bands) != len(self.order) or len(set(bands)) < len(bands):
            raise InvalidSetting(
                "Ddma.sub_bands",
                value=", ".join(map(str, bands)) or repr(self.sub_bands),
                expected=f"{len(self.order)} different sub-bands, one for each transmitter",
                fix="list the sub-bands in the order of the transmitters, or leave them out",
            )
        return tuple(int(band) for band in bands)

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        bands = range(len(self.order)) if self.sub_bands is None else self.sub_bands
        band_of = dict(zip(self.order, bands, strict=True))
        return tuple(
            tuple(
                self._phase_factor(band_of[transmitter_index] * slot)
                if transmitter_index in band_of
                else 0j
                for transmitter_index in range(1 + max(self.order))
            )
            for slot in range(self.n_sub_bands)
        )

    def _phase_factor(self, steps: int) -> complex:
        return cmath.rect(1.0, cmath.tau * (steps % self.n_sub_bands) / self.n_sub_bands)
