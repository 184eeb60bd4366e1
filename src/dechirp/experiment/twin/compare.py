"""A recording beside its twin: peak by peak, and the noise between them."""

from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.experiment.twin.echoes import Echoes
from dechirp.experiment.twin.measure import (
    Seen,
    floor,
    floor_at,
    is_noisy,
    peaks_at,
    peaks_of,
    searched,
    stretches,
    wandering,
)
from dechirp.experiment.twin.start import detected

# Standard deviation of a peak's place, in bins of the samples (a padded map has more cells), times
# the root of its ratio: sqrt(6) / 2 pi, the bound of a tone's frequency. Reading it off a
# Hann-windowed map instead costs the noise bandwidths of both windows, which the ratio in a cell is
# already less by.
_BINS_STD = 0.39


def differences(recorded: Seen, clean: Seen, twin: Seen, points: Echoes) -> xr.Dataset:
    """Each peak of a recording beside its twin's, over `peak`, strongest first, leakage last.

    Returns
    -------
    Dataset
        range : m, velocity : m/s, azimuth : rad
            Of the point that stands for it, at mid-frame; NaN where the array tells no azimuth.
        velocity_cell, range_cell
            The cell of the recording's map that no neighbour exceeds.
        power : W
            There; `snr`, a ratio, over the noise there.
        power_ratio
            The twin's highest cell within one of it, over `power`; `power_ratio_clean`: of the
            twin without noise, over what `power` holds besides noise.
        range_cells, velocity_cells
            How far the twin's peak lies beyond the recording's, between the bins; the same with
            `_clean` without noise.
        azimuth_difference : rad
            What is detected in the twin less `azimuth`; NaN where nothing is.
        power_std, cells_std
            Standard deviations of `power_ratio` and of the distances, by the noise of the twin. A
            peak that noise may hand to a cell beside it, on the flank of another, is as uncertain
            as those are apart.
        leaks, searched
            Whether it is leakage, and whether its range is one in which the chain detects.
    """
    echoes = points.only(*np.flatnonzero(points.is_peak).tolist())
    cells = echoes.cell
    noise_w = floor_at(recorded, cells[:, 1])
    own, without, with_noise = (peaks_at(one, cells) for one in (recorded, clean, twin))
    echo_w = np.maximum(own.power - noise_w, own.power / 2)
    snr = echo_w / noise_w
    n_channels = recorded.radar.n_summed
    # |tone + noise|^2, a mean of so many channels; of the difference of two, three times that.
    power_std = np.sqrt((2 * snr + 1) / n_channels) / (snr + 1)
    lost = wandering(recorded, cells, 3 * np.sqrt(2) * power_std)
    noise = recorded.chain.noise(recorded.radar)
    per_bin = max(one.n_bins / one.n_points for one in (noise.over_velocity, noise.over_range))
    cells_std = _BINS_STD * per_bin / np.sqrt(snr * n_channels)
    told = ~echoes.leaks & (recorded.chain.angle is not None)
    columns = {
        "range": (echoes.range_m, "m"),
        "velocity": (echoes.velocity_m_per_s, "m/s"),
        "azimuth": (np.where(told, echoes.azimuth_rad, np.nan), "rad"),
        "velocity_cell": (cells[:, 0], "1"),
        "range_cell": (cells[:, 1], "1"),
        "power": (own.power, "W"),
        "snr": (snr, "1"),
        "power_ratio": (with_noise.power / own.power, "1"),
        "power_ratio_clean": (without.power / echo_w, "1"),
        "range_cells": (with_noise.fast - own.fast, "1"),
        "velocity_cells": (with_noise.slow - own.slow, "1"),
        "range_cells_clean": (without.fast - own.fast, "1"),
        "azimuth_difference": (_turned(twin, echoes, told), "rad"),
        "velocity_cells_clean": (without.slow - own.slow, "1"),
        "power_std": (power_std, "1"),
        "cells_std": (np.maximum(cells_std, lost), "1"),
        "leaks": (echoes.leaks, "1"),
        "searched": (searched(recorded, cells), "1"),
    }
    return xr.Dataset(
        {
            name: ("peak", np.asarray(column), {"units": units})
            for name, (column, units) in columns.items()
        }
    )


def floors(recorded: Seen, twin: Seen) -> xr.Dataset:
    """The noise of a recording beside its twin's, mean power in a cell of the map.

    Returns
    -------
    Dataset
        recorded, twin : W, and ratio
            From the medians of the whole maps; ratios are NaN where nothing but rounding errors
            lies between the peaks of the recording.
        recorded_over_range, twin_over_range : W, and ratio_over_range
            Over `stretch`, of ranges about `range`, m.
        in_receiver
            Noise of each receiver of the recording over that of all, over `rx`; in the twin it is
            the same in all.
    """
    whole = [float(np.median(one.power.values)) / one.median_over_mean for one in (recorded, twin)]
    each = [floor(one) for one in (recorded, twin)]
    ranges_m = recorded.power.range.values
    middles = [float(ranges_m[rows].mean()) for rows in stretches(recorded)]
    with np.errstate(divide="ignore", invalid="ignore"):
        of_noise = 1.0 if is_noisy(recorded) else np.nan
        ratio, ratios = np.float64(whole[1]) / whole[0] * of_noise, each[1] / each[0] * of_noise
    return xr.Dataset(
        {
            "recorded": ((), whole[0], {"units": "W"}),
            "twin": ((), whole[1], {"units": "W"}),
            "ratio": ((), ratio, {"units": "1"}),
            "range": ("stretch", middles, {"units": "m"}),
            "recorded_over_range": ("stretch", each[0], {"units": "W"}),
            "twin_over_range": ("stretch", each[1], {"units": "W"}),
            "ratio_over_range": ("stretch", ratios, {"units": "1"}),
            "in_receiver": ("rx", _in_receivers(recorded) / max(whole[0], 1e-300), {"units": "1"}),
        }
    )


def _in_receivers(recorded: Seen) -> np.ndarray:
    """Mean power of the noise in a cell of the map of each receiver alone, (n_rx,)."""
    levels = []
    for place, rx_m in enumerate(recorded.radar.array.rx_m):
        radar = replace(recorded.radar, array=replace(recorded.radar.array, rx_m=(rx_m,)))
        one = Seen(frame=recorded.frame.isel(rx=[place]), radar=radar, chain=recorded.chain)
        levels.append(float(np.median(one.power.values)) / one.median_over_mean)
    return np.array(levels)


def _turned(twin: Seen, echoes: Echoes, told: np.ndarray) -> np.ndarray:
    """Azimuths of the twin's detections less those of its points, (n,)."""
    if not told.any() or not len(peaks_of(twin)):
        return np.full(len(echoes), np.nan)
    seen = detected(twin, twin.radar, echoes.cell)
    return np.where(told & (seen.away < 1), seen.azimuth_rad - echoes.azimuth_rad, np.nan)
