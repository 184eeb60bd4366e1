"""Initial points of the fit, from the chain's detections."""

from typing import NamedTuple

import numpy as np

from dechirp.experiments.twin.echoes import PointEchoes
from dechirp.experiments.twin.measure import FrameMap, measure_peaks_near_cells, noise_floor_at_rows
from dechirp.processing.detect import detect
from dechirp.processing.spectrum import rows_with_circular_noise
from dechirp.radar.radar import Radar
from dechirp.scene.aliasing import RangeVelocity, beat_and_doppler_frequencies

_LEAKAGE_RANGE_CELLS = 2.5  # range cells: static echoes nearer than this are leakage
_LEAKAGE_TO_NOISE = 30.0  # smallest ratio of leakage in a row that is not searched


def find_leakage_cell_in_unsearched_rows(frame_map: FrameMap) -> np.ndarray:
    """Find the cell of the leakage outside the rows that detection searches, (1 or 0, 2).

    Real samples: at zero velocity, the strongest of the rows nearer than the searched ones.
    """
    noise = frame_map.chain.map_noise_statistics(frame_map.radar)
    first = rows_with_circular_noise(frame_map.radar.frame.chirp, noise.range_transform).start
    rest_row = frame_map.power.sizes["velocity"] // 2
    near_power = frame_map.power.values[rest_row, :first]
    if (
        not near_power.size
        or near_power.max()
        < _LEAKAGE_TO_NOISE * noise_floor_at_rows(frame_map, np.array([near_power.argmax()]))[0]
    ):
        return np.empty((0, 2), dtype=int)
    return np.array([[rest_row, int(near_power.argmax())]])


def estimate_initial_points(
    frame_map: FrameMap, radar: Radar, peak_cells: np.ndarray, leakage_cells: np.ndarray
) -> PointEchoes:
    """Estimate a point for each peak, then for each cell of leakage.

    Parameters
    ----------
    frame_map : FrameMap
        Samples in sqrt(W).
    radar : Radar
        The recording's own radar: its calibration is needed for directions.
    peak_cells, leakage_cells : arrays (n, 2)
        Velocity and range.
    """
    parameters = np.zeros((4, len(peak_cells)))
    if len(peak_cells):
        parameters = np.nan_to_num(
            np.stack(detections_nearest_to_cells(frame_map, radar, peak_cells)[:4])
        )
    all_cells = np.concatenate([peak_cells, leakage_cells])
    bin_ranges_m = frame_map.radar.frame.chirp.range_bins_m(
        frame_map.chain.map_noise_statistics(frame_map.radar).range_transform.n_bins
    )
    leakage_parameters = np.stack(
        [
            np.maximum(bin_ranges_m[leakage_cells[:, 1]], bin_ranges_m[1]),
            *np.zeros((3, len(leakage_cells))),
        ]
    )
    parameters = np.concatenate([parameters, leakage_parameters], axis=1)
    resolution_m = frame_map.radar.frame.chirp.range_resolution_m
    is_at_rest = all_cells[:, 0] == frame_map.power.sizes["velocity"] // 2
    is_leakage = is_at_rest & (parameters[0] < _LEAKAGE_RANGE_CELLS * resolution_m)
    parameters[1, is_leakage] = 0
    return PointEchoes(
        range_m=np.maximum(parameters[0], 1e-4),
        velocity_m_per_s=parameters[1],
        azimuth_rad=parameters[2],
        elevation_rad=parameters[3],
        power_w=measure_peaks_near_cells(frame_map, all_cells).power.astype(float),
        is_leakage=is_leakage,
        is_peak=np.ones(len(all_cells), dtype=bool),
        map_cell=all_cells,
    )


class NearestDetections(NamedTuple):
    """Detections nearest to given cells of a map, each array (n,)."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    distance_cells: np.ndarray
    """Distance from the cell, in cells."""


def detections_nearest_to_cells(
    frame_map: FrameMap, radar: Radar, cells: np.ndarray
) -> NearestDetections:
    """Find the nearest detection to each cell, (n, 2); of several sources the strongest.

    The map must contain a detection.
    """
    detections = detect(frame_map.samples.expand_dims("frame"), radar, frame_map.chain)
    frame, noise = radar.frame, frame_map.chain.map_noise_statistics(radar)
    tones = beat_and_doppler_frequencies(
        RangeVelocity(detections.range.values, np.nan_to_num(detections.velocity.values)), radar
    )
    n_velocity, n_bins = noise.doppler_transform.n_bins, noise.range_transform.n_bins
    slow = tones.doppler_hz * frame.repetition_s * n_velocity + n_velocity // 2
    fast = tones.beat_hz / frame.chirp.sample_rate_hz * n_bins
    apart_slow = (slow - cells[:, :1] + n_velocity / 2) % n_velocity - n_velocity / 2
    apart_fast = (fast - cells[:, 1:] + n_bins / 2) % n_bins - n_bins / 2
    # Sources of one detection have nearly equal positions: the first is the strongest.
    distance = np.hypot(apart_slow, apart_fast).round(2)
    rows = distance.argmin(axis=1)
    range_m, velocity_m_per_s, azimuth_rad, elevation_rad = (
        detections[name].values[rows] for name in ("range", "velocity", "azimuth", "elevation")
    )
    return NearestDetections(
        range_m, velocity_m_per_s, azimuth_rad, elevation_rad, distance.min(axis=1)
    )
