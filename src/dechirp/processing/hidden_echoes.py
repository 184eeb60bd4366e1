"""Echoes hidden beside a strong one, or at half the sample rate of real samples.

A strong echo hides others below its sidelobes, or below the thresholds it raises.

`peaks.reject_sidelobes` keeps a peak if its amplitude exceeds that of the strong echo's sidelobe,
A s(d) at d cells, and the root of its threshold T together. So an echo at d cells is hidden if its
power relative to that of the strong echo is below

    L(d) = (s(d) + sqrt(T(d)) / A)^2.

T is the threshold of the map itself: training cells that contain the strong echo raise it. Of 250
simulated echoes 8 dB below L none was found, 8 dB above it 237, and 16 dB above it 248.

Cells of real samples in the rows about half the sample rate are not searched for velocities about
zero and about the largest one: noise there is correlated with its own conjugate by rho <= 1, so
that (1 + rho) T bounds its false alarms. With the mirror image beside it, the range of a static
echo depends on the phases of both. Echoes of other velocities are apart from their images, which
have the negative velocity; at the very end of the range axis, noise decides which is which.
"""

import numpy as np
import xarray as xr

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.core.text import format_number_ranges
from dechirp.core.units import from_decibels, to_decibels
from dechirp.processing.cfar_along_velocity import cfar_along_velocity, training_cell_options
from dechirp.processing.chain import Chain
from dechirp.processing.leakage import zero_range_main_lobe_m
from dechirp.processing.peaks import sidelobe_envelope
from dechirp.processing.spectrum import rows_with_circular_noise
from dechirp.radar.radar import Radar

# Levels of hidden echoes relative to the strong one.
_LEVELS_DB = (-20, -40, -60)
# An echo at the lowest level that is stated exceeds the threshold of noise alone by this factor,
# so that the strong echo hides it, and not the noise.
_MIN_MARGIN = 4.0
# A finding is due where echoes of this level are hidden: weaker masking is usual.
_NOTED_LEVEL_DB = -40
# 1 + rho of real noise. Then no more than the designed false alarms are reported as echoes.
_REAL_NOISE_FACTOR = 2.0
# Standard errors from the ends of the range axis within which an echo may be its own image.
_IMAGE_STD = 3.0


def hidden_levels(
    power: np.ndarray, threshold: np.ndarray, radar: Radar, chain: Chain, cell: tuple[int, int]
) -> np.ndarray:
    """Return the level below which an echo beside a strong one of its velocity is hidden.

    Parameters
    ----------
    power, threshold : array (velocity, range)
        A map and its threshold.
    radar, chain
        Those of the map.
    cell : (int, int)
        Cell of the strong echo.

    Returns
    -------
    array (n,)
        L(d) relative to the power of the cell, for d = 1, 2, ... cells along range: of the two
        sides the one that hides less; T counts as zero farther than the training cells reach.
    """
    row, column = cell
    envelope = sidelobe_envelope(chain.map_noise_statistics(radar).range_transform)
    over_range = threshold[row]
    distance = np.arange(1, min(envelope.size, over_range.size))
    # Out of the map, no cell is tested.
    padded = np.pad(over_range, distance.size, constant_values=np.inf)
    middle = column + distance.size
    lower = np.minimum(padded[middle - distance], padded[middle + distance])
    # Thresholds farther away than the training cells reach are raised by other echoes.
    is_near = distance <= chain.cfar.training_window.half_range + 2
    raised = np.where(is_near & np.isfinite(lower), np.sqrt(lower / power[row, column]), 0)
    return np.asarray((envelope[distance] + raised) ** 2)


def hidden_echo_findings(
    power: xr.DataArray, threshold: xr.DataArray, radar: Radar, chain: Chain
) -> tuple[Finding, ...]:
    """Return a note on the cells beside the strongest echo of a map in which echoes are hidden.

    `power` and `threshold` are labelled maps over velocity and range. Echoes beyond the largest
    range of the chain and leakage do not count, since tables leave them out.
    """
    values, limits = (array.transpose("velocity", "range").values for array in (power, threshold))
    range_m, velocity_m_per_s = power["range"].values, power["velocity"].values
    # Leakage within the main lobe of zero range has its peak up to half a cell farther away.
    is_shown = range_m > zero_range_main_lobe_m(radar, chain) + (range_m[1] - range_m[0]) / 2
    if chain.max_range_m is not None:
        is_shown &= range_m <= chain.max_range_m
    searched = np.where(np.isfinite(limits) & is_shown, values, 0)
    row, column = np.unravel_index(int(searched.argmax()), searched.shape)
    strongest = float(searched[row, column])
    finite = limits[np.isfinite(limits)]
    noise_threshold = float(np.median(finite)) if finite.size else np.inf
    levels_db = [
        level_db
        for level_db in _LEVELS_DB
        if strongest * from_decibels(level_db) > _MIN_MARGIN * noise_threshold
    ]
    if _NOTED_LEVEL_DB not in levels_db:
        return ()
    levels = hidden_levels(values, limits, radar, chain, (int(row), int(column)))
    parts = [
        f"{-level_db} dB weaker at"
        f" {format_number_ranges('cell', np.flatnonzero(levels > from_decibels(level_db)) + 1)}"
        for level_db in levels_db
    ]
    remedies = []
    if chain.range_window == Chain.range_window:
        remedies.append("--set chain.range_window=blackman-harris lowers the sidelobes")
    along_velocity = cfar_along_velocity(chain, radar)
    if chain.cfar.n_training.range and along_velocity is not None:
        options = training_cell_options(along_velocity, "chain.cfar")
        remedies.append(
            f"{' '.join(f'--set {option}' for option in options)} keeps the echo out of the"
            " training cells"
        )
    return (
        Finding(
            level="note",
            setting="chain.cfar",
            value=f"the strongest echo, {to_decibels(strongest / noise_threshold):.0f} dB over the"
            f" threshold of noise at {range_m[column]:.4g} m and {velocity_m_per_s[row]:.3g} m/s,"
            f" hides echoes of its velocity {', '.join(parts)} beside it"
            f" ({range_m[1] - range_m[0]:.3g} m each)",
            expected="weaker echoes farther away, or of another velocity",
            fix=" and ".join(remedies) or "more bandwidth separates the echoes",
        ),
    )


def unsearched_echo_findings(
    power: xr.DataArray, threshold: xr.DataArray, radar: Radar, chain: Chain, *, is_recorded: bool
) -> tuple[Finding, ...]:
    """Return a finding on the strongest echo in the unsearched cells about half the sample rate.

    Of real samples, cells of velocities about zero and about the largest one are not searched
    there. `power` and `threshold` are labelled maps over velocity and range. Echoes beyond the
    largest range of the chain do not count. A warning for a simulated frame; a note for a recorded
    one, in which converters leave spurs there.
    """
    if radar.frame.chirp.sampling != "real":
        return ()
    values, limits = (array.transpose("velocity", "range").values for array in (power, threshold))
    end = rows_with_circular_noise(radar.frame.chirp, chain.range_transform(radar.frame.chirp)).stop
    range_m, velocity_m_per_s = power["range"].values, power["velocity"].values
    largest_m = np.inf if chain.max_range_m is None else chain.max_range_m
    if not 0 < end < len(range_m) or range_m[end] > largest_m:
        return ()
    is_searched = np.isfinite(limits[:, end - 1 :])
    last = values[:, end - 1 :]
    unsearched = np.where(is_searched, 0, last).max(axis=1)
    searched = np.where(is_searched, last, 0).max(axis=1)
    # An echo in the searched cells has its image in the others, at minus its velocity.
    mirrored = searched[(2 * (len(searched) // 2) - np.arange(len(searched))) % len(searched)]
    neighbours = [np.roll(row, shift) for row in (searched, mirrored) for shift in (-1, 0, 1)]
    is_echo = unsearched > np.maximum(
        _REAL_NOISE_FACTOR * limits[:, end - 1], np.max(neighbours, axis=0)
    )
    if not is_echo.any():
        return ()
    row = int(np.where(is_echo, unsearched, 0).argmax())
    column = end + int(values[row, end:].argmax())
    margin_db = to_decibels(unsearched[row] / limits[row, end - 1])
    source = "an echo or a spur of the converter" if is_recorded else "an echo"
    return (
        Finding(
            level="note" if is_recorded else "warning",
            setting="radar.frame.chirp.sampling",
            value=f"{source}, {margin_db:.0f} dB over the threshold at about"
            f" {range_m[column]:.4g} m with a radial speed of {abs(velocity_m_per_s[row]):.3g} m/s,"
            f" is not detected: beyond {range_m[end - 1]:.4g} m, real samples are not searched for"
            " echoes of this velocity, which overlap with their mirror images",
            expected=f"echoes nearer than {(range_m[end - 1] + range_m[end]) / 2:.4g} m",
            fix="sample faster, or lower the slope",
        ),
    )


def velocity_sign_findings(detections: xr.Dataset, radar: Radar) -> tuple[Finding, ...]:
    """Return a warning on detections of real samples that may be mirror images of echoes.

    An echo of real samples has an image at the negative beat and Doppler frequencies: as far beyond
    the largest range, with the opposite velocity. Within the error of the range, either may be it.
    """
    if radar.frame.chirp.sampling != "real" or not radar.frame.can_measure_velocity:
        return ()
    range_m, std_m = detections["range"].values, detections["range_std"].values
    if radar.calibration is not None:
        range_m = range_m + radar.calibration.range_offset_m
    distance_m = np.minimum(range_m, radar.frame.chirp.max_range_m - range_m)
    is_moving = abs(detections["velocity"].values) > 3 * detections["velocity_std"].values
    indices = np.flatnonzero((abs(distance_m) < _IMAGE_STD * std_m) & is_moving)
    if not indices.size:
        return ()
    strongest = indices[np.argmax(detections["snr"].values[indices])]
    velocity = detections["velocity"].values[strongest]
    return (
        Finding(
            level="warning",
            setting="radar.frame.chirp.sampling",
            value=f"{format_count_with_noun(indices.size, 'detection')} at an end of the range axis"
            f" of real samples, such as that at {range_m[strongest]:.4g} m: it moves at"
            f" {velocity:.3g} or {-velocity:.3g} m/s, since its mirror image is as near to the end",
            expected=f"detections more than {_IMAGE_STD:g} standard errors of range from 0 and from"
            f" {radar.frame.chirp.max_range_m:.4g} m",
            fix="sample faster, or lower the slope",
        ),
    )
