"""Tones of one chirp and its bursts, each found without the other.

A beat signal of few echoes is a sum of tones. Tones are fitted to the samples outside bursts, and
bursts are where the rest exceeds its noise, in turn, until neither changes: the relaxation of
J. Li and P. Stoica, "Efficient mixed-spectrum estimation with applications to target feature
extraction", IEEE Trans. Signal Process. 44(2), 1996, on samples with gaps.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.processing.mitigation.burst_detection import mark_bursts_over_noise

_MAX_TONES = 16
# Of the median of white noise. Below it, the rest contains echoes that are no tones, such as those
# of walls, whose own changes look like bursts.
_MIN_MEDIAN = 0.5
_MAX_ROUNDS = 8  # of tones, then bursts; three are usual
_FIRST_STEPS, _LAST_STEPS = 1, 4  # of the frequencies, by Gauss and Newton
_FALSE_TONE_PROBABILITY = 1e-6
_FALSE_BURST_PROBABILITY = 1e-12  # in a chirp of noise
_MIN_CLEAR_SHARE = 0.25  # samples outside bursts; tones of fewer are not certain
# Of the mean power: below it, the rest is rounding of single precision.
_RELATIVE_NOISE_FLOOR = 1e-13


class ToneFit(NamedTuple):
    """Tones of a chirp in all receivers, and the samples in bursts."""

    tones: np.ndarray
    """Sum of the fitted tones, (rx, sample)."""
    is_burst: np.ndarray
    """Burst mask (sample,), common to all receivers."""


def fit_tones_outside_bursts(chirp: np.ndarray) -> ToneFit:
    """Fit common frequencies, and amplitudes of each receiver, to the samples outside bursts.

    Parameters
    ----------
    chirp : array (rx, sample), real or complex
        Samples of one chirp, with bursts in three quarters of them at most.

    Returns
    -------
    ToneFit
        Without tones where none exceeds the noise; without bursts where the rest is noise, or
        where tones do not explain the echoes.
    """
    samples = np.asarray(chirp, complex if np.iscomplexobj(chirp) else float)
    frequencies = np.zeros(0)
    tones = np.zeros_like(samples)
    is_burst = np.zeros(samples.shape[1], bool)
    for _ in range(_MAX_ROUNDS):
        found = _find_bursts(samples, tones)
        if np.mean(~found) < _MIN_CLEAR_SHARE:
            break
        is_changed, is_burst = not np.array_equal(found, is_burst), found
        grown, tones = _fit_tones(samples, ~is_burst, frequencies)
        is_settled = not is_changed and len(grown) == len(frequencies)
        if is_settled or len(grown) == _MAX_TONES:
            break
        frequencies = grown
    if is_burst.any() and not _is_white(np.where(is_burst, 0, samples - tones)):
        is_burst = np.zeros_like(is_burst)
    return ToneFit(tones, is_burst)


def _is_white(rest: np.ndarray) -> bool:
    """Return True if no receiver has a rest whose power is in few of its frequencies."""
    power = np.abs(scipy.fft.fft(rest, axis=1)) ** 2
    # Powers of white noise are exponential, with a median of ln 2 of their mean.
    return bool(np.all(np.median(power, axis=1) > _MIN_MEDIAN * math.log(2) * power.mean(axis=1)))


def _find_bursts(samples: np.ndarray, tones: np.ndarray) -> np.ndarray:
    """Return the burst mask (sample,) of what the tones leave."""
    floor = _RELATIVE_NOISE_FLOOR * np.mean(np.abs(samples) ** 2, axis=1)
    is_burst = np.zeros(samples.shape[1], bool)
    mark_bursts_over_noise(
        np.abs(samples - tones) ** 2,
        is_burst,
        n_parts=2 if np.iscomplexobj(samples) else 1,
        noise_floor=floor,
        false_probability=_FALSE_BURST_PROBABILITY,
    )
    return is_burst


def _fit_tones(
    samples: np.ndarray, is_clear: np.ndarray, frequencies: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return all frequencies in cycles per sample, from those of the last round on, and tones."""
    n_rx, n_samples = samples.shape
    n_bins = scipy.fft.next_fast_len(2 * n_samples)
    n_searched = n_bins if np.iscomplexobj(samples) else n_bins // 2 + 1
    # Of white noise, the power of a bin over its mean is the mean of one exponential a receiver.
    limit = scipy.special.gammainccinv(n_rx, _FALSE_TONE_PROBABILITY / n_bins)
    frequencies, tones = _refine_tones(samples, is_clear, frequencies, _FIRST_STEPS)
    while len(frequencies) < _MAX_TONES:
        rest = np.where(is_clear, samples - tones, 0)
        energy = np.sum(np.abs(rest) ** 2, axis=1, keepdims=True)
        spectra = np.abs(scipy.fft.fft(rest, n_bins, axis=1)[:, :n_searched]) ** 2
        excess = np.sum(spectra / np.maximum(energy, np.finfo(float).tiny), axis=0)
        peak = int(excess.argmax())
        if excess[peak] <= limit:
            break
        frequencies = np.append(frequencies, peak / n_bins)
        frequencies, tones = _refine_tones(samples, is_clear, frequencies, _FIRST_STEPS)
    return _refine_tones(samples, is_clear, frequencies, _LAST_STEPS)


def _refine_tones(
    samples: np.ndarray, is_clear: np.ndarray, frequencies: np.ndarray, n_steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Minimise the squared rest outside bursts over all frequencies and amplitudes."""
    n_samples = samples.shape[1]
    times = np.arange(n_samples) - (n_samples - 1) / 2
    clear, largest_step = samples[:, is_clear].T, 0.5 / n_samples  # half a resolution cell
    for _ in range(n_steps if frequencies.size else 0):
        basis = _tone_basis(times[is_clear], frequencies, samples.dtype)
        orthogonal, triangle = np.linalg.qr(basis)
        amplitudes = np.linalg.lstsq(triangle, orthogonal.conj().T @ clear, rcond=1e-9)[0]
        slopes = _frequency_slopes(times[is_clear], basis, amplitudes)
        # Amplitudes follow the frequencies (variable projection): their columns do not count.
        flat = slopes.reshape(len(clear), -1)
        flat = flat - orthogonal @ (orthogonal.conj().T @ flat)
        columns = flat.reshape(-1, len(frequencies))
        rest = (clear - basis @ amplitudes).reshape(-1)
        step = np.linalg.lstsq(
            np.concatenate([columns.real, columns.imag]),
            np.concatenate([rest.real, rest.imag]),
            rcond=1e-9,
        )[0]
        frequencies = frequencies + np.clip(step, -largest_step, largest_step)
    basis = _tone_basis(times, frequencies, samples.dtype)
    amplitudes = np.linalg.lstsq(basis[is_clear], clear, rcond=1e-9)[0]
    return frequencies, (basis @ amplitudes).T


def _tone_basis(times: np.ndarray, frequencies: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return the columns of tones: exponentials, or all cosines and then all sines."""
    phasors = np.exp(2j * np.pi * np.outer(times, frequencies))
    if np.issubdtype(dtype, np.complexfloating):
        return phasors
    return np.concatenate([phasors.real, phasors.imag], axis=1)


def _frequency_slopes(times: np.ndarray, basis: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """Return the derivatives of the tones by their frequencies, (sample, rx, tone)."""
    radians = 2 * np.pi * times[:, None, None]
    if np.iscomplexobj(basis):
        return np.asarray(1j * radians * basis[:, None, :] * amplitudes.T)
    cosines, sines = np.split(basis[:, None, :], 2, axis=2)
    of_cosines, of_sines = np.split(amplitudes.T, 2, axis=1)
    return np.asarray(radians * (of_sines * cosines - of_cosines * sines))
