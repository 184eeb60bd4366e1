"""Lookup tables of the fixed-point chain for one radar: sizes, coefficients and shifts."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.processing.cfar.base import TrainingWindow
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.fixed_point.coefficients import (
    INTEGER_BITS,
    integer_doppler_window,
    integer_log2_table,
    integer_range_window,
    integer_twiddle_factors,
    quantise_factors_with_common_shift,
)
from dechirp.processing.fixed_point.fft import check_power_of_two
from dechirp.processing.fixed_point.word_lengths import WordLengths
from dechirp.processing.spectrum import Transform, rows_with_circular_noise
from dechirp.radar.radar import Radar


class LookupTables(NamedTuple):
    """Fixed data of the chain, independent of the samples; all arrays are int64."""

    words: WordLengths
    range_transform: Transform
    doppler_transform: Transform
    n_channels: int
    n_rows: int
    """Number of kept range rows: all, or for real samples those that are no mirror image."""
    searched_rows: slice
    """Range rows in which targets are detected."""
    training_window: TrainingWindow
    range_window: np.ndarray
    """Weights (sample,)."""
    doppler_window: np.ndarray
    """Weights (chirp,)."""
    range_twiddles: np.ndarray
    """Twiddle factors (n_range_bins / 2, 2)."""
    doppler_twiddles: np.ndarray
    """Twiddle factors (n_velocity_bins / 2, 2)."""
    logarithms: np.ndarray
    """Logarithms (2^log_table_bits,)."""
    factors: np.ndarray
    """Threshold over sum of the training cells, times 2^factor_shift, of each searched row."""
    factor_shift: int

    @property
    def range_product_right_shift(self) -> int:
        """Bits to shift right the product of a sample and a weight."""
        words = self.words
        return words.window_bits - INTEGER_BITS - (words.range_bits - words.sample_bits)

    @property
    def doppler_product_right_shift(self) -> int:
        """Bits to shift right the product of a range profile and a weight."""
        words = self.words
        return words.window_bits - INTEGER_BITS - (words.doppler_bits - words.range_bits)

    @property
    def power_left_shift(self) -> int:
        """Bits to shift left a square of the largest exponent, or right if negative."""
        channel_bits = (self.n_channels - 1).bit_length()
        return self.words.power_bits - 2 * self.words.doppler_bits - channel_bits


def make_lookup_tables(radar: Radar, chain: Chain, words: WordLengths) -> LookupTables:
    """Make the lookup tables for a chain that is fitted to the radar.

    Raises
    ------
    InvalidSetting
        If a transform length is no power of two, the chain has steps without a fixed-point version
        (detectors other than cell averaging, range walk, falling ramps), or sums need over 63 bits.
    """
    _check_has_fixed_point_version(radar, chain)
    noise, chirp = chain.map_noise_statistics(radar), radar.frame.chirp
    range_transform, doppler_transform = noise.range_transform, noise.doppler_transform
    for name, transform in (
        ("n_range_bins", range_transform),
        ("n_velocity_bins", doppler_transform),
    ):
        check_power_of_two(
            f"Chain.{name}",
            transform.n_bins,
            fix=f"pad with zeros: set {name} to {_next_power_of_two(transform.n_bins)}",
        )
    searched_rows = rows_with_circular_noise(chirp, range_transform)
    n_searched = searched_rows.stop - searched_rows.start
    window = chain.cfar.training_window
    # The threshold of a map of ones is the factor.
    unit_map = np.ones((doppler_transform.n_bins, n_searched), np.float32)
    ratios = chain.cfar.threshold(unit_map, noise)[0] / window.n_training_cells_per_row(n_searched)
    integer_factors, factor_shift = quantise_factors_with_common_shift(ratios, words.factor_bits)
    _check_sums_and_factor_fit(words, window, factor_shift)
    return LookupTables(
        words=words,
        range_transform=range_transform,
        doppler_transform=doppler_transform,
        n_channels=noise.n_channels,
        n_rows=range_transform.n_bins
        if chirp.sampling == "complex"
        else range_transform.n_bins // 2 + 1,
        searched_rows=searched_rows,
        training_window=window,
        range_window=integer_range_window(range_transform, words.window_bits),
        doppler_window=integer_doppler_window(doppler_transform, words.window_bits),
        range_twiddles=integer_twiddle_factors(range_transform.n_bins, words.twiddle_bits),
        doppler_twiddles=integer_twiddle_factors(doppler_transform.n_bins, words.twiddle_bits),
        logarithms=integer_log2_table(words.log_table_bits, words.log_fraction_bits),
        factors=integer_factors,
        factor_shift=factor_shift,
    )


def pad_to_powers_of_two(chain: Chain, radar: Radar) -> Chain:
    """Return the chain with transform lengths padded to powers of two, where they are not set."""
    return replace(
        chain,
        n_range_bins=_padded_length(chain.n_range_bins, radar.frame.chirp.n_samples),
        n_velocity_bins=_padded_length(chain.n_velocity_bins, radar.frame.n_chirps),
    )


def _padded_length(requested: int | None, n_points: int) -> int | None:
    padded = _next_power_of_two(n_points)
    return padded if requested is None and padded != n_points else requested


def _next_power_of_two(n: int) -> int:
    """Return the smallest power of two that is at least n."""
    return 1 << (n - 1).bit_length()


def _check_has_fixed_point_version(radar: Radar, chain: Chain) -> None:
    """Check that the chain has only steps with a fixed-point version."""
    if not isinstance(chain.cfar.estimator, CellAveraging):
        raise InvalidSetting(
            "Chain.cfar.estimator",
            value=chain.cfar.estimator.kind(),
            expected="cell-averaging, the only fixed-point detector",
            fix="choose cell-averaging",
        )
    if chain.range_walk is not None:
        raise InvalidSetting(
            "Chain.range_walk",
            value=chain.range_walk,
            expected="none in fixed point",
            fix="remove it",
        )
    if radar.frame.has_falling_ramps:
        raise InvalidSetting(
            "Frame.modulation",
            value="falling ramps",
            expected="only rising ramps in fixed point",
            fix="remove the modulation",
        )


def _check_sums_and_factor_fit(
    words: WordLengths, window: TrainingWindow, factor_shift: int
) -> None:
    """Check that sums need at most 63 bits, and that the factor fits its word."""
    n_box = (2 * window.half_velocity + 1) * (2 * window.half_range + 1)
    max_bits = 63 - (n_box - 1).bit_length()
    if words.power_bits > max_bits:
        raise InvalidSetting(
            "WordLengths.power_bits",
            value=words.power_bits,
            expected=f"at most {max_bits}: {n_box} cells are added, in 63 bits",
            fix="lower it, or the number of training cells",
        )
    if factor_shift < 0:
        raise InvalidSetting(
            "WordLengths.factor_bits",
            value=words.factor_bits,
            expected=f"at least {words.factor_bits - factor_shift}, the bits of the factor",
            fix="raise it, or use more training cells",
        )
