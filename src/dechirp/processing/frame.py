"""One frame through the processing chain: from samples to detections.

The lines of `process_frame` are the steps of the chain.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import compiled_kernels_for_large_work
from dechirp.processing.chain import Chain
from dechirp.processing.channel_errors import median_or_nan
from dechirp.processing.direction_finding import (
    Sources,
    checked_direction_aperture,
    directions_from_phase_centre,
    estimate_sources,
    phase_centres_m,
    range_and_direction_from_origin,
    sidelobe_dominated_mask,
    sources_without_directions,
)
from dechirp.processing.estimates import (
    local_noise_power,
    principal_doppler_hz,
    range_velocity_estimates,
)
from dechirp.processing.mitigation.apply import RemovedEcho, apply_mitigation
from dechirp.processing.mitigation.noise_loss import MIN_NOISE_GAIN
from dechirp.processing.moving_targets import join_moving_detections
from dechirp.processing.peak_interpolation import interpolate_peak_frequencies
from dechirp.processing.range_doppler_map import (
    detect_peaks_and_count_dropped,
    fill_unusable_cells_with_noise,
    range_doppler_power,
)
from dechirp.processing.range_walk import (
    sample_to_repetition_ratio,
    slow_time_frequency_growth_per_sample,
)
from dechirp.processing.refine import (
    RefinedPeaks,
    SidelobeErrors,
    Tones,
    refine_tones_and_residuals,
)
from dechirp.processing.scaling import (
    binary_scaling_exponent,
    divide_by_power_of_two,
    to_single_precision,
)
from dechirp.processing.sidelobe_rejection import estimate_tones_without_sidelobes
from dechirp.processing.spectrum import check_samples_were_finite, noise_gain
from dechirp.processing.velocity_ambiguity.hypotheses import FramePeaks, ResolvedPeaks
from dechirp.processing.velocity_ambiguity.resolve import resolve_velocity_ambiguity
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

# Power of a sidelobe over the noise, both in all channels, from which an image counts: it shifts
# frequencies by up to sqrt(2 * 0.05) = 0.3 standard errors.
_MIN_IMAGE_SIDELOBE = 0.05


class FrameResult(NamedTuple):
    """Result of the chain for one frame."""

    number: int
    time_s: float
    """Mid-frame, mid-window: the instant to which the estimates refer."""
    detections: dict[str, np.ndarray]
    """Columns of `core.build_detection_columns`, (n_detections,) each."""
    peaks: FramePeaks
    """Peaks that the detections are from."""
    power: tuple[np.ndarray, ...]
    """Range-Doppler map, (velocity, range) float32: one, or under triangular modulation one of
    the rising and one of the falling ramps."""
    equalised_power: tuple[np.ndarray, ...]
    """The maps as the detector reads them.

    See `range_doppler_map.fill_unusable_cells_with_noise`.
    """
    removed: tuple[RemovedEcho, ...]
    """Power that each method of the mitigation removed."""
    n_dropped_peaks: int
    """Peaks beyond the 2,000 strongest of a map."""
    masked_ranges_m: np.ndarray
    """Ranges of detections without directions since the sidelobes of other echoes dominate them."""
    n_unknown_angles: int
    """Sources with an angle at the limit of the field of view, or of a useless error."""
    channel_phase_rms_rad: float
    """RMS error of the phases of the channels, see `channel_errors`; NaN if noise hides it."""


class _MapPeaks(NamedTuple):
    power: np.ndarray
    equalised_power: np.ndarray
    peaks: RefinedPeaks
    n_dropped_peaks: int


def process_frame(
    samples: np.ndarray,
    radar: Radar,
    chain: Chain,
    *,
    number: int = 0,
    start_s: float | None = None,
    with_directions: bool = True,
) -> FrameResult:
    """Process the samples of one frame independently of other frames.

    Parameters
    ----------
    samples : array (chirp, rx, sample)
        Complex or real as the radar samples; processed in single precision.
    radar : Radar
        The radar that they were taken with.
    chain : Chain
        Fitted to the radar, see `Chain.fit_to_radar`.
    number : int
        Number of the frame, which selects its interval where several take turns.
    start_s : float, optional
        Start of the frame; that of the radar's frame of this number if omitted.
    with_directions : bool
        False leaves the directions out, where other frames may still change the velocities that
        they depend on, see `velocity_ambiguity.resolve.resolve_across_frames`.

    Raises
    ------
    InvalidSetting
        If samples are not finite, or the training cells do not fit into the map.
    NotEnoughMemory
        If the map would not fit.
    """
    if chain.moving_targets is not None:
        return _process_frame_with_and_without_static_echoes(
            samples, radar, chain, number, start_s, with_directions
        )
    start_s = radar.frame.frame_start_s(number) if start_s is None else start_s
    radar = radar.for_frame(number)
    clean, removed = _mitigate_and_list_removed_echoes(
        to_single_precision(samples, is_complex=radar.frame.chirp.sampling == "complex"),
        radar.frame,
        chain,
    )
    exponent = binary_scaling_exponent(clean)
    channels = split_chirps_into_slots(divide_by_power_of_two(clean, exponent), radar.frame)
    maps = [
        _find_peaks_of_map(map_channels, map_radar, chain, is_reversed=is_reversed)
        for is_reversed, (map_channels, map_radar) in zip(
            (False, True), split_by_ramp_direction(channels, radar), strict=False
        )
    ]
    resolved = resolve_velocity_ambiguity(
        [map_peaks.peaks for map_peaks in maps], radar, chain.field_of_view
    )
    peaks = FramePeaks(number, start_s + radar.frame.mid_frame_s, radar, resolved)
    sources = find_directions(
        resolved, radar, chain if with_directions else replace(chain, angle=None)
    )
    return FrameResult(
        number=number,
        time_s=peaks.time_s,
        detections=frame_detection_columns(peaks, sources, chain.max_range_m),
        peaks=peaks,
        power=tuple(divide_by_power_of_two(map_peaks.power, -2 * exponent) for map_peaks in maps),
        equalised_power=tuple(
            divide_by_power_of_two(map_peaks.equalised_power, -2 * exponent) for map_peaks in maps
        ),
        removed=removed,
        n_dropped_peaks=sum(map_peaks.n_dropped_peaks for map_peaks in maps),
        masked_ranges_m=_ranges_without_directions_m(resolved, radar, chain),
        n_unknown_angles=int(sources.has_unknown_angle.sum()),
        channel_phase_rms_rad=median_or_nan(sources.channel_phase_rms_rad),
    )


def _find_peaks_of_map(
    samples: np.ndarray, radar: Radar, chain: Chain, *, is_reversed: bool
) -> _MapPeaks:
    """Compute the map of samples (chirp, channel, sample), and find and refine its peaks.

    `is_reversed`: the samples of each chirp are in reversed order, as those of falling ramps.
    """
    power = range_doppler_power(samples, radar, chain)
    with compiled_kernels_for_large_work(power.size):
        equalised = fill_unusable_cells_with_noise(power, radar, chain)
        check_samples_were_finite(equalised[0, 0])
        cells, n_dropped = detect_peaks_and_count_dropped(equalised, radar, chain)
        refined = _refine_peaks(samples, equalised, cells, radar, chain, is_reversed=is_reversed)
    return _MapPeaks(power, equalised, refined, n_dropped)


def frame_detection_columns(
    frame_peaks: FramePeaks, sources: Sources, max_range_m: float | None
) -> dict[str, np.ndarray]:
    """Return the columns of the detections of one frame, a row for each source of its peaks.

    With a largest range, without the rows beyond it or below zero range.
    """
    n_rows = len(sources.detection)
    columns = {
        "frame": np.full(n_rows, frame_peaks.number),
        "time": np.full(n_rows, frame_peaks.time_s),
        **build_detection_columns(frame_peaks.resolved, sources, frame_peaks.radar),
    }
    if max_range_m is None:
        return columns
    is_inside = _within_range_mask(columns["range"], max_range_m)
    return {name: column[is_inside] for name, column in columns.items()}


def _within_range_mask(ranges_m: np.ndarray, max_range_m: float | None) -> np.ndarray:
    largest_m = np.inf if max_range_m is None else max_range_m
    return np.asarray((ranges_m >= 0) & (ranges_m <= largest_m))


def _ranges_without_directions_m(resolved: ResolvedPeaks, radar: Radar, chain: Chain) -> np.ndarray:
    """Return ranges of detections whose sidelobes of other echoes hide the direction."""
    if chain.angle is None:
        return np.zeros(0)
    peaks = resolved.peaks
    ranges_m = _beat_ranges_m(resolved, radar)
    is_hidden = sidelobe_dominated_mask(peaks.tones.amplitude, peaks.sidelobes)
    return ranges_m[is_hidden & _within_range_mask(ranges_m, chain.max_range_m)]


def _process_frame_with_and_without_static_echoes(
    samples: np.ndarray,
    radar: Radar,
    chain: Chain,
    number: int,
    start_s: float | None,
    with_directions: bool,
) -> FrameResult:
    """Process a frame twice, and join the detections; maps and peaks are those of all echoes."""
    with_static, without_static = (
        process_frame(
            samples,
            radar,
            map_chain,
            number=number,
            start_s=start_s,
            with_directions=with_directions,
        )
        for map_chain in (replace(chain, moving_targets=None), chain.moving_target_chain())
    )
    chirp = radar.frame.chirp
    transform = chain.range_transform(chirp)
    bin_m = chirp.sample_rate_hz / transform.n_bins * chirp.range_m(1.0)
    return with_static._replace(
        detections=join_moving_detections(
            with_static.detections,
            without_static.detections,
            radar.for_frame(number),
            range_main_lobe_m=transform.main_lobe_half_width_bins * bin_m,
        ),
        n_dropped_peaks=with_static.n_dropped_peaks + without_static.n_dropped_peaks,
    )


def find_directions(resolved: ResolvedPeaks, radar: Radar, chain: Chain) -> Sources:
    """Find the sources of peaks and their directions; one source each without an estimator."""
    if chain.angle is None:
        return sources_without_directions(len(resolved.doppler_hz))
    if radar.frame.has_falling_ramps:  # paired peaks are referred to the rising ramps
        radar = radar.with_rising_ramps_only()
    aperture = checked_direction_aperture(radar, chain.field_of_view)
    peaks = resolved.peaks
    return estimate_sources(
        peaks.tones.amplitude,
        resolved.doppler_hz,
        peaks.amplitude_noise,
        radar,
        chain.angle,
        aperture,
        sidelobes=peaks.sidelobes,
        range_m=_beat_ranges_m(resolved, radar),
    )


def _beat_ranges_m(resolved: ResolvedPeaks, radar: Radar) -> np.ndarray:
    """Return ranges of peaks by their beat frequencies, shifted by range-Doppler coupling."""
    chirp = radar.frame.chirp
    offset_m = 0.0 if radar.calibration is None else radar.calibration.range_offset_m
    beat_hz = resolved.peaks.tones.fast * (chirp.sample_rate_hz / (2 * np.pi))
    return np.asarray(beat_hz * chirp.range_m(1.0) - offset_m)


def build_detection_columns(
    resolved: ResolvedPeaks, sources: Sources, radar: Radar
) -> dict[str, np.ndarray]:
    """Return the columns of detections except frame and time, a row for each source."""
    peak, hypotheses = sources.detection, resolved.hypotheses
    fast, doppler_hz = resolved.peaks.tones.fast[peak], resolved.doppler_hz[peak]
    snr, sidelobes = resolved.peaks.snr[peak] * sources.power_share, resolved.peaks.sidelobes
    columns = {
        **range_velocity_estimates(
            fast,
            doppler_hz,
            snr,
            radar.frame,
            radar.n_summed_maps,
            sidelobes=None if sidelobes is None else sidelobes.select(peak),
        ),
        "azimuth": sources.azimuth_rad,
        "elevation": sources.elevation_rad,
        "azimuth_std": sources.azimuth_std_rad,
        "elevation_std": sources.elevation_std_rad,
        "ambiguity_number": hypotheses.certain_ambiguity_numbers_or_nan[peak],
        "ambiguity_confidence": hypotheses.confidence[peak],
        "moving": np.full(len(peak), np.nan),
    }
    if radar.calibration is not None:
        # Echoes ahead of the antennas, such as leakage inside the radar, are at zero range.
        offset_m = radar.calibration.range_offset_m
        columns["range"] = np.maximum(columns["range"] - offset_m, 0.0)
    angles = sources.azimuth_rad, sources.elevation_rad
    centre_m = phase_centres_m(*angles, columns["ambiguity_number"], radar)
    angles = directions_from_phase_centre(
        columns["range"], *angles, columns["ambiguity_number"], radar
    )
    columns["azimuth"], columns["elevation"] = angles
    if centre_m.any():
        columns["range"], columns["azimuth"], columns["elevation"] = (
            range_and_direction_from_origin(columns["range"], *angles, centre_m)
        )
    return columns


def _refine_peaks(
    samples: np.ndarray,
    equalised: np.ndarray,
    cells: np.ndarray,
    radar: Radar,
    chain: Chain,
    *,
    is_reversed: bool,
) -> RefinedPeaks:
    """Refine the peaks at cells of the map of samples (chirp, channel, sample)."""
    frame, noise = radar.frame, chain.map_noise_statistics(radar)
    slow, fast = interpolate_peak_frequencies(equalised, cells, noise)
    cell_noise = local_noise_power(equalised, cells, chain.cfar.training_window, noise.n_channels)
    sample_noise = cell_noise / noise_gain(
        noise.range_transform, noise.doppler_transform, frame.chirp
    )
    sample_noise = np.maximum(sample_noise, np.finfo(np.float32).tiny)
    growth = slow_time_frequency_growth_per_sample(frame.chirp)
    with_image = _find_peaks_with_strong_images(
        slow, fast, noise.n_channels * equalised[tuple(cells.T)] / cell_noise, frame
    )
    n_peaks = len(slow)
    tones, remaining_power = refine_tones_and_residuals(
        samples,
        np.concatenate([slow, -slow[with_image]]),
        np.concatenate([fast, -fast[with_image]]),
        np.concatenate([sample_noise, sample_noise[with_image]]),
        growth=growth,
        interval_ratio=sample_to_repetition_ratio(frame) * (-1 if is_reversed else 1),
    )
    amplitude_noise = sample_noise / (frame.n_chirps * frame.chirp.n_samples)
    tones, sidelobes, is_kept = estimate_tones_without_sidelobes(
        samples,
        tones,
        np.concatenate([amplitude_noise, amplitude_noise[with_image]]),
        remaining_power,
        growth=growth,
    )
    if with_image.size:
        peaks = np.arange(n_peaks)
        tones, is_kept = tones.select(peaks), is_kept[peaks]
        sidelobes = None if sidelobes is None else sidelobes.select(peaks)
    if sidelobes is not None:
        amplitude_noise = amplitude_noise * sidelobes.noise_gain
    window_gain = 1.0 if sidelobes is None else sidelobes.noise_gain
    tones, sidelobes = _undo_mitigation_gain(tones, sidelobes, frame, chain)
    refined = RefinedPeaks(
        tones=tones,
        snr=np.maximum(tones.energy / sample_noise - noise.n_channels * window_gain, 1e-3),
        amplitude_noise=amplitude_noise,
        sidelobes=sidelobes,
    )
    return refined if is_kept.all() else refined.select(np.flatnonzero(is_kept))


def _find_peaks_with_strong_images(
    slow: np.ndarray, fast: np.ndarray, snr: np.ndarray, frame: Frame
) -> np.ndarray:
    """Return the indices of peaks of real samples whose mirror images shift a peak.

    Images are at the negative beat and Doppler frequencies. Without a window, their sidelobes are
    1 / (pi d) of their amplitude at d cells on each axis.
    """
    if frame.chirp.sampling != "real":
        return np.zeros(0, int)
    sidelobes = snr[:, None]
    for frequency, n_points in ((slow, frame.n_chirps), (fast, frame.chirp.n_samples)):
        cells = (frequency[:, None] + frequency) * (n_points / (2 * np.pi))
        cells -= n_points * np.round(cells / n_points)
        sidelobes = sidelobes / np.maximum(np.pi * abs(cells), 1.0) ** 2
    return np.flatnonzero(sidelobes.max(axis=1, initial=0.0) > _MIN_IMAGE_SIDELOBE)


def _mitigate_and_list_removed_echoes(
    samples: np.ndarray, frame: Frame, chain: Chain
) -> tuple[np.ndarray, tuple[RemovedEcho, ...]]:
    """Apply the mitigation, and return what each method removed."""
    if not chain.mitigation:
        return samples, ()
    clean = apply_mitigation(samples, frame, chain.mitigation)
    return clean.samples, clean.removed


def split_by_ramp_direction(
    channels: np.ndarray, radar: Radar
) -> Iterator[tuple[np.ndarray, Radar]]:
    """Yield the channels of each map: of all ramps, or of rising and of falling ones."""
    if not radar.frame.has_falling_ramps:
        yield channels, radar
        return
    n_rx = radar.array.n_rx
    for part in (slice(n_rx), slice(n_rx, None)):
        yield np.ascontiguousarray(channels[:, part]), radar.with_rising_ramps_only()


def _undo_mitigation_gain(
    tones: Tones, sidelobes: SidelobeErrors | None, frame: Frame, chain: Chain
) -> tuple[Tones, SidelobeErrors | None]:
    """Restore the power that the mitigation took from targets of the tones' velocity."""
    if not chain.mitigation:
        return tones, sidelobes
    doppler_hz = principal_doppler_hz(tones, frame)
    gain = np.prod(
        [method.doppler_power_gain(doppler_hz, frame) for method in chain.mitigation], axis=0
    )
    # Peaks lie where a tenth of the noise is left; beside a notch a target may have less.
    gain = np.maximum(gain, MIN_NOISE_GAIN)
    amplitude = tones.amplitude / np.sqrt(gain)[:, None]
    if sidelobes is not None:
        sidelobes = sidelobes._replace(
            components=sidelobes.components / np.sqrt(gain)[:, None, None]
        )
    return replace(tones, energy=tones.energy / gain, amplitude=amplitude), sidelobes
