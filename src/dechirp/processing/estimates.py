"""Noise, range and velocity of peaks, with standard errors."""

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.cfar.base import TrainingWindow
from dechirp.processing.refine import SidelobeErrors, Tones
from dechirp.radar.chirp import Chirp
from dechirp.radar.estimation_bounds import range_and_velocity_crlb_std
from dechirp.radar.frame import Frame
from dechirp.theory.bounds import noncoherent_effective_snr
from dechirp.theory.detection import detection_threshold


def local_noise_power(
    power: np.ndarray, cells: np.ndarray, training_window: TrainingWindow, n_channels: int
) -> np.ndarray:
    """Estimate the mean noise power around each peak, (n,).

    The median of the corners of the training window, over that of the mean of n_channels
    exponentials: the sidelobes of a separable window lie on the cross that the corners leave out,
    and other targets shift a median little. All cells of a training window along one axis count.
    """
    median = detection_threshold(0.5, n_summed=n_channels)
    guard, rows = training_window.n_guard, 2 * training_window.half_range + 1
    first = cells[:, 1] - training_window.tested_rows_in_training_box(power.shape[1])[cells[:, 1]]
    reach = np.array([training_window.half_velocity, guard.velocity, rows, guard.range])
    return np.asarray(_training_corner_medians(power, cells, first, reach) * n_channels / median)


def _training_corner_medians_in_numpy(
    power: np.ndarray, peaks: np.ndarray, first_rows: np.ndarray, reach: np.ndarray
) -> np.ndarray:
    """Plain twin of `_training_corner_medians`: equal within single precision."""
    half_velocity, guard_velocity, n_rows, guard_range = reach
    dv = np.arange(-half_velocity, half_velocity + 1)
    dv = dv[abs(dv) > guard_velocity] if half_velocity > guard_velocity else np.array([0])
    medians = np.empty(len(peaks))
    for i, (velocity, row) in enumerate(peaks):
        rows = np.arange(first_rows[i], first_rows[i] + n_rows)
        distances = abs(rows - row)
        is_corner = distances > guard_range if distances.max() > guard_range else distances == 0
        medians[i] = np.median(power[np.ix_((velocity + dv) % len(power), rows[is_corner])])
    return medians


@kernel(plain=_training_corner_medians_in_numpy)
def _training_corner_medians(
    power: np.ndarray, peaks: np.ndarray, first_rows: np.ndarray, reach: np.ndarray
) -> np.ndarray:
    """Return the median of the corners of each window; of all cells of a flat one."""
    half_velocity, guard_velocity, n_rows, guard_range = reach
    cells = np.empty(n_rows * (2 * half_velocity + 1), power.dtype)
    medians = np.empty(len(peaks))
    for i in range(len(peaks)):
        velocity, row = peaks[i]
        has_sides = max(row - first_rows[i], first_rows[i] + n_rows - 1 - row) > guard_range
        n = 0
        for dv in range(-half_velocity, half_velocity + 1):
            if abs(dv) <= guard_velocity and (half_velocity > guard_velocity or dv != 0):
                continue
            for r in range(first_rows[i], first_rows[i] + n_rows):
                if abs(r - row) <= guard_range and (has_sides or r != row):
                    continue
                cells[n] = power[(velocity + dv) % power.shape[0], r]
                n += 1
        medians[i] = np.median(cells[:n])
    return medians


def principal_doppler_hz(tones: Tones, frame: Frame) -> np.ndarray:
    """Return the Doppler frequencies within half a cycle per repetition of zero, (n,)."""
    wrapped = (tones.slow + np.pi) % (2 * np.pi) - np.pi
    return np.asarray(wrapped / (2 * np.pi * frame.repetition_s))


def range_velocity_estimates(
    beat_rad_per_sample: np.ndarray,
    doppler_hz: np.ndarray,
    snr: np.ndarray,
    frame: Frame,
    n_channels: int,
    *,
    sidelobes: SidelobeErrors | None = None,
) -> dict[str, np.ndarray]:
    """Estimate range and velocity of tones, with standard errors.

    With the delay tau at mid-window, the fast-time frequency (`beat_rad_per_sample`, rad per
    sample) is S tau + f_D and the slow-time frequency f_D = 2 v (f - S tau) / c, f the mean of the
    sampled frequencies. So their difference is free of range-Doppler coupling and of the residual
    video phase, if f_D is unambiguous. A single chirp gives no velocity: NaN, and the range is that
    of a target at rest. Complex samples alias beats by the sample rate: `_unalias_delay_frequency`.
    Standard errors are those of the maximum of the sum of n_channels periodograms, see
    `theory.bounds.noncoherent_effective_snr`, times those of `sidelobes`.
    """
    if not len(snr):  # the bounds refuse empty arrays
        return dict.fromkeys(("range", "velocity", "snr", "range_std", "velocity_std"), np.empty(0))
    chirp = frame.chirp
    delay_hz = beat_rad_per_sample * chirp.sample_rate_hz / (2 * np.pi) - doppler_hz
    effective_snr = noncoherent_effective_snr(snr=snr, n_channels=n_channels)
    range_std, velocity_std = range_and_velocity_crlb_std(frame, snr=effective_snr)
    if sidelobes is not None:
        range_std = range_std * np.sqrt(sidelobes.fast_variance_gain)
        # The velocity of a lone triangle follows from its beats.
        is_from_beats = frame.n_chirps == 1
        velocity_std = velocity_std * np.sqrt(
            sidelobes.fast_variance_gain if is_from_beats else sidelobes.slow_variance_gain
        )
    if chirp.sampling == "complex":
        has_echo_beside = np.zeros(len(snr), bool)
        if sidelobes is not None:
            has_echo_beside = sidelobes.fast_variance_gain > 1
        std_hz = range_std / chirp.range_m(1.0)
        delay_hz = _unalias_delay_frequency(delay_hz, std_hz, has_echo_beside, chirp)
    wavelength_m = SPEED_OF_LIGHT / (chirp.mean_sampled_frequency_hz - delay_hz)
    velocity = doppler_hz * wavelength_m / 2
    return {
        "range": chirp.range_m(1.0) * delay_hz,
        "velocity": velocity if frame.can_measure_velocity else np.full_like(velocity, np.nan),
        "snr": snr,
        "range_std": range_std,
        "velocity_std": velocity_std * (wavelength_m / chirp.wavelength_m),
    }


def _unalias_delay_frequency(
    delay_hz: np.ndarray, std_hz: np.ndarray, has_echo_beside: np.ndarray, chirp: Chirp
) -> np.ndarray:
    """Return S tau from 0 to below the sample rate, since no delay is negative.

    The first cells of a map contain the last ones of all ranges too. Values below 0, aliased to the
    sample rate or not, by less than three standard errors are those of echoes at 0, such as
    leakage: they become 0. With an undescribed echo beside it, which shifts leakage, so do those
    below it by less than 0.15 cells (of 660 trials, two exceeded three standard errors, by up to
    0.14 cells). None are by more than two cells, half a main lobe of a Hann window.
    """
    cell_hz = chirp.sample_rate_hz / chirp.n_samples
    tolerance_hz = np.maximum(3 * std_hz, np.where(has_echo_beside, 0.15 * cell_hz, 0.0))
    tolerance_hz = np.minimum(tolerance_hz, 2 * cell_hz)
    unaliased_hz = delay_hz % chirp.sample_rate_hz
    is_at_zero = unaliased_hz >= chirp.sample_rate_hz - tolerance_hz
    return np.where(is_at_zero, 0.0, unaliased_hz)
