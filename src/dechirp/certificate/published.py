"""Published values of the reference report, and its detection rule.

The report simulates a 77 GHz radar in MATLAB: chirp, range transform, Doppler transform of 128
chirps, a two-dimensional cell-averaging detector, and noise down to -24 dB. It uses c = 3e8 m/s.
Its detector averages amplitudes and multiplies the mean by "15 dB" taken as a power ratio, 31.6;
its axes include both end points; its range transform has 4,096 points, of which it retains the
first 2,048.
"""

import numpy as np

from dechirp.core.units import from_decibels
from dechirp.processing.cfar.base import Cells, TrainingWindow
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.spectrum import Transform, mean_range_doppler_power

SPEED_OF_LIGHT = 3e8
START_FREQUENCY_HZ = 77e9
MAX_RANGE_M = 200.0
RANGE_RESOLUTION_M = 1.0
MAX_VELOCITY_M_PER_S = 100.0
BANDWIDTH_HZ = 150e6
CHIRP_DURATION_S = 7.3333e-6
SLOPE_HZ_PER_S = 2.045e13
SAMPLE_RATE_HZ = 300e6
N_SAMPLES = 2200
N_CHIRPS = 128
N_RANGE_BINS = 4096
ROUNDED_SLOPE_HZ_PER_S = 2e13
OFFSET_DB = 15.0
LOWEST_SNR_DB = -24.0
RULE_NAME = "the report's rule"
RANGE_M = 49.98
RANGE_ERROR_M = 0.02
VELOCITY_M_PER_S = 9.94
VELOCITY_ERROR_M_PER_S = 0.06

TRAINING_WINDOW = TrainingWindow(
    n_training=Cells(range=10, velocity=8), n_guard=Cells(range=12, velocity=4)
)
"""Training window of the rule. The report states 4 and 12 guard cells; 12 suits it better."""
SMALL_GUARD_WINDOW = TrainingWindow(
    n_training=TRAINING_WINDOW.n_training, n_guard=Cells(range=4, velocity=4)
)
OVER_RANGE = Transform(window="rectangular", n_points=N_SAMPLES, n_bins=N_RANGE_BINS)
OVER_VELOCITY = Transform(window="rectangular", n_points=N_CHIRPS, n_bins=N_CHIRPS)
_N_RETAINED_BINS = N_RANGE_BINS // 2


def apply_report_rule(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return amplitude map, threshold and detection mask of the report's rule, (velocity, range).

    `samples` (chirp, rx, sample) are those of the reference radar. Cells whose training window
    extends beyond the map are not tested.
    """
    amplitude = _amplitude_map(samples)
    threshold = np.float32(from_decibels(OFFSET_DB)) * _mean_training_amplitude(
        amplitude, TRAINING_WINDOW
    )
    exceeds = amplitude > threshold
    is_tested = np.zeros_like(exceeds)
    rows, columns = TRAINING_WINDOW.half_velocity, TRAINING_WINDOW.half_range
    is_tested[rows:-rows, columns:-columns] = True
    return amplitude, threshold, exceeds & is_tested


def threshold_over_peak_amplitude(samples: np.ndarray, training_window: TrainingWindow) -> float:
    """Return the threshold over the amplitude at the peak of a noise-free echo.

    The sidelobes of the target in the training window raise its threshold. With a ratio of 1 or
    more the target is never detected.
    """
    amplitude = _amplitude_map(samples)
    peak = np.unravel_index(np.argmax(amplitude), amplitude.shape)
    mean = _mean_training_amplitude(amplitude, training_window)[peak]
    return float(from_decibels(OFFSET_DB) * mean / amplitude[peak])


def _amplitude_map(samples: np.ndarray) -> np.ndarray:
    power = mean_range_doppler_power(samples, "complex", OVER_RANGE, OVER_VELOCITY)
    return np.ascontiguousarray(np.sqrt(power[:, :_N_RETAINED_BINS]))


def _mean_training_amplitude(amplitude: np.ndarray, training_window: TrainingWindow) -> np.ndarray:
    return CellAveraging().threshold(
        amplitude, training_window, np.ones(_N_RETAINED_BINS, np.float32)
    )


def peak_and_training_power(samples: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the power of a noise-free echo at its peak, and in the training cells of the rule.

    Both are relative to noise of unit power per sample in the map.
    """
    amplitude, window = _amplitude_map(samples), TRAINING_WINDOW
    row, column = np.unravel_index(np.argmax(amplitude), amplitude.shape)
    rows = np.arange(-window.half_velocity, window.half_velocity + 1)
    columns = np.arange(-window.half_range, window.half_range + 1)
    is_guard = np.logical_and.outer(
        abs(rows) <= window.n_guard.velocity, abs(columns) <= window.n_guard.range
    )
    box = amplitude[np.ix_((row + rows) % len(amplitude), column + columns)]
    noise_power = 1 / (N_SAMPLES * N_CHIRPS)  # rectangular windows; a tone on a bin keeps its power
    return float(amplitude[row, column] ** 2 / noise_power), box[~is_guard] ** 2 / noise_power


def report_range_and_velocity_axes() -> tuple[np.ndarray, np.ndarray]:
    """Return range (m) and velocity (m/s) of the cells on the report's axes."""
    duration_s = N_SAMPLES / SAMPLE_RATE_HZ
    max_range_m = SPEED_OF_LIGHT * SAMPLE_RATE_HZ / (2 * BANDWIDTH_HZ / duration_s) / 2
    max_velocity_m_per_s = SPEED_OF_LIGHT / START_FREQUENCY_HZ / (4 * duration_s)
    return np.linspace(0, max_range_m, _N_RETAINED_BINS), np.linspace(
        -max_velocity_m_per_s, max_velocity_m_per_s, N_CHIRPS
    )


def find_strongest_report_rule_detection(samples: np.ndarray) -> tuple[float, float]:
    """Return range and velocity of the strongest detection on the report's axes, or NaN."""
    amplitude, _, detected = apply_report_rule(samples)
    if not detected.any():
        return float("nan"), float("nan")
    row, column = np.unravel_index(np.argmax(np.where(detected, amplitude, 0)), detected.shape)
    range_m, velocity_m_per_s = report_range_and_velocity_axes()
    return float(range_m[column]), float(velocity_m_per_s[row])
