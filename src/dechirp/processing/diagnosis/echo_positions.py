"""Mistakes shown by the positions of echoes: order of axes, fftshift, I and Q, mirror images."""

from dataclasses import dataclass

import numpy as np
import scipy

from dechirp.core.units import to_decibels
from dechirp.processing.diagnosis.diagnosis import (
    NOTHING_FOUND,
    Diagnosis,
    cannot_be_told,
    mistake_found,
)
from dechirp.processing.diagnosis.map_peaks import MapPeaks

_FALSE_ALARM_PROBABILITY = 1e-5
_MIN_STATIC_ECHOES = 4
_MIN_FAR_ECHOES = 4
_FAR_ENERGY = 0.95
_MAX_PROBABILITY_OF_SPREADS = 3e-3
_MAX_SIMILARITY_BY_CHANCE = 0.8
MIRRORED = 0.98
"""Independent noise has a similarity of 0.5, with a standard error of 0.01 in a thousand cells."""


def measure_mirror_similarity(power: np.ndarray) -> float:
    """Return the similarity of a map to its mirror image in both frequencies, 0 to 1.

    1 for the whole spectrum of real samples, 0.5 in noise. 0 where shifted mirror images are
    similar too, as in a map of equal cells.
    """
    n_rows, n_columns = power.shape
    rows, columns = np.arange(n_rows), -np.arange(n_columns)
    # Rows are shifted or of even number, or shifted and of odd number.
    similarity = max(
        _similarity(power, power[flipped][:, columns])
        for flipped in ((-rows) % n_rows, n_rows - 1 - rows)
    )
    by_chance = _similarity(power, np.roll(power[(-rows) % n_rows][:, columns], 3, axis=1))
    return similarity if by_chance < _MAX_SIMILARITY_BY_CHANCE else 0.0


def _similarity(power: np.ndarray, other: np.ndarray) -> float:
    total = np.maximum(power + other, 1e-300)
    return float(1 - np.mean(abs(power - other) / total))


def diagnose_mirror_image(similarity: float, *, content: str) -> Diagnosis:
    """Report a map that is its own mirror image."""
    if similarity < MIRRORED:
        return NOTHING_FOUND
    is_map = content == "map"
    return mistake_found(
        "range_m.mirror" if is_map else "iq",
        value=f"a spectrum that is its own mirror image to {similarity:.2%} (noise: 50 %)",
        expected="ranges from 0 to fs / 2 only, because real samples have a mirrored spectrum"
        if is_map
        else "I and Q in quadrature",
        fix="keep n // 2 + 1 cells of the range FFT (rfft), and end the axis at fs / 2"
        if is_map
        else "if the radar has one mixer, give real samples; else one of the two parts was lost",
    )


@dataclass(frozen=True)
class _Band:
    """Echoes in a narrow band of cells of one axis."""

    n_echoes: int
    n_total: int
    chance: float
    """Probability that so many of all echoes lie there, at random positions."""

    @property
    def is_significant(self) -> bool:
        """Return whether the band contains more echoes than chance puts there."""
        return self.n_echoes >= _MIN_STATIC_ECHOES and self.chance < _FALSE_ALARM_PROBABILITY


def _band_of_echoes(index: np.ndarray, place: int, size: int, padding: float) -> _Band:
    """Count the echoes at a cell of an axis of `size` cells, or within a resolution cell of it.

    Whichever is less probable: walls are exactly at velocity 0, trees sway.
    """
    distance = abs(index - place) % size
    distance = np.minimum(distance, size - distance)
    bands = []
    for half_width in (0, round(padding)):
        n_echoes = int(np.count_nonzero(distance <= half_width))
        share = min((2 * half_width + 1) / size, 1.0)
        chance = 2 * float(scipy.stats.binom.sf(n_echoes - 1, index.size, share))
        bands.append(_Band(n_echoes=n_echoes, n_total=index.size, chance=min(chance, 1.0)))
    return min(bands, key=lambda band: band.chance)


def diagnose_axis_order(
    peaks: MapPeaks,
    shape: tuple[int, int],
    zero_row: int,
    padding: tuple[float, float],
    *,
    content: str,
) -> Diagnosis:
    """Report static echoes at one range and many velocities, as after an exchange of the axes.

    Exchanged before the transforms, velocity 0 is at range 0. In a map that is transposed after
    `fftshift`, it is in the middle of the range axis.
    """
    # Real samples have every echo of range 0 at both signs of the velocity.
    velocity = abs(peaks.row - zero_row)
    twins = (peaks.column == 0) & (peaks.row < zero_row)
    is_twin = twins & np.isin(velocity, velocity[(peaks.column == 0) & ~twins])
    is_other = (velocity > padding[0]) & ~is_twin
    column = 0
    fix = (
        "exchange the axes of chirps and samples before the transforms: samples of one chirp are"
        " the fast time"
    )
    at_one_range = _band_of_echoes(peaks.column[is_other], 0, shape[1], padding[1])
    if content == "map":
        middle = _band_of_echoes(peaks.column[is_other], shape[1] // 2, shape[1], padding[1])
        if middle.chance < at_one_range.chance:
            at_one_range, column = middle, shape[1] // 2
            fix = "transpose the map to (velocity, range), and give each axis its own steps"
    is_elsewhere = abs(peaks.column - column) > padding[1]
    static = _band_of_echoes(peaks.row[is_elsewhere], zero_row, shape[0], padding[0])
    if at_one_range.n_echoes <= max(2 * static.n_echoes, 1):
        return NOTHING_FOUND
    evidence = (
        f"{at_one_range.n_echoes} of {at_one_range.n_total} moving echoes"
        f" {'in the middle of the range axis' if column else 'at range 0'} with different"
        f" velocities, and {static.n_echoes} static ones at other ranges (probability of"
        f" chance {at_one_range.chance:.1g})"
    )
    if not at_one_range.is_significant:
        return cannot_be_told(
            "axes",
            value=evidence,
            expected=f"at least {_MIN_STATIC_ECHOES} static echoes, and a probability below"
            f" {_FALSE_ALARM_PROBABILITY:g}",
            fix="give a frame with more static echoes, or with different numbers of chirps and"
            " samples",
        )
    return mistake_found(
        "axes",
        value=evidence,
        expected="static echoes, which have one velocity and many ranges",
        fix=fix,
    )


def has_static_row(
    peaks: MapPeaks, shape: tuple[int, int], zero_row: int, padding: tuple[float, float]
) -> bool:
    """Return whether the row of velocity 0 contains more echoes than chance puts there."""
    return _band_of_echoes(peaks.row, zero_row, shape[0], padding[0]).is_significant


def diagnose_fftshift(
    peaks: MapPeaks, shape: tuple[int, int], zero_row: int, padding: tuple[float, float]
) -> Diagnosis:
    """Report static echoes in the row that is labelled with the largest velocity."""
    edge_row = (zero_row + shape[0] // 2) % shape[0]
    edge = _band_of_echoes(peaks.row, edge_row, shape[0], padding[0])
    zero = _band_of_echoes(peaks.row, zero_row, shape[0], padding[0])
    if edge.is_significant and edge.n_echoes > 2 * zero.n_echoes:
        return mistake_found(
            "fftshift",
            value=f"{edge.n_echoes} of {edge.n_total} echoes at the largest velocity of the axis,"
            f" and {zero.n_echoes} at velocity 0 (probability of chance {edge.chance:.1g})",
            expected="static echoes at velocity 0",
            fix="apply fftshift along the velocity axis, and only there:"
            " fftshift(X, axes=0) for (velocity, range)",
        )
    if zero.n_echoes > edge.n_echoes:
        return NOTHING_FOUND
    return cannot_be_told(
        "fftshift",
        value=f"{zero.n_echoes} of {zero.n_total} echoes at velocity 0, and {edge.n_echoes} at the"
        " largest",
        expected=f"at least {_MIN_STATIC_ECHOES} static echoes at different ranges, or a known"
        " target",
        fix="give a frame with walls or furniture, or the range and velocity of a target",
    )


def diagnose_iq_order(peaks: MapPeaks, n_range: int, padding: float, *, content: str) -> Diagnosis:
    """Report echoes that fill the upper half of a complex spectrum, near ranges at its end.

    Echoes weaken with the fourth power of range, and most designs leave the upper half empty.
    Swapped parts turn the cell k into n - k. Where echoes are in both halves, the levels without
    that fall decide, if they spread by significantly less in the other order. Echoes whose levels
    fall neither way fit both orders. A map of reversed ranges shows the same as one of swapped
    parts, unless a moving target is known.
    """
    from_zero = np.minimum(peaks.column, n_range - peaks.column)
    inner = from_zero > 2 * padding
    columns, snr = peaks.column[inner], peaks.snr[inner]
    is_far = columns > n_range / 2
    n_far, n_total = np.unique(columns[is_far]).size, np.unique(columns).size
    energy = float(snr[is_far].sum() / snr.sum()) if snr.size else 0.0
    # Spread of the levels in decibels, freed from the fall with range, in either order.
    level = to_decibels(snr)
    as_read, swapped = (
        float(np.std(level + 40 * np.log10(cells))) if cells.size else 0.0
        for cells in (columns, n_range - columns)
    )
    evidence = (
        f"{n_far} of {n_total} echoes and {energy:.1%} of their energy beyond half of the"
        f" unambiguous range; their levels, freed from R^-4, spread by {as_read:.1f} dB as read"
        f" and by {swapped:.1f} dB in the other order"
    )
    # Fisher's distribution of the ratio of variances tells 10 of 30 swapped arrays with echoes in
    # both halves. None of 161 right arrays has so many echoes in the far half that it is asked.
    degrees = max(n_total - 1, 1)
    ratio = (as_read / max(swapped, np.finfo(float).tiny)) ** 2
    fall_backwards = scipy.stats.f.sf(ratio, degrees, degrees) < _MAX_PROBABILITY_OF_SPREADS
    fall_with_range = scipy.stats.f.cdf(ratio, degrees, degrees) < _MAX_PROBABILITY_OF_SPREADS
    mostly_near = n_total - n_far >= _MIN_FAR_ECHOES and energy <= 1 - _FAR_ENERGY
    is_near_stronger = energy < _FAR_ENERGY and n_total >= _MIN_FAR_ECHOES
    if mostly_near or (is_near_stronger and fall_with_range):
        return NOTHING_FOUND
    mostly_far = n_far >= 0.8 * n_total and swapped < as_read
    is_far_stronger = energy >= _FAR_ENERGY and n_far >= _MIN_FAR_ECHOES
    if is_far_stronger and (mostly_far or fall_backwards):
        return mistake_found(
            "iq",
            value=evidence,
            expected="the strongest echoes near the radar, at low positive beat frequencies",
            fix="exchange I and Q, which conjugates the samples and mirrors range and velocity;"
            + (
                " if the program reversed the ranges alone, reverse them again: powers of static"
                " echoes are the same in both cases;"
                if content == "map"
                else ""
            )
            + " right as it is only if all echoes are that far",
        )
    return cannot_be_told(
        "iq",
        value=evidence,
        expected=f"at least {_MIN_FAR_ECHOES} echoes whose levels fall with range, or a known"
        " target",
        fix="give a frame with more echoes, or the range of a target",
    )
