"""Joint statistics of the CFAR estimate and the measured noise in training windows.

A detector compares a cell with a factor times its estimator's statistic, and the reported ratio
rests on the median of the window's corners. Both are drawn together from boxes of noise with
the covariance of the transforms: no estimator needs a formula of its law. As the guard
cells separate the window from the cell under test, both are assumed independent of the cell.
"""

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dechirp.core.disk_cache import read_cached_numbers, write_cached_numbers
from dechirp.processing.cfar.base import Cfar, MapNoise, factor_key
from dechirp.processing.cfar.factor_cache import calibration_code_hash
from dechirp.theory.detection import detection_threshold

# Complex numbers for all draws: one second. 4,000 draws determine the mean of a level with a
# standard deviation of 6 % to 0.1 %, 0.004 dB.
_NUMBERS = 2.5e7
_MIN_DRAWS, _MAX_DRAWS = 400, 4000
_NUMBERS_PER_STEP = 2**21
# Power added to the cells of a lobe to measure the sensitivity of an estimator.
_PROBE_POWER = 10.0


class TrainingStatistics(NamedTuple):
    """Draws in noise of mean 1."""

    statistic: np.ndarray
    """(n_draws,), statistic of the estimator."""
    corners: np.ndarray
    """(n_draws,): the noise as measured for the ratio, in the same windows."""
    sensitivity: float
    """Increase of the statistic by power in few cells of the window, relative to its mean: 1 for
    cell averaging, 0 for an ordered statistic."""


@lru_cache(maxsize=16)
def draw_training_window_statistics(cfar: Cfar, noise: MapNoise) -> TrainingStatistics:
    """Draw statistic and measured noise jointly, from a fixed seed; kept on disk.

    The draws take 2 s of processor time in each process of a run.
    """
    code = calibration_code_hash(type(cfar.estimator), Path(__file__))
    key = {
        **factor_key(cfar, noise),
        "n_bins": [noise.range_transform.n_bins, noise.doppler_transform.n_bins],
        "source": code,
    }
    numbers = None if code is None else read_cached_numbers("training-statistics", key)
    if numbers is not None and len(numbers) % 2:
        statistic, corners = np.array(numbers[1:]).reshape(2, -1)
        return TrainingStatistics(statistic, corners, numbers[0])
    statistics = _draw_statistics(cfar, noise)
    if code is not None:
        draws = (*statistics.statistic.tolist(), *statistics.corners.tolist())
        write_cached_numbers("training-statistics", key, [statistics.sensitivity, *draws])
    return statistics


def _draw_statistics(cfar: Cfar, noise: MapNoise) -> TrainingStatistics:
    window, n_channels = cfar.training_window, noise.n_channels
    offsets = window.training_cell_offsets(window.half_range)
    n_rows, n_columns = 2 * window.half_range + 1, 2 * window.half_velocity + 1
    over_range = _hermitian_matrix_root(noise.range_transform.noise_correlation_of_bins(n_rows))
    over_velocity = _hermitian_matrix_root(
        noise.doppler_transform.noise_correlation_of_bins(n_columns)
    )
    cell_index = (offsets[:, 0] + window.half_velocity, offsets[:, 1] + window.half_range)
    guard = window.n_guard
    # As `processing.estimates.local_noise_power` has it: a one-dimensional window has no corners.
    is_corner = np.ones(len(offsets), bool)
    for dimension, guarded, half in (
        (0, guard.velocity, window.half_velocity),
        (1, guard.range, window.half_range),
    ):
        if half > guarded:
            is_corner &= abs(offsets[:, dimension]) > guarded
    median = detection_threshold(0.5, n_summed=n_channels) / n_channels
    n_draws = int(np.clip(_NUMBERS / (n_rows * n_columns * n_channels), _MIN_DRAWS, _MAX_DRAWS))
    step = max(_NUMBERS_PER_STEP // (n_rows * n_columns * n_channels), 1)
    rng = np.random.default_rng(1)
    statistic, corners = np.empty(n_draws), np.empty(n_draws)
    for first in range(0, n_draws, step):
        rows = slice(first, min(first + step, n_draws))
        shape = rows.stop - rows.start, n_channels, n_columns, 2 * n_rows
        white = rng.standard_normal(shape, np.float32).view(np.complex64)
        amplitudes = over_velocity @ white @ over_range.T * np.float32(np.sqrt(0.5))
        cells = np.mean(abs(amplitudes) ** 2, axis=1)[:, cell_index[0], cell_index[1]]
        statistic[rows] = cfar.estimator.statistic(cells, offsets)
        corners[rows] = np.median(cells[:, is_corner], axis=1) / median
    return TrainingStatistics(statistic, corners, _estimator_sensitivity_to_interferer(cfar))


def _hermitian_matrix_root(covariance: np.ndarray) -> np.ndarray:
    """Compute the root of a Hermitian matrix that padding may leave singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0))).astype(np.complex64))


def _estimator_sensitivity_to_interferer(cfar: Cfar) -> float:
    offsets = cfar.training_window.training_cell_offsets(cfar.training_window.half_range)
    cells = np.ones(len(offsets))
    near = np.argsort(np.max(abs(offsets - offsets[0]), axis=1), kind="stable")[:9]
    cells[near] += _PROBE_POWER
    raised = float(cfar.estimator.statistic(cells, offsets)) - 1.0
    return raised / (_PROBE_POWER * near.size / cells.size)
