"""Doppler-division multiple access: simultaneous transmitters in separate Doppler sub-bands."""

import cmath
from functools import cached_property

from dechirp.core.checks import check_integer_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.multiplexing.base import Multiplexing, check_transmitter_order


@frozen_dataclass
class Ddma(Multiplexing):
    """Simultaneous transmitters with phases that advance in equal steps from chirp to chirp.

    The k-th of the order advances by 2 pi k / n_sub_bands from chirp to chirp, which raises the
    Doppler frequency of its echoes by k / (n_sub_bands x interval): one sub-band for each
    transmitter. Empty sub-bands later identify the first transmitter (Jansen 2019). A round is
    n_sub_bands chirps, over which the echoes are orthogonal.
    """

    order: tuple[int, ...]
    """Transmitter of each sub-band, from the one without a shift upwards: zero-based index into
    the transmitters of the array."""
    n_sub_bands: int
    """Number of sub-bands, at least that of transmitters; the others stay empty."""

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

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        band_of = {transmitter: band for band, transmitter in enumerate(self.order)}
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
