"""What the reference report says, and the detector that it describes.

The report built a 77 GHz radar in MATLAB: chirp, range transform, Doppler transform of 128
chirps, a two-dimensional cell-averaging detector, and noise down to -24 dB. It computed
with c = 3e8 m/s. Its detector averages amplitudes and multiplies them by "15 dB" taken as a
ratio of powers, 31.6; its axes count both end points; it transforms 4,096 points over range
and keeps the first 2,048.
"""

import numpy as np

from dechirp.core.units import from_decibels
from dechirp.process.cfar.base import Cells, Ring
from dechirp.process.cfar.cell_averaging import CellAveraging
from dechirp.process.spectrum import Transform, mean_power

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
RULE = "the report's rule"
RANGE_M = 49.98
RANGE_ERROR_M = 0.02
VELOCITY_M_PER_S = 9.94
VELOCITY_ERROR_M_PER_S = 0.06

RING = Ring(n_training=Cells(range=10, velocity=8), n_guard=Cells(range=12, velocity=4))
"""The report has 4 guard cells in one place and 12 in another; 12 suits its rule better."""
OTHER_RING = Ring(n_training=RING.n_training, n_guard=Cells(range=4, velocity=4))
OVER_RANGE = Transform(window="rectangular", n_points=N_SAMPLES, n_bins=N_RANGE_BINS)
OVER_VELOCITY = Transform(window="rectangular", n_points=N_CHIRPS, n_bins=N_CHIRPS)
_N_KEPT = N_RANGE_BINS // 2


def rule(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Amplitude map of a frame, the report's threshold, and which cells it calls targets.

    `samples` (chirp, rx, sample) of the reference radar; the maps are (velocity, range). Cells
    whose ring would leave the map are not tested.
    """
    amplitude = _amplitude(samples)
    threshold = np.float32(from_decibels(OFFSET_DB)) * _mean_amplitude(amplitude, RING)
    over = amplitude > threshold
    tested = np.zeros_like(over)
    rows, columns = RING.half_velocity, RING.half_range
    tested[rows:-rows, columns:-columns] = True
    return amplitude, threshold, over & tested


def leakage(samples: np.ndarray, ring: Ring) -> float:
    """Threshold of the rule over the amplitude, at the peak of an echo without noise.

    What the target's own sidelobes in the ring take of it: at 1 it could never be detected.
    """
    amplitude = _amplitude(samples)
    peak = np.unravel_index(np.argmax(amplitude), amplitude.shape)
    mean = _mean_amplitude(amplitude, ring)[peak]
    return float(from_decibels(OFFSET_DB) * mean / amplitude[peak])


def _amplitude(samples: np.ndarray) -> np.ndarray:
    power = mean_power(samples, "complex", OVER_RANGE, OVER_VELOCITY)
    return np.ascontiguousarray(np.sqrt(power[:, :_N_KEPT]))


def _mean_amplitude(amplitude: np.ndarray, ring: Ring) -> np.ndarray:
    return CellAveraging().threshold(amplitude, ring, np.ones(_N_KEPT, np.float32))


def axes_m_and_m_per_s() -> tuple[np.ndarray, np.ndarray]:
    """Range and velocity of the cells on the report's axes, both end points counted."""
    duration_s = N_SAMPLES / SAMPLE_RATE_HZ
    half_m = SPEED_OF_LIGHT * SAMPLE_RATE_HZ / (2 * BANDWIDTH_HZ / duration_s) / 2
    fastest = SPEED_OF_LIGHT / START_FREQUENCY_HZ / (4 * duration_s)
    return np.linspace(0, half_m, _N_KEPT), np.linspace(-fastest, fastest, N_CHIRPS)


def strongest(samples: np.ndarray) -> tuple[float, float]:
    """Range and velocity on the report's axes of the strongest cell over threshold, or nan."""
    amplitude, _, over = rule(samples)
    if not over.any():
        return float("nan"), float("nan")
    row, column = np.unravel_index(np.argmax(np.where(over, amplitude, 0)), over.shape)
    range_m, velocity_m_per_s = axes_m_and_m_per_s()
    return float(range_m[column]), float(velocity_m_per_s[row])
