"""Doppler division: all transmitters send in every chirp, each moved along velocity."""

import cmath
from functools import cached_property

from dechirp.core.checks import count
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.multiplexing.base import Multiplexing, transmitters_in


@value
class Ddma(Multiplexing):
    """Every transmitter sends in every chirp, its echoes turned on by equal steps of phase.

    The k-th of the order turns by 2 pi k / n_sub_bands from chirp to chirp, which raises the
    Doppler frequency of its echoes by k / (n_sub_bands x interval): one sub-band for each
    transmitter. Sub-bands that stay empty tell later which transmitter is the first (Jansen
    2019). A round is n_sub_bands chirps, over which the echoes are orthogonal.
    """

    order: tuple[int, ...]
    """Which transmitter has each sub-band, from that without a shift upwards: its place in
    the list of the array's transmitters, counted from 0."""
    n_sub_bands: int
    """At least as many as transmitters; those beyond stay empty."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", transmitters_in("Ddma.order", self.order))
        count(self, "n_sub_bands", at_most=4096)
        if self.n_sub_bands < len(self.order):
            raise InvalidSetting(
                "Ddma.n_sub_bands",
                got=self.n_sub_bands,
                need=f"at least {len(self.order)}, one for each transmitter of the order",
                fix="Take more sub-bands, or name fewer transmitters.",
            )

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """The phase factors, see `Multiplexing.weights`."""
        band_of = {transmitter: band for band, transmitter in enumerate(self.order)}
        return tuple(
            tuple(
                self._turned(band_of[place] * slot) if place in band_of else 0j
                for place in range(1 + max(self.order))
            )
            for slot in range(self.n_sub_bands)
        )

    def _turned(self, steps: int) -> complex:
        return cmath.rect(1.0, cmath.tau * (steps % self.n_sub_bands) / self.n_sub_bands)
