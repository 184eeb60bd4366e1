"""Detection of interference bursts in the samples of a frame.

The chirps with bursts are those of the recording quality measures, by the same law: the share of
a chirp's energy in a stretch of it exceeds the share that white noise reaches once in 1e12
chirps. In such a chirp a burst is where the power over twice that of noise adds up to more than
noise makes likely; its ends are where it falls to that. In noise, sums of e - 2, e exponential of
mean 1, exceed x from some sample on with a probability below exp(-0.797 x) (Lundberg's bound of
an insurer's ruin).
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.processing.mitigation.base import all_zero_chirp_mask
from dechirp.processing.quality.background import Background, estimate_background
from dechirp.processing.quality.interference_bursts import measure_bursts_over_background
from dechirp.processing.quality.sample_statistics import SILENT, compute_sample_statistics
from dechirp.radar.frame import Frame

# Share of a chirp; slightly above 1/2, so that stretches of 128 samples fit 240 samples.
_MAX_BURST_SHARE = 0.55
_FALSE_STRETCH_PROBABILITY = 1e-6  # of a false stretch in a chirp with a burst
_BURST_THRESHOLD = 2.0
_STRONG_BURST_THRESHOLD = 10.0  # stronger bursts would bias a mean over 64 chirps
# Solves exp(-2 t) / (1 - t) = 1 for exponential powers; half of that t for squares of real values.
_DECAY = {2: 0.7968, 1: 0.3984}
_MEDIAN = {2: 0.693, 1: 0.455}  # median of such powers over their mean
_QUARTER = {2: 0.288, 1: 0.102}  # lower quartile over the mean
_MIN_GAP = 20.0  # about the samples of noise that separate two bursts
_MARGIN = 2  # samples on each side for the skirts of a burst
_N_NOISE_CHIRPS = 32  # chirps whose median power estimates the noise
_MIN_USABLE_SHARE = 0.25  # share of burst-free chirps; the mean over fewer is noisy


@dataclass(frozen=True)
class FrameBursts:
    """Bursts in a frame, and its signal without them."""

    is_burst: np.ndarray
    """Burst mask (chirp, sample), common to all receivers."""
    static_samples: np.ndarray
    """Static echoes (slot, rx, sample), in the unit of the samples."""
    predictor: np.ndarray
    """Weights of the samples before, (order,), that predict moving echoes, the nearest first."""


def detect_bursts(samples: np.ndarray, frame: Frame) -> FrameBursts | None:
    """Detect bursts in one frame, (chirp, rx, sample), float32 or complex64; None without any.

    Frames with fewer than four chirps of each transmitter or 16 samples are too short for
    detection.
    """
    is_lost, n_parts = all_zero_chirp_mask(samples), 2 if np.iscomplexobj(samples) else 1
    statistics = compute_sample_statistics(samples.view(np.float32), is_lost, n_parts)
    scale = statistics.largest_part_magnitude
    if scale < SILENT:
        return None
    normalised = samples * np.float32(1 / scale)
    step = statistics.step / scale
    background = estimate_background(normalised, is_lost, n_slots=frame.n_slots, largest_value=1.0)
    if background is None or not background.receiver_weight.any():
        return None
    is_strong_burst = _burst_mask(
        normalised, is_lost, background, step, threshold=_STRONG_BURST_THRESHOLD
    )
    if is_strong_burst.any():
        # The quieter half contains some of them as well: detect again without those.
        filled, static_samples = normalised.copy(), background.static_samples.view(normalised.dtype)
        for chirp in np.flatnonzero(is_strong_burst.any(axis=1)):
            filled[chirp, :, is_strong_burst[chirp]] = static_samples[
                chirp % len(static_samples), :, is_strong_burst[chirp]
            ]
        background = (
            estimate_background(filled, is_lost, n_slots=frame.n_slots, largest_value=1.0)
            or background
        )
    is_burst = _burst_mask(normalised, is_lost, background, step, threshold=_BURST_THRESHOLD)
    if not is_burst.any():
        return None
    static_samples = np.float32(scale) * _burst_free_mean_per_slot(
        normalised, is_burst, is_lost, background.static_samples
    )
    return FrameBursts(
        is_burst=is_burst, static_samples=static_samples, predictor=background.predictor
    )


def _burst_mask(
    samples: np.ndarray,
    is_lost: np.ndarray,
    background: Background,
    adc_step: float,
    *,
    threshold: float,
) -> np.ndarray:
    """Return a mask of samples in bursts, (chirp, sample), above the noise by `threshold`."""
    chirp_bursts = measure_bursts_over_background(
        background,
        samples,
        is_lost,
        largest_value=1.0,
        adc_step=adc_step,
        max_share=_MAX_BURST_SHARE,
    )
    n_parts = 2 if np.iscomplexobj(samples) else 1
    alive = np.flatnonzero(background.receiver_weight)
    static_samples = background.static_samples.view(samples.dtype)[:, alive]

    def error_power(chirp: int) -> np.ndarray:
        return _smaller_prediction_error_power(
            samples[chirp, alive] - static_samples[chirp % len(static_samples)],
            background.predictor,
        )

    # Medians are robust against bursts in less than half of the quieter chirps.
    measured_chirps = background.quiet_chirps[
        :: -(-background.quiet_chirps.size // _N_NOISE_CHIRPS)
    ]
    noise = np.median([np.median(error_power(chirp), axis=1) for chirp in measured_chirps], axis=0)
    # The quantisation noise of the converter is the lower limit of the noise.
    noise_floor = np.maximum(
        n_parts / 2 * adc_step**2, background.rounding_power / background.receiver_weight[alive]
    )
    noise_floor = np.maximum(noise_floor, noise / _MEDIAN[n_parts])
    is_burst = np.zeros((len(samples), samples.shape[2]), bool)
    for chirp in np.flatnonzero(chirp_bursts.excess > 1).tolist():
        mark_bursts_over_noise(
            error_power(chirp),
            is_burst[chirp],
            n_parts=n_parts,
            noise_floor=noise_floor,
            false_probability=_FALSE_STRETCH_PROBABILITY,
            threshold=threshold,
        )
    return is_burst


def mark_bursts_over_noise(
    power: np.ndarray,
    is_burst: np.ndarray,
    *,
    n_parts: int,
    noise_floor: np.ndarray,
    false_probability: float,
    threshold: float = _BURST_THRESHOLD,
) -> None:
    """Mark the bursts of one chirp in `is_burst` (sample,), from powers (rx, sample).

    Powers are those of samples without echoes, of two parts, I and Q, or of one. Their noise is at
    least `noise_floor` (rx,). In noise, a stretch is marked with `false_probability`.
    """
    # Noise may differ from chirp to chirp; a burst leaves a quarter of a chirp to measure it.
    noise = np.maximum(np.quantile(power, 0.25, axis=1) / _QUARTER[n_parts], noise_floor)
    limit = np.log(power.shape[1] / false_probability) / _DECAY[n_parts]
    _mark_bursts(np.mean(power / noise[:, None], axis=0) - threshold, limit, is_burst)


def _smaller_prediction_error_power(moving: np.ndarray, predictor: np.ndarray) -> np.ndarray:
    """Return the smaller power of the forward and backward prediction errors, (rx, sample).

    A burst spoils the prediction of the samples that follow it in either direction.
    """
    runs = sliding_window_view(moving, predictor.size + 1, axis=1)
    forward, backward = np.full((2, *moving.shape), np.inf)
    forward[:, predictor.size :] = np.abs(runs @ np.r_[-predictor[::-1], 1]) ** 2
    backward[:, : runs.shape[1]] = np.abs(runs @ np.r_[1, -predictor.conj()]) ** 2
    return np.minimum(forward, backward)


@kernel(plain=AS_WRITTEN)
def _mark_bursts(excess: np.ndarray, min_summed_excess: float, is_burst: np.ndarray) -> None:
    """Mark stretches whose sums exceed a limit, each as long as its sum still grows."""
    n = 0
    while n < excess.size:
        start, last, total, largest = n, -1, 0.0, 0.0
        while n < excess.size:
            total += excess[n]
            if total > largest:
                largest, last = total, n
            if total <= max(0.0, largest - _MIN_GAP):
                break
            n += 1
        if largest > min_summed_excess:
            is_burst[max(start - _MARGIN, 0) : last + 1 + _MARGIN] = True
        # Samples after the largest sum may start another burst.
        n = max(last, start) + 1


def _burst_free_mean_per_slot(
    samples: np.ndarray, is_burst: np.ndarray, is_lost: np.ndarray, static_samples: np.ndarray
) -> np.ndarray:
    """Return the burst-free mean of each slot, (slot, rx, sample); static samples if few."""
    out = static_samples.view(samples.dtype).copy()
    n_slots = len(out)
    is_usable = ~is_burst & ~is_lost[:, None]
    for slot in range(n_slots):
        total = np.zeros(samples.shape[1:], np.result_type(samples.dtype, np.float64))
        for chirp in range(slot, len(samples), n_slots):
            total += samples[chirp] * is_usable[chirp]
        n_usable = is_usable[slot::n_slots].sum(axis=0)
        is_sufficient = n_usable >= max(
            1, _MIN_USABLE_SHARE * np.count_nonzero(~is_lost[slot::n_slots])
        )
        out[slot, :, is_sufficient] = (total[:, is_sufficient] / n_usable[is_sufficient]).T
    return out
