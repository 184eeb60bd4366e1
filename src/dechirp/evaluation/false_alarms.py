"""False alarms: probability of a chain in a cell and in a frame, and counts in maps of noise."""

from functools import lru_cache

import numpy as np
import scipy

from dechirp.evaluation.trial import NoiseMap
from dechirp.processing.cfar.base import Cfar, MapNoise
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.mitigation.noise_loss import sufficient_noise_gain_mask
from dechirp.processing.range_doppler_map import detect_peaks_and_count_dropped, residual_noise_gain
from dechirp.processing.spectrum import (
    Transform,
    rows_with_circular_noise,
    searched_cell_mask,
)
from dechirp.radar.radar import Radar
from dechirp.theory.alarm_clusters import NeighbourCorrelation, local_maximum_fraction

# Rows of the cell under test at which the law of an offset is computed; it is smooth between them.
_N_SAMPLED_ROWS = 5
_MIN_PROBABILITY = 1e-60
# Above this number in a training window, false alarms occur in clusters: neighbouring cells share
# training cells that are low by chance.
_MAX_ALARMS_PER_WINDOW = 0.01


def cell_false_alarm_probability(radar: Radar, chain: Chain) -> float:
    """Return the probability that noise exceeds the threshold of a cell.

    The design value; for an offset the exact law of independent cells or, for cell averaging, of
    cells correlated by windows and zero padding; NaN for other estimators, which have no law. The
    mean over all ranges, since there are more training cells at the ends.
    """
    noise = chain.map_noise_statistics(radar)
    if chain.cfar.false_alarm_probability is not None:
        return chain.cfar.false_alarm_probability
    rows = rows_with_circular_noise(radar.frame.chirp, noise.range_transform)
    return _mean_false_alarm_probability_of_offset(chain.cfar, noise, rows.stop - rows.start)


def frame_false_alarm_probability(radar: Radar, chain: Chain) -> float:
    """Return the probability of a detection in a frame of noise.

    .. math:: 1 - e^{-N p q}

    over N cells, with p of a cell and q the fraction of the cells over threshold that exceed their
    neighbours, see `theory.alarm_clusters`. NaN if mitigation correlates the cells differently, or
    if more than 0.01 false alarms are expected in a training window: they then occur in clusters,
    so fewer frames have any.
    """
    noise, p = chain.map_noise_statistics(radar), cell_false_alarm_probability(radar, chain)
    cfar = chain.cfar
    n_in_ring = len(cfar.training_window.training_cell_offsets(cfar.training_window.half_range)) * p
    if not n_in_ring <= _MAX_ALARMS_PER_WINDOW or residual_noise_gain(radar, chain) is not None:
        return np.nan
    neighbours = NeighbourCorrelation(
        in_range=_noise_correlation_at_lags_one_and_two(noise.range_transform),
        in_velocity=_noise_correlation_at_lags_one_and_two(noise.doppler_transform),
    )
    q = local_maximum_fraction(p, neighbours, n_summed=noise.n_channels)
    return float(-np.expm1(-_count_searched_cells(radar, noise) * p * q))


def _count_searched_cells(radar: Radar, noise: MapNoise) -> float:
    """Return the number of searched cells, without those that repeat the power of another.

    At half the sample rate of real samples, opposite velocities have the same power.
    """
    chirp, transform = radar.frame.chirp, noise.range_transform
    is_searched = searched_cell_mask(chirp, transform, noise.doppler_transform)
    n_cells = float(np.count_nonzero(is_searched))
    if chirp.sampling == "real" and transform.n_bins % 2 == 0:
        n_cells -= np.count_nonzero(is_searched[:, -1]) / 2
    return n_cells


def _noise_correlation_at_lags_one_and_two(transform: Transform) -> tuple[complex, complex]:
    _, lag_one, lag_two = transform.noise_correlation_of_bins(3)[:, 0].tolist()
    return complex(lag_one), complex(lag_two)


@lru_cache(maxsize=64)
def _mean_false_alarm_probability_of_offset(cfar: Cfar, noise: MapNoise, n_rows: int) -> float:
    half_range = cfar.training_window.half_range
    sampled_rows = np.unique(
        np.linspace(0, half_range, min(half_range + 1, _N_SAMPLED_ROWS)).round().astype(int)
    )
    probabilities = [_false_alarm_probability_at_row(cfar, noise, int(row)) for row in sampled_rows]
    rows = cfar.training_window.tested_rows_in_training_box(n_rows)
    log_probabilities = np.interp(
        np.minimum(rows, 2 * half_range - rows), sampled_rows, np.log(probabilities)
    )
    return float(np.mean(np.exp(log_probabilities)))


def _false_alarm_probability_at_row(cfar: Cfar, noise: MapNoise, training_row: int) -> float:
    """Return the probability in a row of the training window whose factor is the offset."""
    box, n_channels, offset = (
        cfar.training_window.noise_covariance_in_box(noise, training_row),
        noise.n_channels,
        cfar.offset,
    )
    assert offset is not None
    closed = cfar.estimator.independent_cells_threshold_factor(
        0.1, box.training_offsets, n_channels=n_channels
    )
    if not isinstance(cfar.estimator, CellAveraging) and (not box.is_white or closed is None):
        return np.nan

    def missing(log_pfa: float) -> float:
        factor = cfar.estimator.threshold_factor(float(np.exp(log_pfa)), box, n_channels=n_channels)
        return float(np.log(factor.value / offset))

    high, low = np.log(0.5), np.log(0.1)
    if missing(high) > 0:
        return np.nan
    while missing(low) < 0:
        high, low = low, 1.5 * low
        if low < np.log(_MIN_PROBABILITY):
            return np.nan
    return float(np.exp(scipy.optimize.brentq(missing, low, high, xtol=1e-9)))


def count_noise_alarms(power: np.ndarray, radar: Radar, chain: Chain) -> NoiseMap:
    """Count the alarms in a map of a scene without its targets.

    Parameters
    ----------
    power : array (velocity, range), float32
        As the detector reads it: after `processing.range_doppler_map`, or as
        `processing.noise_maps.draw_noise_map` returns it.
    radar : Radar
        For triangles `Radar.with_rising_ramps_only`, with the map of the rising ramps.
    chain : Chain
        Fitted to the radar.
    """
    noise = chain.map_noise_statistics(radar)
    rows = rows_with_circular_noise(radar.frame.chirp, noise.range_transform)
    is_over = chain.cfar.exceeds_threshold(np.ascontiguousarray(power[:, rows]), noise)
    n_tested = is_over.size
    if (residual_noise_map := residual_noise_gain(radar, chain)) is not None:
        is_usable = sufficient_noise_gain_mask(residual_noise_map)[:, rows]
        is_over &= is_usable
        n_tested = int(np.count_nonzero(is_usable))
    n_over = int(np.count_nonzero(is_over))
    # Most maps of complex samples have no alarm, and then no peak: those are not looked for. Maps
    # of real samples are searched at the ends of the range axis too.
    n_peaks = 0
    if n_over or radar.frame.chirp.sampling == "real":
        n_peaks = len(detect_peaks_and_count_dropped(power, radar, chain)[0])
    return NoiseMap(power, n_tested, n_over, n_peaks)
