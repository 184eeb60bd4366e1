"""Settings of the chain that fit a recording, chosen from some of its frames.

Only settings that have their default values and were not given are chosen. Rules:

* Training cells along velocity alone, where they show static echoes that the default window hides.
  A static echo occupies one velocity, so the cells of its range at other velocities contain noise,
  whereas the default window contains the echoes beside it: a row of n cells of power P in a window
  of N cells raises the threshold to alpha n P / N. The factor alpha stays exact for fewer cells.
* A map of moving targets without static echoes, where there are static echoes and chirps enough.
  Its training cells lie along velocity alone where its noise rises towards zero range, as leakage
  and amplifiers cause it: cells at other ranges contain less noise than those next to zero range.
  But not if these cells hide moving echoes of wide Doppler spectra, such as people.
* No detections beyond the range axis. Beat frequencies slightly below zero, of leakage between the
  antennas, alias to its far end. A static echo within a main lobe of the end is taken for leakage,
  and within the last 1/32 of the axis an echo that mirrors one as near to zero range: true echoes
  of equal strength would differ by 120 dB in cross section.
  Real samples stored as complex ones have a spectrum symmetric about zero: half of it is images.
* No I/Q images, of which each is at the negative beat and Doppler frequencies of a stronger echo.
  Moving echoes prove them, as all static ones have one velocity: two, 20 dB over the noise, whose
  levels agree to 6 dB (they depend on the beat frequency where I and Q differ in delay). Two other
  echoes lie at mirrors of n stronger ones with a probability of (n / cells)^2. Or leakage and
  static echoes next to zero range prove them, if their power over range recurs below zero: in eight
  cells or more, with a correlation of 0.9 and levels whose standard deviation is below 3 dB.
* One or two directions of each detection, where an echo has two that channels without calibration
  do not explain, see `angle.second_source_test`.
"""

import shlex
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import from_decibels, to_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle.fft import Fft
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.processing.cfar.base import Cfar
from dechirp.processing.cfar_along_velocity import cfar_along_velocity, training_cell_options
from dechirp.processing.chain import Chain
from dechirp.processing.frame import (
    find_directions,
    frame_detection_columns,
    process_frame,
    split_by_ramp_direction,
)
from dechirp.processing.mitigation.apply import apply_mitigation
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.moving_targets import MovingTargetMap
from dechirp.processing.noise_profile import maps_of_rising_ramps, noise_excess_of_ranges
from dechirp.processing.peaks import image_levels
from dechirp.processing.range_doppler_map import (
    detect_peaks_and_count_dropped,
    fill_unusable_cells_with_noise,
    range_doppler_power,
)
from dechirp.processing.spectrum import rows_with_circular_noise
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.radar import Radar

ChosenSettingName = Literal[
    "mitigation", "cfar", "moving_targets", "max_range", "image_rejection", "angle"
]
"""Setting of the chain that may be chosen for a recording: of `cfar` the training and guard cells,
of `mitigation` the repair of bursts, see `experiments.recording_faults`."""

# Fewest chirps of a frame for the map of moving targets: the filter takes the three cells about
# zero, and the window correlates the others with them.
_MIN_CHIRPS_OF_MOVING_MAP = 8
# Share of the range axis, at least a main lobe, in which echoes of leakage and their images lie.
_LEAKAGE_SHARE = 1 / 32
# Moving echoes that prove I/Q images: their number, least power over the median of the map, highest
# level (real samples have 0 dB) and its differences; and the margin of the rejection.
_MIN_IMAGES, _MIN_IMAGE_POWER, _MAX_IMAGE_LEVEL = 2, 100.0, 10**-0.1
_IMAGE_SPREAD_DB, _IMAGE_MARGIN_DB = 6.0, 3
# Static images next to zero range: cells 6 dB over the noise, and the agreement of both sides.
_MIN_IMAGE_CELLS, _MIN_IMAGE_CORRELATION, _MAX_LEVEL_STD_DB = 8, 0.9, 3.0
# Largest difference between a spectrum and its mirror image, relative to its power, of real
# samples; independent noise in both halves differs by about its own power.
_MAX_ASYMMETRY = 0.01
# Estimator of one or two directions: phases of 10 to 16 degrees are usual without calibration.
_PAIR_ESTIMATOR = MaximumLikelihood(n_sources="mdl", channel_phase_rad=float(np.radians(20)))
# Two sources, with two angles each, fit any four elements exactly.
_MIN_ELEMENTS_OF_PAIR = 5


@frozen_dataclass
class ChosenSetting:
    """Setting chosen for a recording, written as an option, with the reason."""

    setting: str
    options: tuple[str, ...]
    """PATH=VALUE, as after `--set`."""
    reason: str

    def to_finding(self) -> Finding:
        """Return a note that states the choice in one line."""
        options = " ".join(f"--set {shlex.quote(option)}" for option in self.options)
        return Finding(
            level="note",
            setting=self.setting,
            value=f"chosen {options} because {self.reason}",
            expected="settings that fit the recording",
            fix="give a value, the default one too, to replace it",
        )


class _StaticPeak(NamedTuple):
    range_m: float
    power_ratio: float
    """Power over the median of the map."""


def fit_chain_to_frames(
    chain: Chain,
    radar: Radar,
    frames: Iterable[np.ndarray],
    *,
    kept: Collection[ChosenSettingName] = (),
) -> tuple[Chain, tuple[ChosenSetting, ...]]:
    """Choose the settings of a chain that have their defaults by frames of a recording.

    `frames` are arrays (chirp, rx, sample); the settings in `kept` stay as they are. Returns the
    chain, fitted to the radar, and the choices.
    """
    default = chain.fit_to_radar(radar)
    reference = replace(chain, cfar=_cfar_over_both_axes(chain.cfar)).fit_to_radar(radar)
    frames = [samples for samples in frames if samples.any() and np.isfinite(samples).all()]
    maps, moving_maps, map_radar = _range_doppler_maps(frames, radar, reference)
    if not maps:
        return default, ()
    fitted, choices = default, []
    filters_slow_time = any(method.filters_slow_time for method in chain.mitigation)
    along_velocity = cfar_along_velocity(default, radar)
    may_choose_cells = "cfar" not in kept and chain.cfar.has_default_window
    if along_velocity is not None and may_choose_cells and not filters_slow_time:
        candidate = replace(default, cfar=along_velocity)
        hidden = _static_peaks_hidden_by(default, candidate, maps, map_radar)
        if hidden:
            fitted = candidate
            choices.append(_choice_of_cells_along_velocity(along_velocity, hidden))
    static = [peak for power in maps for peak in _static_peaks(power, map_radar, fitted)]
    if (
        static
        and "moving_targets" not in kept
        and chain.moving_targets is None
        and not filters_slow_time
        and radar.frame.n_chirps >= _MIN_CHIRPS_OF_MOVING_MAP
        and radar.frame.n_intervals == 1
    ):
        moving = MovingTargetMap(cfar=_cfar_over_both_axes(chain.cfar))
        fitted = replace(fitted, moving_targets=moving).fit_to_radar(radar)
        fitted, choice = _choose_cells_of_moving_map(fitted, frames, radar, static)
        choices.append(choice)
    if "max_range" not in kept and chain.max_range_m is None:
        limit_m, reason = _range_limit_and_reason(maps, static, map_radar, fitted)
        if reason:
            limit_m = float(f"{limit_m:.4g}")  # as printed, so that the option repeats the run
        fitted = replace(fitted, max_range_m=limit_m)
        if reason:
            options = (f"chain.max_range={limit_m:.4g} m",)
            choices.append(ChosenSetting(setting="chain.max_range", options=options, reason=reason))
    may_reject_images = "image_rejection" not in kept and chain.image_rejection is None
    if may_reject_images and radar.frame.chirp.sampling == "complex":
        level = _moving_image_level(moving_maps, map_radar, reference)
        echoes = "moving echoes have"
        if level is None:
            level = _static_image_level(maps, map_radar, reference)
            echoes = "leakage and static echoes next to zero range have"
        if level is not None:
            rejection_db = max(round(float(-to_decibels(level))) - _IMAGE_MARGIN_DB, 1)
            fitted = replace(fitted, image_rejection=float(from_decibels(rejection_db)))
            choices.append(_choice_of_image_rejection(rejection_db, level, echoes))
    if "angle" not in kept and _may_have_pairs(fitted, radar):
        candidate = replace(fitted, angle=_PAIR_ESTIMATOR)
        pair = _find_strongest_pair(frames, radar, candidate)
        if pair is not None:
            fitted = candidate
            choices.append(_choice_of_pair_estimator(pair))
    return fitted, tuple(choices)


def _range_doppler_maps(
    frames: Iterable[np.ndarray], radar: Radar, chain: Chain
) -> tuple[list[np.ndarray], list[np.ndarray], Radar]:
    """Return the map of each frame that is not empty, of rising ramps alone, and their radar.

    And a second list of maps without static echoes, of complex samples and enough chirps.
    """
    maps: list[np.ndarray] = []
    moving_maps: list[np.ndarray] = []
    map_radar = radar
    for samples in frames:
        clean = apply_mitigation(samples, radar.frame, chain.mitigation).samples
        channels = split_chirps_into_slots(clean, radar.frame)
        map_channels, map_radar = next(split_by_ramp_direction(channels, radar))
        power = range_doppler_power(map_channels, map_radar, chain)
        if not (np.isfinite(power).all() and power.any()):
            continue
        maps.append(fill_unusable_cells_with_noise(power, map_radar, chain))
        if np.iscomplexobj(clean) and len(map_channels) >= _MIN_CHIRPS_OF_MOVING_MAP:
            map_channels = map_channels - map_channels.mean(axis=0)
            moving_power = range_doppler_power(map_channels, map_radar, chain)
            moving_maps.append(
                fill_unusable_cells_with_noise(moving_power, map_radar, _moving_chain(chain))
            )
    return maps, moving_maps, map_radar


def _moving_chain(chain: Chain) -> Chain:
    """Return the chain of the maps without static echoes."""
    return replace(chain, mitigation=(MeanSubtraction(),))


def _cfar_over_both_axes(cfar: Cfar) -> Cfar:
    """Return the detector, with the default cells if its own lie along velocity alone.

    Such cells, chosen or given, are meant for static echoes: maps without these, and levels of
    images, are judged by the default cells, so that chosen cells given as an option change nothing.
    """
    if cfar.n_training.range:
        return cfar
    return replace(cfar, n_training=Chain.cfar.n_training, n_guard=Chain.cfar.n_guard)


def _static_peaks(power: np.ndarray, radar: Radar, chain: Chain) -> list[_StaticPeak]:
    """Detect the peaks of a map at zero velocity."""
    cells, _ = detect_peaks_and_count_dropped(power, radar, chain)
    cells = cells[cells[:, 0] == len(power) // 2]
    range_m = radar.frame.chirp.range_bins_m(chain.range_transform(radar.frame.chirp).n_bins)
    level = float(np.median(power)) or 1.0
    return [
        _StaticPeak(float(range_m[row]), float(power[velocity, row]) / level)
        for velocity, row in cells
    ]


def _static_peaks_hidden_by(
    default: Chain, candidate: Chain, maps: Sequence[np.ndarray], radar: Radar
) -> list[_StaticPeak]:
    """Return the static peaks that the candidate detects in the maps and the default does not."""
    hidden: list[_StaticPeak] = []
    for power in maps:
        detected = {peak.range_m for peak in _static_peaks(power, radar, default)}
        hidden += [
            peak for peak in _static_peaks(power, radar, candidate) if peak.range_m not in detected
        ]
    return hidden


def _choice_of_cells_along_velocity(cfar: Cfar, hidden: Sequence[_StaticPeak]) -> ChosenSetting:
    """Return the choice of training cells along velocity alone."""
    strongest = max(hidden, key=lambda peak: peak.power_ratio)
    return ChosenSetting(
        setting="chain.cfar",
        options=training_cell_options(cfar, "chain.cfar"),
        reason=f"static echoes hide another at {strongest.range_m:.4g} m,"
        f" {to_decibels(strongest.power_ratio):.0f} dB over the noise, from the default cells",
    )


def _choose_cells_of_moving_map(
    chain: Chain, frames: Sequence[np.ndarray], radar: Radar, static: Sequence[_StaticPeak]
) -> tuple[Chain, ChosenSetting]:
    """Return a chain with a map without static echoes, its cells chosen, and the choice."""
    assert chain.moving_targets is not None
    along_velocity = _moving_cfar_in_rising_noise(frames, radar, chain.moving_target_chain())
    if along_velocity is not None:
        chain = replace(chain, moving_targets=replace(chain.moving_targets, cfar=along_velocity))
    return chain, _choice_of_moving_target_map(static, along_velocity)


def _moving_cfar_in_rising_noise(
    frames: Sequence[np.ndarray], radar: Radar, chain: Chain
) -> Cfar | None:
    """Return the detector along velocity if the noise rises towards zero range, else None.

    `chain` is that of the map without static echoes. None too if the detector loses one of its
    peaks that exceeds the noise of its range.
    """
    along_velocity = cfar_along_velocity(chain, radar)
    if along_velocity is None:
        return None
    excess = noise_excess_of_ranges(frames, radar, chain)
    transform = chain.range_transform(radar.frame.chirp)
    rows = rows_with_circular_noise(radar.frame.chirp, transform)
    if not np.any(excess[rows][:1] > 1):
        return None
    candidate = replace(chain, cfar=along_velocity)
    for power, map_radar in maps_of_rising_ramps(frames, radar, chain):
        threshold = chain.cfar.threshold(power[:, rows], chain.map_noise_statistics(map_radar))
        exceeds_noise = np.zeros(power.shape, bool)
        exceeds_noise[:, rows] = power[:, rows] > threshold * excess[rows]
        cells, _ = detect_peaks_and_count_dropped(power, map_radar, chain)
        kept, _ = detect_peaks_and_count_dropped(power, map_radar, candidate)
        if not set(map(tuple, cells[exceeds_noise[tuple(cells.T)]])) <= set(map(tuple, kept)):
            return None
    return along_velocity


def _choice_of_moving_target_map(
    static: Sequence[_StaticPeak], along_velocity: Cfar | None
) -> ChosenSetting:
    """Return the choice of a map without static echoes, with training cells along velocity."""
    strongest = max(static, key=lambda peak: peak.power_ratio)
    options: tuple[str, ...] = ("chain.moving_targets.filter.kind=mean-subtraction",)
    reason = (
        f"static echoes, up to {to_decibels(strongest.power_ratio):.0f} dB over the noise"
        f" at {strongest.range_m:.4g} m, cover slow targets"
    )
    if along_velocity is not None:
        options += training_cell_options(along_velocity, "chain.moving_targets.cfar")
        reason += ", and noise rises towards zero range"
    return ChosenSetting(setting="chain.moving_targets", options=options, reason=reason)


def _range_limit_and_reason(
    maps: Sequence[np.ndarray], static: Sequence[_StaticPeak], radar: Radar, chain: Chain
) -> tuple[float, str]:
    """Return the largest range of detections, and the reason if it is nearer than the axis."""
    chirp = radar.frame.chirp
    if chirp.sampling == "real":
        return chirp.max_range_m, ""
    if all(_asymmetry(power) < _MAX_ASYMMETRY for power in maps):
        reason = "the spectrum is symmetric, as of real samples: echoes beyond are mirror images"
        return chirp.max_range_m / 2, reason
    transform = chain.range_transform(chirp)
    bin_m = chirp.max_range_m / transform.n_bins
    main_lobe_m = (transform.main_lobe_half_width_bins + 0.5) * bin_m
    near_m = max(main_lobe_m, _LEAKAGE_SHARE * chirp.max_range_m)
    near_echoes_m = np.array([0.0, *(peak.range_m for peak in static if peak.range_m < near_m)])
    aliased = []
    for peak in static:
        below_zero_m = chirp.max_range_m - peak.range_m
        # Both are centres of cells: each is up to half a cell from its peak, and noise moves it.
        is_image = abs(near_echoes_m - below_zero_m).min() <= 1.5 * chirp.range_resolution_m
        if below_zero_m <= main_lobe_m or (below_zero_m <= near_m and is_image):
            aliased.append(peak)
    if not aliased and not any(peak.range_m == 0 for peak in static):
        return chirp.max_range_m, ""
    limit_m = min([chirp.max_range_m - main_lobe_m, *(peak.range_m - bin_m for peak in aliased)])
    reason = (
        f"leakage between the antennas at beat frequencies about zero aliases to the largest range,"
        f" {chirp.max_range_m:.4g} m, where they are negative"
    )
    return limit_m, reason


def _moving_image_level(
    moving_maps: Sequence[np.ndarray], radar: Radar, chain: Chain
) -> float | None:
    """Return the highest level of moving I/Q images, relative to their echoes; None without proof.

    The maps are those without static echoes.
    """
    powers, levels = [], []
    for power in moving_maps:
        cells, _ = detect_peaks_and_count_dropped(power, radar, _moving_chain(chain))
        # About zero and half the sample rate, the sidebands of a vibrating echo mirror each other.
        half = power.shape[1] / 2
        apart = half / 2 - abs(cells[:, 1] % half - half / 2)
        cells = cells[apart >= chain.range_transform(radar.frame.chirp).main_lobe_half_width_bins]
        powers.append(power[tuple(cells.T)] / np.median(power))
        levels.append(image_levels(power, cells))
    if not levels:
        return None
    power_ratio, level = np.concatenate(powers), np.concatenate(levels)
    is_image = (level < _MAX_IMAGE_LEVEL) & (power_ratio > _MIN_IMAGE_POWER)
    if is_image.sum() < _MIN_IMAGES:
        return None
    power_ratio, level = power_ratio[is_image], level[is_image]
    strongest = level[power_ratio.argmax()]
    similar = level[abs(to_decibels(level / strongest)) <= _IMAGE_SPREAD_DB]
    return float(similar.max()) if similar.size >= _MIN_IMAGES else None


def _static_image_level(maps: Sequence[np.ndarray], radar: Radar, chain: Chain) -> float | None:
    """Return the highest level of I/Q images next to zero range at rest; None without proof."""
    first = int(np.ceil(chain.range_transform(radar.frame.chirp).main_lobe_half_width_bins))
    levels = []
    for power in maps:
        static = power[len(power) // 2]
        rows = np.arange(first, max(int(_LEAKAGE_SHARE * static.size), first) + 1)
        rows = rows[static[-rows] > from_decibels(6.0) * np.median(power)]
        if rows.size < _MIN_IMAGE_CELLS:
            continue
        near_db, image_db = to_decibels(static[rows]), to_decibels(static[-rows])
        correlation = np.corrcoef(near_db, image_db)[0, 1]
        level = static[-rows] / static[rows]
        if (
            correlation >= _MIN_IMAGE_CORRELATION
            and np.std(image_db - near_db) <= _MAX_LEVEL_STD_DB
            and level.max() < _MAX_IMAGE_LEVEL
        ):
            levels.append(float(level.max()))
    return max(levels, default=None)


def _choice_of_image_rejection(rejection_db: int, level: float, echoes: str) -> ChosenSetting:
    """Return the choice to leave out I/Q images."""
    return ChosenSetting(
        setting="chain.image_rejection",
        options=(f"chain.image_rejection={rejection_db} dB",),
        reason=f"{echoes} I/Q images of up to {to_decibels(level):.0f} dB at the mirrored"
        " range and velocity",
    )


def _asymmetry(power: np.ndarray) -> float:
    """Return the difference between a map and its mirror image about zero, over its power."""
    n_velocity, n_range = power.shape
    velocity = (2 * (n_velocity // 2) - np.arange(n_velocity)) % n_velocity
    mirrored = power[velocity][:, -np.arange(n_range) % n_range]
    return float(np.sum(abs(power - mirrored)) / np.sum(power))


def _may_have_pairs(chain: Chain, radar: Radar) -> bool:
    """Return whether the default estimator may be replaced by one of two directions."""
    return (
        chain.angle == Fft()
        and radar.frame.n_intervals == 1
        and len(radar.element_positions_m) >= _MIN_ELEMENTS_OF_PAIR
    )


def _find_strongest_pair(
    frames: Iterable[np.ndarray], radar: Radar, chain: Chain
) -> dict[str, np.ndarray] | None:
    """Return the columns of the strongest detection with two directions, two rows; None without."""
    chain = replace(chain, moving_targets=None)
    strongest = None
    for samples in frames:
        frame = process_frame(samples, radar, chain, with_directions=False)
        sources = find_directions(frame.peaks.resolved, radar, chain)
        columns = frame_detection_columns(frame.peaks, sources, None)
        limit_m = np.inf if chain.max_range_m is None else chain.max_range_m
        is_inside = (columns["range"] >= 0) & (columns["range"] <= limit_m)
        is_first = (np.diff(sources.detection) == 0) & is_inside[:-1] & is_inside[1:]
        for row in np.flatnonzero(is_first):
            pair = {name: column[row : row + 2] for name, column in columns.items()}
            has_angle = np.isfinite(pair["azimuth"]) | np.isfinite(pair["elevation"])
            if has_angle.all() and (
                strongest is None or pair["snr"].sum() > strongest["snr"].sum()
            ):
                strongest = pair
    return strongest


def _choice_of_pair_estimator(pair: dict[str, np.ndarray]) -> ChosenSetting:
    """Return the choice of an estimator of one or two directions."""
    name = "azimuth" if np.isfinite(pair["azimuth"]).all() else "elevation"
    first, second = np.degrees(pair[name])
    phase_deg = np.degrees(_PAIR_ESTIMATOR.channel_phase_rad)
    return ChosenSetting(
        setting="chain.angle",
        options=(
            f"chain.angle.kind={_PAIR_ESTIMATOR.kind()}",
            f"chain.angle.n_sources={_PAIR_ESTIMATOR.n_sources}",
            f"chain.angle.channel_phase={phase_deg:.3g} deg",
        ),
        reason=f"the echo at {pair['range'][0]:.4g} m has two directions, {name}s {first:.3g} and"
        f" {second:.3g} deg, which channels with phases of {phase_deg:.3g} deg do not explain"
        " (two targets, an extended one, or a reflection beside it)",
    )
