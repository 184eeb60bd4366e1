"""Echoes in a map of unknown origin: local maxima over the noise that are no sidelobes."""

from dataclasses import dataclass

import numpy as np

_MIN_OVER_MEDIAN = 40.0
"""Noise reaches 40 times its median with a probability of 2^-40 = 1e-12 in a cell."""
_MIN_OVER_STRONGEST = 1e-6  # in maps without noise, sidelobes and rounding errors lie below
_MAX_PEAKS = 400
_MIN_ECHO_OVER_MEDIAN, _CLIPPED_OVER_MEDIAN = 14.0, 6.0
_SIDELOBE_MARGIN = 16.0
_MIN_LOBE_OVER_MEDIAN, _MAX_LOBES = 1000.0, 24
# Sidelobes of a Hann window, at most 31 dB below the strongest echo, are no main lobes.
_MIN_LOBE_OVER_STRONGEST = 10**-2.9


@dataclass(frozen=True)
class MapPeaks:
    """Echoes of a map (velocity, range), the strongest first."""

    row: np.ndarray
    column: np.ndarray
    snr: np.ndarray
    """Power over the median of the noise."""

    @property
    def size(self) -> int:
        """Number of echoes."""
        return self.row.size


def median_noise(power: np.ndarray) -> np.ndarray:
    """Return the median of each column, (range,), or of the whole map if it has few rows.

    The noise may depend on range, as behind the IF filter; echoes occupy few velocities.
    """
    few_rows = power.shape[0] < 8
    median = np.full(power.shape[1], np.median(power)) if few_rows else np.median(power, axis=0)
    return np.maximum(median, max(float(power.max()) * 1e-15, 1e-300))


def noise_correlation(power: np.ndarray, axis: int, lags: np.ndarray) -> np.ndarray:
    """Return the correlation of noise powers between cells of an axis, for each lag.

    Lines with an echo are left out if others remain, and powers are clipped at 6 times the
    median, which noise exceeds in 1 of 64 cells.
    """
    over_noise = np.moveaxis(power / median_noise(power), axis, -1)
    has_echo = over_noise.max(axis=-1) > _MIN_ECHO_OVER_MEDIAN
    if np.mean(has_echo) < 0.9:
        over_noise = over_noise[~has_echo]
    clipped = np.minimum(over_noise, _CLIPPED_OVER_MEDIAN)
    lines = clipped - clipped.mean()
    covariance = [np.mean(lines[:, lag:] * lines[:, :-lag]) for lag in lags]
    return np.array(covariance) / max(float(np.mean(lines**2)), 1e-300)


def measure_main_lobes(power: np.ndarray, axis: int) -> np.ndarray:
    """Return the main lobes of the strongest echoes along an axis, (echo,).

    The sum of the amplitudes of both neighbours over that of the peak, from 0 of a tone on the grid
    without a window to 2 of a long zero-padded transform.
    """
    lines = np.moveaxis(power, axis, -1)
    over_noise = np.moveaxis(power / median_noise(power), axis, -1)
    is_peak = (lines > np.roll(lines, 1, -1)) & (lines >= np.roll(lines, -1, -1))
    if len(lines) > 2:  # each echo once, not in all lines of its lobe
        is_peak &= (lines > np.roll(lines, 1, 0)) & (lines >= np.roll(lines, -1, 0))
    is_peak &= lines > _MIN_LOBE_OVER_STRONGEST * lines.max(initial=0.0)
    line, cell = np.nonzero(is_peak & (over_noise > _MIN_LOBE_OVER_MEDIAN))
    is_inner = (cell > 1) & (cell < lines.shape[-1] - 2)
    line, cell = line[is_inner], cell[is_inner]
    strongest = np.argsort(-lines[line, cell])[:_MAX_LOBES]
    line, cell = line[strongest], cell[strongest]
    amplitude = np.sqrt(lines)
    neighbours = amplitude[line, cell - 1] + amplitude[line, cell + 1]
    return np.asarray(neighbours / amplitude[line, cell])


def find_map_peaks(
    power: np.ndarray, *, padding: tuple[float, float], is_windowed: tuple[bool, bool]
) -> MapPeaks:
    """Find the echoes of a map (velocity, range) of linear powers.

    `padding` is the number of cells per resolution cell, (velocity, range). Maxima below the
    sidelobes of a stronger echo are left out: 16 / (pi d)^2 at a distance of d cells, four times
    the sidelobes without a window, times 1 / d^4 with one.
    """
    over_noise = power / median_noise(power)
    is_peak = over_noise > max(
        _MIN_OVER_MEDIAN, _MIN_OVER_STRONGEST * float(over_noise.max(initial=0.0))
    )
    for axis, size in enumerate(power.shape):
        if size > 2:
            is_peak &= (over_noise >= np.roll(over_noise, 1, axis)) & (
                over_noise > np.roll(over_noise, -1, axis)
            )
    row, column = np.nonzero(is_peak)
    order = np.argsort(-power[row, column])[:_MAX_PEAKS]
    row, column = row[order], column[order]
    level = power[row, column]
    sidelobes = np.ones((row.size, row.size))
    for axis, index in enumerate((row, column)):
        cells = abs(index[:, None] - index)
        distance = np.minimum(cells, power.shape[axis] - cells) / padding[axis]
        far = np.maximum(distance, 1.0)
        envelope = np.minimum(1.0, _SIDELOBE_MARGIN / (np.pi * far) ** 2)
        sidelobes *= envelope / far**4 if is_windowed[axis] else envelope
    is_sidelobe = np.any(np.tril(sidelobes * level > level[:, None], -1), axis=1)
    is_echo = ~is_sidelobe
    return MapPeaks(
        row=row[is_echo], column=column[is_echo], snr=over_noise[row[is_echo], column[is_echo]]
    )
