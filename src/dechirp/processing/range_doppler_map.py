"""Range-Doppler maps: power, threshold, and the cells that exceed it."""

from functools import lru_cache

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.compiled_kernels import plain_twins_in_first_calls
from dechirp.core.conventions import (
    axis_coordinate,
    labelled_array,
    labelled_variable,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory
from dechirp.core.units import power_units
from dechirp.processing.cfar.base import MapNoise
from dechirp.processing.chain import Chain
from dechirp.processing.mitigation.apply import apply_mitigation
from dechirp.processing.mitigation.noise_loss import (
    equalise_map_noise,
    mitigation_noise_gain,
    sufficient_noise_gain_mask,
)
from dechirp.processing.peaks import (
    image_levels,
    reject_sidelobes,
    strongest_local_maxima_and_n_dropped,
)
from dechirp.processing.range_walk import select_frame_transform
from dechirp.processing.scaling import check_fits_single_precision
from dechirp.processing.spectrum import (
    check_samples_were_finite,
    mean_range_doppler_power,
    nearest_circular_noise_rows,
    rows_with_circular_noise,
    searched_cell_mask,
    velocities_with_circular_noise,
)
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.cube import select_only_frame
from dechirp.radar.radar import Radar


@check_argument_types
def power_map(cube: xr.DataArray, radar: Radar, chain: Chain | None = None) -> xr.DataArray:
    """Compute the range-Doppler map of one frame, (chirp, rx, sample) to (velocity, range).

    The frame may have an axis `frame` of length 1, and its axes any order. Without a chain, that of
    `detect` with its defaults.

    Mean power over the channels, see `split_chirps_into_slots`; a tone on a bin keeps its power.
    Where mitigation attenuates velocities, the map is divided by the residual white noise, except
    in cells with less than a tenth of it, see `processing.mitigation.noise_loss`.

    Raises
    ------
    InvalidSetting
        If the cube has several frames or samples that are not finite, or the radar cannot have
        taken the frame.
    """
    frame = select_only_frame(cube, radar)
    chain = chain or Chain()
    samples = frame.variable.transpose("chirp", "rx", "sample").values
    check_fits_single_precision(samples)
    with plain_twins_in_first_calls(samples.size):
        if chain.mitigation:
            samples = apply_mitigation(samples, radar.frame, chain.mitigation).samples
        power = range_doppler_power(split_chirps_into_slots(samples, radar.frame), radar, chain)
    check_samples_were_finite(power[0, 0])
    return label_map_axes(power, radar, chain, samples_unit=str(cube.attrs.get("units")))


def label_map_axes(
    power: np.ndarray, radar: Radar, chain: Chain, *, samples_unit: str
) -> xr.DataArray:
    """Label a map (velocity, range) with its axes and its unit."""
    attributes = {"units": power_units(samples_unit), "long_name": "power"}
    variable = labelled_variable(("velocity", "range"), power, attributes)
    return labelled_array(variable, _map_axis_coordinates(radar, chain))


@lru_cache(maxsize=8)  # 0.7 ms
def _map_axis_coordinates(radar: Radar, chain: Chain) -> xr.Coordinates:
    noise = chain.map_noise_statistics(radar)
    velocity_m_per_s = radar.frame.velocity_bins_m_per_s(noise.doppler_transform.n_bins)
    range_m = radar.frame.chirp.range_bins_m(noise.range_transform.n_bins)
    return xr.Coordinates(
        {
            "velocity": axis_coordinate("velocity", velocity_m_per_s),
            "range": axis_coordinate("range", range_m),
        }
    )


@check_argument_types
def threshold_map(power: xr.DataArray, radar: Radar, chain: Chain | None = None) -> xr.DataArray:
    """Compute the threshold of each cell of a map; infinite where no false-alarm law holds.

    Without a chain, that of `detect` with its defaults, which fit the training cells to the map.

    Infinite in cells of real samples that `processing.spectrum.searched_cell_mask` excludes, and in
    cells with less than a tenth of the noise left by mitigation. Rows about DC and about half the
    sample rate, which are no training cells, have the threshold of the next row.

    Parameters
    ----------
    power : DataArray (velocity, range)
        The map that `power_map` returns for this radar and chain.
    radar : Radar
        The radar of the map.
    chain : Chain, optional
        Its `cfar`, windows and mitigation are used.
    """
    if set(power.dims) != {"velocity", "range"}:
        raise InvalidSetting(
            "power",
            value=f"an array over {', '.join(map(str, power.dims))}",
            expected="a map over velocity, range",
            fix="pass what power_map returns for this radar and chain",
        )
    chain = chain or Chain().fit_to_radar(radar)
    noise = chain.map_noise_statistics(radar)
    labelled = power.transpose("velocity", "range")
    rows = rows_with_circular_noise(radar.frame.chirp, noise.range_transform)
    level = np.ascontiguousarray(
        fill_unusable_cells_with_noise(labelled.values, radar, chain)[:, rows]
    )
    threshold = np.full_like(labelled.values, np.inf)
    with plain_twins_in_first_calls(level.size):
        threshold[:, rows] = chain.cfar.threshold(level, noise)
    if level.shape != threshold.shape and level.size:
        threshold[:, : rows.start] = threshold[:, rows.start, None]
        threshold[:, rows.stop :] = threshold[:, rows.stop - 1, None]
        threshold[~_searched_cells(radar, noise)] = np.inf
    if (residual := residual_noise_gain(radar, chain)) is not None:
        threshold[~sufficient_noise_gain_mask(residual)] = np.inf
    return labelled.copy(data=threshold).assign_attrs(long_name="threshold")


def threshold_cuts_through_cell(
    power: xr.DataArray, radar: Radar, chain: Chain, cell: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the threshold of the row and the column through a cell (velocity, range).

    (range,) and (velocity,): from the part of the map with their training cells, in a third of
    the time of `threshold_map`.
    """
    row, column = cell
    noise, window = chain.map_noise_statistics(radar), chain.cfar.training_window
    rows = rows_with_circular_noise(radar.frame.chirp, noise.range_transform)
    values = power.variable.transpose("velocity", "range").values
    level = fill_unusable_cells_with_noise(values, radar, chain)[:, rows]
    window_rows = np.arange(row - window.half_velocity, row + window.half_velocity + 1) % len(level)
    over_range = np.full(values.shape[1], np.inf, np.float32)
    over_range[rows] = chain.cfar.threshold(level[window_rows], noise)[window.half_velocity]
    over_range[: rows.start] = over_range[rows.start]
    over_range[rows.stop :] = over_range[rows.stop - 1]
    tested = int(nearest_circular_noise_rows(np.array(column), rows))
    box_row = int(window.tested_rows_in_training_box(level.shape[1])[tested])
    first = tested - box_row
    box = np.ascontiguousarray(level[:, first : first + 2 * window.half_range + 1])
    over_velocity = chain.cfar.threshold(box, noise)[:, box_row]
    is_searched = _searched_cells(radar, noise)
    over_range[~is_searched[row]] = np.inf
    over_velocity = np.where(is_searched[:, column], over_velocity, np.inf)
    if (residual := residual_noise_gain(radar, chain)) is not None:
        is_usable = sufficient_noise_gain_mask(residual)
        over_range[~is_usable[row]] = np.inf
        over_velocity = np.where(is_usable[:, column], over_velocity, np.inf)
    return over_range, over_velocity


def range_doppler_power(samples: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """Compute the map (velocity, range) of samples (chirp, channel, sample) after mitigation."""
    noise = chain.map_noise_statistics(radar)
    cells = noise.range_transform.n_bins * noise.doppler_transform.n_bins
    check_free_memory(
        "range-Doppler map",
        needed_bytes=cells * (3 * 8.0 + 3 * 4.0),  # spectra of a channel, power, threshold
        fix="take fewer range or velocity bins",
    )
    chirp = radar.frame.chirp
    transform = select_frame_transform(chain.range_walk, chirp)
    power = mean_range_doppler_power(
        samples, chirp.sampling, noise.range_transform, noise.doppler_transform, transform
    )
    if (residual := residual_noise_gain(radar, chain)) is not None:
        np.divide(power, residual, out=power, where=sufficient_noise_gain_mask(residual))
    return power


def residual_noise_gain(radar: Radar, chain: Chain) -> np.ndarray | None:
    """Return the noise gain of the mitigation in each cell, see `mitigation_noise_gain`.

    None if no method filters slow time, which leaves all noise.
    """
    if not any(method.filters_slow_time for method in chain.mitigation):
        return None
    noise = chain.map_noise_statistics(radar)
    return mitigation_noise_gain(
        chain.mitigation, radar.frame.chirp, noise.range_transform, noise.doppler_transform
    )


def fill_unusable_cells_with_noise(power: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """Return the map that the detector reads: unused cells are filled with noise beside them."""
    residual = residual_noise_gain(radar, chain)
    return (
        power
        if residual is None
        else equalise_map_noise(power, sufficient_noise_gain_mask(residual).astype(np.float32))
    )


def detect_peaks_and_count_dropped(
    power: np.ndarray, radar: Radar, chain: Chain
) -> tuple[np.ndarray, int]:
    """Detect the peaks of a map.

    Parameters
    ----------
    power : array (velocity, range)
        Map from `fill_unusable_cells_with_noise`.
    radar, chain
        Those of the map.

    Returns
    -------
    array (n, 2)
        Indices of velocity and range, strongest first: those of `peaks.find_peaks` with the
        threshold map.
    int
        Number of local maxima over threshold beyond the 2,000 strongest, which are dropped.

    Notes
    -----
    The mask of cells over threshold, and the threshold of a few cells, take a fraction of the
    time that an ordered statistic takes for a whole map.
    """
    noise = chain.map_noise_statistics(radar)
    rows = rows_with_circular_noise(radar.frame.chirp, noise.range_transform)
    searched_power = np.ascontiguousarray(power[:, rows])
    is_over = chain.cfar.exceeds_threshold(searched_power, noise)
    if searched_power.shape != power.shape:
        in_rows, is_over = is_over, np.zeros(power.shape, bool)
        is_over[:, rows] = in_rows
        is_over |= _exceeds_threshold_at_range_ends(power, rows, radar, chain)
    if (residual := residual_noise_gain(radar, chain)) is not None:
        is_over &= sufficient_noise_gain_mask(residual)
    cells, n_dropped = strongest_local_maxima_and_n_dropped(power, is_over)
    threshold = _threshold_at_cells(searched_power, cells, rows, chain, noise)
    cells = reject_sidelobes(power, cells, threshold, noise)
    if searched_power.shape != power.shape:
        cells = cells[_searched_cells(radar, noise)[cells[:, 0], cells[:, 1]]]
    if chain.image_rejection is not None and radar.frame.chirp.sampling == "complex":
        cells = cells[image_levels(power, cells) > 1 / chain.image_rejection]
    return cells, n_dropped


def _searched_cells(radar: Radar, noise: MapNoise) -> np.ndarray:
    return searched_cell_mask(radar.frame.chirp, noise.range_transform, noise.doppler_transform)


def _exceeds_threshold_at_range_ends(
    power: np.ndarray, rows: slice, radar: Radar, chain: Chain
) -> np.ndarray:
    """Return which cells of real samples outside the rows exceed the threshold of the next row.

    Cells that are not searched too: their echoes have sidelobes among the others. But not the
    offset of a converter: the transform of a constant is zero between the sidelobes, so an offset
    60 dB above an echo leaves it as it is.
    """
    noise = chain.map_noise_statistics(radar)
    is_over = np.zeros(power.shape, bool)
    if rows.start == rows.stop:
        return is_over
    # The thresholds of the outermost rows depend on a training window beside each alone.
    n_rows = 2 * chain.cfar.training_window.half_range + 1
    boxes = slice(rows.start, rows.start + n_rows), slice(rows.stop - n_rows, rows.stop)
    ends = slice(rows.start), slice(rows.stop, None)
    for box, end, row in zip(boxes, ends, (0, -1), strict=True):
        threshold = chain.cfar.threshold(np.ascontiguousarray(power[:, box]), noise)[:, row]
        is_over[:, end] = power[:, end] > threshold[:, None]
    is_over[~velocities_with_circular_noise(noise.doppler_transform), 0] = False
    return is_over


def _threshold_at_cells(
    searched_power: np.ndarray, cells: np.ndarray, rows: slice, chain: Chain, noise: MapNoise
) -> np.ndarray:
    """Return the threshold at cells of a map, (n,): outside the rows that of the next one."""
    tested = np.stack([cells[:, 0], nearest_circular_noise_rows(cells[:, 1], rows)], axis=1)
    return chain.cfar.threshold_at_cells(searched_power, tested, noise)
