"""Noise that depends on range, which raises the false-alarm rate of moving targets where it rises.

Noise of the beat signal is white behind a flat filter. Below some 100 kHz, amplifiers add noise in
proportion to 1 / f; filters shape it; leakage and strong echoes carry amplitude and phase noise
beside them. A training window that extends over range averages it: where the noise exceeds the mean
of its training cells by a factor e, the threshold is too low by that factor. Without static echoes,
the median over the velocities of a range shows its noise, since targets occupy few of them.
"""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import scipy

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.core.text import format_number
from dechirp.core.units import to_decibels
from dechirp.processing.cfar_along_velocity import cfar_along_velocity, training_cell_options
from dechirp.processing.chain import Chain
from dechirp.processing.frame import split_by_ramp_direction
from dechirp.processing.mitigation.apply import apply_mitigation
from dechirp.processing.range_doppler_map import (
    fill_unusable_cells_with_noise,
    range_doppler_power,
)
from dechirp.processing.spectrum import rows_with_circular_noise
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.radar import Radar

# Least excess of noise that counts: 1 dB, or four standard deviations of a median of few cells,
# which is 1.25 times that of a mean.
_MIN_EXCESS, _MEDIAN_STD, _MIN_STDS = 10**0.1, 1.25, 4.0


def noise_excess_of_ranges(frames: Iterable[np.ndarray], radar: Radar, chain: Chain) -> np.ndarray:
    """Return the noise of each range, relative to the mean of its training cells, (n_ranges,).

    1 where it is not significantly higher. `frames` are arrays (chirp, rx, sample), `chain` filters
    static echoes. Empty without frames.
    """
    profiles, n_cells = [], 0
    for power, map_radar in maps_of_rising_ramps(frames, radar, chain):
        profiles.append(np.median(power, axis=0))
        n_cells += len(power) * map_radar.n_summed_maps
    if not profiles:
        return np.zeros(0)
    rows = rows_with_circular_noise(radar.frame.chirp, chain.range_transform(radar.frame.chirp))
    profile = np.mean(profiles, axis=0)[rows]
    window = chain.cfar.training_window
    box_row = window.tested_rows_in_training_box(profile.size)
    training = np.empty(profile.size)
    for row in np.unique(box_row):
        tested = np.flatnonzero(box_row == row)
        offsets = window.training_cell_offsets(int(row))[:, 1]
        training[tested] = np.mean(profile[tested[:, None] + offsets], axis=1)
    excess = np.divide(profile, training, out=np.ones_like(profile), where=training > 0)
    least = max(_MIN_EXCESS, 1 + _MIN_STDS * _MEDIAN_STD / np.sqrt(n_cells))
    excess_of_ranges = np.ones(len(profiles[0]))
    excess_of_ranges[rows] = np.where(excess > least, excess, 1.0)
    return excess_of_ranges


def maps_of_rising_ramps(
    frames: Iterable[np.ndarray], radar: Radar, chain: Chain
) -> Iterator[tuple[np.ndarray, Radar]]:
    """Yield the map of each frame without invalid samples, of rising ramps alone, and its radar."""
    for samples in frames:
        clean = apply_mitigation(samples, radar.frame, chain.mitigation).samples
        channels = split_chirps_into_slots(clean, radar.frame)
        map_channels, map_radar = next(split_by_ramp_direction(channels, radar))
        power = range_doppler_power(map_channels, map_radar, chain)
        if np.isfinite(power).all():
            yield fill_unusable_cells_with_noise(power, map_radar, chain), map_radar


def doubtful_motion_mask(
    columns: Mapping[str, np.ndarray], excess: np.ndarray, radar: Radar, chain: Chain
) -> np.ndarray:
    """Return which moving detections the noise of their range may have caused, (n,).

    `columns` are those of `core.detection_columns`, `chain` that of the map without static echoes.
    """
    probability = chain.cfar.false_alarm_probability
    if probability is None or not (excess > 1).any():
        return np.zeros(len(columns["range"]), bool)
    factor = _excess_of_detections(columns, excess, radar, chain)
    window = chain.cfar.training_window
    n_channels = radar.n_summed_maps
    n_training = len(window.training_cell_offsets(window.half_range))
    ratio = scipy.special.fdtri(2 * n_channels, 2 * n_channels * n_training, 1 - probability)
    is_moving = columns["moving"] == 1
    # An SNR is the sum over the channels, relative to the noise of the training cells in one.
    is_weak = columns["snr"] < n_channels * (ratio * factor - 1)
    return np.asarray((factor > 1) & is_moving & is_weak)


def _excess_of_detections(
    columns: Mapping[str, np.ndarray], excess: np.ndarray, radar: Radar, chain: Chain
) -> np.ndarray:
    """Return the excess of the nearest range of each detection, (n,)."""
    chirp = radar.frame.chirp
    range_bins_m = chirp.range_bins_m(chain.range_transform(chirp).n_bins)
    nearest = np.round(columns["range"] / (range_bins_m[1] - range_bins_m[0])).astype(int)
    return np.asarray(excess[np.clip(nearest, 0, excess.size - 1)])


def noise_profile_findings(
    columns: Mapping[str, np.ndarray], excess: np.ndarray, radar: Radar, chain: Chain
) -> tuple[Finding, ...]:
    """Return a note on moving detections that noise of their range may have caused."""
    is_doubtful = doubtful_motion_mask(columns, excess, radar, chain)
    if not is_doubtful.any():
        return ()
    factor = _excess_of_detections(columns, excess, radar, chain)
    doubtful_m = columns["range"][is_doubtful]
    span = " to ".join(
        dict.fromkeys(format_number(m, 2) for m in (min(doubtful_m), max(doubtful_m)))
    )
    fix = "discard them if no other frame confirms them"
    along_velocity = cfar_along_velocity(chain, radar)
    if chain.cfar.n_training.range and along_velocity is not None:
        options = training_cell_options(along_velocity, "chain.moving_targets.cfar")
        fix += (
            ", or take training cells along velocity alone:"
            f" {' '.join(f'--set {option}' for option in options)}"
        )
    return (
        Finding(
            level="note",
            setting="chain.moving_targets",
            value=f"{format_count_with_noun(int(is_doubtful.sum()), 'moving detection')}"
            f" at {span} m may be false alarms: the noise there is up to"
            f" {to_decibels(factor[is_doubtful].max()):.1f} dB higher than in the training cells;"
            " whether they move counts as unknown",
            expected="noise as in the training cells at other ranges, without that of amplifiers"
            " at low beat frequencies or beside strong leakage; detections over a threshold for it",
            fix=fix,
        ),
    )
