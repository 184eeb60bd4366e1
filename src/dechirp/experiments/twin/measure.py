"""Noise floor and peaks of a map, measured alike for a recording and its twin."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import xarray as xr

from dechirp.processing.chain import Chain
from dechirp.processing.peak_interpolation import interpolate_peak_frequencies
from dechirp.processing.range_doppler_map import (
    detect_peaks_and_count_dropped,
    fill_unusable_cells_with_noise,
    power_map,
)
from dechirp.processing.spectrum import amplitude_range_weights, rows_with_circular_noise
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.radar import Radar
from dechirp.theory.detection import detection_threshold

# 256 cells give a median to 0.5 dB in one channel, and better in several; 24 segments keep a
# settings file readable.
_MIN_SEGMENT_CELLS, _MAX_SEGMENTS = 256, 24
_ROUNDING = 1e-12  # of the strongest cell; single precision has 1e-14


@dataclass(frozen=True)
class FrameMap:
    """Samples of one frame, with its radar and chain."""

    samples: xr.DataArray
    """(chirp, rx, sample)."""
    radar: Radar
    chain: Chain

    @cached_property
    def power(self) -> xr.DataArray:
        """Power map, (velocity, range)."""
        return power_map(self.samples, self.radar, self.chain).transpose("velocity", "range")

    @property
    def theoretical_noise_median_over_mean(self) -> float:
        """Ratio of median to mean of the noise in a cell: of a mean of exponentials."""
        n_channels = self.radar.n_summed_maps
        return detection_threshold(0.5, n_summed=n_channels) / n_channels


@dataclass(frozen=True)
class Peaks:
    """Peaks of a map, or of a twin near the peaks of its recording."""

    cell: np.ndarray
    """(n, 2), velocity and range."""
    power: np.ndarray
    """(n,), of the highest cell."""
    velocity_bin: np.ndarray
    """(n,), position between the bins, in cells of the map."""
    range_bin: np.ndarray


def range_row_segments(frame_map: FrameMap) -> list[slice]:
    """Split the rows of the map into segments of similar length, of assumed constant noise."""
    n_velocity, n_rows = frame_map.power.shape
    rows = max(-(-_MIN_SEGMENT_CELLS // n_velocity), -(-n_rows // _MAX_SEGMENTS))
    n = max(n_rows // rows, 1)
    edges = np.linspace(0, n_rows, n + 1).round().astype(int)
    return [slice(first, stop) for first, stop in pairwise(edges.tolist())]


def noise_floor_per_segment(frame_map: FrameMap) -> np.ndarray:
    """Estimate the mean noise power in a cell of each of the `range_row_segments`, (n,).

    From the median of all their cells, on which targets in few of them have little effect.
    """
    medians = [np.median(frame_map.power.values[:, rows]) for rows in range_row_segments(frame_map)]
    return np.asarray(medians) / frame_map.theoretical_noise_median_over_mean


def has_noise_in_all_segments(frame_map: FrameMap) -> bool:
    """Return whether all segments contain noise beyond rounding errors."""
    return bool(
        np.all(noise_floor_per_segment(frame_map) > _ROUNDING * frame_map.power.values.max())
    )


def noise_floor_at_rows(frame_map: FrameMap, rows: np.ndarray) -> np.ndarray:
    """Interpolate the noise floor at rows of the map, linearly in dB between segment centres."""
    centres = [(segment.start + segment.stop - 1) / 2 for segment in range_row_segments(frame_map)]
    level = np.maximum(noise_floor_per_segment(frame_map), np.finfo(np.float32).tiny)
    return np.asarray(np.exp(np.interp(rows, centres, np.log(level))))


def find_peak_cells(frame_map: FrameMap) -> np.ndarray:
    """Return the cells of the peaks that the chain detects, (n, 2), strongest first.

    Peaks at the level of rounding errors are excluded.
    """
    power = frame_map.power.values
    cells, _ = detect_peaks_and_count_dropped(
        fill_unusable_cells_with_noise(power, frame_map.radar, frame_map.chain),
        frame_map.radar,
        frame_map.chain,
    )
    return cells[power[cells[:, 0], cells[:, 1]] > _ROUNDING * power.max()]


def is_in_searched_rows(frame_map: FrameMap, cells: np.ndarray) -> np.ndarray:
    """Return whether detection searches the rows of cells, (n, 2)."""
    rows = rows_with_circular_noise(
        frame_map.radar.frame.chirp,
        frame_map.chain.map_noise_statistics(frame_map.radar).range_transform,
    )
    return np.asarray((rows.start <= cells[:, 1]) & (cells[:, 1] < rows.stop))


def measure_peaks_near_cells(frame_map: FrameMap, cells: np.ndarray) -> Peaks:
    """Measure the highest cell within one of each given cell, (n, 2), and its peak position."""
    neighbours, powers = _neighbouring_cells_and_powers(frame_map, cells)
    best = powers.argmax(axis=1)
    rows = np.arange(len(cells))
    slow, fast = _interpolated_peak_positions(frame_map, neighbours[rows, best], cells)
    return Peaks(
        cell=neighbours[rows, best], power=powers[rows, best], velocity_bin=slow, range_bin=fast
    )


def peak_position_spread_over_neighbours(
    frame_map: FrameMap, cells: np.ndarray, relative_power_margin: np.ndarray
) -> np.ndarray:
    """Return how far peaks may move if noise favours a neighbouring cell, (n,), in cells.

    Neighbours are the cells whose power is less by at most a `relative_power_margin` of the
    peak's, (n,); their peak positions are compared. For a tone between two bins they agree, for
    a peak on the flank of another they differ.
    """
    neighbours, powers = _neighbouring_cells_and_powers(frame_map, cells)
    own_positions = [
        position[:, None] for position in _interpolated_peak_positions(frame_map, cells, cells)
    ]
    n = neighbours.shape[1]
    neighbour_positions = _interpolated_peak_positions(
        frame_map, neighbours.reshape(-1, 2), np.repeat(cells, n, axis=0)
    )
    distances = [
        abs(a.reshape(-1, n) - b) for a, b in zip(neighbour_positions, own_positions, strict=True)
    ]
    is_rival = powers > powers[:, :1] * (1 - relative_power_margin[:, None])
    return np.asarray(np.where(is_rival, np.maximum(*distances), 0.0).max(axis=1, initial=0.0))


def _neighbouring_cells_and_powers(
    frame_map: FrameMap, cells: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nine cells about each, (n, 9, 2), itself first, and their powers; -1 outside."""
    power = frame_map.power.values
    n_velocity, n_rows = power.shape
    neighbours = cells[:, None] + np.array([(v, r) for v in (0, -1, 1) for r in (0, -1, 1)])
    inside = (neighbours[..., 1] >= 0) & (neighbours[..., 1] < n_rows)
    neighbours[..., 0] %= n_velocity
    neighbours[..., 1] = neighbours[..., 1].clip(0, n_rows - 1)
    return neighbours, np.where(inside, power[neighbours[..., 0], neighbours[..., 1]], -1.0)


def _interpolated_peak_positions(
    frame_map: FrameMap, peak_cells: np.ndarray, reference_cells: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate peak positions from the highest cells, unwrapped towards reference cells."""
    noise, n_velocity = (
        frame_map.chain.map_noise_statistics(frame_map.radar),
        frame_map.power.sizes["velocity"],
    )
    slow, fast = interpolate_peak_frequencies(frame_map.power.values, peak_cells, noise)
    offset = slow / (2 * np.pi) * n_velocity + n_velocity // 2 - reference_cells[:, 0]
    offset = (offset + n_velocity / 2) % n_velocity - n_velocity / 2  # velocities wrap
    return reference_cells[:, 0] + offset, fast / (2 * np.pi) * noise.range_transform.n_bins


def channel_spectra_at_cells(frame_map: FrameMap, cells: np.ndarray) -> np.ndarray:
    """Compute the complex spectrum of each channel at cells of the map, (n, channel)."""
    noise, chirp = (
        frame_map.chain.map_noise_statistics(frame_map.radar),
        frame_map.radar.frame.chirp,
    )
    over_velocity, over_range = noise.doppler_transform, noise.range_transform
    m, n = np.arange(over_velocity.n_points), np.arange(over_range.n_points)
    velocities, row = np.unique(cells[:, 0], return_inverse=True)  # static echoes share one
    cycles = np.outer(velocities - over_velocity.n_bins // 2, m) / over_velocity.n_bins
    slow = np.exp(-2j * np.pi * cycles) * over_velocity.weights / over_velocity.weights.sum()
    fast = np.exp(-2j * np.pi * np.outer(cells[:, 1], n) / over_range.n_bins)
    fast = fast * amplitude_range_weights(over_range, chirp.sampling)
    chirp_samples = frame_map.samples.transpose("chirp", "rx", "sample").values
    samples = split_chirps_into_slots(np.ascontiguousarray(chirp_samples), frame_map.radar.frame)
    n_chirps, n_channels, n_samples = samples.shape
    rows = (slow @ samples.reshape(n_chirps, -1)).reshape(-1, n_channels, n_samples)
    return (rows[row] @ fast[..., None])[..., 0]
