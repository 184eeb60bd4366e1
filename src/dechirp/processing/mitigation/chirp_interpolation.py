"""Interpolation of whole chirps of a frame from the other chirps of the same transmitter.

A chirp set to zero adds to every velocity of an echo: one of M chirps leaves sidelobes of 1/M^2 in
power, -36 dB for 64 chirps. Interpolated are the strong cells of the slow-time spectrum of each
range, by regularised least squares, as the conditional mean of a Gaussian process with that
spectrum (the iterative adaptive approach estimates it in a similar way). Noise is not
interpolated: the noise of a map decreases by the share of the chirps, 0.07 dB for one of 64.

References
----------
P. Stoica, J. Li and J. Ling, "Missing data recovery via a nonparametric iterative adaptive
approach", IEEE Signal Processing Letters 16(4), 2009.
"""

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.theory.detection import detection_threshold

_MIN_ROUNDS = 16  # of fewer, the main lobe of an echo takes half of the velocities
# Of the chirps of a transmitter. What remains of an echo 60 dB over the noise is below the noise
# for a quarter spread over the frame, and 3 dB over it for an eighth in a row.
_MAX_MISSING_SHARE, _MAX_SHARE_IN_A_ROW = 1 / 4, 1 / 8
# The first pass sees the sidelobes of the zeros, the later ones those of the errors before.
_N_PASSES = 3
_FALSE_CELL_PROBABILITY = 1e-7  # of a strong cell in noise, below that of usual detectors
_NOISE_QUANTILE = 0.25  # of the velocities of a range: robust with echoes in half of them
# Of the strongest velocity: extrapolation amplifies the rounding errors of single precision.
_MIN_NOISE_RATIO = 1e-8


def interpolable_chirp_mask(is_missing: np.ndarray, n_slots: int) -> np.ndarray:
    """Return the mask of missing chirps, (chirp,), that the others suffice to interpolate.

    A transmitter needs at least 16 chirps, of which at most a quarter is missing, and at most an
    eighth in a row. `n_slots` is the number of chirps after which the same transmitter sends again.
    """
    by_slot = is_missing.reshape(-1, n_slots)
    n_rounds = len(by_slot)
    longest_run = int(n_rounds * _MAX_SHARE_IN_A_ROW)
    has_long_run = sliding_window_view(by_slot, longest_run + 1, axis=0).all(-1).any(0)
    can_interpolate = ~has_long_run & (by_slot.mean(axis=0) <= _MAX_MISSING_SHARE)
    can_interpolate &= n_rounds >= _MIN_ROUNDS
    return np.asarray((by_slot & can_interpolate).ravel())


def interpolate_chirps(samples: np.ndarray, is_missing: np.ndarray, n_slots: int) -> np.ndarray:
    """Return the samples (chirp, rx, sample) of a frame with missing chirps interpolated.

    The given samples of missing chirps are ignored. Those that cannot be interpolated, see
    `interpolable_chirp_mask`, become zero; all others stay bit-identical.
    """
    out = samples.copy()
    out[is_missing] = 0
    is_interpolated = interpolable_chirp_mask(is_missing, n_slots)
    if not is_interpolated.any():
        return out
    n_samples = samples.shape[2]
    is_complex = np.iscomplexobj(samples)
    spectra = scipy.fft.fft(out, axis=2) if is_complex else scipy.fft.rfft(out, axis=2)
    series = spectra.reshape(-1, n_slots, *spectra.shape[1:])
    n_cells = 2 * len(series)
    missing_by_slot = is_missing.reshape(-1, n_slots)
    # Only slots that are interpolated: the zeros of others have sidelobes.
    slots = np.flatnonzero(is_interpolated.reshape(-1, n_slots).any(axis=0))
    zero_filled_spectra = {slot: scipy.fft.fft(series[:, slot], n_cells, axis=0) for slot in slots}
    for _ in range(_N_PASSES):
        power, noise, threshold = _slow_time_power_and_noise(series[:, slots])
        for slot in slots:
            missing = np.flatnonzero(missing_by_slot[:, slot])
            series[missing, slot] = _evaluate_strong_cells(
                zero_filled_spectra[slot],
                scipy.fft.fft((~missing_by_slot[:, slot]).astype(float), n_cells),
                power,
                noise,
                threshold,
                missing,
            )
    filled = spectra[is_interpolated]
    out[is_interpolated] = (
        scipy.fft.ifft(filled, axis=2) if is_complex else scipy.fft.irfft(filled, n_samples, axis=2)
    )
    return out


def _slow_time_power_and_noise(series: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the mean power (velocity, range), the noise of each range, and a detection threshold.

    `series` is (round, slot, rx, range). The velocities have half the spacing of a cell; the
    power is that of a noise sample in noise, and the threshold a multiple of it.
    """
    n_rounds, n_slots, n_rx, n_ranges = series.shape
    n_channels = n_slots * n_rx
    taper = np.hanning(n_rounds + 1)[:-1].astype(np.float32)
    power = np.zeros((2 * n_rounds, n_ranges))
    for slot in range(n_slots):
        spectrum = scipy.fft.fft(series[:, slot] * taper[:, None, None], 2 * n_rounds, axis=0)
        power += np.sum(spectrum.real**2 + spectrum.imag**2, axis=1)
    power /= n_channels * float(np.sum(taper**2))
    # Means of n exponential powers have a gamma distribution.
    quantile_of_noise = detection_threshold(1 - _NOISE_QUANTILE, n_summed=n_channels) / n_channels
    noise = np.quantile(power, _NOISE_QUANTILE, axis=0) / quantile_of_noise
    noise = np.maximum(noise, _MIN_NOISE_RATIO * power.max(axis=0))
    threshold = detection_threshold(_FALSE_CELL_PROBABILITY, n_summed=n_channels) / n_channels
    return power, noise, threshold


@kernel(plain=AS_WRITTEN)
def _evaluate_strong_cells(
    zero_filled_spectrum: np.ndarray,
    kept_spectrum: np.ndarray,
    power: np.ndarray,
    noise: np.ndarray,
    threshold: float,
    missing: np.ndarray,
) -> np.ndarray:
    """Fit the strong cells to the given chirps; return their sum in the missing ones.

    Minimises |x - A c|^2 / noise + sum |c_k|^2 / P_k over the amplitudes c of the strong cells.
    `zero_filled_spectrum` (velocity, rx, range) is the transform A^H x of the chirps with zeros in
    place of missing ones, `kept_spectrum` (velocity,) that of the mask of the others, which is a
    row of A^H A. Returns (missing, rx, range).
    """
    n_cells, n_rx, n_ranges = zero_filled_spectrum.shape
    out = np.zeros((missing.size, n_rx, n_ranges), np.complex64)
    for row in range(n_ranges):
        cells = np.flatnonzero(power[:, row] > threshold * noise[row])
        if not cells.size:
            continue
        matrix = np.empty((cells.size, cells.size), np.complex128)
        right_side = np.empty((cells.size, n_rx), np.complex128)
        for i in range(cells.size):
            for j in range(cells.size):
                matrix[i, j] = kept_spectrum[(cells[i] - cells[j]) % n_cells]
            matrix[i, i] += noise[row] * n_cells / (power[cells[i], row] - noise[row])
            for k in range(n_rx):
                right_side[i, k] = zero_filled_spectrum[cells[i], k, row]
        amplitudes = np.linalg.solve(matrix, right_side)
        for m in range(missing.size):
            for i in range(cells.size):
                phase = 2 * np.pi * ((missing[m] * cells[i]) % n_cells) / n_cells
                rotation = complex(np.cos(phase), np.sin(phase))
                for k in range(n_rx):
                    out[m, k, row] += np.complex64(rotation * amplitudes[i, k])
    return out
