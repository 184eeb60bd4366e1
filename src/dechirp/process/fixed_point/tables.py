"""What a machine for one radar holds before the first sample: sizes, tables and shifts."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.process.cfar.base import Ring
from dechirp.process.cfar.cell_averaging import CellAveraging
from dechirp.process.chain import Chain
from dechirp.process.fixed_point.coefficients import (
    POINT,
    doppler_weights,
    factors,
    logarithms,
    range_weights,
    twiddles,
)
from dechirp.process.fixed_point.fft import must_be_power_of_two
from dechirp.process.fixed_point.words import WordLengths
from dechirp.process.spectrum import Transform, independent_rows
from dechirp.radar.radar import Radar


class Tables(NamedTuple):
    """Everything but the samples; all arrays are int64."""

    words: WordLengths
    over_range: Transform
    over_velocity: Transform
    n_channels: int
    n_rows: int
    """Range rows that are kept: all, or of real samples those that are no mirror image."""
    searched: slice
    """Range rows in which targets are looked for."""
    ring: Ring
    range_window: np.ndarray
    """(sample,)"""
    doppler_window: np.ndarray
    """(chirp,)"""
    range_twiddles: np.ndarray
    """(n_range_bins / 2, 2)"""
    doppler_twiddles: np.ndarray
    """(n_velocity_bins / 2, 2)"""
    logarithms: np.ndarray
    """(2^log_table_bits,)"""
    factors: np.ndarray
    """Threshold over sum of the ring, times 2^factor_shift, of each row searched."""
    factor_shift: int

    @property
    def range_shift(self) -> int:
        """Bits that a sample times a weight is shifted right."""
        words = self.words
        return words.window_bits - POINT - (words.range_bits - words.sample_bits)

    @property
    def doppler_shift(self) -> int:
        """Bits that a range profile of the largest exponent times a weight is shifted right."""
        words = self.words
        return words.window_bits - POINT - (words.doppler_bits - words.range_bits)

    @property
    def power_shift(self) -> int:
        """Bits that a square of the largest exponent is shifted left, or right if negative."""
        channel_bits = (self.n_channels - 1).bit_length()
        return self.words.power_bits - 2 * self.words.doppler_bits - channel_bits


def tables(radar: Radar, chain: Chain, words: WordLengths) -> Tables:
    """Make them; `chain` is one that fits the radar.

    Raises
    ------
    InvalidSetting
        If a transform is no power of two long, the chain has what whole numbers have not (another
        detector than cell averaging, range walk, ramps that fall), or sums need over 63 bits.
    """
    _must_be_plain(radar, chain)
    noise, chirp = chain.noise(radar), radar.frame.chirp
    over_range, over_velocity = noise.over_range, noise.over_velocity
    for name, transform in (("n_range_bins", over_range), ("n_velocity_bins", over_velocity)):
        must_be_power_of_two(
            f"Chain.{name}",
            transform.n_bins,
            fix=f"Pad with zeros: set {name} to {_power_of_two(transform.n_points)}.",
        )
    searched = independent_rows(chirp, over_range)
    n_searched = searched.stop - searched.start
    ring = chain.cfar.ring
    # The threshold where every cell is 1 is the factor itself.
    flat = np.ones((over_velocity.n_bins, n_searched), np.float32)
    ratios = chain.cfar.threshold(flat, noise)[0] / ring.n_cells(n_searched)
    whole_factors, factor_shift = factors(ratios, words.factor_bits)
    _must_fit(words, ring, factor_shift)
    return Tables(
        words=words,
        over_range=over_range,
        over_velocity=over_velocity,
        n_channels=noise.n_channels,
        n_rows=over_range.n_bins if chirp.sampling == "complex" else over_range.n_bins // 2 + 1,
        searched=searched,
        ring=ring,
        range_window=range_weights(over_range, words.window_bits),
        doppler_window=doppler_weights(over_velocity, words.window_bits),
        range_twiddles=twiddles(over_range.n_bins, words.twiddle_bits),
        doppler_twiddles=twiddles(over_velocity.n_bins, words.twiddle_bits),
        logarithms=logarithms(words.log_table_bits, words.log_fraction_bits),
        factors=whole_factors,
        factor_shift=factor_shift,
    )


def padded(chain: Chain, radar: Radar) -> Chain:
    """The same with transforms that are powers of two long, where their lengths are not set."""
    return replace(
        chain,
        n_range_bins=_padded_length(chain.n_range_bins, radar.frame.chirp.n_samples),
        n_velocity_bins=_padded_length(chain.n_velocity_bins, radar.frame.n_chirps),
    )


def _padded_length(asked: int | None, n_points: int) -> int | None:
    longer = _power_of_two(n_points)
    return longer if asked is None and longer != n_points else asked


def _power_of_two(n: int) -> int:
    """The least that is n or more."""
    return 1 << (n - 1).bit_length()


def _must_be_plain(radar: Radar, chain: Chain) -> None:
    """Raise `InvalidSetting` for what has no counterpart in whole numbers."""
    if not isinstance(chain.cfar.estimator, CellAveraging):
        raise InvalidSetting(
            "Chain.cfar.estimator",
            got=chain.cfar.estimator.kind(),
            need="cell-averaging, the only one in whole numbers",
            fix="Choose that.",
        )
    if chain.range_walk is not None:
        raise InvalidSetting(
            "Chain.range_walk",
            got=chain.range_walk,
            need="none in whole numbers",
            fix="Leave it out.",
        )
    if radar.frame.falls:
        raise InvalidSetting(
            "Frame.modulation",
            got="ramps that fall",
            need="ramps that rise, in whole numbers",
            fix="Leave the modulation out.",
        )


def _must_fit(words: WordLengths, ring: Ring, factor_shift: int) -> None:
    """Raise `InvalidSetting` if a sum needs over 63 bits, or a factor more than it has."""
    n_box = (2 * ring.half_velocity + 1) * (2 * ring.half_range + 1)
    most = 63 - (n_box - 1).bit_length()
    if words.power_bits > most:
        raise InvalidSetting(
            "WordLengths.power_bits",
            got=words.power_bits,
            need=f"at most {most}: {n_box} cells are added, in 63 bits",
            fix="Lower it, or the number of training cells.",
        )
    if factor_shift < 0:
        raise InvalidSetting(
            "WordLengths.factor_bits",
            got=words.factor_bits,
            need=f"at least {words.factor_bits - factor_shift}, the factor has so many bits",
            fix="Raise it, or take more training cells.",
        )
