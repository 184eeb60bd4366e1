"""Comparison of a recording with its twin: peak by peak, and the noise between the peaks."""

from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.experiments.twin.echoes import PointEchoes
from dechirp.experiments.twin.initial_points import detections_nearest_to_cells
from dechirp.experiments.twin.measure import (
    FrameMap,
    find_peak_cells,
    has_noise_in_all_segments,
    is_in_searched_rows,
    measure_peaks_near_cells,
    noise_floor_at_rows,
    noise_floor_per_segment,
    peak_position_spread_over_neighbours,
    range_row_segments,
)

# Standard deviation of a peak position, in unpadded bins, times the root of its SNR:
# sqrt(6) / 2 pi, the Cramer-Rao bound of a tone's frequency. A Hann-windowed map loses the noise
# bandwidths of both windows, by which the SNR in a cell is already reduced.
_FREQUENCY_STD_BINS = 0.39


def compare_peaks(
    recorded: FrameMap, noise_free_twin: FrameMap, twin: FrameMap, points: PointEchoes
) -> xr.Dataset:
    """Compare each peak of a recording with its twin's, over `peak`, strongest first, leakage last.

    Returns
    -------
    Dataset
        range : m, velocity : m/s, azimuth : rad
            Of the point that represents it, at mid-frame; NaN where the array resolves no azimuth.
        velocity_cell, range_cell
            The cell of the recording's map that no neighbour exceeds.
        power : W
            Power there; `snr`, a ratio, over the noise there.
        power_ratio
            The twin's highest cell within one of it, over `power`; `power_ratio_clean`: of the
            twin without noise, over the part of `power` that is not noise.
        range_cells, velocity_cells
            Distance of the twin's peak beyond the recording's, between the bins; the same with
            `_clean` without noise.
        azimuth_difference : rad
            Azimuth detected in the twin less `azimuth`; NaN without a detection.
        power_std, cells_std
            Standard deviations of `power_ratio` and of the distances, from the noise of the twin.
            For a peak on the flank of another, which noise may move to a neighbouring cell, the
            deviation is the distance of these cells.
        leaks, searched
            Whether it is leakage, and whether the chain detects at its range.
    """
    echoes = points.select_points(*np.flatnonzero(points.is_peak).tolist())
    cells = echoes.map_cell
    noise_w = noise_floor_at_rows(recorded, cells[:, 1])
    recorded_peaks, clean_peaks, twin_peaks = (
        measure_peaks_near_cells(item, cells) for item in (recorded, noise_free_twin, twin)
    )
    echo_w = np.maximum(recorded_peaks.power - noise_w, recorded_peaks.power / 2)
    snr = echo_w / noise_w
    n_channels = recorded.radar.n_summed_maps
    # |tone + noise|^2, averaged over the channels; the difference of two has three times that.
    power_std = np.sqrt((2 * snr + 1) / n_channels) / (snr + 1)
    position_spread = peak_position_spread_over_neighbours(
        recorded, cells, 3 * np.sqrt(2) * power_std
    )
    noise = recorded.chain.map_noise_statistics(recorded.radar)
    per_bin = max(
        item.n_bins / item.n_points for item in (noise.doppler_transform, noise.range_transform)
    )
    cells_std = _FREQUENCY_STD_BINS * per_bin / np.sqrt(snr * n_channels)
    has_azimuth = ~echoes.is_leakage & (recorded.chain.angle is not None)
    columns = {
        "range": (echoes.range_m, "m"),
        "velocity": (echoes.velocity_m_per_s, "m/s"),
        "azimuth": (np.where(has_azimuth, echoes.azimuth_rad, np.nan), "rad"),
        "velocity_cell": (cells[:, 0], "1"),
        "range_cell": (cells[:, 1], "1"),
        "power": (recorded_peaks.power, "W"),
        "snr": (snr, "1"),
        "power_ratio": (twin_peaks.power / recorded_peaks.power, "1"),
        "power_ratio_clean": (clean_peaks.power / echo_w, "1"),
        "range_cells": (twin_peaks.range_bin - recorded_peaks.range_bin, "1"),
        "velocity_cells": (twin_peaks.velocity_bin - recorded_peaks.velocity_bin, "1"),
        "range_cells_clean": (clean_peaks.range_bin - recorded_peaks.range_bin, "1"),
        "azimuth_difference": (_azimuth_differences(twin, echoes, has_azimuth), "rad"),
        "velocity_cells_clean": (clean_peaks.velocity_bin - recorded_peaks.velocity_bin, "1"),
        "power_std": (power_std, "1"),
        "cells_std": (np.maximum(cells_std, position_spread), "1"),
        "is_leakage": (echoes.is_leakage, "1"),
        "is_searched": (is_in_searched_rows(recorded, cells), "1"),
    }
    return xr.Dataset(
        {
            name: ("peak", np.asarray(column), {"units": units})
            for name, (column, units) in columns.items()
        }
    )


def compare_noise_floors(recorded: FrameMap, twin: FrameMap) -> xr.Dataset:
    """Compare the noise of a recording with its twin's, mean power in a cell of the map.

    Returns
    -------
    Dataset
        recorded, twin : W, and ratio
            From the medians of the whole maps; ratios are NaN where the recording contains only
            rounding errors between its peaks.
        recorded_over_range, twin_over_range : W, and ratio_over_range
            Over `segment`, of ranges about `range`, m.
        in_receiver
            Noise of each receiver of the recording over that of all, over `rx`; in the twin it is
            the same in all.
    """
    levels = [
        float(np.median(item.power.values)) / item.theoretical_noise_median_over_mean
        for item in (recorded, twin)
    ]
    segment_levels = [noise_floor_per_segment(item) for item in (recorded, twin)]
    ranges_m = recorded.power.range.values
    middles = [float(ranges_m[rows].mean()) for rows in range_row_segments(recorded)]
    with np.errstate(divide="ignore", invalid="ignore"):
        of_noise = 1.0 if has_noise_in_all_segments(recorded) else np.nan
        ratio, ratios = (
            np.float64(levels[1]) / levels[0] * of_noise,
            segment_levels[1] / segment_levels[0] * of_noise,
        )
    return xr.Dataset(
        {
            "recorded": ((), levels[0], {"units": "W"}),
            "twin": ((), levels[1], {"units": "W"}),
            "ratio": ((), ratio, {"units": "1"}),
            "range": ("segment", middles, {"units": "m"}),
            "recorded_over_range": ("segment", segment_levels[0], {"units": "W"}),
            "twin_over_range": ("segment", segment_levels[1], {"units": "W"}),
            "ratio_over_range": ("segment", ratios, {"units": "1"}),
            "in_receiver": (
                "rx",
                _noise_floor_per_receiver(recorded) / max(levels[0], 1e-300),
                {"units": "1"},
            ),
        }
    )


def _noise_floor_per_receiver(recorded: FrameMap) -> np.ndarray:
    """Estimate the mean noise power in a cell of the map of each receiver alone, (n_rx,)."""
    levels = []
    for place, rx_m in enumerate(recorded.radar.array.rx_m):
        array = replace(recorded.radar.array, rx_m=(rx_m,))
        radar = replace(recorded.radar, array=array, calibration=None)
        receiver_map = FrameMap(
            samples=recorded.samples.isel(rx=[place]), radar=radar, chain=recorded.chain
        )
        levels.append(
            float(np.median(receiver_map.power.values))
            / receiver_map.theoretical_noise_median_over_mean
        )
    return np.array(levels)


def _azimuth_differences(
    twin: FrameMap, echoes: PointEchoes, has_azimuth: np.ndarray
) -> np.ndarray:
    """Return the azimuths of the twin's detections less those of its points, (n,)."""
    if not has_azimuth.any() or not len(find_peak_cells(twin)):
        return np.full(len(echoes), np.nan)
    nearest = detections_nearest_to_cells(twin, twin.radar, echoes.map_cell)
    return np.where(
        has_azimuth & (nearest.distance_cells < 1), nearest.azimuth_rad - echoes.azimuth_rad, np.nan
    )
